"""Compiled table of the objective over all sequences of swings from a grid.

With swings on an even grid the boom angles at the stances are on one too, so that few frame changes
serve all sequences; sequences with a common beginning share its poses.
"""

from __future__ import annotations

from math import cos, sin

import numpy as np

from hopdata.code_cache import kept_njit
from hopdata.steering.control.rollout_kernel import penalty
from hopdata.steering.models.compiled_spline import spline_change


@kept_njit(nogil=True, error_model="numpy")
def changes_of_grid(coefficients, limit, boom, n, horizon):  # type: ignore[no-untyped-def]
    """Frame changes (horizon (n - 1) + 1, n, 3): of boom angles a step apart, by the swings."""
    step = 2.0 * limit / (n - 1)
    half = (horizon - 1) * (n - 1) // 2
    out, unused = np.empty((2 * half + 1, n, 3)), np.empty((3, 2))
    for a in range(2 * half + 1):
        for j in range(n):
            angle = boom + (a - half) * step
            spline_change(coefficients, limit, angle, -limit + j * step, out[a, j], unused)
    return out


@kept_njit(nogil=True, error_model="numpy")
def coarse_table(coefficients, limit, pose, boom, n, horizon, target, values):  # type: ignore[no-untyped-def]
    """Fill `values` (n^horizon,): objectives, the first swing slowest; n odd."""
    changes = changes_of_grid(coefficients, limit, boom, n, horizon)
    half, middle = (horizon - 1) * (n - 1) // 2, (n - 1) // 2
    poses = np.empty((horizon + 1, 3))
    poses[0] = pose
    digits = np.zeros(horizon, dtype=np.int64)
    sums = np.zeros(horizon + 1)
    at = np.zeros(horizon + 1, dtype=np.int64)
    at[0] = half
    changed = 0
    every = target[5] == 0.0
    for row in range(values.size // n):
        for k in range(changed, horizon - 1):
            _step(poses, k, changes[at[k], digits[k]])
            at[k + 1] = at[k] + digits[k] - middle
            x, y, heading = poses[k + 1]
            sums[k + 1] = sums[k] + (penalty(target, 0.0, x, y, heading) if every else 0.0)
        x0, y0, h0 = poses[horizon - 1]
        c, s = cos(h0), sin(h0)
        last, so_far = changes[at[horizon - 1]], sums[horizon - 1]
        for j in range(n):
            x, y = x0 + c * last[j, 0] - s * last[j, 1], y0 + s * last[j, 0] + c * last[j, 1]
            values[row * n + j] = so_far + penalty(target, 0.0, x, y, h0 + last[j, 2])
        changed = _advance(digits, n, horizon - 2)


@kept_njit(nogil=True, error_model="numpy")
def _step(poses, k, change):  # type: ignore[no-untyped-def]
    c, s = cos(poses[k, 2]), sin(poses[k, 2])
    poses[k + 1, 0] = poses[k, 0] + c * change[0] - s * change[1]
    poses[k + 1, 1] = poses[k, 1] + s * change[0] + c * change[1]
    poses[k + 1, 2] = poses[k, 2] + change[2]


@kept_njit(nogil=True, error_model="numpy")
def _advance(digits, n, k):  # type: ignore[no-untyped-def]
    """Count on; the place of the first digit that changed."""
    while k >= 0:
        digits[k] += 1
        if digits[k] < n:
            return k
        digits[k] = 0
        k -= 1
    return 0


@kept_njit(nogil=True, error_model="numpy")
def lowest_dips(values, n, horizon, starts):  # type: ignore[no-untyped-def]
    """Fill `starts` with the places of the lowest values that no neighbour along an axis undercuts.

    Returns how many there are, lowest first, `starts.size` at most.
    """
    best = np.full(starts.size, np.inf)
    found = 0
    for place in range(values.size):
        value = values[place]
        if value >= best[-1] or not _is_dip(values, place, n, horizon):
            continue
        k = min(found, starts.size - 1)
        while k > 0 and best[k - 1] > value:
            best[k], starts[k] = best[k - 1], starts[k - 1]
            k -= 1
        best[k], starts[k] = value, place
        found = min(found + 1, starts.size)
    return found


@kept_njit(nogil=True, error_model="numpy")
def _is_dip(values, place, n, horizon):  # type: ignore[no-untyped-def]
    stride = 1
    for _ in range(horizon):
        digit = (place // stride) % n
        if digit > 0 and values[place - stride] < values[place]:
            return False
        if digit < n - 1 and values[place + stride] < values[place]:
            return False
        stride *= n
    return True
