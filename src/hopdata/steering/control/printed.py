"""The controller as printed: direct single shooting with L-BFGS-B (Sec. 3.4.3).

Let g be the pose, s the states of the robot and u its inputs. The controller minimises,
over the inputs of the next H strides within their limits,

    J(u_0, ..., u_H-1) = sum over k = 1 ... H of error(g_k),

where g_k and s_k follow from g_0 and s_0 by the one-step prediction, and the error is
the distance to the point or the absolute heading error. There is no terminal cost.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, one_blas_thread
from hopdata.steering.control import objectives
from hopdata.steering.control.interface import Plan, checked_state
from hopdata.steering.control.prediction import poses_ahead
from hopdata.steering.models.interface import StrideModel
from hopdata.steering.models.process import has_table
from hopdata.steering.models.stride_table import StrideTable

#: Step of the finite differences of the objective.
#: Unit: rad. Origin: convention: scipy's own, but with all differences at once.
DIFFERENCE_RAD = 1e-8

# The objective by inputs and the steps of their differences.
Values: TypeAlias = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True, kw_only=True)
class PrintedController:
    """Predictive control by scipy's L-BFGS-B with finite differences of the objective.

    The text does not say where the search begins. A single descent does not find the
    other way round, so up to four are made and the best is kept. They begin with the
    same inputs in all strides: halfway from the middle to their upper limits, in the
    middle, halfway to the lower limits, or as in the previous stride. For the hopper
    these are half the largest swing to the left, none, half of it to the right, and the
    last swing.

    Parameters
    ----------
    model : StrideModel
    objective : ToPoint or ToHeading
    horizon : Horizon
    """

    model: StrideModel
    objective: objectives.Objective = field(default_factory=objectives.ToPoint)
    horizon: objectives.Horizon = field(default_factory=objectives.Horizon)

    def towards(self, objective: objectives.Objective) -> Self:
        """Return the same controller with another objective."""
        return replace(self, objective=objective)

    @one_blas_thread()
    def plan(
        self,
        pose: ArrayLike,
        state: ArrayLike,
        previous_inputs: ArrayLike | None = None,
        /,
    ) -> Plan:
        """Plan from a pose and the states; one search begins with the last inputs."""
        axes = self.model.axes
        here, states = checked_state(pose, state, axes)
        firsts = self.first_inputs(previous_inputs)
        ends = [self.descended(here, states, first) for first in firsts]
        solved = min(ends, key=lambda end: end.fun)
        inputs = solved.x.reshape(self.horizon.hops, -1)
        poses = poses_ahead(self.model, here, states, inputs)
        return Plan(inputs, poses, float(solved.fun))

    def first_inputs(
        self, previous_inputs: ArrayLike | None
    ) -> tuple[tuple[float, ...], ...]:
        """Return the inputs (U,) at which the searches begin, without repeats."""
        lower, upper = self.horizon.limits(self.model.axes)
        middle = (lower + upper) / 2
        half = (upper - lower) / 4
        firsts = [middle + half, middle, middle - half]
        if previous_inputs is not None:
            again = np.asarray(previous_inputs, dtype=float).reshape(-1)
            if np.isfinite(again).all():
                firsts.append(np.clip(again, lower, upper))
        return tuple(dict.fromkeys(tuple(first.tolist()) for first in firsts))

    def descended(self, pose: FloatArray, state: ArrayLike, first: ArrayLike) -> Any:
        """Search from the same initial inputs (U,) in all strides."""
        from scipy.optimize import minimize

        n_strides = self.horizon.hops
        limits = self.horizon.limits(self.model.axes)
        lower, upper = (np.tile(limit, n_strides) for limit in limits)
        values_at = self.values_from(pose, state)

        def value_and_slope(inputs: FloatArray) -> tuple[float, FloatArray]:
            """Return the objective, and its slope by differences within the limits."""
            at_limit = inputs + DIFFERENCE_RAD > upper
            steps = np.where(at_limit, -DIFFERENCE_RAD, DIFFERENCE_RAD)
            values = values_at(inputs, steps)
            taken = (inputs + steps) - inputs  # the steps as rounded
            return float(values[0]), (values[1:] - values[0]) / taken

        return minimize(
            value_and_slope,
            np.tile(first, n_strides),
            jac=True,
            method="L-BFGS-B",
            bounds=list(zip(lower.tolist(), upper.tolist(), strict=True)),
        )

    def values_from(self, pose: FloatArray, state: ArrayLike) -> Values:
        """Return a function that gives the objective by inputs and their steps.

        It takes inputs (H U,) and steps (H U,), and returns the value at the inputs as
        they are, then with each of them changed by its step in turn, (H U + 1,).
        """
        if isinstance(self.model, StrideTable) and self._is_compiled_for(self.model):
            return self._compiled(self.model, pose, state)
        n_strides = self.horizon.hops

        def values(inputs: FloatArray, steps: FloatArray) -> FloatArray:
            tried = inputs + np.vstack([np.zeros(len(inputs)), np.diag(steps)])
            by_stride = tried.reshape(len(tried), n_strides, -1)
            poses = poses_ahead(self.model, pose, state, by_stride)
            errors = objectives.goal_errors(self.objective, poses[1:])
            return np.asarray(errors.sum(axis=0))

        return values

    def _is_compiled_for(self, table: StrideTable) -> bool:
        """Tell whether it is over one angle and one input, none beyond its limits."""
        axes = table.axes
        lower, upper = self.horizon.limits(axes)
        is_within = bool((lower >= axes.lower).all() and (upper <= axes.upper).all())
        return has_table(axes) and is_within

    def _compiled(
        self, table: StrideTable, pose: FloatArray, state: ArrayLike
    ) -> Values:
        """Return the same function for a table over an angle and an input, compiled."""
        from hopdata.steering.control.printed_objective import fill_values

        knots_and_coefficients = table.spline_parts
        start = (*pose.tolist(), float(np.asarray(state).item()))
        is_heading = isinstance(self.objective, objectives.ToHeading)
        numbers: tuple[float, float]
        if isinstance(self.objective, objectives.ToHeading):
            numbers = (self.objective.heading_rad, 0.0)
        else:
            numbers = self.objective.point_m
        goal = (float(numbers[0]), float(numbers[1]))

        def values(inputs: FloatArray, steps: FloatArray) -> FloatArray:
            filled = np.empty(len(inputs) + 1)
            fill_values(
                knots_and_coefficients, start, inputs, steps, goal, is_heading, filled
            )
            return filled

        return values
