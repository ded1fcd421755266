"""Compiled polish of a sequence of swings: damped Newton steps within the bounds.

The Hessian is that of differences of the exact gradient. Swings at a bound that the gradient pushes
outwards are held. Kinks of the objective are smoothed, less and less.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from hopdata.code_cache import kept_njit
from hopdata.steering.control.rollout_kernel import rollout

_DIFFERENCE = 1e-5  # rad
_MOST_STEPS = 12
_STILL = 1e-10  # what a step must gain


@kept_njit(nogil=True, error_model="numpy")
def polish(coefficients, limit, pose, boom, swings, target, smoothings, poses):  # type: ignore[no-untyped-def]
    """Improve `swings` (H,) in place; fills `poses` (H + 1, 3); the objective without smoothing."""
    horizon = swings.size
    changes, gradients = np.empty((horizon, 3)), np.empty((horizon, 3, 2))
    slopes = np.empty(horizon)
    for smooth in smoothings:
        _descend(
            coefficients,
            limit,
            pose,
            boom,
            swings,
            target,
            smooth,
            poses,
            changes,
            gradients,
            slopes,
        )
    return rollout(
        coefficients, limit, pose, boom, swings, target, 0.0, poses, changes, gradients, slopes
    )


@kept_njit(nogil=True, error_model="numpy")
def _descend(  # type: ignore[no-untyped-def]
    coefficients, limit, pose, boom, swings, target, smooth, poses, changes, gradients, slopes
):
    horizon = swings.size
    hessian, moved = np.empty((horizon, horizon)), np.empty(horizon)
    beside, step, trial = np.empty(horizon), np.empty(horizon), np.empty(horizon)
    damping = 1e-6
    value = rollout(
        coefficients, limit, pose, boom, swings, target, smooth, poses, changes, gradients, slopes
    )
    for _ in range(_MOST_STEPS):
        for k in range(horizon):
            moved[:] = swings
            h = -_DIFFERENCE if swings[k] > 0 else _DIFFERENCE
            moved[k] += h
            rollout(
                coefficients,
                limit,
                pose,
                boom,
                moved,
                target,
                smooth,
                poses,
                changes,
                gradients,
                beside,
            )
            hessian[:, k] = (beside - slopes) / h
        gained = False
        for _ in range(12):
            _newton_step(hessian, slopes, swings, limit, damping, step)
            for k in range(horizon):
                trial[k] = min(max(swings[k] + step[k], -limit), limit)
            after = rollout(
                coefficients,
                limit,
                pose,
                boom,
                trial,
                target,
                smooth,
                poses,
                changes,
                gradients,
                beside,
            )
            if after < value - _STILL:
                gained = True
                break
            damping = max(8.0 * damping, 1e-4)
            if damping > 1e6:
                break
        if not gained:
            return
        swings[:] = trial
        slopes[:] = beside
        value = after
        damping *= 0.05


@kept_njit(nogil=True, error_model="numpy")
def _newton_step(hessian, slopes, swings, limit, damping, step):  # type: ignore[no-untyped-def]
    """Fill `step`; the damping is raised until the free part of the Hessian is positive."""
    n = slopes.size
    free = np.empty(n, dtype=np.bool_)
    for k in range(n):
        low, high = swings[k] <= -limit, swings[k] >= limit
        free[k] = not ((low and slopes[k] > 0) or (high and slopes[k] < 0))
    factor = np.zeros((n, n))
    while not _factored(hessian, free, damping, factor):
        damping = max(4.0 * damping, 1e-3)
    for i in range(n):
        step[i] = -slopes[i] if free[i] else 0.0
        for j in range(i):
            step[i] -= factor[i, j] * step[j]
        step[i] /= factor[i, i]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            step[i] -= factor[j, i] * step[j]
        step[i] /= factor[i, i]


@kept_njit(nogil=True, error_model="numpy")
def _factored(hessian, free, damping, factor):  # type: ignore[no-untyped-def]
    """Cholesky factor of the damped Hessian of the free swings; false if there is none."""
    n = free.size
    for i in range(n):
        for j in range(i + 1):
            total = 0.5 * (hessian[i, j] + hessian[j, i]) if free[i] and free[j] else 0.0
            if i == j:
                total += damping if free[i] else 1.0
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i == j:
                if not total > 1e-12:
                    return False
                factor[i, i] = sqrt(total)
            else:
                factor[i, j] = total / factor[j, j]
    return True
