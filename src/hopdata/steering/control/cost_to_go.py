"""What it costs to go on from a state as well as can be: by value iteration on a grid.

Seen from the hopper, "go to a point" depends on three numbers: the distance of the point, its
bearing, and the boom angle. "Turn to a heading" depends on two: the heading error and the boom
angle. The cost of a stance rises from 0 at the goal to 1 far away, and later stances count less:
what is minimised is the time away from the goal, now and in the long run, so that it pays to
arrive early and to stay.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError, ConfigError
from hopdata.steering.control.heading_value_kernel import improve_heading
from hopdata.steering.control.point_value_kernel import distances_of, improve_point, point_hops
from hopdata.steering.models.tabulated import TabulatedMap, turn_nodes

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MOST_SWEEPS = 200
SWEEPS_BETWEEN = 8  # under the policy chosen last


@dataclass(frozen=True, kw_only=True)
class PointGrid:
    """Grid of states and swings on which the cost-to-go to a point is computed.

    Parameters
    ----------
    distances, bearings, boom_angles, swings : int
        Number of nodes of each. Distances lie closer near the goal.
    farthest_m : float
        Largest distance, m; beyond it each metre costs as much as it takes hops.
    """

    distances: int = 40
    bearings: int = 48
    boom_angles: int = 32
    swings: int = 25
    farthest_m: float = 3.0

    def __post_init__(self) -> None:
        _at_least(
            4,
            distances=self.distances,
            bearings=self.bearings,
            boom_angles=self.boom_angles,
            swings=self.swings,
        )
        if not self.farthest_m > 0:
            raise ConfigError(f"farthest_m: expected more than 0, found {self.farthest_m}")


@dataclass(frozen=True, kw_only=True)
class HeadingGrid:
    """Grid of states and swings on which the cost-to-go to a heading is computed."""

    errors: int = 180
    boom_angles: int = 72
    swings: int = 37

    def __post_init__(self) -> None:
        _at_least(4, errors=self.errors, boom_angles=self.boom_angles, swings=self.swings)


@dataclass(frozen=True, kw_only=True)
class StageCost:
    """Cost of a stance: ``e^2 / (e^2 + width^2)`` of the error e that is left.

    Parameters
    ----------
    width : float
        Error at which it is one half, m or rad.
    discount : float
        What the next stance counts beside this one.
    tolerance : float
        Largest change of the cost-to-go in the last sweep.
    """

    width: float
    discount: float = 0.98
    tolerance: float = 1e-3

    def __post_init__(self) -> None:
        if not self.width > 0:
            raise ConfigError(f"width: expected more than 0, found {self.width}")
        if not 0 < self.discount < 1:
            raise ConfigError(f"discount: expected between 0 and 1, found {self.discount}")


@dataclass(frozen=True)
class CostToGo:
    """Cost-to-go on a grid.

    Parameters
    ----------
    values : (D, B, A) or (E, A) array
        By distance, bearing and boom angle, or by heading error and boom angle. Bearings and errors
        are spaced evenly from -pi on, boom angles from 0 on.
    stage : StageCost
    farthest_m : float
        Distance of the last node, m (NaN for headings).
    sweeps : int
        Improvements of the policy that it took.
    """

    values: FloatArray
    stage: StageCost
    farthest_m: float
    sweeps: int

    @property
    def layers(self) -> FloatArray:
        """Values with three axes: those of headings have one layer."""
        return self.values if self.values.ndim == 3 else self.values[None]


def to_a_point(model: TabulatedMap, stage: StageCost, grid: PointGrid | None = None) -> CostToGo:
    """Cost-to-go to a point: (D, B, A)."""
    grid = grid or PointGrid()
    changes, swings = _changes(model, grid.boom_angles, grid.swings)
    shape = (grid.distances, grid.bearings, grid.boom_angles)
    cells = np.empty((*shape, grid.swings, 2), dtype=np.int32)
    places = np.empty((*shape, grid.swings, 3), dtype=np.float32)
    distances = distances_of(grid.distances, grid.farthest_m)
    point_hops(distances, grid.bearings, changes, stage.width, stage.discount, cells, places)
    boom_cells, boom_places = _boom_hops(grid.boom_angles, swings)

    def improve(values: FloatArray, policy: IntArray, choose: bool) -> float:
        return float(
            improve_point(
                values, policy, choose, cells, places, boom_cells, boom_places, stage.discount
            )
        )

    return _iterated(improve, shape, stage, grid.farthest_m)


def to_a_heading(
    model: TabulatedMap, stage: StageCost, grid: HeadingGrid | None = None
) -> CostToGo:
    """Cost-to-go to a heading: (E, A)."""
    grid = grid or HeadingGrid()
    changes, swings = _changes(model, grid.boom_angles, grid.swings)

    def improve(values: FloatArray, policy: IntArray, choose: bool) -> float:
        return float(
            improve_heading(
                values, policy, choose, changes[..., 2], swings, stage.width, stage.discount
            )
        )

    return _iterated(improve, (grid.errors, grid.boom_angles), stage, np.nan)


def _changes(model: TabulatedMap, boom_angles: int, swings: int) -> tuple[FloatArray, FloatArray]:
    """Frame changes (A, U, 3) at the nodes, and the swings (U,)."""
    limit = model.swing_limit_rad
    swing = np.linspace(-limit, limit, swings)
    grid = [axis.ravel() for axis in np.meshgrid(turn_nodes(boom_angles), swing, indexing="ij")]
    return model.change(*grid).reshape(boom_angles, swings, 3), swing


def _boom_hops(boom_angles: int, swings: FloatArray) -> tuple[IntArray, FloatArray]:
    """Cells (A, U) of the boom angles that swings lead to, and the places in them."""
    after = turn_nodes(boom_angles)[:, None] + swings
    places = after * (boom_angles / (2 * np.pi))
    cells = np.floor(places)
    return cells.astype(np.int64) % boom_angles, places - cells


Improve = Callable[[FloatArray, IntArray, bool], float]


def _iterated(
    improve: Improve, shape: tuple[int, ...], stage: StageCost, farthest_m: float
) -> CostToGo:
    """Policy iteration: choose the best swings, see what they cost over some hops, choose again."""
    values, policy = np.zeros(shape), np.zeros(shape, dtype=np.int64)
    for sweep in range(1, MOST_SWEEPS + 1):
        if improve(values, policy, True) < stage.tolerance:
            return CostToGo(values, stage, farthest_m, sweep)
        for _ in range(SWEEPS_BETWEEN):
            improve(values, policy, False)
    raise AnalysisError(
        f"cost-to-go: expected changes below {stage.tolerance} within {MOST_SWEEPS} sweeps"
    )


def _at_least(least: int, **counts: int) -> None:
    for name, count in counts.items():
        if count < least:
            raise ConfigError(f"{name}: expected {least} at least, found {count}")
