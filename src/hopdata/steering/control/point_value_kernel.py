"""Compiled value iteration for "go to a point": by distance, bearing and boom angle."""

from __future__ import annotations

from math import atan2, cos, exp, floor, log, pi, sin, sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: How much closer the distances lie near the goal than at the far end: exp(STRETCH).
STRETCH = 3.5
#: Cost per metre beyond the last distance.
BEYOND = 1.0


def distances_of(count: int, farthest_m: float) -> FloatArray:
    """Distances (count,) of the nodes, m."""
    place = np.linspace(0.0, 1.0, count)
    return np.asarray(farthest_m * np.expm1(STRETCH * place) / np.expm1(STRETCH))


@njit(cache=True, nogil=True, error_model="numpy")
def stage_cost(squared_error, width):  # type: ignore[no-untyped-def]
    """Cost of a stance from its squared error."""
    return squared_error / (squared_error + width * width)


@njit(cache=True, nogil=True, error_model="numpy")
def point_value(values, farthest, x, y, boom):  # type: ignore[no-untyped-def]
    """Cost-to-go where the goal is at (x, y) in the body frame; linear between the nodes."""
    count, bearings, angles = values.shape
    distance = sqrt(x * x + y * y)
    excess = max(0.0, distance - farthest)
    scale = (exp(STRETCH) - 1.0) / farthest
    d = log(1.0 + (distance - excess) * scale) * ((count - 1) / STRETCH)
    i = min(int(d), count - 2)
    d -= i
    b = (atan2(y, x) + pi) * (bearings / (2.0 * pi))
    j = min(int(b), bearings - 1)
    b -= j
    a = boom * (angles / (2.0 * pi))
    cell = floor(a)
    a -= cell
    k = int(cell) % angles
    j1 = j + 1 if j + 1 < bearings else 0
    k1 = k + 1 if k + 1 < angles else 0
    near = (1.0 - b) * ((1.0 - a) * values[i, j, k] + a * values[i, j, k1])
    near += b * ((1.0 - a) * values[i, j1, k] + a * values[i, j1, k1])
    far = (1.0 - b) * ((1.0 - a) * values[i + 1, j, k] + a * values[i + 1, j, k1])
    far += b * ((1.0 - a) * values[i + 1, j1, k] + a * values[i + 1, j1, k1])
    return (1.0 - d) * near + d * far + BEYOND * excess


@njit(cache=True, nogil=True, error_model="numpy")
def _cost_after(values, farthest, x, y, change, boom, width, discount):  # type: ignore[no-untyped-def]
    """Cost of the next stance and all after it, the goal being at (x, y) before the hop."""
    c, s = cos(change[2]), sin(change[2])
    px, py = x - change[0], y - change[1]
    cost = stage_cost(px * px + py * py, width)
    return cost + discount * point_value(values, farthest, c * px + s * py, c * py - s * px, boom)


@njit(cache=True, nogil=True, error_model="numpy")
def _expected(values, farthest, x, y, change, boom, width, discount, spread):  # type: ignore[no-untyped-def]
    """Mean over the spread of the frame change: exact for cubic functions of it."""
    if spread[0] == 0.0 and spread[1] == 0.0 and spread[2] == 0.0:
        return _cost_after(values, farthest, x, y, change, boom, width, discount)
    total = 0.0
    moved = np.empty(3)
    for c in range(3):
        for side in (-1.0, 1.0):
            moved[:] = change
            moved[c] += side * sqrt(3.0) * spread[c]
            total += _cost_after(values, farthest, x, y, moved, boom, width, discount)
    return total / 6.0


@njit(cache=True, nogil=True, error_model="numpy")
def improve_point(values, policy, choose, distances, farthest, changes, swings, width, discount, spread):  # type: ignore[no-untyped-def]
    """Sweep once over `values` (D, B, A) in place; the largest change.

    `choose` the best swing at each node into `policy`, or keep to that.
    """
    count, bearings, angles = values.shape
    largest = 0.0
    for i in range(count):
        for j in range(bearings):
            bearing = 2.0 * pi * j / bearings - pi
            x, y = distances[i] * cos(bearing), distances[i] * sin(bearing)
            for k in range(angles):
                boom = 2.0 * pi * k / angles
                first = 0 if choose else policy[i, j, k]
                last = swings.size if choose else first + 1
                best = np.inf
                for u in range(first, last):
                    value = _expected(
                        values, farthest, x, y, changes[k, u], boom + swings[u], width, discount,
                        spread,
                    )  # fmt: skip
                    if value < best:
                        best = value
                        policy[i, j, k] = u
                largest = max(largest, abs(best - values[i, j, k]))
                values[i, j, k] = best
    return largest
