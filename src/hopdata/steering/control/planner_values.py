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
from math import atan2, cos, exp, floor, log, pi, sin, sqrt

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.code_cache import kept_njit
from hopdata.errors import AnalysisError, ConfigError
from hopdata.steering.models.tabulated import LEAST_NODES, TabulatedMap, spline_change, turn_nodes


@kept_njit(nogil=True, error_model="numpy")
def wrap(angle):  # type: ignore[no-untyped-def]
    """Bring an angle to [-pi, pi)."""
    return (angle + pi) % (2.0 * pi) - pi


# Compiled value iteration for "go to a point": by distance, bearing and boom angle.
#
# Where each hop leads does not change from sweep to sweep, so that it is worked out once.

#: How much closer the distances lie near the goal than at the far end: exp(STRETCH).
STRETCH = 3.5
#: Cost per metre beyond the last distance.
BEYOND = 1.0


def distances_of(count: int, farthest_m: float) -> FloatArray:
    """Distances (count,) of the nodes, m."""
    place = np.linspace(0.0, 1.0, count)
    return np.asarray(farthest_m * np.expm1(STRETCH * place) / np.expm1(STRETCH))


@kept_njit(nogil=True, error_model="numpy")
def stage_cost(squared_error, width):  # type: ignore[no-untyped-def]
    """Cost of a stance from its squared error."""
    return squared_error / (squared_error + width * width)


@kept_njit(nogil=True, error_model="numpy")
def _place(count, bearings, farthest, x, y):  # type: ignore[no-untyped-def]
    """Cell of a goal at (x, y), its places in the cell, and the distance beyond the farthest."""
    distance = sqrt(x * x + y * y)
    excess = max(0.0, distance - farthest)
    scale = (exp(STRETCH) - 1.0) / farthest
    d = log(1.0 + (distance - excess) * scale) * ((count - 1) / STRETCH)
    i = min(int(d), count - 2)
    b = (atan2(y, x) + pi) * (bearings / (2.0 * pi))
    j = min(int(b), bearings - 1)
    return i, j, d - i, b - j, excess


@kept_njit(nogil=True, error_model="numpy")
def boom_place(angles, boom):  # type: ignore[no-untyped-def]
    """Cell of a boom angle, and its place in it."""
    a = boom * (angles / (2.0 * pi))
    cell = floor(a)
    return int(cell) % angles, a - cell


@kept_njit(nogil=True, error_model="numpy")
def _between(values, i, j, k, d, b, a):  # type: ignore[no-untyped-def]
    """Linear interpolation; bearing and boom angle go round."""
    j1 = j + 1 if j + 1 < values.shape[1] else 0
    k1 = k + 1 if k + 1 < values.shape[2] else 0
    near = (1.0 - b) * ((1.0 - a) * values[i, j, k] + a * values[i, j, k1])
    near += b * ((1.0 - a) * values[i, j1, k] + a * values[i, j1, k1])
    far = (1.0 - b) * ((1.0 - a) * values[i + 1, j, k] + a * values[i + 1, j, k1])
    far += b * ((1.0 - a) * values[i + 1, j1, k] + a * values[i + 1, j1, k1])
    return (1.0 - d) * near + d * far


@kept_njit(nogil=True, error_model="numpy")
def point_value(values, farthest, x, y, boom):  # type: ignore[no-untyped-def]
    """Cost-to-go where the goal is at (x, y) in the body frame; linear between the nodes."""
    count, bearings, angles = values.shape
    i, j, d, b, excess = _place(count, bearings, farthest, x, y)
    k, a = boom_place(angles, boom)
    return _between(values, i, j, k, d, b, a) + BEYOND * excess


@kept_njit(nogil=True, error_model="numpy")
def point_hops(distances, bearings, changes, width, discount, cells, places):  # type: ignore[no-untyped-def]
    """Where each swing leads from each node, over (D, B, A, U).

    Fills `cells` (..., 2) by those of distance and bearing, and `places` (..., 3) by the places in
    them and the cost of the stance.
    """
    count, farthest = distances.size, distances[-1]
    for i in range(count):
        for j in range(bearings):
            bearing = 2.0 * pi * j / bearings - pi
            x, y = distances[i] * cos(bearing), distances[i] * sin(bearing)
            for k in range(changes.shape[0]):
                for u in range(changes.shape[1]):
                    c, s = cos(changes[k, u, 2]), sin(changes[k, u, 2])
                    px, py = x - changes[k, u, 0], y - changes[k, u, 1]
                    i1, j1, d, b, excess = _place(
                        count, bearings, farthest, c * px + s * py, c * py - s * px
                    )
                    cost = stage_cost(px * px + py * py, width) + discount * BEYOND * excess
                    cells[i, j, k, u, 0], cells[i, j, k, u, 1] = i1, j1
                    places[i, j, k, u, 0], places[i, j, k, u, 1] = d, b
                    places[i, j, k, u, 2] = cost


@kept_njit(nogil=True, error_model="numpy")
def improve_point(values, policy, choose, cells, places, boom_cells, boom_places, discount):  # type: ignore[no-untyped-def]
    """Sweep once over `values` (D, B, A) in place; the largest change.

    `choose` the best swing at each node into `policy`, or keep to that. The boom angles that swings
    lead to are in `boom_cells` and `boom_places` (A, U).
    """
    count, bearings, angles = values.shape
    largest = 0.0
    for i in range(count):
        for j in range(bearings):
            for k in range(angles):
                first = 0 if choose else policy[i, j, k]
                last = boom_cells.shape[1] if choose else first + 1
                best = np.inf
                for u in range(first, last):
                    cell, place = cells[i, j, k, u], places[i, j, k, u]
                    ahead = _between(
                        values, cell[0], cell[1], boom_cells[k, u], place[0], place[1],
                        boom_places[k, u],
                    )  # fmt: skip
                    value = place[2] + discount * ahead
                    if value < best:
                        best = value
                        policy[i, j, k] = u
                largest = max(largest, abs(best - values[i, j, k]))
                values[i, j, k] = best
    return largest


# Compiled value iteration for "turn to a heading": by heading error and boom angle.


@kept_njit(nogil=True, error_model="numpy")
def heading_value(values, error, boom):  # type: ignore[no-untyped-def]
    """Cost-to-go at a heading error in [-pi, pi) and a boom angle; linear between the nodes."""
    errors, angles = values.shape
    e = (error + pi) * (errors / (2.0 * pi))
    i = min(int(e), errors - 1)
    e -= i
    k, a = boom_place(angles, boom)
    i1 = i + 1 if i + 1 < errors else 0
    k1 = k + 1 if k + 1 < angles else 0
    return (1.0 - e) * ((1.0 - a) * values[i, k] + a * values[i, k1]) + e * (
        (1.0 - a) * values[i1, k] + a * values[i1, k1]
    )


@kept_njit(nogil=True, error_model="numpy")
def improve_heading(values, policy, choose, turns, swings, width, discount):  # type: ignore[no-untyped-def]
    """Sweep once over `values` (E, A) in place; the largest change.

    The error is the heading wanted less the heading. `choose` the best swing at each node into
    `policy`, or keep to that.
    """
    errors, angles = values.shape
    largest = 0.0
    for i in range(errors):
        error = 2.0 * pi * i / errors - pi
        for k in range(angles):
            boom = 2.0 * pi * k / angles
            first = 0 if choose else policy[i, k]
            last = swings.size if choose else first + 1
            best = np.inf
            for u in range(first, last):
                left = wrap(error - turns[k, u])
                ahead = heading_value(values, left, boom + swings[u])
                value = stage_cost(left * left, width) + discount * ahead
                if value < best:
                    best = value
                    policy[i, k] = u
            largest = max(largest, abs(best - values[i, k]))
            values[i, k] = best
    return largest


# Compiled search for the next swings with the cost-to-go at the end of a short look ahead.


@kept_njit(nogil=True, error_model="numpy")
def _hop(error, change, is_heading, after):  # type: ignore[no-untyped-def]
    """Fill `after` (3,): what is left of the way to the goal, in the body frame, after a hop."""
    dx, dy, turn = change
    if is_heading:
        after[0], after[1], after[2] = 0.0, 0.0, wrap(error[2] - turn)
        return
    c, s = cos(turn), sin(turn)
    px, py = error[0] - dx, error[1] - dy
    after[0], after[1], after[2] = c * px + s * py, c * py - s * px, 0.0


@kept_njit(nogil=True, error_model="numpy")
def _ahead(values, farthest, error, boom, is_heading):  # type: ignore[no-untyped-def]
    if is_heading:
        return heading_value(values[0], error[2], boom)
    return point_value(values, farthest, error[0], error[1], boom)


@kept_njit(nogil=True, error_model="numpy")
def _stage(error, width):  # type: ignore[no-untyped-def]
    return stage_cost(error[0] ** 2 + error[1] ** 2 + error[2] ** 2, width)


@kept_njit(nogil=True, error_model="numpy")
def cost_of(  # type: ignore[no-untyped-def]
    coefficients, limit, values, farthest, width, discount, is_heading, error, boom, swings, errors
):
    """Cost of swings (H,) and of all that comes after; `errors` (H + 1, 3) is filled."""
    errors[0] = error
    total, weight = 0.0, 1.0
    change = np.empty(3)
    for k in range(swings.size):
        spline_change(coefficients, limit, boom, swings[k], change)
        _hop(errors[k], change, is_heading, errors[k + 1])
        boom += swings[k]
        total += weight * _stage(errors[k + 1], width)
        weight *= discount
    return total + weight * _ahead(values, farthest, errors[swings.size], boom, is_heading)


@kept_njit(nogil=True, error_model="numpy")
def best_ahead(  # type: ignore[no-untyped-def]
    coefficients, limit, values, farthest, width, discount, is_heading, error, boom, n, swings
):
    """Fill `swings` (H,) with the best of all sequences of `n` swings a hop, then refined."""
    horizon = swings.size
    trial, errors = np.empty(horizon), np.empty((horizon + 1, 3))
    best = np.inf
    for row in range(n**horizon):
        place = row
        for k in range(horizon):
            trial[k] = -limit + (place % n) * 2.0 * limit / (n - 1)
            place //= n
        value = cost_of(
            coefficients, limit, values, farthest, width, discount, is_heading, error, boom,
            trial, errors,
        )  # fmt: skip
        if value < best:
            best = value
            swings[:] = trial
    step = limit / (n - 1)
    while step > 2e-3:
        improved = False
        for k in range(horizon):
            for side in (-1.0, 1.0):
                trial[:] = swings
                trial[k] = min(max(swings[k] + side * step, -limit), limit)
                value = cost_of(
                    coefficients, limit, values, farthest, width, discount, is_heading, error,
                    boom, trial, errors,
                )  # fmt: skip
                if value < best:
                    best, improved = value, True
                    swings[:] = trial
        if not improved:
            step *= 0.5
    return best


# From compiled sweeps to the cost-to-go.

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
        _check_counts(self)
        if not self.farthest_m > 0:
            raise ConfigError(f"farthest_m: expected more than 0, found {self.farthest_m}")


@dataclass(frozen=True, kw_only=True)
class HeadingGrid:
    """Grid of states and swings on which the cost-to-go to a heading is computed."""

    errors: int = 180
    boom_angles: int = 72
    swings: int = 37

    def __post_init__(self) -> None:
        _check_counts(self)


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


def _check_counts(grid: PointGrid | HeadingGrid) -> None:
    for name, count in vars(grid).items():
        if count < LEAST_NODES and name != "farthest_m":
            raise ConfigError(f"{name}: expected {LEAST_NODES} at least, found {count}")
