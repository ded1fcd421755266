"""A planner that reaches a point from any heading: a short look ahead, then the cost-to-go.

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

DISCOUNT = 0.98  # weight of the next stance relative to this one
TOLERANCE = 1e-3  # largest change of the cost-to-go in the last sweep
MOST_SWEEPS = 200
SWEEPS_BETWEEN = 24  # evaluations of the current policy before it is improved again

# Distances are closer together near the goal than at the far end by the factor
# exp(STRETCH).
STRETCH = 3.5
SHARPNESS = (
    8  # of the goal region's edge, which is mostly within 0.8 to 1.3 times its width
)
BEYOND = (
    5.0  # cost per metre beyond the last distance: its slope there (4 to 9 cm per hop)
)

#: Number of swings tried in each hop before refinement, by the number of hops.
SWINGS_TRIED = {1: 101, 2: 31, 3: 13}
FINEST_RAD = (
    5e-3  # smallest step of the refinement, which tries swings a third of a step apart
)


@dataclass(frozen=True, kw_only=True)
class _Grid:
    """Common part of both grids; `left` is the goal's pose (..., 3) relative to the hopper."""

    scatter: tuple[float, float, float] = (0.022, 0.022, 0.036)

    def perhaps(self, left: FloatArray) -> FloatArray:
        """Return six equally likely values (..., 6, 3) of `left`, given its prediction (..., 3)."""
        one = np.sqrt(3.0) * np.diag(self.scatter)
        return relative(np.concatenate([one, -one]), left[..., None, :])


@dataclass(frozen=True, kw_only=True)
class PointGrid(_Grid):
    """Grid of states and swings for the cost-to-go to a point.

    Parameters
    ----------
    distances, bearings, boom_angles, swings : int
        Number of nodes of each. Distances are closer together near the goal.
    farthest_m : float
        Largest distance, m; beyond it the cost increases by `BEYOND` per metre.
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
        place = np.linspace(0.0, 1.0, self.distances)
        return np.asarray(
            self.farthest_m * np.expm1(STRETCH * place) / np.expm1(STRETCH)
        )

    def nodes(self) -> FloatArray:
        """Return the point's relative pose at the nodes, (D, B, 3)."""
        distance, bearing = (
            self.distances_m[:, None],
            tables.turn_nodes(self.bearings) - np.pi,
        )
        x, y = distance * np.cos(bearing), distance * np.sin(bearing)
        return np.stack([x, y, np.zeros_like(x)], axis=-1)

    def errors(self, left: FloatArray) -> FloatArray:
        """Return the distances to the goal, m."""
        return np.hypot(left[..., 0], left[..., 1])

    def places(self, left: FloatArray) -> tuple[FloatArray, ...]:
        """Return fractional node indices of distance and of bearing."""
        inner = np.minimum(self.errors(left), self.farthest_m)
        stretched = np.log1p(inner * (np.expm1(STRETCH) / self.farthest_m)) / STRETCH
        bearing = np.arctan2(left[..., 1], left[..., 0]) + np.pi
        return stretched * (self.distances - 1), bearing * (self.bearings / TURN)

    def beyond(self, left: FloatArray) -> FloatArray:
        """Return the cost of the way to the last distance."""
        return BEYOND * np.maximum(self.errors(left) - self.farthest_m, 0.0)


@dataclass(frozen=True, kw_only=True)
class HeadingGrid(_Grid):
    """Grid for turning to a heading; `width` is the half-width of the goal region, rad."""

    heading_errors: int = 180
    boom_angles: int = 72
    swings: int = 37
    width: float = np.pi / 12

    def nodes(self) -> FloatArray:
        """Return the heading's relative pose at the nodes, (E, 3)."""
        turn = tables.turn_nodes(self.heading_errors) - np.pi
        return np.stack([np.zeros_like(turn), np.zeros_like(turn), turn], axis=-1)

    def errors(self, left: FloatArray) -> FloatArray:
        """Return the absolute heading errors, rad."""
        return np.abs(left[..., 2])

    def places(self, left: FloatArray) -> tuple[FloatArray, ...]:
        """Return fractional node indices of the heading error."""
        return ((left[..., 2] + np.pi) * (self.heading_errors / TURN),)

    def beyond(self, left: FloatArray) -> FloatArray:
        """Return zeros: all heading errors are on the grid."""
        return np.zeros(left.shape[:-1])


Grid: TypeAlias = PointGrid | HeadingGrid


def _away(grid: Grid, left: FloatArray) -> FloatArray:
    """Return how far stances are from being arrivals, from 0 (arrived) to 1."""
    return np.asarray(1.0 - 1.0 / (1.0 + (grid.errors(left) / grid.width) ** SHARPNESS))


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

    def ahead(self, left: FloatArray, boom_angle_rad: ArrayLike) -> FloatArray:
        """Return the cost of stances predicted at `left` (..., 3); linear between the nodes."""
        places = (
            *self.grid.places(left),
            _boom_places(boom_angle_rad, self.grid.boom_angles),
        )
        return _between(self._closed, np.stack(places)) + self.grid.beyond(left)


def _boom_places(boom_angle_rad: ArrayLike, boom_angles: int) -> FloatArray:
    return np.asarray(boom_angle_rad) % TURN * (boom_angles / TURN)


def _closed(values: FloatArray) -> FloatArray:
    """Repeat the first value of each angle after the last, on all axes except the distance."""
    return np.pad(values, [(0, 0), (0, 1), (0, 1)][-values.ndim :], mode="wrap")


def _between(closed: FloatArray, places: FloatArray) -> FloatArray:
    """Interpolate linearly at places (axes, ...)."""
    from scipy.ndimage import map_coordinates

    return np.asarray(map_coordinates(closed, places, order=1, mode="nearest"))


@cache
def _averages(grid: Grid) -> tuple[FloatArray, Any]:
    """Return a (N, 1) and sparse B (N, N): a + B v is the expected cost at predicted nodes.

    Here v (N, ...) is the cost after a stance at each node.
    """
    from scipy.sparse import csr_array

    nodes = grid.nodes()
    left = grid.perhaps(nodes).reshape(-1, 6, 3)
    away, places = _away(grid, left) / 6, np.stack(grid.places(left))
    row, low = np.repeat(np.arange(len(left)), 6), np.floor(places).astype(int)
    modes: Any = ("clip", "wrap")[-len(low) :]
    total = csr_array((len(left), len(left)))
    for corner in product((0, 1), repeat=len(low)):
        at = low + np.reshape(corner, (-1, 1, 1))
        weight = DISCOUNT * away * np.prod(1.0 - np.abs(places - at), axis=0)
        column = np.ravel_multi_index(tuple(at), nodes.shape[:-1], mode=modes)
        total += csr_array((weight.ravel(), (row, column.ravel())), total.shape)
    return (away * (1.0 + DISCOUNT * grid.beyond(left))).sum(
        axis=1, keepdims=True
    ), total


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
    rows = [axis.ravel() for axis in np.broadcast_arrays(boom, swing)]
    change = model.change(*rows).reshape(grid.boom_angles, grid.swings, 3)
    left = relative(change, grid.nodes()[..., None, None, :])
    beyond = grid.beyond(left)
    booms = np.broadcast_to(_boom_places(boom + swing, grid.boom_angles), beyond.shape)
    places = np.stack([*grid.places(left), booms])
    values = np.zeros(beyond.shape[:-1]) if begin is None else begin.values
    mean, average = _averages(grid)

    def foretold(after: FloatArray) -> FloatArray:
        """Return the expected cost at predicted nodes, given the cost after a stance."""
        return np.asarray(mean + average @ after.reshape(len(mean), -1)).reshape(
            after.shape
        )

    for _ in range(MOST_SWEEPS if begin is None else 1):
        costs = beyond + _between(_closed(values), places)
        best = costs.argmin(axis=-1)[..., None]
        before, values = (
            values,
            foretold(np.take_along_axis(costs, best, axis=-1)[..., 0]),
        )
        if np.abs(values - before).max() < TOLERANCE:
            return CostToGo(values, grid)
        stage = np.take_along_axis(beyond, best, axis=-1)[..., 0]
        chosen = np.take_along_axis(places, best[None], axis=-1)[..., 0]
        for _ in range(SWEEPS_BETWEEN):
            values = foretold(stage + _between(_closed(values), chosen))
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
        """Return a planner with another objective; one of the other kind needs a new cost-to-go."""
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
            left = relative(start, [*start[:2], self.objective.heading_rad])
        else:
            left = relative(start, [*self.objective.point_m, start[2]])
        hops, limit = self.horizon.hops, self.horizon.swing_limit_rad
        tried = SWINGS_TRIED[hops]
        value, swings = self._best(
            left, boom, [np.linspace(-limit, limit, tried)] * hops
        )
        step = 2 * limit / (tried - 1)
        while step > FINEST_RAD:
            near = np.clip(
                swings[:, None] + step * np.linspace(-1, 1, 7), -limit, limit
            )
            value, swings = self._best(left, boom, near)
            step /= 3
        return objectives.Plan(
            swings, predicted_poses(self.model, start, boom, swings), value
        )

    def _best(
        self, left: FloatArray, boom: float, tried: Iterable[FloatArray]
    ) -> tuple[float, FloatArray]:
        """Return the least cost over all sequences of the swings tried, and its swings."""
        grid, total, weight, booms = (
            self.cost_to_go.grid,
            np.zeros(()),
            np.ones(()),
            np.array(boom),
        )
        for hop, swing in enumerate(tried):
            if hop:  # the previous stance is only predicted, and may be an arrival
                away = weight * _away(grid, grid.perhaps(left)).mean(axis=-1)
                total, weight = total + away, DISCOUNT * away
            shape = (*booms.shape, len(swing))
            at = [
                np.broadcast_to(one, shape).ravel() for one in (booms[..., None], swing)
            ]
            left = relative(
                self.model.change(*at).reshape(*shape, 3), left[..., None, :]
            )
            booms = booms[..., None] + swing
            total, weight = total[..., None], weight[..., None]
        total = total + weight * self.cost_to_go.ahead(left, booms)
        best = np.unravel_index(total.argmin(), total.shape)
        return float(total[best]), np.array(
            [one[k] for one, k in zip(tried, best, strict=True)]
        )


def planner(
    model: tables.FrameChangeMap,
    objective: objectives.Objective | None = None,
    *,
    horizon: objectives.Horizon | None = None,
    grid: Grid | None = None,
) -> Planner:
    """Return a planner after computing its cost-to-go, which takes a few seconds."""
    objective, horizon = (
        objective or objectives.ToPoint(),
        horizon or objectives.Horizon(hops=2),
    )
    require(
        horizon.hops in SWINGS_TRIED,
        "hops",
        f"one of {sorted(SWINGS_TRIED)}",
        horizon.hops,
    )
    limit = horizon.swing_limit_rad
    if not (isinstance(model, tables.TabulatedMap) and model.swing_limit_rad == limit):
        model = tables.tabulated(model, limit)
    usual = HeadingGrid if isinstance(objective, objectives.ToHeading) else PointGrid
    return Planner(model, objective, horizon, cost_to_go(model, grid or usual()))


# A planner that keeps learning.

COARSE: dict[type, Grid] = {
    PointGrid: PointGrid(distances=20, bearings=24, boom_angles=16, swings=9),
    HeadingGrid: HeadingGrid(heading_errors=90, boom_angles=32, swings=17),
}
COARSE_TABLE = {"angles": 64, "swings": 17}  # size of the table of the corrected map


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
        nodes = np.meshgrid(
            self._known.boom_angle_rad, self._known.swing_rad, indexing="ij"
        )
        self._at = self.correction.functions(*nodes)
        ahead = cost_to_go(self._known, COARSE[type(known.cost_to_go.grid)])
        self._planner = replace(known, cost_to_go=ahead)
        self._before: tuple[FloatArray, float] | None = None

    def towards(self, objective: objectives.Objective) -> AdaptivePlanner:
        """Switch to another objective of the same kind, keeping what has been learned."""
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
            self._learn(*self._before, previous_swing_rad, here)
        self._before = (here, boom)
        return self._planner.plan(here, boom)

    @one_blas_thread()
    def _learn(
        self, start: FloatArray, boom: float, swing: float, here: FloatArray
    ) -> None:
        """Correct the map and the cost-to-go from an observed hop."""
        known, limit = self._known, self._known.swing_limit_rad
        swing = float(np.clip(swing, -limit, limit))
        missed = relative(start, here) - known.change(boom, swing)[0]
        missed[2] = wrapped(missed[2])
        self.correction.learn(boom, swing, missed)
        model = tables.TabulatedMap(
            known.values + self.correction.added(self._at), limit
        )
        before = self._planner.cost_to_go
        ahead = cost_to_go(model, before.grid, begin=before)
        self._planner = replace(self._planner, model=model, cost_to_go=ahead)
