"""Compiled search for the next swings with the cost-to-go at the end of a short look ahead."""

from __future__ import annotations

from math import cos, sin

import numpy as np

from hopdata.code_cache import kept_njit
from hopdata.steering.control.heading_value_kernel import heading_value
from hopdata.steering.control.point_value_kernel import point_value, stage_cost
from hopdata.steering.control.rollout_kernel import wrap
from hopdata.steering.models.compiled_spline import spline_change


@kept_njit(nogil=True, error_model="numpy")
def _hop(error, change, is_heading, after):  # type: ignore[no-untyped-def]
    """Fill `after` (3,): what is left of the way to the goal, in the body frame, after a hop."""
    dx, dy, turn = change
    if is_heading:
        after[0], after[1], after[2] = 0.0, 0.0, wrap(error[2] - turn)
        return
    c, s = cos(turn), sin(turn)
    px, py = error[0] - dx, error[1] - dy
    after[0], after[1], after[2] = c * px + s * py, c * py - s * px, 0.0


@kept_njit(nogil=True, error_model="numpy")
def _ahead(values, farthest, error, boom, is_heading):  # type: ignore[no-untyped-def]
    if is_heading:
        return heading_value(values[0], error[2], boom)
    return point_value(values, farthest, error[0], error[1], boom)


@kept_njit(nogil=True, error_model="numpy")
def _stage(error, width):  # type: ignore[no-untyped-def]
    return stage_cost(error[0] ** 2 + error[1] ** 2 + error[2] ** 2, width)


@kept_njit(nogil=True, error_model="numpy")
def cost_of(  # type: ignore[no-untyped-def]
    coefficients, limit, values, farthest, width, discount, is_heading, error, boom, swings, errors
):
    """Cost of swings (H,) and of all that comes after; `errors` (H + 1, 3) is filled."""
    errors[0] = error
    total, weight = 0.0, 1.0
    change, gradient = np.empty(3), np.empty((3, 2))
    for k in range(swings.size):
        spline_change(coefficients, limit, boom, swings[k], change, gradient)
        _hop(errors[k], change, is_heading, errors[k + 1])
        boom += swings[k]
        total += weight * _stage(errors[k + 1], width)
        weight *= discount
    return total + weight * _ahead(values, farthest, errors[swings.size], boom, is_heading)


@kept_njit(nogil=True, error_model="numpy")
def best_ahead(  # type: ignore[no-untyped-def]
    coefficients, limit, values, farthest, width, discount, is_heading, error, boom, n, swings
):
    """Fill `swings` (H,) with the best of all sequences of `n` swings a hop, then refined."""
    horizon = swings.size
    trial, errors = np.empty(horizon), np.empty((horizon + 1, 3))
    best = np.inf
    for row in range(n**horizon):
        place = row
        for k in range(horizon):
            trial[k] = -limit + (place % n) * 2.0 * limit / (n - 1)
            place //= n
        value = cost_of(
            coefficients, limit, values, farthest, width, discount, is_heading, error, boom,
            trial, errors,
        )  # fmt: skip
        if value < best:
            best = value
            swings[:] = trial
    step = limit / (n - 1)
    while step > 2e-3:
        improved = False
        for k in range(horizon):
            for side in (-1.0, 1.0):
                trial[:] = swings
                trial[k] = min(max(swings[k] + side * step, -limit), limit)
                value = cost_of(
                    coefficients, limit, values, farthest, width, discount, is_heading, error,
                    boom, trial, errors,
                )  # fmt: skip
                if value < best:
                    best, improved = value, True
                    swings[:] = trial
        if not improved:
            step *= 0.5
    return best
