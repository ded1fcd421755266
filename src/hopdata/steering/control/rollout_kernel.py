"""Compiled rollout of a few hops: the objective and its gradient by the swings.

A target is six numbers, see `target_of`: whether it is a heading, the point or the heading,
whether errors are squared, whether the last stance alone counts. The size of an error has a kink
where it vanishes; with `smooth` above 0 it is sqrt(error^2 + smooth^2) - smooth, which has none and
is smaller by at most `smooth`.
"""

from __future__ import annotations

from math import cos, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from hopdata.code_cache import kept_njit
from hopdata.steering.control.objectives import Objective, ToHeading
from hopdata.steering.models.compiled_spline import spline_change

FloatArray = NDArray[np.float64]


def target_of(objective: Objective) -> FloatArray:
    """Six numbers that tell the compiled code what to reach."""
    square, last = float(objective.penalty == "square"), float(objective.stances == "last")
    if isinstance(objective, ToHeading):
        return np.array([1.0, 0.0, 0.0, objective.heading_rad, square, last])
    return np.array([0.0, *objective.point_m, 0.0, square, last])


@kept_njit(nogil=True, error_model="numpy")
def wrap(angle):  # type: ignore[no-untyped-def]
    """Bring an angle to [-pi, pi)."""
    return (angle + pi) % (2.0 * pi) - pi


@kept_njit(nogil=True, error_model="numpy")
def penalty(target, smooth, x, y, heading):  # type: ignore[no-untyped-def]
    """Penalty of a pose."""
    if target[0] == 1.0:
        e = wrap(heading - target[3])
        squared = e * e
    else:
        squared = (x - target[1]) ** 2 + (y - target[2]) ** 2
    if target[4] == 1.0:
        return squared
    return sqrt(squared + smooth * smooth) - smooth


@kept_njit(nogil=True, error_model="numpy")
def penalty_slopes(target, smooth, x, y, heading):  # type: ignore[no-untyped-def]
    """Return the derivatives of the penalty by x, y and heading."""
    ex = ey = eh = 0.0
    if target[0] == 1.0:
        eh = wrap(heading - target[3])
    else:
        ex, ey = x - target[1], y - target[2]
    if target[4] == 1.0:
        return 2.0 * ex, 2.0 * ey, 2.0 * eh
    size = sqrt(ex * ex + ey * ey + eh * eh + smooth * smooth)
    if size == 0.0:
        return 0.0, 0.0, 0.0
    return ex / size, ey / size, eh / size


@kept_njit(nogil=True, error_model="numpy")
def rollout(  # type: ignore[no-untyped-def]
    coefficients, limit, pose, boom, swings, target, smooth, poses, changes, gradients, slopes
):
    """Objective of swings (H,); fills `slopes` (H,) and, on the way, `poses` (H + 1, 3).

    `changes` (H, 3) and `gradients` (H, 3, 2) keep the frame changes and their derivatives.
    """
    horizon = swings.size
    poses[0] = pose
    total = 0.0
    for k in range(horizon):
        change = changes[k]
        spline_change(coefficients, limit, boom, swings[k], change, gradients[k])
        c, s = cos(poses[k, 2]), sin(poses[k, 2])
        poses[k + 1, 0] = poses[k, 0] + c * change[0] - s * change[1]
        poses[k + 1, 1] = poses[k, 1] + s * change[0] + c * change[1]
        poses[k + 1, 2] = poses[k, 2] + change[2]
        boom += swings[k]
        if target[5] == 0.0 or k == horizon - 1:
            x, y, heading = poses[k + 1]
            total += penalty(target, smooth, x, y, heading)
    _backwards(target, smooth, poses, changes, gradients, slopes)
    return total


@kept_njit(nogil=True, error_model="numpy")
def _backwards(target, smooth, poses, changes, gradients, slopes):  # type: ignore[no-untyped-def]
    """Fill the derivatives of the objective by the swings, from the last hop to the first."""
    horizon = slopes.size
    by_x = by_y = by_heading = by_boom = 0.0
    for k in range(horizon - 1, -1, -1):
        if target[5] == 0.0 or k == horizon - 1:
            x, y, heading = poses[k + 1]
            px, py, ph = penalty_slopes(target, smooth, x, y, heading)
            by_x, by_y, by_heading = by_x + px, by_y + py, by_heading + ph
        change, gradient = changes[k], gradients[k]
        c, s = cos(poses[k, 2]), sin(poses[k, 2])
        by_dx, by_dy = c * by_x + s * by_y, c * by_y - s * by_x
        slopes[k] = by_boom + _along(gradient, 1, by_dx, by_dy, by_heading)
        by_boom += _along(gradient, 0, by_dx, by_dy, by_heading)
        by_heading += by_dy * change[0] - by_dx * change[1]


@kept_njit(nogil=True, error_model="numpy", inline="always")
def _along(gradient, axis, by_dx, by_dy, by_heading):  # type: ignore[no-untyped-def]
    """Return the derivative by boom angle (axis 0) or swing (1), from those by the frame change."""
    return by_dx * gradient[0, axis] + by_dy * gradient[1, axis] + by_heading * gradient[2, axis]
