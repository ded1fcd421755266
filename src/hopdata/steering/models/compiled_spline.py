"""Cubic splines on even grids, periodic in the first input, compiled for controllers.

A spline is twice continuously differentiable. It is a sum of products of cubic B-splines (de Boor
2001, ch. IX and XVII), one of each input, so that a point costs 16 coefficients of two inputs and
64 of three.
"""

from __future__ import annotations

from math import floor, pi

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.code_cache import kept_njit

FloatArray = NDArray[np.float64]

LEAST_NODES = 4  # of an input that is not periodic


def spline_coefficients(values: ArrayLike) -> FloatArray:
    """Return coefficients of the spline through values on a grid.

    Parameters
    ----------
    values : (A, S, ..., 3) array
        The first axis covers a turn, its end left out; the others but the last go from end to end
        of their inputs, where the third derivative does not jump at the node next to the end.

    Returns
    -------
    (A + 3, S + 2, ..., 3) array
        The first three of the first axis stand again at its end.
    """
    coefficients = _periodic(np.asarray(values, dtype=float))
    for axis in range(1, coefficients.ndim - 1):
        coefficients = _open(coefficients, axis)
    return np.ascontiguousarray(coefficients)


def _periodic(values: FloatArray) -> FloatArray:
    n = len(values)
    symbol = (4 + 2 * np.cos(2 * np.pi * np.arange(n // 2 + 1) / n)) / 6
    shape = (-1,) + (1,) * (values.ndim - 1)
    spectrum = np.fft.rfft(values, axis=0) / symbol.reshape(shape)
    coefficients = np.fft.irfft(spectrum, n, axis=0)
    return np.asarray(coefficients[np.arange(-1, n + 2) % n])


def _open(values: FloatArray, axis: int) -> FloatArray:
    n = values.shape[axis]
    system = np.zeros((n + 2, n + 2))
    for row in range(n):
        system[row + 1, row : row + 3] = 1 / 6, 4 / 6, 1 / 6
    system[0, :5] = system[-1, -5:] = 1, -4, 6, -4, 1
    moved = np.moveaxis(values, axis, 0)
    right = np.zeros((n + 2, *moved.shape[1:]))
    right[1:-1] = moved
    solved = np.linalg.solve(system, right.reshape(n + 2, -1)).reshape(right.shape)
    return np.moveaxis(solved, 0, axis)


@kept_njit(error_model="numpy")
def _basis(f):  # type: ignore[no-untyped-def]
    """Return the four B-splines at `f`, 0 to 1 in the cell."""
    g = 1.0 - f
    return (
        g * g * g / 6.0,
        (4.0 - 6.0 * f * f + 3.0 * f * f * f) / 6.0,
        (4.0 - 6.0 * g * g + 3.0 * g * g * g) / 6.0,
        f * f * f / 6.0,
    )


@kept_njit(error_model="numpy")
def _slopes(f, per_unit):  # type: ignore[no-untyped-def]
    """Return the derivatives of the four B-splines by the input."""
    g = 1.0 - f
    return (
        -0.5 * g * g * per_unit,
        (1.5 * f * f - 2.0 * f) * per_unit,
        (2.0 * g - 1.5 * g * g) * per_unit,
        0.5 * f * f * per_unit,
    )


@kept_njit(error_model="numpy")
def _on_turn(angle, nodes):  # type: ignore[no-untyped-def]
    """Return cell and place in it of an angle, rad, and cells per rad; `nodes` make a turn."""
    per_unit = nodes / (2.0 * pi)
    place = angle * per_unit
    place -= nodes * floor(place / nodes)
    cell = min(int(place), nodes - 1)
    return cell, place - cell, per_unit


@kept_njit(error_model="numpy")
def _on_line(x, limit, nodes):  # type: ignore[no-untyped-def]
    """Return the same for `nodes` from -limit to limit; beyond, the last cell's cubic goes on."""
    per_unit = (nodes - 1) / (2.0 * limit)
    place = (x + limit) * per_unit
    cell = min(max(int(place), 0), nodes - 2)
    return cell, place - cell, per_unit


@kept_njit(error_model="numpy")
def spline_change(coefficients, limit, angle, swing, value, gradient):  # type: ignore[no-untyped-def]
    """Write value (3,) and gradient (3, 2) of a spline (A + 3, S + 2, 3) of angle and swing."""
    i, f, per_angle = _on_turn(angle, coefficients.shape[0] - 3)
    k, g, per_swing = _on_line(swing, limit, coefficients.shape[1] - 2)
    b, db = _basis(f), _slopes(f, per_angle)
    e, de = _basis(g), _slopes(g, per_swing)
    for j in range(3):
        total = by_angle = by_swing = 0.0
        for p in range(4):
            row = slope = 0.0
            for q in range(4):
                c = coefficients[i + p, k + q, j]
                row += e[q] * c
                slope += de[q] * c
            total += b[p] * row
            by_angle += db[p] * row
            by_swing += b[p] * slope
        value[j] = total
        gradient[j, 0] = by_angle
        gradient[j, 1] = by_swing


@kept_njit(error_model="numpy")
def spline_change_with_history(  # type: ignore[no-untyped-def]
    coefficients, limit, angle, swing, previous, value, gradient
):
    """Write value (3,) and gradient (3, 3) of a spline (A + 3, S + 2, P + 2, 3)."""
    i, f, per_angle = _on_turn(angle, coefficients.shape[0] - 3)
    k, g, per_swing = _on_line(swing, limit, coefficients.shape[1] - 2)
    m, w, per_previous = _on_line(previous, limit, coefficients.shape[2] - 2)
    b, db = _basis(f), _slopes(f, per_angle)
    e, de = _basis(g), _slopes(g, per_swing)
    h, dh = _basis(w), _slopes(w, per_previous)
    for j in range(3):
        value[j] = 0.0
        gradient[j, :] = 0.0
    for p in range(4):
        for q in range(4):
            for j in range(3):
                row = slope = 0.0
                for r in range(4):
                    c = coefficients[i + p, k + q, m + r, j]
                    row += h[r] * c
                    slope += dh[r] * c
                value[j] += b[p] * e[q] * row
                gradient[j, 0] += db[p] * e[q] * row
                gradient[j, 1] += b[p] * de[q] * row
                gradient[j, 2] += b[p] * e[q] * slope


@kept_njit(error_model="numpy")
def spline_changes(coefficients, limit, angles, swings):  # type: ignore[no-untyped-def]
    """Return values (n, 3) and gradients (n, 3, 2); see `spline_change`."""
    n = len(angles)
    values, gradients = np.empty((n, 3)), np.empty((n, 3, 2))
    for a in range(n):
        spline_change(coefficients, limit, angles[a], swings[a], values[a], gradients[a])
    return values, gradients


@kept_njit(error_model="numpy")
def spline_changes_with_history(coefficients, limit, angles, swings, previous):  # type: ignore[no-untyped-def]
    """Return values (n, 3) and gradients (n, 3, 3); see `spline_change_with_history`."""
    n = len(angles)
    values, gradients = np.empty((n, 3)), np.empty((n, 3, 3))
    for a in range(n):
        spline_change_with_history(
            coefficients, limit, angles[a], swings[a], previous[a], values[a], gradients[a]
        )
    return values, gradients
