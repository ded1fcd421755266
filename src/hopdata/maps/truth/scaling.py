"""The scaling study: residuals of linear maps as the landings approach a simultaneous contact.

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
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, IntArray, one_blas_thread, pd
from hopdata.maps.truth import maps as truth

SPARE_LANDINGS = 2
COLUMNS = (
    *(
        "case",
        "coupling",
        "impulse",
        "delay_s",
        "scale",
        "landings",
        "failed",
        "schedules",
    ),
    *("spread_ms", "pooled_rms", "specialised_rms", "pooled_over_specialised"),
    *("map_difference", "exact_difference", "map_error", "slope"),
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
            units = sample.y.std(axis=0) if units is None else units
            row |= _errors(sample, units)
        rows.append(row)
    table = pd.DataFrame(rows).reindex(columns=COLUMNS)
    for case in dict.fromkeys(table["case"]):
        mine = table["case"] == case
        table.loc[mine, "slope"] = _slope(
            *table.loc[mine, ["scale", "pooled_rms"]].to_numpy().T
        )
    return table


def score_scaling(table: pd.DataFrame) -> truth.Entries:
    """Return entries on the results of the scaling study for each case."""
    entries: truth.Entries = {}
    for case in dict.fromkeys(table["case"]):
        smallest = table[table["case"] == case].sort_values("scale").iloc[0]
        who = truth.TOLD["cases"].get(case, f"the {case}") + _strength(smallest)
        at = f"at {smallest['scale']:g} of the spread, {who}"
        for name, (column, what) in truth.TOLD["scaling"].items():
            said = what.format(who=who, at=at)
            entries[f"{name}_{case}"] = truth.entry(float(smallest[column]), "1", said)
    return entries


def _strength(row: Any) -> str:
    names = (
        ("coupling", "kappa", ""),
        ("impulse", "epsilon", ""),
        ("delay_s", "tau", " s"),
    )
    given = [f"{name} {row[key]:g}{unit}" for key, name, unit in names if row[key] != 0]
    return f" ({', '.join(given)})" if given else ""


def _counts(sample: Any) -> dict[str, Any]:
    return {
        "case": sample.case,
        **{
            name: getattr(sample.control, name)
            for name in ("coupling", "impulse", "delay_s")
        },
        "scale": sample.scale,
        "landings": len(sample.x),
        "failed": sample.n_failed,
    }


def _errors(sample: Any, units: FloatArray) -> dict[str, Any]:
    how = {"root": truth.input_root(sample.x), "units": units}
    pooled, own = _fit(sample, np.arange(len(sample.x)), units), _fits(sample, units)
    variance, own_variance = _mean_square([pooled]), _mean_square(own)
    p, maps = sample.x.shape[1], np.array([slopes for slopes, *_ in own])
    exact = sample.exact_maps
    return {
        "schedules": len(own),
        "spread_ms": 1e3 * float(np.median(sample.contact_s.std(axis=1))),
        "pooled_rms": float(np.sqrt(variance)),
        "specialised_rms": float(np.sqrt(own_variance)),
        "pooled_over_specialised": float(variance / own_variance) if own else np.nan,
        "map_difference": truth.largest_difference(maps[..., :p], **how)
        if own
        else np.nan,
        "exact_difference": truth.largest_difference(exact, **how),
        "map_error": truth.relative_difference(
            pooled[0][:, :p], exact.mean(axis=0), **how
        ),
    }


#: Slopes of an affine map of inputs and preloads, residual sum of squares, degrees of
#: freedom.
_Fit = tuple[FloatArray, float, int]


def _fit(sample: Any, rows: IntArray, units: FloatArray) -> _Fit:
    x, y = np.hstack([sample.x, sample.preloads_n])[rows], sample.y[rows]
    spread = x.std(axis=0)
    spread[spread == 0] = 1.0
    design = np.column_stack([np.ones(len(x)), (x - x.mean(axis=0)) / spread])
    solved, _, rank, _ = np.linalg.lstsq(design, y, rcond=None)
    squares = float((((y - design @ solved) / units) ** 2).sum())
    return (solved[1:] / spread[:, None]).T, squares, (len(x) - int(rank)) * y.shape[1]


def _fits(sample: Any, units: FloatArray) -> list[_Fit]:
    """Return the fits of the schedules that have enough landings."""
    classes = [
        np.flatnonzero(sample.schedule == name) for name in np.unique(sample.schedule)
    ]
    return [
        _fit(sample, rows, units) for rows in classes if len(rows) >= _needed(sample)
    ]


def _needed(sample: Any) -> int:
    """Return the number of landings that a map of inputs and preloads needs."""
    return 1 + sample.x.shape[1] + sample.preloads_n.shape[1] + SPARE_LANDINGS


def _mean_square(fits: list[_Fit]) -> float:
    """Return the residual mean square of fits with degrees of freedom; NaN if there are none."""
    free = [(squares, freedom) for _, squares, freedom in fits if freedom > 0]
    return sum(s for s, _ in free) / sum(f for _, f in free) if free else float("nan")


def _slope(scale: FloatArray, rms: FloatArray) -> float:
    """Return the slope of log rms over log scale; NaN for fewer than two scales."""
    known = np.isfinite(rms) & (rms > 0)
    if known.sum() < 2:
        return float("nan")
    return float(np.polyfit(np.log(scale[known]), np.log(rms[known]), 1)[0])
