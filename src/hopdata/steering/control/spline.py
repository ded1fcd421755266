"""A model of frame changes as a cubic spline on a grid: quick to evaluate, with its gradient."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import ConfigError
from hopdata.steering.control.spline_kernel import changes_and_gradients
from hopdata.steering.models.interface import FrameChangeMap

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class SplineMap:
    """Frame changes as a uniform cubic B-spline, periodic in the boom angle.

    Parameters
    ----------
    coefficients : (A, S + 2, 3) array
        Coefficients over boom angles and swings, for the three components; m, m, rad.
    swing_limit_rad : float
        The swings range from minus to plus this; beyond, the value is that at the limit.
    """

    coefficients: FloatArray
    swing_limit_rad: float

    def change(self, boom_angle: FloatArray, swing: FloatArray, /) -> FloatArray:
        """Return the frame changes (n, 3)."""
        return self.change_and_gradient(boom_angle, swing)[0]

    def change_and_gradient(
        self, boom_angle: FloatArray, swing: FloatArray, /
    ) -> tuple[FloatArray, FloatArray]:
        """Return the frame changes (n, 3), and derivatives (n, 3, 2) by boom angle and swing."""
        boom, dphi = np.broadcast_arrays(np.atleast_1d(boom_angle), np.atleast_1d(swing))
        out: FloatArray = changes_and_gradients(
            self.coefficients,
            self.swing_limit_rad,
            np.ascontiguousarray(boom, dtype=float),
            np.ascontiguousarray(dphi, dtype=float),
        )
        return out[:, :3], np.stack([out[:, 3:6], out[:, 6:]], axis=-1)


def spline_of_grid(change: FloatArray, swing_limit_rad: float) -> SplineMap:
    """Spline through frame changes (A, S, 3) on a grid.

    Boom angles are evenly spaced over a turn from 0, 2 pi left out; swings from limit to limit.
    """
    angles, swings = change.shape[:2]
    if angles < 4 or swings < 4:
        raise ConfigError(
            f"spline: expected 4 boom angles and 4 swings at least, found {angles} and {swings}"
        )
    along_swing = np.linalg.solve(_not_a_knot(swings), _with_ends(change))
    around = np.linalg.solve(_periodic(angles), along_swing.reshape(angles, -1))
    coefficients = around.reshape(angles, swings + 2, change.shape[2])
    return SplineMap(np.ascontiguousarray(coefficients), swing_limit_rad)


def tabulated(
    model: FrameChangeMap, swing_limit_rad: float, *, boom_angles: int = 144, swings: int = 49
) -> SplineMap:
    """Spline through a model's frame changes on a grid; a `SplineMap` with that limit is kept."""
    if isinstance(model, SplineMap) and model.swing_limit_rad == swing_limit_rad:
        return model
    phi = 2 * np.pi * np.arange(boom_angles) / boom_angles
    dphi = np.linspace(-swing_limit_rad, swing_limit_rad, swings)
    grid = [axis.ravel() for axis in np.meshgrid(phi, dphi, indexing="ij")]
    change = np.asarray(model.change(*grid)).reshape(boom_angles, swings, 3)
    return spline_of_grid(change, swing_limit_rad)


def _not_a_knot(n: int) -> FloatArray:
    """Matrix (n + 2, n + 2): values at n nodes; no jump of the third derivative next to the ends."""
    matrix = np.zeros((n + 2, n + 2))
    for row in range(n):
        matrix[row, row : row + 3] = 1 / 6, 4 / 6, 1 / 6
    matrix[n, :5] = matrix[n + 1, -5:] = 1, -4, 6, -4, 1
    return matrix


def _with_ends(change: FloatArray) -> FloatArray:
    """Right-hand sides (A, S + 2, 3)."""
    return np.pad(change, ((0, 0), (0, 2), (0, 0)))


def _periodic(n: int) -> FloatArray:
    identity = np.eye(n)
    sides = np.roll(identity, 1, axis=0) + np.roll(identity, -1, axis=0)
    return np.asarray((4 * identity + sides) / 6)
