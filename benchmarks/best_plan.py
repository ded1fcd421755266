"""The best plan there is, slowly: a dense grid in NumPy, then scipy's polish of its lowest dips."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import FloatArray
from hopdata.rigid import composed
from hopdata.steering.control.objectives import Horizon, Objective, errors_left
from hopdata.steering.control.printed import objective_and_gradient
from hopdata.steering.models.tabulated import FrameChangeMap


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
    from scipy.optimize import minimize

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
    for k in range(hops):
        shape = (*booms.shape, len(grid))
        boom, swing = np.broadcast_to(booms[..., None], shape), np.broadcast_to(grid, shape)
        change = model.change(boom.ravel(), swing.ravel()).reshape(*shape, 3)
        poses = composed(np.broadcast_to(poses[..., None, :], (*shape, 3)), change)
        booms = boom + swing
        left = errors_left(objective, poses)
        penalty = left**2 if objective.penalty == "square" else left
        counts = objective.stances == "all" or k == hops - 1
        total = total[..., None] + (penalty if counts else 0.0 * penalty)
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
