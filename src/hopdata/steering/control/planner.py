"""A planner that reaches a point from any heading: a short horizon and a cost-to-go.

A turn takes more than three strides. The printed controller, facing away from the
point, therefore sees no inputs that bring it nearer, and stays where it is. The
cost-to-go knows the way round.

With the remaining pose z (that of the goal relative to the robot), the robot's state s
and its inputs u, the planner minimises, over the inputs of the next H strides within
their limits,

    J(u_0, ..., u_H-1) = sum over k = 1 ... H-1 of w_k  +  DISCOUNT w_H-1 V(z_H, s_H),
    z_k+1 = d(s_k, u_k)^-1 z_k,    s_k+1 = f(s_k, u_k),
    w_k = DISCOUNT w_k-1 mean over the samples of a(z_k),    w_0 = 1 / DISCOUNT.

Here d and f are the one-step prediction of the model, a is the share by which a stance
is no arrival, its mean is over the samples about the predicted stance, and the terminal
cost V is the cost-to-go (`hopdata.steering.control.cost_to_go`). So the stage cost of a
stance is one, discounted, times the probability that no stance before it was an
arrival: J is the expected number of strides until the first arrival.

The minimum is sought on a grid of all sequences of inputs, which is then refined about
the best one. From there, scipy's Nelder-Mead finds costs within 0.001 strides of it in
2.5 times the time, and L-BFGS-B within 0.002 in 8 times (median of 40 states: none).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import ConfigError, require
from hopdata.rigid import relative
from hopdata.steering.control import objectives
from hopdata.steering.control.cost_to_go import (
    DISCOUNT,
    CostToGo,
    cost_to_go,
    input_nodes,
)
from hopdata.steering.control.grids import (
    Grid,
    HeadingGrid,
    PointGrid,
    coarse,
    not_arrived,
)
from hopdata.steering.control.interface import Plan, checked_state
from hopdata.steering.control.prediction import (
    next_state,
    poses_ahead,
    predicted_change,
)
from hopdata.steering.frame_changes import is_hopper
from hopdata.steering.models.interface import StrideModel
from hopdata.steering.models.process import FrameChangeProcess
from hopdata.steering.models.stride_table import StrideTable, tabulated
from hopdata.steering.strides import StrideAxes

#: Number of values tried of an input in each stride before refinement, by the number
#: of strides; with two inputs its square root.
#: Unit: 1. Origin: chosen.
INPUTS_TRIED = {1: 101, 2: 31, 3: 13}
#: Smallest step of the refinement, as a share of an input's range.
#: Unit: 1. Origin: chosen: 5 mrad of the hopper's swings.
FINEST_SHARE = 0.002
#: Values that the refinement tries about the best so far, a third of a step apart.
#: Unit: 1. Origin: derived: the outermost are the neighbours that were tried before.
INPUTS_REFINED = 7
#: Factor by which the step of the refinement shrinks: the distance of its values.
#: Unit: 1. Origin: derived: the steps between `INPUTS_REFINED` values on each side.
REFINEMENT = 3

# The sequences of more inputs are too many to be tried.
MOST_INPUTS = 2
#: Strides of a cost-to-go above which its time and memory are told beforehand.
#: Unit: 1. Origin: chosen: twice those of the hopper, which take some two seconds.
MOST_STRIDES = 3_200_000
#: Memory of a cost-to-go for each of its strides.
#: Unit: bytes. Origin: derived: tail, cost and three locations, a copy of each.
BYTES_A_STRIDE = 80

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Search:
    """Inputs that are tried in each stride: everywhere, then about the best so far.

    Parameters
    ----------
    lower, upper : (U,) array
        Limits of the inputs.
    everywhere : (n, U) array
        Tried first.
    refined : tuple of (m, U) array
        Tried next, relative to the best so far, with smaller and smaller steps.
    """

    lower: FloatArray
    upper: FloatArray
    everywhere: FloatArray
    refined: tuple[FloatArray, ...]

    @classmethod
    def of(cls, horizon: objectives.Horizon, axes: StrideAxes) -> Search:
        """Return the search within a horizon."""
        lower, upper = horizon.limits(axes)
        n_inputs = len(lower)
        n_tried = round(INPUTS_TRIED[horizon.hops] ** (1 / n_inputs))
        ones = np.ones(n_inputs)
        about = input_nodes(-ones, ones, INPUTS_REFINED)
        refined = []
        share = 1.0 / (n_tried - 1)
        step = (upper - lower) / (n_tried - 1)
        while share > FINEST_SHARE:
            refined.append(step * about)
            step = step / REFINEMENT
            share /= REFINEMENT
        everywhere = input_nodes(lower, upper, n_tried)
        return cls(lower, upper, everywhere, tuple(refined))


@dataclass(frozen=True)
class Planner:
    """Predictive control with the cost-to-go beyond the horizon; made by `planner`.

    Parameters
    ----------
    model : StrideTable
        Model of which the cost-to-go is.
    objective : ToPoint or ToHeading
    horizon : Horizon
    cost_to_go : CostToGo
        Of the same kind as the objective; one serves all points, or all headings.
    near_model : StrideModel, optional
        Model of the strides within the horizon, by default the same. It may have more
        states, after those of the cost-to-go.
    """

    model: StrideTable
    objective: objectives.Objective
    horizon: objectives.Horizon
    cost_to_go: CostToGo
    near_model: StrideModel | None = None

    @property
    def predictor(self) -> StrideModel:
        """The model of the strides within the horizon."""
        return self.near_model or self.model

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
        state: ArrayLike,
        previous_inputs: ArrayLike | None = None,
        /,
    ) -> Plan:
        """Plan from a pose and the states; the previous inputs are ignored."""
        del previous_inputs
        here, states = checked_state(pose, state, self.predictor.axes)
        remaining = self.remaining(here)
        cost, inputs = self._minimum(remaining, states)
        poses = poses_ahead(self.predictor, here, states, inputs)
        return Plan(inputs, poses, cost)

    def remaining(self, here: FloatArray) -> FloatArray:
        """Return the pose of the goal relative to poses (..., 3).

        What does not count of the goal's pose is as it is here.
        """
        goal = here.copy()
        if isinstance(self.objective, objectives.ToHeading):
            goal[..., 2] = self.objective.heading_rad
        else:
            goal[..., :2] = self.objective.point_m
        return relative(here, goal)

    @cached_property
    def _search(self) -> Search:
        return Search.of(self.horizon, self.model.axes)

    def _minimum(
        self, remaining: FloatArray, state: FloatArray
    ) -> tuple[float, FloatArray]:
        """Return the least cost and its inputs (H, U), sought ever finer."""
        search = self._search
        tried: Sequence[FloatArray] = [search.everywhere] * self.horizon.hops
        cost, inputs = self._best(remaining, state, tried)
        for around in search.refined:
            near = inputs[:, None] + around
            tried = list(np.clip(near, search.lower, search.upper))
            cost, inputs = self._best(remaining, state, tried)
        return cost, inputs

    def _best(
        self, remaining: FloatArray, state: FloatArray, tried: Sequence[FloatArray]
    ) -> tuple[float, FloatArray]:
        """Return the least cost over the sequences that are tried, and its inputs."""
        total = self.costs(remaining, state, tried)
        best = np.unravel_index(total.argmin(), total.shape)
        chosen = [inputs[k] for inputs, k in zip(tried, best, strict=True)]
        return float(total[best]), np.array(chosen)

    def costs(
        self, remaining: FloatArray, state: FloatArray, tried: Sequence[FloatArray]
    ) -> FloatArray:
        """Return the costs (..., n_1, ..., n_H) of all sequences of the inputs tried.

        Parameters
        ----------
        remaining : (..., 3) array
            Remaining poses.
        state : (..., S) array
        tried : sequence of (n, U) array
            Inputs that are tried in each stride; each adds an axis to the costs.
        """
        grid = self.cost_to_go.grid
        total = np.zeros(())
        weight = np.ones(())
        for stride, inputs in enumerate(tried):
            if stride > 0:
                # The previous stance is only predicted, and may be an arrival.
                samples = grid.samples(remaining)
                goes_on = weight * not_arrived(grid, samples).mean(axis=-1)
                total = total + goes_on
                weight = DISCOUNT * goes_on
            before = state[..., None, :]
            change = predicted_change(self.predictor, before, inputs)
            state = next_state(self.predictor, before, inputs)
            remaining = relative(change, remaining[..., None, :])
            total = total[..., None]
            weight = weight[..., None]
        return np.asarray(total + weight * self.cost_to_go.at(remaining, state))


def planner(
    model: StrideModel,
    objective: objectives.Objective | None = None,
    *,
    horizon: objectives.Horizon | None = None,
    grid: Grid | None = None,
    few_nodes: bool = False,
    state_limits: tuple[float, float] | None = None,
) -> Planner:
    """Return a planner after computing its cost-to-go.

    It takes a few seconds, with two inputs and a state a minute and some 3 GB unless
    `few_nodes`; more than a few seconds are told before they begin.

    Supported are robots with no state, one periodic state or one linear state, and one
    input or two.

    Parameters
    ----------
    model : StrideModel
    objective : ToPoint or ToHeading, optional
        By default to the origin.
    horizon : Horizon, optional
        By default two strides.
    grid : PointGrid or HeadingGrid, optional
        By default the hopper's; for another robot with its own scatter and tail cost.
    few_nodes : bool
        Whether the default grid has so few nodes that the cost-to-go takes a second.
        A grid that is given has its own nodes.
    state_limits : (float, float), optional
        Least and largest value of a linear state; by default those of the strides that
        the model has learned from, or of the input that sets it.

    Raises
    ------
    ConfigError
        If the robot is not supported, or the limits of its state are not known; if
        `few_nodes` is asked for beside a grid.
    """
    if few_nodes and grid is not None:
        wanted = "no few_nodes beside a grid, which has its own nodes"
        raise ConfigError.at("planner", wanted, "few_nodes=True")
    objective = objective or objectives.ToPoint()
    horizon = horizon or objectives.Horizon(hops=2)
    known = f"one of {sorted(INPUTS_TRIED)}"
    require(horizon.hops in INPUTS_TRIED, "hops", known, horizon.hops)
    table = _tabulated(model, horizon, state_limits)
    if grid is None:
        to_heading = isinstance(objective, objectives.ToHeading)
        grid = HeadingGrid() if to_heading else PointGrid()
        if not is_hopper(table.axes):
            grid = _grid_of(grid, table)
        if few_nodes:
            grid = coarse(grid)
    _warn_of_time(table.axes, grid)
    return Planner(table, objective, horizon, cost_to_go(table, grid))


def _combinations(axes: StrideAxes, grid: Grid) -> tuple[int, int]:
    """Return the numbers of nodes, and of combinations of inputs tried from each."""
    n_states = grid.states if axes.states else 1
    n_nodes = math.prod(grid.nodes().shape[:-1]) * n_states
    return n_nodes, grid.inputs ** len(axes.inputs)


def _warn_of_time(axes: StrideAxes, grid: Grid) -> None:
    """Say before a cost-to-go that takes minutes that it does, and what is quicker."""
    n_nodes, n_inputs = _combinations(axes, grid)
    if n_nodes * n_inputs <= MOST_STRIDES:
        return
    by_default = type(grid)()  # few_nodes makes that coarser, not a grid that is given
    few_nodes, few_inputs = _combinations(axes, coarse(by_default))
    logger.warning(
        "planner: the cost-to-go tries %d combinations of %s from each of %d nodes. "
        "That takes a minute or more and some %.0f MB. planner(..., few_nodes=True) "
        "tries %d from each of %d, with %.0f MB.",
        n_inputs,
        " and ".join(axes.input_names),
        n_nodes,
        n_nodes * n_inputs * BYTES_A_STRIDE / 1e6,
        few_inputs,
        few_nodes,
        few_nodes * few_inputs * BYTES_A_STRIDE / 1e6,
    )


def _tabulated(
    model: StrideModel,
    horizon: objectives.Horizon,
    state_limits: tuple[float, float] | None,
) -> StrideTable:
    """Return the model as a table, for which this robot must be supported."""
    axes = model.axes
    if len(axes.states) > 1:
        states = ", ".join(state.name for state in axes.states)
        raise ConfigError.at("planner", "a robot with at most one state", states)
    if len(axes.inputs) > MOST_INPUTS:
        found = ", ".join(axes.input_names)
        raise ConfigError.at("planner", f"at most {MOST_INPUTS} inputs", found)
    lower, upper = horizon.limits(axes)
    if isinstance(model, StrideTable):
        return model.within(lower, upper)
    if axes.linear:
        limits = [state_limits or _limits_of_state(model)]
        return tabulated(model, state_limits=limits, lower=lower, upper=upper)
    if isinstance(model, FrameChangeProcess):  # which may have its table already
        return model.within(lower, upper)
    return tabulated(model, lower=lower, upper=upper)


def _limits_of_state(model: StrideModel) -> tuple[float, float]:
    """Return the least and the largest value of the only, linear state."""
    axes = model.axes
    (state,) = axes.linear
    if state.set_by:
        source = axes.input_names.index(state.set_by)
        return float(axes.lower[source]), float(axes.upper[source])
    learned_from: Any = getattr(model, "points", None)
    if learned_from is None:
        wanted = f"the limits of the state {state.name}, as state_limits"
        raise ConfigError.at("planner", wanted, "none")
    values = learned_from[:, 0]
    return float(values.min()), float(values.max())


def _grid_of(grid: Grid, table: StrideTable) -> Grid:
    """Return a grid with the scatter and the tail cost of a robot's own strides."""
    if table.noise_sd is not None:
        x, y, turn = np.asarray(table.noise_sd, dtype=float).tolist()
        grid = replace(grid, scatter=(x, y, turn))
    if isinstance(grid, PointGrid):
        ahead = table.values[..., :2]
        longest_m = float(np.hypot(ahead[..., 0], ahead[..., 1]).max())
        n_strides = grid.farthest_m / longest_m
        slope = DISCOUNT**n_strides / longest_m
        grid = replace(grid, tail_cost_per_m=slope)
    return grid
