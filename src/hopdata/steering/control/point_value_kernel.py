"""Compiled value iteration for "go to a point": by distance, bearing and boom angle.

Where each hop leads does not change from sweep to sweep, so that it is worked out once.
"""

from __future__ import annotations

from math import atan2, cos, exp, floor, log, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from hopdata.code_cache import kept_njit

FloatArray = NDArray[np.float64]

#: How much closer the distances lie near the goal than at the far end: exp(STRETCH).
STRETCH = 3.5
#: Cost per metre beyond the last distance.
BEYOND = 1.0


def distances_of(count: int, farthest_m: float) -> FloatArray:
    """Distances (count,) of the nodes, m."""
    place = np.linspace(0.0, 1.0, count)
    return np.asarray(farthest_m * np.expm1(STRETCH * place) / np.expm1(STRETCH))


@kept_njit(nogil=True, error_model="numpy")
def stage_cost(squared_error, width):  # type: ignore[no-untyped-def]
    """Cost of a stance from its squared error."""
    return squared_error / (squared_error + width * width)


@kept_njit(nogil=True, error_model="numpy")
def _place(count, bearings, farthest, x, y):  # type: ignore[no-untyped-def]
    """Cell of a goal at (x, y), its places in the cell, and the distance beyond the farthest."""
    distance = sqrt(x * x + y * y)
    excess = max(0.0, distance - farthest)
    scale = (exp(STRETCH) - 1.0) / farthest
    d = log(1.0 + (distance - excess) * scale) * ((count - 1) / STRETCH)
    i = min(int(d), count - 2)
    b = (atan2(y, x) + pi) * (bearings / (2.0 * pi))
    j = min(int(b), bearings - 1)
    return i, j, d - i, b - j, excess


@kept_njit(nogil=True, error_model="numpy")
def boom_place(angles, boom):  # type: ignore[no-untyped-def]
    """Cell of a boom angle, and its place in it."""
    a = boom * (angles / (2.0 * pi))
    cell = floor(a)
    return int(cell) % angles, a - cell


@kept_njit(nogil=True, error_model="numpy")
def _between(values, i, j, k, d, b, a):  # type: ignore[no-untyped-def]
    """Linear interpolation; bearing and boom angle go round."""
    j1 = j + 1 if j + 1 < values.shape[1] else 0
    k1 = k + 1 if k + 1 < values.shape[2] else 0
    near = (1.0 - b) * ((1.0 - a) * values[i, j, k] + a * values[i, j, k1])
    near += b * ((1.0 - a) * values[i, j1, k] + a * values[i, j1, k1])
    far = (1.0 - b) * ((1.0 - a) * values[i + 1, j, k] + a * values[i + 1, j, k1])
    far += b * ((1.0 - a) * values[i + 1, j1, k] + a * values[i + 1, j1, k1])
    return (1.0 - d) * near + d * far


@kept_njit(nogil=True, error_model="numpy")
def point_value(values, farthest, x, y, boom):  # type: ignore[no-untyped-def]
    """Cost-to-go where the goal is at (x, y) in the body frame; linear between the nodes."""
    count, bearings, angles = values.shape
    i, j, d, b, excess = _place(count, bearings, farthest, x, y)
    k, a = boom_place(angles, boom)
    return _between(values, i, j, k, d, b, a) + BEYOND * excess


@kept_njit(nogil=True, error_model="numpy")
def point_hops(distances, bearings, changes, width, discount, cells, places):  # type: ignore[no-untyped-def]
    """Where each swing leads from each node, over (D, B, A, U).

    Fills `cells` (..., 2) by those of distance and bearing, and `places` (..., 3) by the places in
    them and the cost of the stance.
    """
    count, farthest = distances.size, distances[-1]
    for i in range(count):
        for j in range(bearings):
            bearing = 2.0 * pi * j / bearings - pi
            x, y = distances[i] * cos(bearing), distances[i] * sin(bearing)
            for k in range(changes.shape[0]):
                for u in range(changes.shape[1]):
                    c, s = cos(changes[k, u, 2]), sin(changes[k, u, 2])
                    px, py = x - changes[k, u, 0], y - changes[k, u, 1]
                    i1, j1, d, b, excess = _place(
                        count, bearings, farthest, c * px + s * py, c * py - s * px
                    )
                    cost = stage_cost(px * px + py * py, width) + discount * BEYOND * excess
                    cells[i, j, k, u, 0], cells[i, j, k, u, 1] = i1, j1
                    places[i, j, k, u, 0], places[i, j, k, u, 1] = d, b
                    places[i, j, k, u, 2] = cost


@kept_njit(nogil=True, error_model="numpy")
def improve_point(values, policy, choose, cells, places, boom_cells, boom_places, discount):  # type: ignore[no-untyped-def]
    """Sweep once over `values` (D, B, A) in place; the largest change.

    `choose` the best swing at each node into `policy`, or keep to that. The boom angles that swings
    lead to are in `boom_cells` and `boom_places` (A, U).
    """
    count, bearings, angles = values.shape
    largest = 0.0
    for i in range(count):
        for j in range(bearings):
            for k in range(angles):
                first = 0 if choose else policy[i, j, k]
                last = boom_cells.shape[1] if choose else first + 1
                best = np.inf
                for u in range(first, last):
                    cell, place = cells[i, j, k, u], places[i, j, k, u]
                    ahead = _between(
                        values, cell[0], cell[1], boom_cells[k, u], place[0], place[1],
                        boom_places[k, u],
                    )  # fmt: skip
                    value = place[2] + discount * ahead
                    if value < best:
                        best = value
                        policy[i, j, k] = u
                largest = max(largest, abs(best - values[i, j, k]))
                values[i, j, k] = best
    return largest
