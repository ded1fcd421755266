"""Plans with the gradient in closed form, and the best plan there is, slowly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, minimize

from hopdata.arrays import FloatArray
from hopdata.rigid import composed, wrapped
from hopdata.steering.control.objectives import (
    Horizon,
    Objective,
    ToHeading,
    errors_left,
    objective_value,
)
from hopdata.steering.control.printed import PrintedController
from hopdata.steering.models.tabulated import FrameChangeMap

STARTS = ("several", "previous swing", "rest")


@dataclass(frozen=True, kw_only=True)
class GradientController(PrintedController):
    """The printed controller with the gradient of the model by the chain rule, and other starts.

    `start`: the search begins at "several" places, of which the best end counts, with the
    "previous swing" (half the limit if there was none), or at "rest".
    """

    start: str = "several"

    def first_swings(self, previous_swing_rad: float | None) -> tuple[float, ...]:
        """Return the swings of all hops at which the searches begin."""
        limit = self.horizon.swing_limit_rad
        known = previous_swing_rad and np.isfinite(previous_swing_rad)
        again = float(np.clip(previous_swing_rad, -limit, limit)) if known else limit / 2
        several = super().first_swings(previous_swing_rad)
        return {"several": several, "previous swing": (again,), "rest": (0.0,)}[self.start]

    def descended(
        self, pose: FloatArray, boom_angle_rad: float, first_rad: float
    ) -> OptimizeResult:
        """Search from the same swing in all hops."""
        limit, hops = self.horizon.swing_limit_rad, self.horizon.hops
        return minimize(
            lambda u: objective_and_gradient(self.model, self.objective, pose, boom_angle_rad, u),
            np.full(hops, first_rad),
            jac=True,
            method="L-BFGS-B",
            bounds=[(-limit, limit)] * hops,
        )


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
    size = errors_left(objective, poses)[:, None]
    return np.divide(away, size, out=np.zeros_like(away), where=size > 0)


# A dense grid in NumPy, then scipy's polish of its lowest dips.


def reference_objective(
    model: FrameChangeMap,
    objective: Objective,
    horizon: Horizon,
    pose: FloatArray,
    boom_angle_rad: float,
    *,
    swings: int = 41,
    polishes: int = 4,
) -> float:
    """Lowest objective over all sequences of swings.

    Parameters
    ----------
    model : FrameChangeMap
    objective, horizon
        As of a controller.
    pose : (3,) array
    boom_angle_rad : float
    swings : int
        Nodes of each swing.
    polishes : int
        Lowest dips of the grid that are polished by L-BFGS-B with the exact gradient.
    """
    limit = horizon.swing_limit_rad
    grid = np.linspace(-limit, limit, swings)
    values = _dense(model, objective, horizon.hops, pose, boom_angle_rad, grid)
    places = np.flatnonzero(_dips(values))
    lowest = places[np.argsort(values.ravel()[places])[:polishes]]
    best = float(values.min())
    for place in lowest:
        start = grid[list(np.unravel_index(place, values.shape))]
        solved = minimize(
            lambda u: objective_and_gradient(model, objective, pose, boom_angle_rad, u),
            start,
            jac=True,
            method="L-BFGS-B",
            bounds=[(-limit, limit)] * horizon.hops,
        )
        best = min(best, float(solved.fun))
    return best


def _dense(
    model: FrameChangeMap,
    objective: Objective,
    hops: int,
    pose: FloatArray,
    boom_angle_rad: float,
    grid: FloatArray,
) -> FloatArray:
    """Objective of all sequences, (n, n, ...)."""
    poses, booms, total = np.asarray(pose, dtype=float), np.array(boom_angle_rad), np.zeros(())
    for _ in range(hops):
        shape = (*booms.shape, len(grid))
        boom, swing = np.broadcast_to(booms[..., None], shape), np.broadcast_to(grid, shape)
        change = model.change(boom.ravel(), swing.ravel()).reshape(*shape, 3)
        poses = composed(np.broadcast_to(poses[..., None, :], (*shape, 3)), change)
        booms = boom + swing
        total = total[..., None] + errors_left(objective, poses)
    return np.asarray(total)


def _dips(values: FloatArray) -> NDArray[np.bool_]:
    """Whether no neighbour along an axis is lower."""
    low = np.ones(values.shape, dtype=bool)
    for axis in range(values.ndim):
        rising = np.diff(values, axis=axis) >= 0
        ahead = [(0, 0)] * values.ndim
        ahead[axis] = (0, 1)
        behind = [(0, 0)] * values.ndim
        behind[axis] = (1, 0)
        low &= np.pad(rising, ahead, constant_values=True)
        low &= np.pad(~rising | (np.diff(values, axis=axis) == 0), behind, constant_values=True)
    return low
