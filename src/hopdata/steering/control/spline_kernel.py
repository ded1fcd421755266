"""Compiled evaluation of the spline of frame changes."""

from __future__ import annotations

from math import floor, pi

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _weights(t):  # type: ignore[no-untyped-def]
    """Weights of the four coefficients around a place `t` in [0, 1) between two nodes."""
    s = 1.0 - t
    return (
        s * s * s / 6.0,
        (3.0 * t * t * (t - 2.0) + 4.0) / 6.0,
        (3.0 * s * s * (s - 2.0) + 4.0) / 6.0,
        t * t * t / 6.0,
    )


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _slopes(t):  # type: ignore[no-untyped-def]
    """Derivatives of the weights by `t`."""
    s = 1.0 - t
    return -s * s / 2.0, t * (1.5 * t - 2.0), s * (2.0 - 1.5 * s), t * t / 2.0


@njit(cache=True, nogil=True, error_model="numpy")
def _place(coefficients, limit, boom, swing):  # type: ignore[no-untyped-def]
    """Cell and place within it on both axes; a swing beyond the limit is at the limit."""
    angles, nodes = coefficients.shape[0], coefficients.shape[1] - 2
    a = boom * (angles / (2.0 * pi))
    cell_a = floor(a)
    u = (min(max(swing, -limit), limit) + limit) * ((nodes - 1) / (2.0 * limit))
    cell_u = min(int(u), nodes - 2)
    return int(cell_a) % angles, a - cell_a, cell_u, u - cell_u


@njit(cache=True, nogil=True, error_model="numpy")
def frame_change(coefficients, limit, boom, swing):  # type: ignore[no-untyped-def]
    """Frame change at one boom angle and swing: three numbers."""
    cell_a, place_a, cell_u, place_u = _place(coefficients, limit, boom, swing)
    angles = coefficients.shape[0]
    along_a, along_u = _weights(place_a), _weights(place_u)
    dx = dy = turn = 0.0
    for i in range(4):
        row = cell_a + i - 1
        row = row + angles if row < 0 else (row - angles if row >= angles else row)
        for j in range(4):
            w = along_a[i] * along_u[j]
            dx += w * coefficients[row, cell_u + j, 0]
            dy += w * coefficients[row, cell_u + j, 1]
            turn += w * coefficients[row, cell_u + j, 2]
    return dx, dy, turn


@njit(cache=True, nogil=True, error_model="numpy")
def frame_change_and_gradient(coefficients, limit, boom, swing, out):  # type: ignore[no-untyped-def]
    """Fill `out` (9,): frame change, its derivatives by the boom angle, and by the swing."""
    cell_a, place_a, cell_u, place_u = _place(coefficients, limit, boom, swing)
    angles, nodes = coefficients.shape[0], coefficients.shape[1] - 2
    along_a, along_u = _weights(place_a), _weights(place_u)
    slope_a, slope_u = _slopes(place_a), _slopes(place_u)
    per_a, per_u = angles / (2.0 * pi), (nodes - 1) / (2.0 * limit)
    out[:] = 0.0
    for i in range(4):
        row = cell_a + i - 1
        row = row + angles if row < 0 else (row - angles if row >= angles else row)
        for j in range(4):
            w = along_a[i] * along_u[j]
            wa = per_a * slope_a[i] * along_u[j]
            wu = per_u * along_a[i] * slope_u[j]
            for c in range(3):
                value = coefficients[row, cell_u + j, c]
                out[c] += w * value
                out[3 + c] += wa * value
                out[6 + c] += wu * value


@njit(cache=True, nogil=True, error_model="numpy")
def changes_and_gradients(coefficients, limit, boom, swing):  # type: ignore[no-untyped-def]
    """Frame changes and their derivatives at boom angles (n,) and swings (n,): (n, 9)."""
    out = np.empty((boom.size, 9))
    for n in range(boom.size):
        frame_change_and_gradient(coefficients, limit, boom[n], swing[n], out[n])
    return out
