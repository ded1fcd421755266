"""Maps as tables, with cubic splines between the nodes: any map at the price of a look-up.

The tables are plain arrays (`values`, and `coefficients` for the functions of `compiled_spline`),
so that compiled controllers can take them. Models and the plant's true map both become tables.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import floor, pi
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.code_cache import kept_njit
from hopdata.errors import AnalysisError
from hopdata.steering.models.process import input_rows

# Cubic splines on even grids, periodic in the first input, compiled for controllers.
#
# A spline is twice continuously differentiable. It is a sum of products of cubic B-splines (de Boor
# 2001, ch. IX and XVII), one of each input, so that a point costs 16 coefficients of two inputs and
# 64 of three.

LEAST_NODES = 4  # of an input that is not periodic


def spline_coefficients(values: ArrayLike) -> FloatArray:
    """Return coefficients of the spline through values on a grid.

    Parameters
    ----------
    values : (A, S, ..., 3) array
        The first axis covers a turn, its end left out; the others but the last go from end to end
        of their inputs, where the third derivative does not jump at the node next to the end.

    Returns
    -------
    (A + 3, S + 2, ..., 3) array
        The first three of the first axis stand again at its end.
    """
    coefficients = _periodic(np.asarray(values, dtype=float))
    for axis in range(1, coefficients.ndim - 1):
        coefficients = _open(coefficients, axis)
    return np.ascontiguousarray(coefficients)


def _periodic(values: FloatArray) -> FloatArray:
    n = len(values)
    symbol = (4 + 2 * np.cos(2 * np.pi * np.arange(n // 2 + 1) / n)) / 6
    shape = (-1,) + (1,) * (values.ndim - 1)
    spectrum = np.fft.rfft(values, axis=0) / symbol.reshape(shape)
    coefficients = np.fft.irfft(spectrum, n, axis=0)
    return np.asarray(coefficients[np.arange(-1, n + 2) % n])


def _open(values: FloatArray, axis: int) -> FloatArray:
    n = values.shape[axis]
    system = np.zeros((n + 2, n + 2))
    for row in range(n):
        system[row + 1, row : row + 3] = 1 / 6, 4 / 6, 1 / 6
    system[0, :5] = system[-1, -5:] = 1, -4, 6, -4, 1
    moved = np.moveaxis(values, axis, 0)
    right = np.zeros((n + 2, *moved.shape[1:]))
    right[1:-1] = moved
    solved = np.linalg.solve(system, right.reshape(n + 2, -1)).reshape(right.shape)
    return np.moveaxis(solved, 0, axis)


@kept_njit(error_model="numpy")
def _basis(f):  # type: ignore[no-untyped-def]
    """Return the four B-splines at `f`, 0 to 1 in the cell."""
    g = 1.0 - f
    return (
        g * g * g / 6.0,
        (4.0 - 6.0 * f * f + 3.0 * f * f * f) / 6.0,
        (4.0 - 6.0 * g * g + 3.0 * g * g * g) / 6.0,
        f * f * f / 6.0,
    )


@kept_njit(error_model="numpy")
def _on_turn(angle, nodes):  # type: ignore[no-untyped-def]
    """Return cell and place in it of an angle, rad, and cells per rad; `nodes` make a turn."""
    per_unit = nodes / (2.0 * pi)
    place = angle * per_unit
    place -= nodes * floor(place / nodes)
    cell = min(int(place), nodes - 1)
    return cell, place - cell, per_unit


@kept_njit(error_model="numpy")
def _on_line(x, limit, nodes):  # type: ignore[no-untyped-def]
    """Return the same for `nodes` from -limit to limit; beyond, the last cell's cubic goes on."""
    per_unit = (nodes - 1) / (2.0 * limit)
    place = (x + limit) * per_unit
    cell = min(max(int(place), 0), nodes - 2)
    return cell, place - cell, per_unit


@kept_njit(error_model="numpy")
def spline_change(coefficients, limit, angle, swing, value):  # type: ignore[no-untyped-def]
    """Write the value (3,) of a spline (A + 3, S + 2, 3) of angle and swing."""
    i, f, _ = _on_turn(angle, coefficients.shape[0] - 3)
    k, g, _ = _on_line(swing, limit, coefficients.shape[1] - 2)
    b, e = _basis(f), _basis(g)
    for j in range(3):
        total = 0.0
        for p in range(4):
            row = 0.0
            for q in range(4):
                row += e[q] * coefficients[i + p, k + q, j]
            total += b[p] * row
        value[j] = total


@kept_njit(error_model="numpy")
def spline_changes(coefficients, limit, angles, swings):  # type: ignore[no-untyped-def]
    """Return values (n, 3); see `spline_change`."""
    values = np.empty((len(angles), 3))
    for a in range(len(angles)):
        spline_change(coefficients, limit, angles[a], swings[a], values[a])
    return values


# What a controller asks of a model: frame changes of many hops at once.
#
# Conventions of all models: the frame change is (x, y, heading) in the frame of the first stance;
# m, m, rad. Angles in rad. The boom angle is periodic: a whole turn more gives the same frame
# change.

COMPONENTS = ("dx", "dy", "dtheta")


class FrameChangeMap(Protocol):
    """Frame change as a function of boom angle and swing."""

    def change(self, boom_angle: FloatArray, swing: FloatArray, /) -> FloatArray:
        """Return the frame changes (n, 3) of hops from boom angles (n,) by swings (n,)."""
        ...


BEYOND = 1e-3  # of the limit: room for differences at the bounds


@dataclass(frozen=True)
class TabulatedMap:
    """Frame changes by boom angle and swing on a grid; a `FrameChangeMap`.

    Parameters
    ----------
    values : (A, S, 3) array
        Frame changes, m, m, rad; boom angles evenly spaced over a turn from 0, swings from minus to
        plus the limit.
    swing_limit_rad : float
        The limit.

    Raises
    ------
    ValueError
        If the grid is too coarse or the values are not all finite.
    """

    values: FloatArray
    swing_limit_rad: float

    def __post_init__(self) -> None:
        shape = self.values.shape
        if len(shape) != 3 or shape[-1] != 3 or min(shape[:-1]) < LEAST_NODES:
            raise ValueError(
                f"values: expected (A, S, 3) of at least {LEAST_NODES} nodes each, found {shape}"
            )
        if not np.isfinite(self.values).all():
            raise ValueError("values: expected finite frame changes, found some that are not")
        if not self.swing_limit_rad > 0:
            raise ValueError(f"swing_limit_rad: expected more than 0, found {self.swing_limit_rad}")

    @cached_property
    def coefficients(self) -> FloatArray:
        """Coefficients of the spline; see `spline_coefficients`."""
        return spline_coefficients(self.values)

    @property
    def boom_angle_rad(self) -> FloatArray:
        """Nodes of the boom angle, (A,)."""
        return turn_nodes(len(self.values))

    @property
    def swing_rad(self) -> FloatArray:
        """Nodes of the swing, (S,)."""
        return np.linspace(-self.swing_limit_rad, self.swing_limit_rad, self.values.shape[1])

    def change(self, *inputs: ArrayLike) -> FloatArray:
        """Return the frame changes (n, 3) of hops with these inputs, (n,) each.

        Raises
        ------
        AnalysisError
            If a swing is beyond the limit, or the number of inputs is wrong.
        """
        angles, swings = input_rows(inputs, 2)
        largest = float(np.abs(swings).max(initial=0.0))
        if not largest <= self.swing_limit_rad * (1 + BEYOND):
            raise AnalysisError(
                f"table: expected swings within {self.swing_limit_rad:.4f} rad, found {largest:.4f}"
            )
        values = spline_changes(self.coefficients, self.swing_limit_rad, angles, swings)
        return np.asarray(values)


def tabulated(
    model: FrameChangeMap, swing_limit_rad: float, *, angles: int = 128, swings: int = 33
) -> TabulatedMap:
    """Tabulate a map of boom angle and swing."""
    grid = np.linspace(-swing_limit_rad, swing_limit_rad, swings)
    angle, swing = np.meshgrid(turn_nodes(angles), grid, indexing="ij")
    values = model.change(angle.ravel(), swing.ravel())
    return TabulatedMap(values.reshape(angles, swings, 3), swing_limit_rad)


def turn_nodes(number: int) -> FloatArray:
    """Angles evenly spaced over a turn from 0, its end left out, rad."""
    return 2 * np.pi * np.arange(number) / number
