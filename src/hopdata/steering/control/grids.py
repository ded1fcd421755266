"""Grids on which the cost-to-go is tabulated, and what a stance costs on them.

The remaining pose is that of the goal relative to the robot. "Go to a point" depends on
two of its numbers, the distance and the bearing of the point; "turn to a heading"
depends on one, the heading error. Beside these there is a state of the robot, or none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import ConfigError
from hopdata.rigid import relative
from hopdata.steering.goals import ARRIVED_M, FENCE_M, TURNED_RAD
from hopdata.steering.models.stride_table import StrideTable
from hopdata.steering.strides import TURN, turn_nodes

#: Logarithm of the factor by which distances are closer together near the goal than at
#: the far end of the grid.
#: Unit: 1. Origin: chosen.
STRETCH = 3.5
#: Sharpness of the goal region's edge, most of which is within 0.8 to 1.3 widths.
#: Unit: 1. Origin: chosen.
SHARPNESS = 8
#: Cost of each metre beyond the last distance of the hopper's grid.
#: Unit: strides/m. Origin: derived: the slope of the cost-to-go there, where the hopper
#: comes 4 to 9 cm nearer a hop.
TAIL_COST_PER_M = 5.0

# A stride may end at six points about its prediction: one on each side, on each axis.
N_SAMPLES = 6


@dataclass(frozen=True, kw_only=True)
class _Grid:
    """Common part of both grids."""

    scatter: tuple[float, float, float] = (0.022, 0.022, 0.036)

    def samples(self, remaining: FloatArray) -> FloatArray:
        """Return six equally likely remaining poses (..., 6, 3) about a predicted one.

        On each of three axes two lie sqrt(3) deviations away, so that the six have the
        variance of the scatter.
        """
        offsets = np.sqrt(3.0) * np.diag(self.scatter)
        ends = np.concatenate([offsets, -offsets])
        return relative(ends, remaining[..., None, :])


@dataclass(frozen=True, kw_only=True)
class PointGrid(_Grid):
    """Grid for the cost-to-go to a point; the defaults are the hopper's.

    Parameters
    ----------
    distances, bearings, states, inputs : int
        Number of nodes of each; `states` of the robot's state, `inputs` of each of its
        inputs. Distances are closer together near the goal.
    farthest_m : float
        Largest distance, m; beyond it the cost increases by `tail_cost_per_m`.
    width : float
        Radius of the goal region, m.
    tail_cost_per_m : float
        Strides that it takes to come a metre nearer from far away, discounted.
    scatter : tuple of float
        Standard deviation of a stride's end about its prediction, m, m, rad. The
        default is the error of a model learned from 100 hops (``model_scores.csv``).
    """

    distances: int = 40
    bearings: int = 48
    states: int = 32
    inputs: int = 25
    farthest_m: float = FENCE_M
    width: float = ARRIVED_M
    tail_cost_per_m: float = TAIL_COST_PER_M

    @property
    def distances_m(self) -> FloatArray:
        """Distances (D,) of the nodes, m."""
        share = np.linspace(0.0, 1.0, self.distances)
        return np.asarray(
            self.farthest_m * np.expm1(STRETCH * share) / np.expm1(STRETCH)
        )

    #: Whether each axis of the nodes is periodic.
    periodic = (False, True)

    def nodes(self) -> FloatArray:
        """Return the point's relative pose at the nodes, (D, B, 3)."""
        distance = self.distances_m[:, None]
        bearing = turn_nodes(self.bearings) - np.pi
        x = distance * np.cos(bearing)
        y = distance * np.sin(bearing)
        return np.stack([x, y, np.zeros_like(x)], axis=-1)

    def errors(self, remaining: FloatArray) -> FloatArray:
        """Return the distances to the goal, m."""
        return np.hypot(remaining[..., 0], remaining[..., 1])

    def locations(self, remaining: FloatArray) -> tuple[FloatArray, ...]:
        """Return fractional node indices of distance and of bearing."""
        inner = np.minimum(self.errors(remaining), self.farthest_m)
        stretched = np.log1p(inner * (np.expm1(STRETCH) / self.farthest_m)) / STRETCH
        bearing = np.arctan2(remaining[..., 1], remaining[..., 0]) + np.pi
        return stretched * (self.distances - 1), bearing * (self.bearings / TURN)

    def tail_cost(self, remaining: FloatArray) -> FloatArray:
        """Return the cost of the way to the last distance of the grid."""
        excess_m = np.maximum(self.errors(remaining) - self.farthest_m, 0.0)
        return self.tail_cost_per_m * excess_m


@dataclass(frozen=True, kw_only=True)
class HeadingGrid(_Grid):
    """Grid for turning to a heading.

    The `width` is half that of the goal region, rad.
    """

    heading_errors: int = 180
    states: int = 72
    inputs: int = 37
    width: float = TURNED_RAD

    periodic = (True,)

    def nodes(self) -> FloatArray:
        """Return the heading's relative pose at the nodes, (E, 3)."""
        turn = turn_nodes(self.heading_errors) - np.pi
        return np.stack([np.zeros_like(turn), np.zeros_like(turn), turn], axis=-1)

    def errors(self, remaining: FloatArray) -> FloatArray:
        """Return the absolute heading errors, rad."""
        return np.abs(remaining[..., 2])

    def locations(self, remaining: FloatArray) -> tuple[FloatArray, ...]:
        """Return fractional node indices of the heading error."""
        return ((remaining[..., 2] + np.pi) * (self.heading_errors / TURN),)

    def tail_cost(self, remaining: FloatArray) -> FloatArray:
        """Return zeros: all heading errors are on the grid."""
        return np.zeros(remaining.shape[:-1])


Grid: TypeAlias = PointGrid | HeadingGrid


def coarse(grid: Grid) -> Grid:
    """Return a grid with so few nodes that a cost-to-go takes some 20 ms a sweep."""
    if isinstance(grid, PointGrid):
        return replace(grid, distances=20, bearings=24, states=16, inputs=9)
    return replace(grid, heading_errors=90, states=32, inputs=17)


def not_arrived(grid: Grid, remaining: FloatArray) -> FloatArray:
    """Return how far stances are from being arrivals, from 0 (arrived) to 1."""
    ratio = grid.errors(remaining) / grid.width
    return np.asarray(1.0 - 1.0 / (1.0 + ratio**SHARPNESS))


@dataclass(frozen=True)
class StateNodes:
    """Nodes of the robot's state; of a robot without one there is a single node.

    Parameters
    ----------
    number : int
    lower, upper : float
        The first and the last node; of a periodic state, 0 and a whole turn.
    kind : {"none", "periodic", "linear"}
    """

    number: int
    lower: float
    upper: float
    kind: str

    def nodes(self) -> FloatArray:
        """Return the states (number, S) at the nodes."""
        if self.kind == "none":
            return np.empty((1, 0))
        if self.kind == "periodic":
            return turn_nodes(self.number)[:, None]
        return np.linspace(self.lower, self.upper, self.number)[:, None]

    def locations(self, state: FloatArray) -> FloatArray:
        """Return fractional node indices (...) of states (..., S)."""
        if self.kind == "none":
            return np.zeros(state.shape[:-1])
        if self.kind == "periodic":
            return np.asarray(state[..., 0] % TURN * (self.number / TURN))
        share = (state[..., 0] - self.lower) / (self.upper - self.lower)
        return np.asarray(np.clip(share, 0.0, 1.0) * (self.number - 1))


def state_nodes(model: StrideTable, number: int) -> StateNodes:
    """Return the nodes of the state of a tabulated model.

    Raises
    ------
    ConfigError
        If the robot has more than one state.
    """
    axes = model.axes
    if not axes.states:
        return StateNodes(1, 0.0, 0.0, "none")
    if len(axes.states) > 1:
        names = ", ".join(state.name for state in axes.states)
        raise ConfigError.at("planner", "a robot with at most one state", names)
    if axes.periodic:
        return StateNodes(number, 0.0, TURN, "periodic")
    places = model.nodes[0]
    return StateNodes(number, float(places[0]), float(places[-1]), "linear")
