"""A planner that gets to a point from any heading: a short look ahead, then the cost-to-go.

Three hops are fewer than a turn takes, so the printed controller, facing away, sees no way that
brings it nearer, and hops on the spot. The cost-to-go knows the way round.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import ConfigError
from hopdata.rigid import wrapped
from hopdata.steering.control import objectives
from hopdata.steering.control import planner_values as values
from hopdata.steering.control.printed import predicted_poses
from hopdata.steering.models.tabulated import FrameChangeMap, TabulatedMap, tabulated

#: Swings of each hop that are tried before refinement, by the number of hops.
SWINGS_TRIED = {1: 101, 2: 31, 3: 13}


@dataclass(frozen=True, kw_only=True)
class PlannerOptions:
    """What the cost-to-go weighs, and on which grids it is computed."""

    point: values.StageCost = field(default_factory=lambda: values.StageCost(width=0.2))
    heading: values.StageCost = field(default_factory=lambda: values.StageCost(width=0.15))
    point_grid: values.PointGrid = field(default_factory=values.PointGrid)
    heading_grid: values.HeadingGrid = field(default_factory=values.HeadingGrid)


@dataclass(frozen=True)
class Planner:
    """Predictive control with a cost-to-go behind the horizon; made by `planner`.

    Parameters
    ----------
    model : TabulatedMap
    objective : ToPoint or ToHeading
    horizon : Horizon
    options : PlannerOptions
    cost_to_go : CostToGo
        Of the kind of the objective; the same for all points, and for all headings.
    """

    model: TabulatedMap
    objective: objectives.Objective
    horizon: objectives.Horizon
    options: PlannerOptions
    cost_to_go: values.CostToGo

    def towards(self, objective: objectives.Objective) -> Planner:
        """Return a planner with another objective; of the other kind, it is computed anew."""
        if isinstance(objective, type(self.objective)):
            return replace(self, objective=objective)
        return planner(self.model, objective, horizon=self.horizon, options=self.options)

    def plan(
        self, pose: ArrayLike, boom_angle_rad: float, previous_swing_rad: float | None = None, /
    ) -> objectives.Plan:
        """Plan from a pose and a boom angle; the previous swing is not used."""
        del previous_swing_rad
        start, boom = objectives.checked_state(pose, boom_angle_rad)
        swings = np.empty(self.horizon.hops)
        value = values.best_ahead(
            self.model.coefficients,
            self.horizon.swing_limit_rad,
            self.cost_to_go.layers,
            self.cost_to_go.farthest_m,
            self.cost_to_go.stage.width,
            self.cost_to_go.stage.discount,
            isinstance(self.objective, objectives.ToHeading),
            _left(self.objective, start),
            boom,
            SWINGS_TRIED[self.horizon.hops],
            swings,
        )
        return objectives.Plan(swings, predicted_poses(self.model, start, boom, swings), value)


def planner(
    model: FrameChangeMap,
    objective: objectives.Objective | None = None,
    *,
    horizon: objectives.Horizon | None = None,
    options: PlannerOptions | None = None,
) -> Planner:
    """Compute the cost-to-go, which takes a few seconds, and return the planner that uses it."""
    objective, horizon = objective or objectives.ToPoint(), horizon or objectives.Horizon(hops=2)
    options = options or PlannerOptions()
    if horizon.hops not in SWINGS_TRIED:
        raise ConfigError(f"hops: expected one of {sorted(SWINGS_TRIED)}, found {horizon.hops}")
    limit = horizon.swing_limit_rad
    if not (isinstance(model, TabulatedMap) and model.swing_limit_rad == limit):
        model = tabulated(model, limit)
    if isinstance(objective, objectives.ToHeading):
        cost = values.to_a_heading(model, options.heading, options.heading_grid)
    else:
        cost = values.to_a_point(model, options.point, options.point_grid)
    return Planner(model, objective, horizon, options, cost)


def _left(objective: objectives.Objective, pose: FloatArray) -> FloatArray:
    """Return what is left of the way, in the body frame: the point (m, m), or the turn (rad)."""
    if isinstance(objective, objectives.ToHeading):
        return np.array([0.0, 0.0, wrapped(objective.heading_rad - pose[2])])
    away = np.array(objective.point_m) - pose[:2]
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.array([c * away[0] + s * away[1], c * away[1] - s * away[0], 0.0])
