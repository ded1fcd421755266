"""A planner that gets to a point from any heading: a short look ahead, then the cost-to-go.

Three hops are fewer than a turn takes, so the printed controller, facing away, sees no way that
brings it nearer, and hops on the spot. The cost-to-go knows the way round.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import cos, sin
from typing import TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.code_cache import kept_njit
from hopdata.errors import ConfigError
from hopdata.rigid import wrapped
from hopdata.steering.control.objectives import (
    Horizon,
    Objective,
    Plan,
    ToHeading,
    ToPoint,
    checked_state,
)
from hopdata.steering.control.planner_values import (
    CostToGo,
    HeadingGrid,
    PointGrid,
    StageCost,
    heading_value,
    point_value,
    stage_cost,
    to_a_heading,
    to_a_point,
    wrap,
)
from hopdata.steering.control.printed import predicted_poses
from hopdata.steering.models.tabulated import FrameChangeMap, TabulatedMap, spline_change, tabulated

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
    change, gradient = np.empty(3), np.empty((3, 2))
    for k in range(swings.size):
        spline_change(coefficients, limit, boom, swings[k], change, gradient)
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


# Models as the tables that the compiled controllers take.


def table_of(model: FrameChangeMap, swing_limit_rad: float) -> TabulatedMap:
    """Tabulate a model unless it is a table of boom angle and swing with this limit."""
    if _fits(model, swing_limit_rad):
        return model
    return tabulated(model, swing_limit_rad)


def _fits(model: FrameChangeMap, swing_limit_rad: float) -> TypeGuard[TabulatedMap]:
    if not isinstance(model, TabulatedMap):
        return False
    return model.values.ndim == 3 and model.swing_limit_rad == swing_limit_rad


#: Swings of each hop that are tried before refinement, by the number of hops.
SWINGS_TRIED = {1: 101, 2: 31, 3: 13}


@dataclass(frozen=True, kw_only=True)
class PlannerOptions:
    """What the cost-to-go weighs, and on which grids it is computed."""

    point: StageCost = field(default_factory=lambda: StageCost(width=0.2))
    heading: StageCost = field(default_factory=lambda: StageCost(width=0.15))
    point_grid: PointGrid = field(default_factory=PointGrid)
    heading_grid: HeadingGrid = field(default_factory=HeadingGrid)


@dataclass(frozen=True)
class Planner:
    """Predictive control with a cost-to-go behind the horizon; made by `planner`.

    Parameters
    ----------
    model : TabulatedMap
    objective : ToPoint or ToHeading
        Penalty and stances of it are not used: the cost is that of the cost-to-go.
    horizon : Horizon
    options : PlannerOptions
    cost_to_go : CostToGo
        Of the kind of the objective; the same for all points, and for all headings.
    """

    model: TabulatedMap
    objective: Objective
    horizon: Horizon
    options: PlannerOptions
    cost_to_go: CostToGo

    def towards(self, objective: Objective) -> Planner:
        """Return a planner with another objective; of the other kind, it is computed anew."""
        if isinstance(objective, type(self.objective)):
            return replace(self, objective=objective)
        return planner(self.model, objective, horizon=self.horizon, options=self.options)

    def plan(
        self, pose: ArrayLike, boom_angle_rad: float, previous_swing_rad: float | None = None, /
    ) -> Plan:
        """Plan from a pose and a boom angle; the previous swing is not used."""
        del previous_swing_rad
        start, boom = checked_state(pose, boom_angle_rad)
        swings = np.empty(self.horizon.hops)
        value = best_ahead(
            self.model.coefficients,
            self.horizon.swing_limit_rad,
            self.cost_to_go.layers,
            self.cost_to_go.farthest_m,
            self.cost_to_go.stage.width,
            self.cost_to_go.stage.discount,
            isinstance(self.objective, ToHeading),
            _left(self.objective, start),
            boom,
            SWINGS_TRIED[self.horizon.hops],
            swings,
        )
        return Plan(swings, predicted_poses(self.model, start, boom, swings), value)


def planner(
    model: FrameChangeMap,
    objective: Objective | None = None,
    *,
    horizon: Horizon | None = None,
    options: PlannerOptions | None = None,
) -> Planner:
    """Compute the cost-to-go, which takes a few seconds, and return the planner that uses it."""
    objective, horizon = objective or ToPoint(), horizon or Horizon(hops=2)
    options = options or PlannerOptions()
    if horizon.hops not in SWINGS_TRIED:
        raise ConfigError(f"hops: expected one of {sorted(SWINGS_TRIED)}, found {horizon.hops}")
    spline = table_of(model, horizon.swing_limit_rad)
    if isinstance(objective, ToHeading):
        cost = to_a_heading(spline, options.heading, options.heading_grid)
    else:
        cost = to_a_point(spline, options.point, options.point_grid)
    return Planner(spline, objective, horizon, options, cost)


def _left(objective: Objective, pose: FloatArray) -> FloatArray:
    """Return what is left of the way, in the body frame: the point (m, m), or the turn (rad)."""
    if isinstance(objective, ToHeading):
        return np.array([0.0, 0.0, wrapped(objective.heading_rad - pose[2])])
    away = np.array(objective.point_m) - pose[:2]
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.array([c * away[0] + s * away[1], c * away[1] - s * away[0], 0.0])
