"""Comparison of estimated landing maps with the exact one.

The exact maps of a simulated study use the axes of the true body; estimates use those
of the mean attitude that the study has seen. The exact maps are converted with
neighbours of the landing at which they hold, each displaced a little in one coordinate.

The error of a map is a relative difference of predictions for the study's true inputs
(`relative_difference`), with outputs as displacements of the markers.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import FloatArray, IntArray, one_blas_thread, pd
from hopdata.maps.coordinates import output_weights, rigid_states, section_coordinates
from hopdata.maps.corrected.estimates import coefficient_table
from hopdata.maps.verdict.comparison import contrasts, relative_size
from hopdata.maps.verdict.coordinates import marker_root
from hopdata.maps.verdict.inputs import contact_orders
from hopdata.rigid import OUTPUT_NAMES, kabsch

# Entries of ``truth.json``: name -> value, unit and description.

Entry = dict[str, Any]
Entries = dict[str, Entry]
TOLD: dict[str, Any] = tomllib.loads(
    Path(__file__).with_name("entries.toml").read_text("utf-8")
)


def entry(value: float | int | bool, unit: str, what: str) -> Entry:
    """Return one entry; a value that is not finite becomes None."""
    if not isinstance(value, bool | int):
        value = float(value)
    known = value if np.isfinite(value) else None
    return {"value": known, "unit": unit, "what": what}


def mean(values: NDArray[Any]) -> float:
    """Return the mean, or NaN if there are no values."""
    return float(np.mean(values)) if values.size else float("nan")


# Differences between linear maps, for the inputs of a study.
#
# A difference is measured by its effect on predictions: the rms change over the inputs
# relative to the rms prediction of a map, with each output in its own unit. It is
# dimensionless and does not depend on the coordinates of the inputs.


def input_root(x: FloatArray) -> FloatArray:
    """Return a root R (p, p) of the covariance of inputs (n, p), R R' = cov."""
    _, singular, right = np.linalg.svd(x - x.mean(axis=0), full_matrices=False)
    return np.asarray(right.T * (singular / np.sqrt(max(len(x) - 1, 1))))


def relative_difference(
    a: FloatArray, b: FloatArray, *, root: FloatArray, units: FloatArray
) -> float:
    """Return the rms difference of two maps' predictions, relative to those of `b`.

    Parameters
    ----------
    a, b
        (q, p) maps.
    root
        (p, p) root of the covariance of the inputs.
    units
        (q,) unit of each output.
    """
    size = float(np.linalg.norm((b / units[:, None]) @ root))
    return float(np.linalg.norm(((a - b) / units[:, None]) @ root)) / size


def largest_difference(
    maps: FloatArray, *, root: FloatArray, units: FloatArray
) -> float:
    """Return the largest difference of maps (S, q, p), relative to the mean map."""
    mean = maps.mean(axis=0)
    largest = 0.0
    for a, b in combinations(maps, 2):
        difference = relative_difference(mean + b - a, mean, root=root, units=units)
        largest = max(largest, difference)
    return largest


# Steps of central differences, which err by their squares: tilts, rad, velocities, m/s,
# and spins, rad/s.
STEPS = np.repeat([1e-4, 1e-4, 5e-4], [2, 3, 3])


@dataclass(frozen=True)
class ExactMap:
    """The exact derivative in the coordinates of a study.

    Attributes
    ----------
    coefficients
        (8, 11) derivatives in SI units, the mean over all schedules.
    inputs
        (n, 8) true inputs of the study.
    weights
        (11,) factors from outputs to displacements of the markers, m.
    """

    coefficients: FloatArray
    inputs: FloatArray
    weights: FloatArray

    def error(self, coefficients: FloatArray) -> float:
        """Return the relative error of an estimate (8, 11)."""
        return relative_difference(
            coefficients.T,
            self.coefficients.T,
            root=input_root(self.inputs),
            units=1 / self.weights,
        )

    def table(self) -> pd.DataFrame:
        """Return one row per input and output, as in `MapEstimates.table`."""
        sd = self.inputs.std(axis=0, ddof=1)
        return coefficient_table(self.coefficients, sd, self.weights)


def exact_table(exact: ExactMap | None) -> pd.DataFrame:
    """Return the table of an exact map, with no rows if there is none."""
    if exact is None:
        return pd.DataFrame(columns=["input", "output", "value", "standardised"])
    return exact.table()


@one_blas_thread()
def exact_map(
    exact: Mapping[str, Any],
    states: FloatArray,
    *,
    shape: FloatArray,
    time_unit_s: float,
) -> ExactMap:
    """Convert the exact map to the coordinates of the estimates.

    Parameters
    ----------
    exact
        Content of ``exact_maps.json``.
    states
        (n, 6B) true marker states at the pre section of the landings that the study
        uses, m and m/s.
    shape
        (B, 3) estimated body markers in the attitude of the coordinates, m; if it has
        no rows, the true markers are used.
    time_unit_s
        Unit of time that weights velocities against positions.
    """
    points = np.array(exact["body_points_m"], float)
    centred = points - points.mean(axis=0)
    turned = centred
    if len(shape):
        turned = centred @ kabsch(shape[None], centred)[0].T

    # Landings a step before and behind the one at which the exact maps hold.
    steps = np.vstack([np.diag(STEPS), -np.diag(STEPS)])
    starts = np.array(exact["x"]) + steps
    ends = np.mean(exact["y"], axis=0) + steps @ np.mean(exact["maps"], axis=0).T
    at_origin = np.zeros((len(steps), 3))
    before = marker_states(np.hstack([at_origin, starts]), centred)
    after = marker_states(ends, centred)

    # The same landings in the coordinates of the study.
    x, y = section_coordinates(
        rigid_states(before, turned), rigid_states(after, turned)
    )
    n = len(STEPS)
    slopes = np.linalg.solve(x[:n] - x[n:], y[:n] - y[n:])
    true = rigid_states(states, turned)
    inputs, _ = section_coordinates(true, true)
    return ExactMap(
        coefficients=np.asarray(slopes, float),
        inputs=inputs,
        weights=output_weights(turned, time_unit_s),
    )


def marker_states(coordinates: FloatArray, shape: FloatArray) -> FloatArray:
    """Return marker states (n, 6B) of bodies with these coordinates, at height zero.

    Parameters
    ----------
    coordinates
        (n, 11) place and heading in the plane, then the inputs, with velocities in the
        frame of the plane; see `hopdata.rigid.OUTPUT_NAMES`.
    shape
        (B, 3) markers in the body, centred, m.
    """
    from scipy.spatial.transform import Rotation

    n = len(coordinates)
    turn = Rotation.from_euler("ZYX", coordinates[:, 2:5]).as_matrix()
    centre = np.column_stack([coordinates[:, :2], np.zeros(n)])
    positions = centre[:, None] + np.einsum("nij,bj->nbi", turn, shape)
    arms = np.cross(coordinates[:, None, 8:], shape)
    velocities = coordinates[:, None, 5:8] + np.einsum("nij,nbj->nbi", turn, arms)
    return np.concatenate([positions, velocities], axis=1).reshape(n, -1)


@one_blas_thread()
def estimate_errors(
    exact: ExactMap | None, estimates: Mapping[str, Any]
) -> pd.DataFrame:
    """Return the errors of the estimates of ``map_estimates.json``.

    Returns
    -------
    DataFrame
        Columns estimator, what, landings, error; no rows without an exact map.
    """
    rows = []
    if exact is not None:
        for name, one in estimates["maps"].items():
            error = exact.error(np.array(one["coefficients"]))
            rows.append((name, one["what"], estimates["n_landings"], error))
    return pd.DataFrame(rows, columns=["estimator", "what", "landings", "error"])


def score_estimates(errors: pd.DataFrame) -> Entries:
    """Return entries on the errors of estimated landing maps, and on corrections."""
    found = {}
    entries = {}
    for row in errors.to_dict("records"):
        name = row["estimator"]
        found[name] = float(row["error"])
        what = f"Relative error of the landing map: {row['what']}"
        entries[f"map_estimate_error_{name}"] = entry(found[name], "1", what)
    if "printed" in found and "corrected_curved" in found:
        gain = found["printed"] / found["corrected_curved"]
        what = "Error of the printed landing map over that of the map with both"
        entries["map_estimate_gain"] = entry(gain, "1", f"{what} corrections")
    return entries


# Comparison of the verdict's effect with the exact maps of a simulated study.


@one_blas_thread()
def true_effect(
    exact: Mapping[str, Any], states: FloatArray, instants: FloatArray
) -> float:
    """Return the relative difference of the exact maps as the verdict measures it.

    Where legs scatter it is that over state and posture, which the verdict measures if
    it sees the feet.

    Parameters
    ----------
    exact
        Content of ``exact_maps.json``.
    states
        (n, 6B) true marker states at the pre section, m and m/s, of the landings that
        the verdict judges: a size is a share of what these vary.
    instants
        (m, feet) contact instants, s; NaN where not known. With more than three feet,
        the orders that have an exact map are weighted by how often they occur.
    """
    points = np.array(exact["body_points_m"], float)
    body = rigid_states(states, points - points.mean(axis=0))
    inputs, _ = section_coordinates(body, body)
    orders = []
    for name in exact["schedules"]:
        orders.append([int(foot) - 1 for foot in name.split(">")])  # from zero

    known = np.isfinite(instants).all(axis=1)
    seen, counts = contact_orders(instants[known], 1)
    count_of = dict(zip(map(tuple, seen.tolist()), counts, strict=True))
    occurrences = np.array([count_of.get(tuple(order), 0) for order in orders])
    weights = contrasts(np.array(orders), occurrences)
    maps = np.array(exact["maps"], float) @ input_root(inputs)
    if "legs" in exact:
        # Legs that scatter are inputs as well, and independent of the state.
        root = np.linalg.cholesky(np.array(exact["legs"]["covariance_m2"], float))
        by_legs = np.array(exact["legs"]["maps"], float) @ root
        maps = np.concatenate([maps, by_legs], axis=2)
    return relative_size(marker_motions(points) @ maps, weights)


def judged(x: FloatArray, instants: FloatArray, verdict: Mapping[str, Any]) -> IntArray:
    """Return the numbers, from 0, of the landings whose sizes the verdict states.

    Parameters
    ----------
    x
        (n, 6B) states at the pre section, NaN where not known.
    instants
        (n, feet) contact instants, s; NaN where not known.
    verdict
        Content of ``verdict.json``; what it leaves out as far off counts from 1.
    """
    known = np.asarray(np.isfinite(np.hstack([x, instants])).all(axis=1))
    for left_out in verdict["gross_errors"].values():
        known[np.array(left_out, dtype=np.int64) - 1] = False
    return np.flatnonzero(known)


def marker_motions(points_m: FloatArray) -> FloatArray:
    """Return the (11, 11) matrix from outputs to rms motions of the markers (B, 3)."""
    root = marker_root(points_m - points_m.mean(axis=0)).T
    motions = np.eye(len(OUTPUT_NAMES))
    motions[2:5, 2:5] = root[:, [2, 1, 0]]  # turn, pitch and roll are about z, y and x
    motions[8:, 8:] = root
    return motions


def verdict_errors(true: float | None, verdict: Mapping[str, Any]) -> pd.DataFrame:
    """Return one row with the true effect and that of ``verdict.json``.

    Returns
    -------
    DataFrame
        Columns true_effect, estimate, low, high, upper_bound, detectable, p_value,
        conclusion; no rows if the verdict has no answer, or the truth is unknown.
    """
    columns = [
        "true_effect",
        "estimate",
        "low",
        "high",
        "upper_bound",
        "detectable",
        "p_value",
    ]
    rows = []
    if verdict["effect"] and true is not None:
        # Without an upper end there is none: null in the file.
        row = {"true_effect": true, "conclusion": verdict["conclusion"]}
        rows.append(row | verdict["effect"])
    return pd.DataFrame(rows, columns=[*columns, "conclusion"])


def score_verdict(errors: pd.DataFrame) -> Entries:
    """Return entries that compare the verdict's effect with the true one."""
    if errors.empty:
        return {}
    row = errors.iloc[0]
    entries = {}
    for name, (column, what) in TOLD["verdict"].items():
        entries[name] = entry(float(row[column]), "1", what)
    is_below = pd.isna(row["high"]) or row["true_effect"] <= row["high"]
    inside = bool(row["low"] <= row["true_effect"] and is_below)
    what = "Whether the verdict's interval holds the true difference"
    entries["verdict_interval_covers"] = entry(inside, "yes/no", what)
    return entries
