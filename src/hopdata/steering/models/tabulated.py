"""Maps as tables, with cubic splines between the nodes: any map at the price of a look-up.

The tables are plain arrays (`values`, and `coefficients` for the functions of `compiled_spline`),
so that compiled controllers can take them. Models and the plant's true map both become tables.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.errors import AnalysisError
from hopdata.steering.models.arguments import input_rows
from hopdata.steering.models.compiled_spline import (
    LEAST_NODES,
    spline_changes,
    spline_changes_with_history,
    spline_coefficients,
)
from hopdata.steering.models.interface import FrameChangeMap, HistoryFrameChangeMap

FloatArray = NDArray[np.float64]

BEYOND = 1e-3  # of the limit: room for differences at the bounds


@dataclass(frozen=True)
class TabulatedMap:
    """Frame changes by boom angle and swing, or also by the previous swing, on a grid.

    It is a `FrameChangeMap`, or a `HistoryFrameChangeMap`.

    Parameters
    ----------
    values : (A, S, 3) or (A, S, P, 3) array
        Frame changes, m, m, rad; boom angles evenly spaced over a turn from 0, swings and previous
        swings from minus to plus the limit.
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
        if len(shape) not in (3, 4) or shape[-1] != 3 or min(shape[:-1]) < LEAST_NODES:
            raise ValueError(
                f"values: expected (A, S, 3) or (A, S, P, 3) of at least {LEAST_NODES} nodes each, "
                f"found {shape}"
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
        """Return the frame changes (n, 3) of hops with these inputs, (n,) each."""
        return self.change_and_gradient(*inputs)[0]

    def change_and_gradient(self, *inputs: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the frame changes (n, 3), and derivatives (n, 3, d) by the inputs.

        Raises
        ------
        AnalysisError
            If a swing is beyond the limit, or the number of inputs is wrong.
        """
        wanted = self.values.ndim - 1
        rows = input_rows(inputs, wanted)
        self._require_within(rows[1:])
        compiled: Any = spline_changes if wanted == 2 else spline_changes_with_history
        values, gradients = compiled(self.coefficients, self.swing_limit_rad, *rows)
        return values, gradients

    def _require_within(self, swings: FloatArray) -> None:
        largest = float(np.abs(swings).max(initial=0.0))
        if not largest <= self.swing_limit_rad * (1 + BEYOND):
            raise AnalysisError(
                f"table: expected swings within {self.swing_limit_rad:.4f} rad, found {largest:.4f}"
            )


def tabulated(
    model: FrameChangeMap, swing_limit_rad: float, *, angles: int = 128, swings: int = 33
) -> TabulatedMap:
    """Tabulate a map of boom angle and swing."""
    grid = np.linspace(-swing_limit_rad, swing_limit_rad, swings)
    angle, swing = np.meshgrid(turn_nodes(angles), grid, indexing="ij")
    values = model.change(angle.ravel(), swing.ravel())
    return TabulatedMap(values.reshape(angles, swings, 3), swing_limit_rad)


def tabulated_with_history(
    model: HistoryFrameChangeMap,
    swing_limit_rad: float,
    *,
    angles: int = 96,
    swings: int = 25,
) -> TabulatedMap:
    """Tabulate a map of boom angle, swing and previous swing; both swings have as many nodes."""
    grid = np.linspace(-swing_limit_rad, swing_limit_rad, swings)
    mesh = np.meshgrid(turn_nodes(angles), grid, grid, indexing="ij")
    values = model.change(*(axis.ravel() for axis in mesh))
    return TabulatedMap(values.reshape(angles, swings, swings, 3), swing_limit_rad)


def turn_nodes(number: int) -> FloatArray:
    """Angles evenly spaced over a turn from 0, its end left out, rad."""
    return 2 * np.pi * np.arange(number) / number


def tabulation_errors(
    table: TabulatedMap, model: Any, *, points: int = 2000, seed: int = 0
) -> tuple[FloatArray, FloatArray]:
    """Return the largest errors of a table against its map at random points.

    Returns
    -------
    value, gradient : (3,) arrays
        Of each component, m, m, rad, and of its derivatives by any input, per rad.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    d = table.values.ndim - 1
    angle = rng.uniform(0, 2 * np.pi, points)
    swings = rng.uniform(-table.swing_limit_rad, table.swing_limit_rad, (d - 1, points))
    here, there = (
        table.change_and_gradient(angle, *swings),
        model.change_and_gradient(angle, *swings),
    )
    value, gradient = (np.abs(a - b) for a, b in zip(here, there, strict=True))
    return value.max(axis=0), gradient.max(axis=(0, 2))
