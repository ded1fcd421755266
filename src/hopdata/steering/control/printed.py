"""The controller as printed: direct single shooting with L-BFGS-B (Sec. 3.4.3)."""

from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, one_blas_thread
from hopdata.rigid import turned
from hopdata.steering.control import objectives
from hopdata.steering.models.tabulated import FrameChangeMap

#: Step of the finite differences of the objective.
#: Unit: rad. Origin: convention: scipy's own, but with all differences at once.
DIFFERENCE_RAD = 1e-8


@dataclass(frozen=True, kw_only=True)
class PrintedController:
    """Predictive control by scipy's L-BFGS-B with finite differences of the objective.

    The text does not say where the search begins. A single descent does not find the
    other way round, so up to four are made and the best is kept. They begin with the
    same swing in all hops: half the limit to the left, none, half the limit to the
    right, or the previous swing.

    Parameters
    ----------
    model : FrameChangeMap
    objective : ToPoint or ToHeading
    horizon : Horizon
    """

    model: FrameChangeMap
    objective: objectives.Objective = field(default_factory=objectives.ToPoint)
    horizon: objectives.Horizon = field(default_factory=objectives.Horizon)

    def towards(self, objective: objectives.Objective) -> Self:
        """Return the same controller with another objective."""
        return replace(self, objective=objective)

    @one_blas_thread()
    def plan(
        self,
        pose: ArrayLike,
        boom_angle_rad: float,
        previous_swing_rad: float | None = None,
        /,
    ) -> objectives.Plan:
        """Plan from a pose and a boom angle; one search begins with the last swing."""
        start, boom = objectives.checked_state(pose, boom_angle_rad)
        firsts = self.first_swings(previous_swing_rad)
        ends = [self.descended(start, boom, first) for first in firsts]
        solved = min(ends, key=lambda end: end.fun)
        poses = predicted_poses(self.model, start, boom, solved.x)
        return objectives.Plan(solved.x, poses, float(solved.fun))

    def first_swings(self, previous_swing_rad: float | None) -> tuple[float, ...]:
        """Return the swings at which the searches begin, without repeats."""
        limit = self.horizon.swing_limit_rad
        again = limit / 2
        if previous_swing_rad and np.isfinite(previous_swing_rad):
            again = float(np.clip(previous_swing_rad, -limit, limit))
        return tuple(dict.fromkeys((limit / 2, 0.0, -limit / 2, again)))

    def descended(
        self, pose: FloatArray, boom_angle_rad: float, first_rad: float
    ) -> Any:
        """Search from the same initial swing in all hops."""
        from scipy.optimize import minimize

        limit = self.horizon.swing_limit_rad
        hops = self.horizon.hops

        def value_and_slope(swings: FloatArray) -> tuple[float, FloatArray]:
            """Return the objective, and its slope by differences within the limit."""
            at_limit = swings + DIFFERENCE_RAD > limit
            steps = np.where(at_limit, -DIFFERENCE_RAD, DIFFERENCE_RAD)
            # The swings as they are, then with each of them changed in turn.
            tried = swings + np.vstack([np.zeros(hops), np.diag(steps)])
            poses = predicted_poses(self.model, pose, boom_angle_rad, tried)
            values = objectives.goal_errors(self.objective, poses[1:]).sum(axis=0)
            taken = np.diag(tried[1:] - swings)  # the steps as rounded
            return float(values[0]), (values[1:] - values[0]) / taken

        return minimize(
            value_and_slope,
            np.full(hops, first_rad),
            jac=True,
            method="L-BFGS-B",
            bounds=[(-limit, limit)] * hops,
        )


def predicted_poses(
    model: FrameChangeMap, pose: ArrayLike, boom_angle_rad: float, swings_rad: ArrayLike
) -> FloatArray:
    """Return poses (H + 1, ..., 3) after swings (..., H), the present one first.

    They follow Sec. 3.4.1.
    """
    swings = np.moveaxis(np.asarray(swings_rad, dtype=float), -1, 0)
    booms = boom_angle_rad + np.cumsum(swings, axis=0) - swings
    change = model.change(booms.ravel(), swings.ravel()).reshape(*swings.shape, 3)
    present = np.broadcast_to(pose, change[:1].shape)
    steps = np.concatenate([present, change])
    # Each frame change is turned to the world by the heading before it.
    headings = np.cumsum(steps[:-1, ..., 2], axis=0)
    steps[1:] = turned(change, -headings)
    return np.cumsum(steps, axis=0)
