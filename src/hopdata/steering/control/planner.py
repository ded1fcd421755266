"""A planner that gets to a point from any heading: a short look ahead, then the cost-to-go.

Three hops are fewer than a turn takes, so the printed controller, facing away, sees no way that
brings it nearer, and hops on the spot. The cost-to-go knows the way round: it is what going on from
a state costs as well as can be, by value iteration on a grid.

Seen from the hopper, "go to a point" depends on three numbers: the distance of the point, its
bearing, and the boom angle. "Turn to a heading" depends on two: the heading error and the boom
angle. What is minimised is the number of hops until the first arrival, of which later ones count
less. No hop ends quite where it is foretold: the cost-to-go is an average over where it may end,
so that the planner aims at the goal and not at the edge of what is near enough. What comes after a
stance counts by as much as it is no arrival, so that nothing is gained by lingering beside it.
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

DISCOUNT = 0.98  # what the next stance counts beside this one
TOLERANCE = 1e-3  # largest change of the cost-to-go in the last sweep
MOST_SWEEPS = 200
SWEEPS_BETWEEN = 24  # under the policy chosen last

# How much closer the distances lie near the goal than at the far end: exp(STRETCH).
STRETCH = 3.5
SHARPNESS = 8  # of the edge of what is near enough: most of it from 0.8 to 1.3 times that error
BEYOND = 5.0  # cost per metre beyond the last distance: as at that, where hops make 4 to 9 cm

#: Swings of each hop that are tried before refinement, by the number of hops.
SWINGS_TRIED = {1: 101, 2: 31, 3: 13}
FINEST_RAD = 5e-3  # of the refinement: swings beside the best are a third of it away


@dataclass(frozen=True, kw_only=True)
class _Grid:
    """What both grids share; what is left of the way is the pose (..., 3) of the goal."""

    scatter: tuple[float, float, float] = (0.022, 0.022, 0.036)

    def perhaps(self, left: FloatArray) -> FloatArray:
        """Return what may be left (..., 6, 3), each as likely, where this is foretold (..., 3)."""
        one = np.sqrt(3.0) * np.diag(self.scatter)
        return relative(np.concatenate([one, -one]), left[..., None, :])


@dataclass(frozen=True, kw_only=True)
class PointGrid(_Grid):
    """Grid of states and swings on which the cost-to-go to a point is computed.

    Parameters
    ----------
    distances, bearings, boom_angles, swings : int
        Number of nodes of each. Distances lie closer near the goal.
    farthest_m : float
        Largest distance, m; beyond it each metre costs as much as the last one before.
    width : float
        Distance that is near enough, m.
    scatter : tuple of float
        Standard deviation of a hop's end about where it is foretold, m, m, rad; by default what a
        model of 100 hops errs by (``model_scores.csv``).
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
        return np.asarray(self.farthest_m * np.expm1(STRETCH * place) / np.expm1(STRETCH))

    def nodes(self) -> FloatArray:
        """Return what is left at the nodes, (D, B, 3)."""
        distance, bearing = self.distances_m[:, None], tables.turn_nodes(self.bearings) - np.pi
        x, y = distance * np.cos(bearing), distance * np.sin(bearing)
        return np.stack([x, y, np.zeros_like(x)], axis=-1)

    def errors(self, left: FloatArray) -> FloatArray:
        """Return the distances of the goal, m."""
        return np.hypot(left[..., 0], left[..., 1])

    def places(self, left: FloatArray) -> tuple[FloatArray, ...]:
        """Return places between the nodes of distance and of bearing, counted in nodes."""
        inner = np.minimum(self.errors(left), self.farthest_m)
        stretched = np.log1p(inner * (np.expm1(STRETCH) / self.farthest_m)) / STRETCH
        bearing = np.arctan2(left[..., 1], left[..., 0]) + np.pi
        return stretched * (self.distances - 1), bearing * (self.bearings / TURN)

    def beyond(self, left: FloatArray) -> FloatArray:
        """Return what the way to the last distance costs."""
        return BEYOND * np.maximum(self.errors(left) - self.farthest_m, 0.0)


@dataclass(frozen=True, kw_only=True)
class HeadingGrid(_Grid):
    """The same for a heading; `width` is the heading error that is small enough, rad."""

    heading_errors: int = 180
    boom_angles: int = 72
    swings: int = 37
    width: float = np.pi / 12

    def nodes(self) -> FloatArray:
        """Return what is left at the nodes, (E, 3)."""
        turn = tables.turn_nodes(self.heading_errors) - np.pi
        return np.stack([np.zeros_like(turn), np.zeros_like(turn), turn], axis=-1)

    def errors(self, left: FloatArray) -> FloatArray:
        """Return the sizes of the heading errors, rad."""
        return np.abs(left[..., 2])

    def places(self, left: FloatArray) -> tuple[FloatArray, ...]:
        """Return places between the nodes, counted in nodes."""
        return ((left[..., 2] + np.pi) * (self.heading_errors / TURN),)

    def beyond(self, left: FloatArray) -> FloatArray:
        """Return nothing: all heading errors are on the grid."""
        return np.zeros(left.shape[:-1])


Grid: TypeAlias = PointGrid | HeadingGrid


def _away(grid: Grid, left: FloatArray) -> FloatArray:
    """Return by how much stances from which this is left are no arrivals, from 0 to 1."""
    return np.asarray(1.0 - 1.0 / (1.0 + (grid.errors(left) / grid.width) ** SHARPNESS))


@dataclass(frozen=True)
class CostToGo:
    """Cost-to-go on a grid.

    Parameters
    ----------
    values : (D, B, A) or (E, A) array
        What is paid on average for a stance that is foretold there, and from it on; by distance,
        bearing and boom angle, or by heading error and boom angle. Bearings and errors are spaced
        evenly from -pi on, boom angles from 0 on.
    grid : PointGrid or HeadingGrid
    """

    values: FloatArray
    grid: Grid

    @cached_property
    def _closed(self) -> FloatArray:
        return _closed(self.values)

    def ahead(self, left: FloatArray, boom_angle_rad: ArrayLike) -> FloatArray:
        """Cost of stances foretold where this is left (..., 3); linear between the nodes."""
        places = (*self.grid.places(left), _boom_places(boom_angle_rad, self.grid.boom_angles))
        return _between(self._closed, np.stack(places)) + self.grid.beyond(left)


def _boom_places(boom_angle_rad: ArrayLike, boom_angles: int) -> FloatArray:
    return np.asarray(boom_angle_rad) % TURN * (boom_angles / TURN)


def _closed(values: FloatArray) -> FloatArray:
    """Values with the first of each angle once more behind the last; all axes but the distance."""
    return np.pad(values, [(0, 0), (0, 1), (0, 1)][-values.ndim :], mode="wrap")


def _between(closed: FloatArray, places: FloatArray) -> FloatArray:
    """Interpolate linearly at places (axes, ...)."""
    from scipy.ndimage import map_coordinates

    return np.asarray(map_coordinates(closed, places, order=1, mode="nearest"))


@cache
def _averages(grid: Grid) -> tuple[FloatArray, Any]:
    """Return a (N, 1) and B (N, N), sparse: a + B v is paid on average from N foretold nodes on.

    Here v (N, ...) is what goes on to be paid from stances at the nodes.
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
    return (away * (1.0 + DISCOUNT * grid.beyond(left))).sum(axis=1, keepdims=True), total


def cost_to_go(
    model: tables.TabulatedMap, grid: Grid, *, begin: CostToGo | None = None
) -> CostToGo:
    """Return the cost-to-go on a grid by policy iteration.

    The best swings are chosen, what they cost is followed over some hops, and they are chosen
    again. Where each swing leads does not change, so that it is worked out once.

    Parameters
    ----------
    model : TabulatedMap
    grid : PointGrid or HeadingGrid
    begin : CostToGo, optional
        On the same grid, for a map that was nearly the same: what one choice of the swings makes of
        it is returned, whether or not it has settled.

    Raises
    ------
    AnalysisError
        If it does not settle, and began with nothing.
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
        """Return what is paid on average where this is paid after a stance."""
        return np.asarray(mean + average @ after.reshape(len(mean), -1)).reshape(after.shape)

    for _ in range(MOST_SWEEPS if begin is None else 1):
        costs = beyond + _between(_closed(values), places)
        best = costs.argmin(axis=-1)[..., None]
        before, values = values, foretold(np.take_along_axis(costs, best, axis=-1)[..., 0])
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
    """Predictive control with a cost-to-go behind the horizon; made by `planner`.

    Parameters
    ----------
    model : TabulatedMap
    objective : ToPoint or ToHeading
    horizon : Horizon
    cost_to_go : CostToGo
        Of the kind of the objective; the same for all points, and for all headings.
    """

    model: tables.TabulatedMap
    objective: objectives.Objective
    horizon: objectives.Horizon
    cost_to_go: CostToGo

    def towards(self, objective: objectives.Objective) -> Planner:
        """Return a planner with another objective; of the other kind, it is computed anew."""
        if isinstance(objective, type(self.objective)):
            return replace(self, objective=objective)
        return planner(self.model, objective, horizon=self.horizon)

    def plan(
        self, pose: ArrayLike, boom_angle_rad: float, previous_swing_rad: float | None = None, /
    ) -> objectives.Plan:
        """Plan from a pose and a boom angle; the previous swing is not used."""
        del previous_swing_rad
        start, boom = objectives.checked_state(pose, boom_angle_rad)
        if isinstance(self.objective, objectives.ToHeading):
            left = relative(start, [*start[:2], self.objective.heading_rad])
        else:
            left = relative(start, [*self.objective.point_m, start[2]])
        hops, limit = self.horizon.hops, self.horizon.swing_limit_rad
        tried = SWINGS_TRIED[hops]
        value, swings = self._best(left, boom, [np.linspace(-limit, limit, tried)] * hops)
        step = 2 * limit / (tried - 1)
        while step > FINEST_RAD:
            near = np.clip(swings[:, None] + step * np.linspace(-1, 1, 7), -limit, limit)
            value, swings = self._best(left, boom, near)
            step /= 3
        return objectives.Plan(swings, predicted_poses(self.model, start, boom, swings), value)

    def _best(
        self, left: FloatArray, boom: float, tried: Iterable[FloatArray]
    ) -> tuple[float, FloatArray]:
        """Return the least cost over all sequences of the swings tried at each hop, and those."""
        grid, total, weight, booms = self.cost_to_go.grid, np.zeros(()), np.ones(()), np.array(boom)
        for hop, swing in enumerate(tried):
            if hop:  # the stance before is foretold, and perhaps an arrival
                away = weight * _away(grid, grid.perhaps(left)).mean(axis=-1)
                total, weight = total + away, DISCOUNT * away
            shape = (*booms.shape, len(swing))
            at = [np.broadcast_to(one, shape).ravel() for one in (booms[..., None], swing)]
            left = relative(self.model.change(*at).reshape(*shape, 3), left[..., None, :])
            booms = booms[..., None] + swing
            total, weight = total[..., None], weight[..., None]
        total = total + weight * self.cost_to_go.ahead(left, booms)
        best = np.unravel_index(total.argmin(), total.shape)
        return float(total[best]), np.array([one[k] for one, k in zip(tried, best, strict=True)])


def planner(
    model: tables.FrameChangeMap,
    objective: objectives.Objective | None = None,
    *,
    horizon: objectives.Horizon | None = None,
    grid: Grid | None = None,
) -> Planner:
    """Compute the cost-to-go, which takes a few seconds, and return the planner that uses it."""
    objective, horizon = objective or objectives.ToPoint(), horizon or objectives.Horizon(hops=2)
    require(horizon.hops in SWINGS_TRIED, "hops", f"one of {sorted(SWINGS_TRIED)}", horizon.hops)
    limit = horizon.swing_limit_rad
    if not (isinstance(model, tables.TabulatedMap) and model.swing_limit_rad == limit):
        model = tables.tabulated(model, limit)
    usual = HeadingGrid if isinstance(objective, objectives.ToHeading) else PointGrid
    return Planner(model, objective, horizon, cost_to_go(model, grid or usual()))


# A planner that goes on learning.

COARSE: dict[type, Grid] = {
    PointGrid: PointGrid(distances=20, bearings=24, boom_angles=16, swings=9),
    HeadingGrid: HeadingGrid(heading_errors=90, boom_angles=32, swings=17),
}
COARSE_TABLE = {"angles": 64, "swings": 17}  # of the corrected map


class AdaptivePlanner:
    """Plans with a map that it corrects at each stance by the hop that has just been made.

    The cost-to-go follows the map by one choice of all swings a hop, on a coarse grid. Each run
    needs a planner of its own, since it remembers.

    Parameters
    ----------
    known : Planner
        What it begins with.
    noise : (3,) array
        Standard deviation of the chance of a hop, m, m, rad.
    """

    def __init__(self, known: Planner, noise: FloatArray) -> None:
        limit = known.model.swing_limit_rad
        self.correction = tables.Correction(limit, np.asarray(noise, dtype=float))
        self._known = tables.tabulated(known.model, limit, **COARSE_TABLE)
        nodes = np.meshgrid(self._known.boom_angle_rad, self._known.swing_rad, indexing="ij")
        self._at = self.correction.functions(*nodes)
        ahead = cost_to_go(self._known, COARSE[type(known.cost_to_go.grid)])
        self._planner = replace(known, cost_to_go=ahead)
        self._before: tuple[FloatArray, float] | None = None

    def towards(self, objective: objectives.Objective) -> AdaptivePlanner:
        """Go on towards another objective of the same kind, with what has been learned."""
        self._planner = self._planner.towards(objective)
        return self

    def plan(
        self, pose: ArrayLike, boom_angle_rad: float, previous_swing_rad: float | None = None, /
    ) -> objectives.Plan:
        """Learn from the hop before, if its swing is known, and plan."""
        here, boom = objectives.checked_state(pose, boom_angle_rad)
        if self._before is not None and previous_swing_rad is not None:
            self._learn(*self._before, previous_swing_rad, here)
        self._before = (here, boom)
        return self._planner.plan(here, boom)

    @one_blas_thread()
    def _learn(self, start: FloatArray, boom: float, swing: float, here: FloatArray) -> None:
        """Correct map and cost-to-go by what a hop has shown."""
        known, limit = self._known, self._known.swing_limit_rad
        swing = float(np.clip(swing, -limit, limit))
        missed = relative(start, here) - known.change(boom, swing)[0]
        missed[2] = wrapped(missed[2])
        self.correction.learn(boom, swing, missed)
        model = tables.TabulatedMap(known.values + self.correction.added(self._at), limit)
        before = self._planner.cost_to_go
        ahead = cost_to_go(model, before.grid, begin=before)
        self._planner = replace(self._planner, model=model, cost_to_go=ahead)
