"""The scaling study: residuals of linear maps close to a simultaneous contact.

Affine maps are fitted to noise-free landings whose deviations from a simultaneous
contact have been scaled down. If the landing map is C1 there, the error of one map for
all landings decreases with the square of the scale, and the maps of the schedules
converge. If each schedule has its own derivative, the error decreases only in
proportion to the scale, and the maps stay different.

The preloads of the legs also vary between landings. They are not coordinates of the
body and act like noise in proportion to the scale. In the simulation they are known, so
they are additional inputs.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, IntArray, one_blas_thread, pd
from hopdata.maps.truth import maps as truth

#: Number of landings that a fit needs beyond its number of coefficients per output.
#: Unit: landings. Origin: chosen.
SPARE_LANDINGS = 2

COLUMNS = (
    "case",
    "coupling",
    "impulse",
    "delay_s",
    "scale",
    "landings",
    "failed",
    "schedules",
    "spread_ms",
    "pooled_rms",
    "specialised_rms",
    "pooled_over_specialised",
    "map_difference",
    "exact_difference",
    "map_error",
    "slope",
)


@one_blas_thread()
def scaling_table(samples: Iterable[Any]) -> pd.DataFrame:
    """Fit maps to each sample.

    Parameters
    ----------
    samples
        `ScaledLandings` of each case, the largest scale first. Errors of outputs are in
        units of the outputs' standard deviations in the first sample with enough
        landings.

    Returns
    -------
    DataFrame
        One row per sample: ``case``; the strengths ``coupling, impulse, delay_s``;
        ``scale``; ``landings, failed, schedules``; ``spread_ms`` (median standard
        deviation of the contact instants); ``pooled_rms`` and ``specialised_rms``
        (error per output, corrected for the degrees of freedom);
        ``pooled_over_specialised`` (ratio of mean squares); ``map_difference`` (largest
        between two schedules); ``exact_difference`` (the same for the exact
        derivatives); ``map_error`` (pooled map against the mean exact one); ``slope``
        (of log pooled rms over log scale, the same in all rows of a case). A sample
        with too few landings has no errors (NaN).
    """
    rows: list[dict[str, Any]] = []
    units: FloatArray | None = None
    for sample in samples:
        row = _counts(sample)
        if len(sample.y) >= _needed(sample):
            if units is None:
                units = sample.y.std(axis=0)
            row |= _errors(sample, units)
        rows.append(row)
    table = pd.DataFrame(rows).reindex(columns=COLUMNS)
    for case in dict.fromkeys(table["case"]):
        of_case = table["case"] == case
        scale, rms = table.loc[of_case, ["scale", "pooled_rms"]].to_numpy().T
        table.loc[of_case, "slope"] = _slope(scale, rms)
    return table


def score_scaling(table: pd.DataFrame) -> truth.Entries:
    """Return entries on the results of the scaling study for each case."""
    entries: truth.Entries = {}
    for case in dict.fromkeys(table["case"]):
        smallest = table[table["case"] == case].sort_values("scale").iloc[0]
        who = truth.TOLD["cases"].get(case, f"the {case}") + _strength(smallest)
        at = f"at {smallest['scale']:g} of the spread, {who}"
        for name, (column, what) in truth.TOLD["scaling"].items():
            value = float(smallest[column])
            said = what.format(who=who, at=at)
            entries[f"{name}_{case}"] = truth.entry(value, "1", said)
    return entries


def _strength(row: Any) -> str:
    """Return the strengths of the case's mechanisms in brackets, if it has any."""
    given = []
    if row["coupling"] != 0:
        given.append(f"kappa {row['coupling']:g}")
    if row["impulse"] != 0:
        given.append(f"epsilon {row['impulse']:g}")
    if row["delay_s"] != 0:
        given.append(f"tau {row['delay_s']:g} s")
    if not given:
        return ""
    return f" ({', '.join(given)})"


def _counts(sample: Any) -> dict[str, Any]:
    return {
        "case": sample.case,
        "coupling": sample.control.coupling,
        "impulse": sample.control.impulse,
        "delay_s": sample.control.delay_s,
        "scale": sample.scale,
        "landings": len(sample.x),
        "failed": sample.n_failed,
    }


def _errors(sample: Any, units: FloatArray) -> dict[str, Any]:
    n_inputs = sample.x.shape[1]
    root = truth.input_root(sample.x)
    pooled = _fit(sample, np.arange(len(sample.x)), units)
    specialised = _fits(sample, units)
    pooled_square = _mean_square([pooled])
    specialised_square = _mean_square(specialised)
    ratio = np.nan
    map_difference = np.nan
    if specialised:
        ratio = float(pooled_square / specialised_square)
        maps = np.array([fit.slopes[:, :n_inputs] for fit in specialised])
        map_difference = truth.largest_difference(maps, root=root, units=units)
    exact = sample.exact_maps
    return {
        "schedules": len(specialised),
        "spread_ms": 1e3 * float(np.median(sample.contact_s.std(axis=1))),
        "pooled_rms": float(np.sqrt(pooled_square)),
        "specialised_rms": float(np.sqrt(specialised_square)),
        "pooled_over_specialised": ratio,
        "map_difference": map_difference,
        "exact_difference": truth.largest_difference(exact, root=root, units=units),
        "map_error": truth.relative_difference(
            pooled.slopes[:, :n_inputs], exact.mean(axis=0), root=root, units=units
        ),
    }


@dataclass(frozen=True)
class _Fit:
    """An affine map of inputs and preloads.

    Attributes
    ----------
    slopes
        (q, p) slopes by all inputs, then by the preloads.
    squares
        Residual sum of squares, in units of the outputs.
    freedom
        Degrees of freedom of the residuals.
    """

    slopes: FloatArray
    squares: float
    freedom: int


def _fit(sample: Any, rows: IntArray, units: FloatArray) -> _Fit:
    x = np.hstack([sample.x, sample.preloads_n])[rows]
    y = sample.y[rows]
    sd = x.std(axis=0)
    sd[sd == 0] = 1.0
    design = np.column_stack([np.ones(len(x)), (x - x.mean(axis=0)) / sd])
    solved, _, rank, _ = np.linalg.lstsq(design, y, rcond=None)
    residuals = (y - design @ solved) / units
    return _Fit(
        slopes=(solved[1:] / sd[:, None]).T,
        squares=float((residuals**2).sum()),
        freedom=(len(x) - int(rank)) * y.shape[1],
    )


def _fits(sample: Any, units: FloatArray) -> list[_Fit]:
    """Return the fits of the schedules that have enough landings."""
    fits = []
    for name in np.unique(sample.schedule):
        rows = np.flatnonzero(sample.schedule == name)
        if len(rows) >= _needed(sample):
            fits.append(_fit(sample, rows, units))
    return fits


def _needed(sample: Any) -> int:
    """Return the number of landings that a map of inputs and preloads needs."""
    return 1 + sample.x.shape[1] + sample.preloads_n.shape[1] + SPARE_LANDINGS


def _mean_square(fits: list[_Fit]) -> float:
    """Return the residual mean square of fits with degrees of freedom, or NaN."""
    free = [fit for fit in fits if fit.freedom > 0]
    if not free:
        return float("nan")
    return sum(fit.squares for fit in free) / sum(fit.freedom for fit in free)


def _slope(scale: FloatArray, rms: FloatArray) -> float:
    """Return the slope of log rms over log scale; NaN for fewer than two scales."""
    known = np.isfinite(rms) & (rms > 0)
    if known.sum() < 2:
        return float("nan")
    return float(np.polyfit(np.log(scale[known]), np.log(rms[known]), 1)[0])
