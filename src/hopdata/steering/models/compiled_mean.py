"""Mean of the three processes and its gradient, compiled: a few points cost microseconds."""

from __future__ import annotations

from math import cos, sin

import numpy as np

from hopdata.code_cache import kept_njit
from hopdata.steering.models.kernels import correlation_and_slope


@kept_njit(error_model="numpy")
def accumulate(  # type: ignore[no-untyped-def]
    point, train, weights, inverse_squares, offset, code, periodic, value, gradient
):
    """Write mean (3,) and gradient (3, d) at one point (d,).

    `train` (m, 2 + d) holds cosine and sine of the boom angle, and the inputs; `weights` (3, m) and
    `offset` (3,) are in units of the output; `inverse_squares` (3, d) are of the length scales.
    """
    d = len(point)
    c, s = cos(point[0]), sin(point[0])
    squares, slopes = np.empty(d), np.empty(d)
    for j in range(3):
        value[j] = offset[j]
        for a in range(d):
            gradient[j, a] = 0.0
    for i in range(len(train)):
        if periodic:
            x, y = c - train[i, 0], s - train[i, 1]
            squares[0] = x * x + y * y
            slopes[0] = 2.0 * (s * train[i, 0] - c * train[i, 1])
        for a in range(1 if periodic else 0, d):
            difference = point[a] - train[i, 2 + a]
            squares[a] = difference * difference
            slopes[a] = 2.0 * difference
        for j in range(3):
            squared = 0.0
            for a in range(d):
                squared += squares[a] * inverse_squares[j, a]
            k, slope = correlation_and_slope(squared, code)
            value[j] += weights[j, i] * k
            for a in range(d):
                gradient[j, a] += weights[j, i] * slope * slopes[a] * inverse_squares[j, a]


@kept_njit(error_model="numpy")
def mean_and_gradient(  # type: ignore[no-untyped-def]
    points, train, weights, inverse_squares, offset, code, periodic
):
    """Return means (n, 3) and gradients (n, 3, d) at points (n, d); see `accumulate`."""
    n, d = points.shape
    values, gradients = np.empty((n, 3)), np.empty((n, 3, d))
    for p in range(n):
        accumulate(
            points[p], train, weights, inverse_squares, offset, code, periodic,
            values[p], gradients[p],
        )  # fmt: skip
    return values, gradients


@kept_njit(error_model="numpy")
def mean(points, train, weights, inverse_squares, offset, code, periodic):  # type: ignore[no-untyped-def]
    """Return means (n, 3) at points (n, d); see `accumulate`."""
    values, gradient = np.empty((len(points), 3)), np.empty((3, points.shape[1]))
    for p in range(len(points)):
        accumulate(
            points[p], train, weights, inverse_squares, offset, code, periodic, values[p], gradient
        )
    return values
