"""Estimated landing maps against the exact one.

The exact maps of a simulated study are in the axes of the true body, estimates in those of the mean
attitude that the study has seen. Neighbours of the landing at which the exact maps hold, each moved
a little in one coordinate, carry them over.

The error of a map is a relative difference of predictions for the study's true inputs
(`hopdata.maps.truth.map_differences`), outputs as displacements of the markers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hopdata.blas import one_blas_thread
from hopdata.maps.rigid import (
    INPUT_NAMES,
    OUTPUT_NAMES,
    kabsch,
    output_weights,
    rigid_states,
    section_coordinates,
)
from hopdata.maps.truth.entries import Entries, entry
from hopdata.maps.truth.map_differences import input_root, relative_difference

if TYPE_CHECKING:
    import pandas as pd

# Of tilts, rad, velocities, m/s, and spins, rad/s; central differences err by their squares.
_STEPS = np.repeat([1e-4, 1e-4, 5e-4], [2, 3, 3])

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ExactMap:
    """The exact derivative in the coordinates of a study.

    Attributes
    ----------
    coefficients
        (8, 11), SI units; the mean of all schedules.
    inputs
        (n, 8) true inputs of the study.
    weights
        (11,) from outputs to displacements of the markers, m.
    """

    coefficients: Floats
    inputs: Floats
    weights: Floats

    def error(self, coefficients: Floats) -> float:
        """Return the relative error of an estimate (8, 11)."""
        return relative_difference(
            coefficients.T,
            self.coefficients.T,
            root=input_root(self.inputs),
            units=1 / self.weights,
        )

    def table(self) -> pd.DataFrame:
        """Return one row an input and output, as `MapEstimates.table` has them."""
        import pandas as pd

        sd = self.inputs.std(axis=0, ddof=1)
        shown = 1e3 * sd[:, None] * self.coefficients * self.weights
        return pd.DataFrame(
            {
                "input": np.repeat(INPUT_NAMES, len(OUTPUT_NAMES)),
                "output": np.tile(OUTPUT_NAMES, len(INPUT_NAMES)),
                "value": self.coefficients.ravel(),
                "standardised": shown.ravel(),
            }
        )


@one_blas_thread()
def exact_map(
    exact: Mapping[str, Any], states: Floats, *, shape: Floats, time_unit_s: float
) -> ExactMap:
    """Bring the exact map to the coordinates that the estimates use.

    Parameters
    ----------
    exact
        Content of ``exact_maps.json``.
    states
        (n, 6B) true marker states of the study's landings at the pre section, m and m/s.
    shape
        (B, 3) body markers as estimated, in the attitude of the coordinates, m; without rows the
        true ones are taken.
    time_unit_s
        Unit of time that weighs velocities against positions.
    """
    points = np.array(exact["body_points_m"], float)
    centred = points - points.mean(axis=0)
    turned = centred @ kabsch(shape[None], centred)[0].T if len(shape) else centred
    moved = np.vstack([np.diag(_STEPS), -np.diag(_STEPS)])
    starts = np.array(exact["x"]) + moved
    ends = np.mean(exact["y"], axis=0) + moved @ np.mean(exact["maps"], axis=0).T
    nowhere = np.zeros((len(moved), 3))
    x, y = section_coordinates(
        rigid_states(marker_states(np.hstack([nowhere, starts]), centred), turned),
        rigid_states(marker_states(ends, centred), turned),
    )
    half = len(_STEPS)
    slopes = np.linalg.solve(x[:half] - x[half:], y[:half] - y[half:])
    true = rigid_states(states, turned)
    inputs, _ = section_coordinates(true, true)
    return ExactMap(np.asarray(slopes, float), inputs, output_weights(turned, time_unit_s))


def marker_states(coordinates: Floats, shape: Floats) -> Floats:
    """Return marker states (n, 6B) of bodies with these coordinates, their centres at height zero.

    Parameters
    ----------
    coordinates
        (n, 11), see `hopdata.maps.rigid.OUTPUT_NAMES`: place and heading in the plane, and the
        inputs, with velocities in the frame of the plane.
    shape
        (B, 3) markers in the body, centred, m.
    """
    n = len(coordinates)
    turn = _turn(2, coordinates[:, 2]) @ _turn(1, coordinates[:, 3]) @ _turn(0, coordinates[:, 4])
    centre = np.column_stack([coordinates[:, :2], np.zeros(n)])
    positions = centre[:, None] + np.einsum("nij,bj->nbi", turn, shape)
    arms = np.cross(coordinates[:, None, 8:], shape)
    velocities = coordinates[:, None, 5:8] + np.einsum("nij,nbj->nbi", turn, arms)
    return np.concatenate([positions, velocities], axis=1).reshape(n, -1)


@one_blas_thread()
def estimate_errors(exact: ExactMap, estimates: Mapping[str, Any]) -> pd.DataFrame:
    """Return the errors of the estimates of ``map_estimates.json``.

    Returns
    -------
    DataFrame
        Columns estimator, what, landings, error.
    """
    import pandas as pd

    rows = [
        (name, one["what"], estimates["n_landings"], exact.error(np.array(one["coefficients"])))
        for name, one in estimates["maps"].items()
    ]
    return pd.DataFrame(rows, columns=["estimator", "what", "landings", "error"])


def score_estimates(errors: pd.DataFrame) -> Entries:
    """Say how far the estimates of the landing map are from the exact one, and what is gained."""
    found = dict(zip(errors["estimator"], errors["error"].astype(float), strict=True))
    entries = {
        f"map_estimate_error_{row['estimator']}": entry(
            float(row["error"]), "1", f"Relative error of the landing map: {row['what']}"
        )
        for row in errors.to_dict("records")
    }
    if {"printed", "corrected_curved"} <= found.keys():
        gain = found["printed"] / found["corrected_curved"]
        what = "Error of the printed landing map over that of the map with both corrections"
        entries["map_estimate_gain"] = entry(gain, "1", what)
    return entries


def _turn(axis: int, angle: Floats) -> Floats:
    """Return rotations (n, 3, 3) about an axis."""
    turn = np.zeros((len(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn[:, axis, axis] = 1.0
    turn[:, i, i] = turn[:, j, j] = np.cos(angle)
    turn[:, j, i] = np.sin(angle)
    turn[:, i, j] = -turn[:, j, i]
    return turn
