"""The controller as printed: direct single shooting with L-BFGS-B (Sec. 3.4.3)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import require_choice
from hopdata.rigid import composed, wrapped
from hopdata.steering.control.objectives import (
    Horizon,
    Objective,
    Plan,
    ToHeading,
    ToPoint,
    checked_state,
    errors_left,
    objective_value,
)
from hopdata.steering.models.tabulated import FrameChangeMap

GRADIENTS = ("numerical", "closed form")
STARTS = ("several", "previous swing", "rest")


@dataclass(frozen=True, kw_only=True)
class PrintedController:
    """Predictive control by scipy's L-BFGS-B.

    Parameters
    ----------
    model : FrameChangeMap
        Asked for one hop at a time, as the difference equation of Sec. 3.4.1 is stepped; for its
        gradient only if that is wanted in closed form.
    objective : ToPoint or ToHeading
    horizon : Horizon
    gradient : {"numerical", "closed form"}
        Differences of the objective, as scipy takes them if given none; or the chain rule
        through the model's own gradient.
    start : {"several", "previous swing", "rest"}
        Where the search begins, which the text does not say. Either from several starts, of which
        the best end counts, since the search descends and does not find the other way round by
        itself: half the limit to the left, none, half the limit to the right, and the last swing
        made again and again. Or once: with the last swing again (half the limit if there was none,
        or it is not known), or with none.
    """

    model: FrameChangeMap
    objective: Objective = field(default_factory=ToPoint)
    horizon: Horizon = field(default_factory=Horizon)
    gradient: str = "numerical"
    start: str = "several"

    def __post_init__(self) -> None:
        require_choice("gradient", self.gradient, GRADIENTS)
        require_choice("start", self.start, STARTS)

    def towards(self, objective: Objective) -> PrintedController:
        """Return the same controller with another objective."""
        return replace(self, objective=objective)

    def plan(
        self, pose: ArrayLike, boom_angle_rad: float, previous_swing_rad: float | None = None, /
    ) -> Plan:
        """Plan from a pose and a boom angle; the search may begin with the previous swing."""
        start, boom = checked_state(pose, boom_angle_rad)
        limit, hops = self.horizon.swing_limit_rad, self.horizon.hops
        closed = self.gradient == "closed form"

        def value(swings: FloatArray) -> float:
            return objective_value(
                self.objective, predicted_poses(self.model, start, boom, swings)[1:]
            )

        def value_and_gradient(swings: FloatArray) -> tuple[float, FloatArray]:
            return objective_and_gradient(self.model, self.objective, start, boom, swings)

        ends = [
            _descended(value_and_gradient if closed else value, first, hops, limit, closed)
            for first in self._first_swings(previous_swing_rad)
        ]
        solved = min(ends, key=lambda end: end.fun)
        return Plan(
            swings_rad=solved.x,
            poses=predicted_poses(self.model, start, boom, solved.x),
            objective=float(solved.fun),
            status="solved" if solved.success else "stopped early",
            reason=str(solved.message),
        )

    def _first_swings(self, previous_swing_rad: float | None) -> tuple[float, ...]:
        """Return the swings of all hops at which the searches begin."""
        limit = self.horizon.swing_limit_rad
        again = _swing_again(previous_swing_rad, limit)
        if self.start == "several":  # each start once
            return tuple(dict.fromkeys((limit / 2, 0.0, -limit / 2, again)))
        return (0.0 if self.start == "rest" else again,)


def _descended(
    function: Callable[..., Any], first_rad: float, hops: int, limit_rad: float, gradient: bool
) -> Any:
    """Search from the same swing in all hops."""
    from scipy.optimize import minimize

    return minimize(
        function,
        np.full(hops, first_rad),
        jac=gradient,
        method="L-BFGS-B",
        bounds=[(-limit_rad, limit_rad)] * hops,
    )


def _swing_again(previous_swing_rad: float | None, limit_rad: float) -> float:
    """Return the previous swing within the limit; half the limit where there was none."""
    if not previous_swing_rad or not np.isfinite(previous_swing_rad):
        return limit_rad / 2
    return float(np.clip(previous_swing_rad, -limit_rad, limit_rad))


def predicted_poses(
    model: FrameChangeMap, pose: FloatArray, boom_angle_rad: float, swings_rad: FloatArray
) -> FloatArray:
    """Poses (H + 1, 3) of a rollout, the present one first (Sec. 3.4.1)."""
    poses, boom = [np.asarray(pose, dtype=float)], boom_angle_rad
    for swing in swings_rad:
        change = model.change(np.array([boom]), np.array([swing]))[0]
        poses.append(composed(poses[-1], change))
        boom += swing
    return np.array(poses)


def objective_and_gradient(
    model: FrameChangeMap,
    objective: Objective,
    pose: FloatArray,
    boom_angle_rad: float,
    swings_rad: FloatArray,
) -> tuple[float, FloatArray]:
    """Objective of swings (H,) and its gradient (H,), by the chain rule forwards."""
    hops = len(swings_rad)
    poses, slopes = [np.asarray(pose, dtype=float)], [np.zeros((3, hops))]
    boom, boom_slope = boom_angle_rad, np.zeros(hops)
    for k, swing in enumerate(swings_rad):
        change, by_inputs = (
            part[0] for part in model.change_and_gradient(np.array([boom]), np.array([swing]))
        )
        by_swings = np.outer(by_inputs[:, 0], boom_slope)
        by_swings[:, k] += by_inputs[:, 1]
        slopes.append(_composed_slopes(poses[-1], slopes[-1], change, by_swings))
        poses.append(composed(poses[-1], change))
        boom_slope[k] += 1.0
        boom += swing
    ahead, ahead_slopes = np.array(poses[1:]), np.array(slopes[1:])
    by_pose = _penalty_slopes(objective, ahead)
    return objective_value(objective, ahead), np.einsum("kc,kch->h", by_pose, ahead_slopes)


def _composed_slopes(
    pose: FloatArray, slopes: FloatArray, change: FloatArray, by_swings: FloatArray
) -> FloatArray:
    """Return the derivatives (3, H) of a pose after a frame change."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    by_heading = np.array([-s * change[0] - c * change[1], c * change[0] - s * change[1], 0.0])
    return np.asarray(slopes + np.outer(by_heading, slopes[2]) + turn @ by_swings)


def _penalty_slopes(objective: Objective, poses: FloatArray) -> FloatArray:
    """Return the derivatives (H, 3) of the objective by the poses (H, 3) that it counts."""
    away = np.zeros_like(poses)
    if isinstance(objective, ToHeading):
        away[:, 2] = wrapped(poses[:, 2] - objective.heading_rad)
    else:
        away[:, :2] = poses[:, :2] - np.array(objective.point_m)
    if objective.penalty == "square":
        slopes = 2 * away
    else:
        size = errors_left(objective, poses)[:, None]
        slopes = np.divide(away, size, out=np.zeros_like(away), where=size > 0)
    if objective.stances == "last":
        slopes[:-1] = 0.0
    return np.asarray(slopes)
