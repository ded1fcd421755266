"""Compiled value iteration for "turn to a heading": by heading error and boom angle."""

from __future__ import annotations

from math import pi

import numpy as np

from hopdata.code_cache import kept_njit
from hopdata.steering.control.point_value_kernel import boom_place, stage_cost
from hopdata.steering.control.rollout_kernel import wrap


@kept_njit(nogil=True, error_model="numpy")
def heading_value(values, error, boom):  # type: ignore[no-untyped-def]
    """Cost-to-go at a heading error in [-pi, pi) and a boom angle; linear between the nodes."""
    errors, angles = values.shape
    e = (error + pi) * (errors / (2.0 * pi))
    i = min(int(e), errors - 1)
    e -= i
    k, a = boom_place(angles, boom)
    i1 = i + 1 if i + 1 < errors else 0
    k1 = k + 1 if k + 1 < angles else 0
    return (1.0 - e) * ((1.0 - a) * values[i, k] + a * values[i, k1]) + e * (
        (1.0 - a) * values[i1, k] + a * values[i1, k1]
    )


@kept_njit(nogil=True, error_model="numpy")
def improve_heading(values, policy, choose, turns, swings, width, discount):  # type: ignore[no-untyped-def]
    """Sweep once over `values` (E, A) in place; the largest change.

    The error is the heading wanted less the heading. `choose` the best swing at each node into
    `policy`, or keep to that.
    """
    errors, angles = values.shape
    largest = 0.0
    for i in range(errors):
        error = 2.0 * pi * i / errors - pi
        for k in range(angles):
            boom = 2.0 * pi * k / angles
            first = 0 if choose else policy[i, k]
            last = swings.size if choose else first + 1
            best = np.inf
            for u in range(first, last):
                left = wrap(error - turns[k, u])
                ahead = heading_value(values, left, boom + swings[u])
                value = stage_cost(left * left, width) + discount * ahead
                if value < best:
                    best = value
                    policy[i, k] = u
            largest = max(largest, abs(best - values[i, k]))
            values[i, k] = best
    return largest
