"""A planner that reaches a point from any heading: a short horizon and a cost-to-go.

A turn takes more than three hops. The printed controller, facing away from the point,
therefore sees no swings that bring it nearer, and hops on the spot. The cost-to-go
knows the way round: it is the cost of continuing optimally from a state, computed by
policy iteration on a grid.

Relative to the hopper, "go to a point" depends on three numbers: the distance and the
bearing of the point, and the boom angle. "Turn to a heading" depends on two: the
heading error and the boom angle. The planner minimises the discounted number of hops
until the first arrival. Hops do not end exactly where they are predicted to, so the
cost-to-go averages over where they may end, and the planner aims at the goal rather
than at the edge of the goal region. Costs after a stance are weighted by how far it is
from being an arrival, so there is nothing to gain by lingering just outside.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import product
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, one_blas_thread
from hopdata.errors import AnalysisError, require
from hopdata.rigid import relative, wrapped
from hopdata.steering.control import objectives
from hopdata.steering.control.printed import predicted_poses
from hopdata.steering.models import tabulated as tables
from hopdata.steering.models.process import TURN

#: Weight of the next stance relative to this one.
#: Unit: 1. Origin: chosen.
DISCOUNT = 0.98
#: Largest change of the cost-to-go in the last sweep.
#: Unit: hops. Origin: chosen.
TOLERANCE = 1e-3
#: Most improvements of the policy; more mean that it does not converge.
#: Unit: 1. Origin: chosen.
MOST_SWEEPS = 200
#: Evaluations of the current policy before it is improved again.
#: Unit: 1. Origin: chosen.
SWEEPS_BETWEEN = 24
#: Logarithm of the factor by which distances are closer together near the goal than at
#: the far end of the grid.
#: Unit: 1. Origin: chosen.
STRETCH = 3.5
#: Sharpness of the goal region's edge, most of which is within 0.8 to 1.3 widths.
#: Unit: 1. Origin: chosen.
SHARPNESS = 8
#: Cost of each metre beyond the last distance of the grid.
#: Unit: hops/m. Origin: derived: the slope of the cost-to-go there, where the hopper
#: comes 4 to 9 cm nearer a hop.
TAIL_COST_PER_M = 5.0
#: Number of swings tried in each hop before refinement, by the number of hops.
#: Unit: 1. Origin: chosen.
SWINGS_TRIED = {1: 101, 2: 31, 3: 13}
#: Smallest step of the refinement.
#: Unit: rad. Origin: chosen.
FINEST_RAD = 5e-3
#: Swings that the refinement tries about the best so far, a third of a step apart.
#: Unit: 1. Origin: derived: the outermost are the neighbours that were tried before.
SWINGS_REFINED = 7
#: Factor by which the step of the refinement shrinks: the distance of its swings.
#: Unit: 1. Origin: derived: the steps between `SWINGS_REFINED` swings on each side.
REFINEMENT = 3

# A hop may end at six points about its prediction: one on each side, on each axis.
N_SAMPLES = 6


@dataclass(frozen=True, kw_only=True)
class _Grid:
    """Common part of both grids.

    The remaining pose (..., 3) is that of the goal relative to the hopper.
    """

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
    """Grid of states and swings for the cost-to-go to a point.

    Parameters
    ----------
    distances, bearings, boom_angles, swings : int
        Number of nodes of each. Distances are closer together near the goal.
    farthest_m : float
        Largest distance, m; beyond it the cost increases by `TAIL_COST_PER_M`.
    width : float
        Radius of the goal region, m.
    scatter : tuple of float
        Standard deviation of a hop's end about its prediction, m, m, rad. The default
        is the error of a model learned from 100 hops (``model_scores.csv``).
    """

    distances: int = 40
    bearings: int = 48
    boom_angles: int = 32
    swings: int = 25
    farthest_m: float = 3.0
    width: float = 0.11

    @property
    def distances_m(self) -> FloatArray:
        """Distances (D,) of the nodes, m."""
        share = np.linspace(0.0, 1.0, self.distances)
        return np.asarray(
            self.farthest_m * np.expm1(STRETCH * share) / np.expm1(STRETCH)
        )

    def nodes(self) -> FloatArray:
        """Return the point's relative pose at the nodes, (D, B, 3)."""
        distance = self.distances_m[:, None]
        bearing = tables.turn_nodes(self.bearings) - np.pi
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
        return TAIL_COST_PER_M * excess_m


@dataclass(frozen=True, kw_only=True)
class HeadingGrid(_Grid):
    """Grid for turning to a heading.

    The `width` is half that of the goal region, rad.
    """

    heading_errors: int = 180
    boom_angles: int = 72
    swings: int = 37
    width: float = np.pi / 12

    def nodes(self) -> FloatArray:
        """Return the heading's relative pose at the nodes, (E, 3)."""
        turn = tables.turn_nodes(self.heading_errors) - np.pi
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


def _not_arrived(grid: Grid, remaining: FloatArray) -> FloatArray:
    """Return how far stances are from being arrivals, from 0 (arrived) to 1."""
    ratio = grid.errors(remaining) / grid.width
    return np.asarray(1.0 - 1.0 / (1.0 + ratio**SHARPNESS))


@dataclass(frozen=True)
class CostToGo:
    """Cost-to-go on a grid.

    Parameters
    ----------
    values : (D, B, A) or (E, A) array
        Expected cost of a stance predicted there, including all later ones; by
        distance, bearing and boom angle, or by heading error and boom angle. Bearings
        and errors are evenly spaced from -pi, boom angles from 0.
    grid : PointGrid or HeadingGrid
    """

    values: FloatArray
    grid: Grid

    @cached_property
    def _closed(self) -> FloatArray:
        return _closed(self.values)

    def at(self, remaining: FloatArray, boom_angle_rad: ArrayLike) -> FloatArray:
        """Return the cost of stances predicted at remaining poses (..., 3).

        It is linear between the nodes.
        """
        boom = _boom_locations(boom_angle_rad, self.grid.boom_angles)
        locations = np.stack((*self.grid.locations(remaining), boom))
        return _interpolated(self._closed, locations) + self.grid.tail_cost(remaining)


def _boom_locations(boom_angle_rad: ArrayLike, boom_angles: int) -> FloatArray:
    """Return fractional node indices of boom angles."""
    return np.asarray(boom_angle_rad) % TURN * (boom_angles / TURN)


def _closed(values: FloatArray) -> FloatArray:
    """Repeat the first value of each angle after the last; a distance is no angle."""
    added = [(0, 1)] * values.ndim
    if values.ndim == 3:  # distance, bearing, boom angle
        added[0] = (0, 0)
    return np.pad(values, added, mode="wrap")


def _interpolated(closed: FloatArray, locations: FloatArray) -> FloatArray:
    """Interpolate linearly at fractional node indices (axes, ...)."""
    from scipy.ndimage import map_coordinates

    return np.asarray(map_coordinates(closed, locations, order=1, mode="nearest"))


@cache
def _averages(grid: Grid) -> tuple[FloatArray, Any]:
    """Return a (N, 1) and sparse B (N, N) with which a + B v is the expected cost.

    It is that of a stance predicted at each node, and v (N, ...) the cost after a
    stance at each node. The stance may be at any of the grid's samples about the node,
    between nodes.
    """
    from scipy.sparse import csr_array

    nodes = grid.nodes()
    samples = grid.samples(nodes).reshape(-1, N_SAMPLES, 3)
    share = _not_arrived(grid, samples) / N_SAMPLES
    locations = np.stack(grid.locations(samples))
    n_axes = len(locations)
    # Beyond the last distance the last one counts; angles begin again.
    modes: Any = ("wrap",) if n_axes == 1 else ("clip", "wrap")
    n_nodes = len(samples)
    row = np.repeat(np.arange(n_nodes), N_SAMPLES)
    low = np.floor(locations).astype(int)
    average = csr_array((n_nodes, n_nodes))
    for corner in product((0, 1), repeat=n_axes):
        node = low + np.reshape(corner, (-1, 1, 1))
        weight = DISCOUNT * share * np.prod(1.0 - np.abs(locations - node), axis=0)
        column = np.ravel_multi_index(tuple(node), nodes.shape[:-1], mode=modes)
        average += csr_array((weight.ravel(), (row, column.ravel())), average.shape)
    costs = share * (1.0 + DISCOUNT * grid.tail_cost(samples))
    return costs.sum(axis=1, keepdims=True), average


def cost_to_go(
    model: tables.TabulatedMap, grid: Grid, *, begin: CostToGo | None = None
) -> CostToGo:
    """Compute the cost-to-go on a grid by policy iteration.

    The best swings are chosen, their cost is evaluated over several hops, and they are
    chosen again. Where each swing leads is computed only once, since it does not
    change.

    Parameters
    ----------
    model : TabulatedMap
    grid : PointGrid or HeadingGrid
    begin : CostToGo, optional
        Cost-to-go on the same grid for a slightly different map. One policy improvement
        of it is returned, whether or not it has converged.

    Raises
    ------
    AnalysisError
        If it does not converge, unless `begin` is given.
    """
    boom = tables.turn_nodes(grid.boom_angles)[:, None]
    swing = np.linspace(-model.swing_limit_rad, model.swing_limit_rad, grid.swings)
    booms, swings = np.broadcast_arrays(boom, swing)
    change = model.change(booms.ravel(), swings.ravel())
    change = change.reshape(grid.boom_angles, grid.swings, 3)
    # Axes: those of the nodes, the boom angle, and last the swings to choose from.
    remaining = relative(change, grid.nodes()[..., None, None, :])
    tail = grid.tail_cost(remaining)
    next_boom = _boom_locations(boom + swing, grid.boom_angles)
    next_booms = np.broadcast_to(next_boom, tail.shape)
    locations = np.stack([*grid.locations(remaining), next_booms])
    mean, average = _averages(grid)

    def expected(after: FloatArray) -> FloatArray:
        """Return the expected cost at predicted nodes, by that after a stance."""
        found = np.asarray(mean + average @ after.reshape(len(mean), -1))
        return found.reshape(after.shape)

    if begin is None:
        values = np.zeros(tail.shape[:-1])
        n_sweeps = MOST_SWEEPS
    else:
        values = begin.values
        n_sweeps = 1
    for _ in range(n_sweeps):
        before = values
        costs = tail + _interpolated(_closed(before), locations)
        best = costs.argmin(axis=-1)[..., None]
        values = expected(np.take_along_axis(costs, best, axis=-1)[..., 0])
        if np.abs(values - before).max() < TOLERANCE:
            return CostToGo(values, grid)
        best_tail = np.take_along_axis(tail, best, axis=-1)[..., 0]
        best_locations = np.take_along_axis(locations, best[None], axis=-1)[..., 0]
        for _ in range(SWEEPS_BETWEEN):
            after = best_tail + _interpolated(_closed(values), best_locations)
            values = expected(after)
    if begin is not None:
        return CostToGo(values, grid)
    raise AnalysisError(
        f"cost-to-go: expected changes below {TOLERANCE} within {MOST_SWEEPS} sweeps"
    )


@dataclass(frozen=True)
class Planner:
    """Predictive control with the cost-to-go beyond the horizon; made by `planner`.

    Parameters
    ----------
    model : TabulatedMap
    objective : ToPoint or ToHeading
    horizon : Horizon
    cost_to_go : CostToGo
        Of the same kind as the objective; one serves all points, or all headings.
    """

    model: tables.TabulatedMap
    objective: objectives.Objective
    horizon: objectives.Horizon
    cost_to_go: CostToGo

    def towards(self, objective: objectives.Objective) -> Planner:
        """Return a planner with another objective.

        One of the other kind needs a new cost-to-go.
        """
        if isinstance(objective, type(self.objective)):
            return replace(self, objective=objective)
        return planner(self.model, objective, horizon=self.horizon)

    def plan(
        self,
        pose: ArrayLike,
        boom_angle_rad: float,
        previous_swing_rad: float | None = None,
        /,
    ) -> objectives.Plan:
        """Plan from a pose and a boom angle; the previous swing is ignored."""
        del previous_swing_rad
        start, boom = objectives.checked_state(pose, boom_angle_rad)
        if isinstance(self.objective, objectives.ToHeading):
            goal = [*start[:2], self.objective.heading_rad]
        else:
            goal = [*self.objective.point_m, start[2]]
        remaining = relative(start, goal)
        limit = self.horizon.swing_limit_rad
        n_tried = SWINGS_TRIED[self.horizon.hops]
        everywhere = np.linspace(-limit, limit, n_tried)
        tried = [everywhere] * self.horizon.hops
        cost, swings = self._best(remaining, boom, tried)
        step = 2 * limit / (n_tried - 1)
        while step > FINEST_RAD:
            about = swings[:, None] + step * np.linspace(-1, 1, SWINGS_REFINED)
            cost, swings = self._best(remaining, boom, np.clip(about, -limit, limit))
            step /= REFINEMENT
        poses = predicted_poses(self.model, start, boom, swings)
        return objectives.Plan(swings, poses, cost)

    def _best(
        self, remaining: FloatArray, boom: float, tried: Iterable[FloatArray]
    ) -> tuple[float, FloatArray]:
        """Return the least cost over all sequences of the swings tried, and its swings.

        Each hop adds an axis to the arrays, with the swings that are tried in it.
        """
        grid = self.cost_to_go.grid
        total = np.zeros(())
        weight = np.ones(())
        booms = np.array(boom)
        for hop, swing in enumerate(tried):
            if hop > 0:
                # The previous stance is only predicted, and may be an arrival.
                samples = grid.samples(remaining)
                goes_on = weight * _not_arrived(grid, samples).mean(axis=-1)
                total = total + goes_on
                weight = DISCOUNT * goes_on
            shape = (*booms.shape, len(swing))
            from_booms = np.broadcast_to(booms[..., None], shape).ravel()
            swings = np.broadcast_to(swing, shape).ravel()
            change = self.model.change(from_booms, swings).reshape(*shape, 3)
            remaining = relative(change, remaining[..., None, :])
            booms = booms[..., None] + swing
            total = total[..., None]
            weight = weight[..., None]
        total = total + weight * self.cost_to_go.at(remaining, booms)
        best = np.unravel_index(total.argmin(), total.shape)
        chosen = [swing[k] for swing, k in zip(tried, best, strict=True)]
        return float(total[best]), np.array(chosen)


def planner(
    model: tables.FrameChangeMap,
    objective: objectives.Objective | None = None,
    *,
    horizon: objectives.Horizon | None = None,
    grid: Grid | None = None,
) -> Planner:
    """Return a planner after computing its cost-to-go, which takes a few seconds."""
    objective = objective or objectives.ToPoint()
    horizon = horizon or objectives.Horizon(hops=2)
    known = f"one of {sorted(SWINGS_TRIED)}"
    require(horizon.hops in SWINGS_TRIED, "hops", known, horizon.hops)
    limit = horizon.swing_limit_rad
    if not (isinstance(model, tables.TabulatedMap) and model.swing_limit_rad == limit):
        model = tables.tabulated(model, limit)
    if grid is None:
        to_heading = isinstance(objective, objectives.ToHeading)
        grid = HeadingGrid() if to_heading else PointGrid()
    return Planner(model, objective, horizon, cost_to_go(model, grid))


# A planner that keeps learning.

# Grids on which the cost-to-go follows the map during a flight.
COARSE: dict[type, Grid] = {
    PointGrid: PointGrid(distances=20, bearings=24, boom_angles=16, swings=9),
    HeadingGrid: HeadingGrid(heading_errors=90, boom_angles=32, swings=17),
}
# Size of the table of the corrected map.
COARSE_TABLE = {"angles": 64, "swings": 17}


class AdaptivePlanner:
    """Plans with a map that it corrects at each stance by the hop just made.

    At each hop, one policy improvement on a coarse grid adapts the cost-to-go to the
    map. A planner remembers what it has learned, so each run needs its own.

    Parameters
    ----------
    known : Planner
        Planner to start from.
    noise : (3,) array
        Standard deviation of a hop's random part, m, m, rad.
    """

    def __init__(self, known: Planner, noise: FloatArray) -> None:
        limit = known.model.swing_limit_rad
        self.correction = tables.Correction(limit, np.asarray(noise, dtype=float))
        self._known = tables.tabulated(known.model, limit, **COARSE_TABLE)
        booms, swings = np.meshgrid(
            self._known.boom_angle_rad, self._known.swing_rad, indexing="ij"
        )
        # Basis functions of the correction at the nodes of the table.
        self._functions = self.correction.functions(booms, swings)
        coarse = cost_to_go(self._known, COARSE[type(known.cost_to_go.grid)])
        self._planner = replace(known, cost_to_go=coarse)
        # Pose and boom angle at the last stance.
        self._before: tuple[FloatArray, float] | None = None

    def towards(self, objective: objectives.Objective) -> AdaptivePlanner:
        """Switch to another objective of the same kind; what was learned is kept."""
        self._planner = self._planner.towards(objective)
        return self

    def plan(
        self,
        pose: ArrayLike,
        boom_angle_rad: float,
        previous_swing_rad: float | None = None,
        /,
    ) -> objectives.Plan:
        """Learn from the previous hop, if its swing is known, then plan."""
        here, boom = objectives.checked_state(pose, boom_angle_rad)
        if self._before is not None and previous_swing_rad is not None:
            start, boom_before = self._before
            self._learn(start, boom_before, previous_swing_rad, here)
        self._before = (here, boom)
        return self._planner.plan(here, boom)

    @one_blas_thread()
    def _learn(
        self, start: FloatArray, boom: float, swing: float, here: FloatArray
    ) -> None:
        """Correct the map and the cost-to-go from an observed hop."""
        known = self._known
        limit = known.swing_limit_rad
        swing = float(np.clip(swing, -limit, limit))
        missed = relative(start, here) - known.change(boom, swing)[0]
        missed[2] = wrapped(missed[2])
        self.correction.learn(boom, swing, missed)
        corrected = known.values + self.correction.added(self._functions)
        model = tables.TabulatedMap(corrected, limit)
        before = self._planner.cost_to_go
        improved = cost_to_go(model, before.grid, begin=before)
        self._planner = replace(self._planner, model=model, cost_to_go=improved)
