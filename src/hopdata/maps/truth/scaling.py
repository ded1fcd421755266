"""The scaling study: what linear maps leave over as the landings draw together.

Affine maps are fitted to noise-free landings whose deviations from a simultaneous contact have been
scaled down. If the landing map is C1 there, the error of one map for all landings falls with the
square of the scale, and the maps of the schedules become one. If each schedule has a derivative of
its own, the error falls with the scale, and their difference stays.

The preloads of the legs differ from landing to landing too. They are no coordinates of the body and
act like noise in proportion to the scale; here they are known, and stand beside the inputs.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hopdata.blas import one_blas_thread
from hopdata.maps.truth.entries import Entries, entry
from hopdata.maps.truth.map_differences import input_root, largest_difference, relative_difference

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]

SPARE_LANDINGS = 2
COLUMNS = (
    *("case", "coupling", "impulse", "delay_s", "scale", "landings", "failed", "schedules"),
    *("spread_ms", "pooled_rms", "specialised_rms", "pooled_over_specialised"),
    *("map_difference", "exact_difference", "map_error", "slope"),
)
KINDS = {
    "hopper": "the hopper",
    "coupling": "coupled forces",
    "impulse": "partly rigid impulses",
    "delay": "contact by velocity",
    "study": "the study's own control",
}


class Strengths(Protocol):
    """What the study reads of a control."""

    coupling: float
    impulse: float
    delay_s: float


class Landings(Protocol):
    """What the study reads of `hopdata.synthesis.scaling.ScaledLandings`."""

    case: str
    control: Strengths
    scale: float
    x: Floats
    y: Floats
    preloads_n: Floats
    contact_s: Floats
    schedule: NDArray[np.str_]
    n_failed: int
    exact_maps: Floats


@one_blas_thread()
def scaling_table(samples: Iterable[Landings]) -> pd.DataFrame:
    """Fit maps to each sample.

    Parameters
    ----------
    samples
        Landings of each case, the largest scale first; outputs are in units of their standard
        deviation in the first sample of all.

    Returns
    -------
    DataFrame
        One row a sample. ``case``, the strengths ``coupling, impulse, delay_s``, ``scale``,
        ``landings, failed, schedules``, ``spread_ms`` (median standard deviation of the contact
        instants), ``pooled_rms`` and ``specialised_rms`` (error per output, corrected for the
        degrees of freedom), ``pooled_over_specialised`` (ratio of mean squares),
        ``map_difference`` (largest between two schedules), ``exact_difference`` (of the exact
        derivatives), ``map_error`` (of the pooled map against their mean), ``slope`` (of log
        pooled rms over log scale, the same for all rows of a case). A sample of too few landings
        has no errors (NaN).
    """
    import pandas as pd

    rows: list[dict[str, Any]] = []
    units: Floats | None = None
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
            table.loc[mine, "scale"].to_numpy(), table.loc[mine, "pooled_rms"].to_numpy()
        )
    return table


def score_scaling(table: pd.DataFrame) -> Entries:
    """Say what the scaling study shows of each case."""
    entries: Entries = {}
    for case in dict.fromkeys(table["case"]):
        rows = table[table["case"] == case].sort_values("scale")
        smallest, who = rows.iloc[0], KINDS[case] + _strength(rows.iloc[0])
        at = f"at {smallest['scale']:g} of the spread, {who}"
        entries |= {
            f"scaling_slope_{case}": entry(
                float(smallest["slope"]), "1", f"Slope of log pooled error over log scale, {who}"
            ),
            f"scaling_pooled_over_specialised_{case}": entry(
                float(smallest["pooled_over_specialised"]),
                "1",
                f"Noise-free MSE of one map over that of one a schedule {at}",
            ),
            f"scaling_map_difference_{case}": entry(
                float(smallest["map_difference"]),
                "1",
                f"Largest relative difference between the fitted maps of two schedules {at}",
            ),
            f"exact_map_difference_{case}": entry(
                float(smallest["exact_difference"]),
                "1",
                f"Largest relative difference between the exact maps of two schedules, {who}",
            ),
            f"scaling_map_error_{case}": entry(
                float(smallest["map_error"]),
                "1",
                f"Relative error of the noise-free pooled map against the exact one {at}",
            ),
        }
    return entries


def _strength(row: Any) -> str:
    given = [
        f"{name} {row[key]:g}{unit}"
        for key, name, unit in (
            ("coupling", "kappa", ""),
            ("impulse", "epsilon", ""),
            ("delay_s", "tau", " s"),
        )
        if row[key] != 0
    ]
    return f" ({', '.join(given)})" if given else ""


def _counts(sample: Landings) -> dict[str, Any]:
    strengths = sample.control
    return {
        "case": sample.case,
        "coupling": strengths.coupling,
        "impulse": strengths.impulse,
        "delay_s": strengths.delay_s,
        "scale": sample.scale,
        "landings": len(sample.x),
        "failed": sample.n_failed,
    }


def _errors(sample: Landings, units: Floats) -> dict[str, Any]:
    root = input_root(sample.x)
    pooled, own = _fit(sample, np.arange(len(sample.x)), units), _fits(sample, units)
    variance, own_variance = pooled.variance, _mean_square([fit for fit in own if fit.freedom > 0])
    p, maps = sample.x.shape[1], np.array([fit.slopes for fit in own])
    exact = sample.exact_maps
    return {
        "schedules": len(own),
        "spread_ms": 1e3 * float(np.median(sample.contact_s.std(axis=1))),
        "pooled_rms": float(np.sqrt(variance)),
        "specialised_rms": float(np.sqrt(own_variance)),
        "pooled_over_specialised": float(variance / own_variance) if own else float("nan"),
        "map_difference": largest_difference(maps[..., :p], root=root, units=units)
        if own
        else float("nan"),
        "exact_difference": largest_difference(exact, root=root, units=units),
        "map_error": relative_difference(
            pooled.slopes[:, :p], exact.mean(axis=0), root=root, units=units
        ),
    }


class _Fit:
    """An affine map by least squares, of inputs and preloads."""

    def __init__(self, x: Floats, y: Floats, units: Floats) -> None:
        spread = x.std(axis=0)
        spread[spread == 0] = 1.0
        design = np.column_stack([np.ones(len(x)), (x - x.mean(axis=0)) / spread])
        solved, _, rank, _ = np.linalg.lstsq(design, y, rcond=None)
        self.slopes: Floats = (solved[1:] / spread[:, None]).T
        self.squares = float((((y - design @ solved) / units) ** 2).sum())
        self.freedom = (len(x) - int(rank)) * y.shape[1]

    @property
    def variance(self) -> float:
        return self.squares / self.freedom if self.freedom > 0 else float("nan")


def _fit(sample: Landings, rows: NDArray[np.int64], units: Floats) -> _Fit:
    inputs = np.hstack([sample.x, sample.preloads_n])[rows]
    return _Fit(inputs, sample.y[rows], units)


def _fits(sample: Landings, units: Floats) -> list[_Fit]:
    """Return the fits of the schedules that have landings enough."""
    classes = [np.flatnonzero(sample.schedule == name) for name in np.unique(sample.schedule)]
    return [_fit(sample, rows, units) for rows in classes if len(rows) >= _needed(sample)]


def _needed(sample: Landings) -> int:
    """Return how many landings a map of inputs and preloads needs."""
    return 1 + sample.x.shape[1] + sample.preloads_n.shape[1] + SPARE_LANDINGS


def _mean_square(fits: list[_Fit]) -> float:
    freedom = sum(fit.freedom for fit in fits)
    return sum(fit.squares for fit in fits) / freedom if freedom else float("nan")


def _slope(scale: Floats, rms: Floats) -> float:
    """Return the slope of log rms over log scale; NaN of a single scale."""
    known = np.isfinite(rms) & (rms > 0)
    if known.sum() < 2:
        return float("nan")
    return float(np.polyfit(np.log(scale[known]), np.log(rms[known]), 1)[0])
