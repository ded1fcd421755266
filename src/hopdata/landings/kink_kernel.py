"""Compiled core of the kink fit: penalised least squares profiled over the contact instant.

A problem is a `window` of frames (time, height), the contacts of other feet, and priors (mean,
weight) of the coefficients but the first two. Its workspace is (gram, right, row). The functions
are few and have one call site each, since Numba compiles them on a user's first run.
"""

from __future__ import annotations

from math import isnan, sqrt

import numpy as np
from numba import njit

GOLDEN = 0.6180339887498949
GOLDEN_STEPS = 15  # half a frame to 0.1 % of a frame
LEAST_FRAMES = 4


@njit(cache=True)
def _design_row(tau, t, scale, others, row):  # type: ignore[no-untyped-def]
    """Fill `row` with the derivatives of the height at `t` by the coefficients."""
    row[:] = 0.0
    row[0] = 1.0
    s = (t - tau) / scale
    if s >= 0.0:
        return
    row[1] = s
    row[2] = 0.5 * s * s
    for j in range(others.size):
        if others[j] < tau:
            top = (tau - others[j]) / scale
            now = max((t - others[j]) / scale, 0.0)
            row[3 + 2 * j] = (now * now - top * top) / 2
            row[4 + 2 * j] = (now * now * now - top * top * top) / 6


@njit(cache=True)
def _slope_by_instant(tau, t, scale, others, coefficients):  # type: ignore[no-untyped-def]
    """Return the derivative of the height at `t` by the instant, per `scale` of time."""
    s = (t - tau) / scale
    if s >= 0.0:
        return 0.0
    slope = -(coefficients[1] + coefficients[2] * s)
    for j in range(others.size):
        if others[j] < tau:
            top = (tau - others[j]) / scale
            slope -= coefficients[3 + 2 * j] * top + coefficients[4 + 2 * j] * top * top / 2
    return slope


@njit(cache=True)
def _factor(gram):  # type: ignore[no-untyped-def]
    """Cholesky-factor `gram` in place (lower triangle); False if it is singular."""
    for a in range(gram.shape[0]):
        pivot = gram[a, a]
        for b in range(a + 1):
            value = gram[a, b]
            for k in range(b):
                value -= gram[a, k] * gram[b, k]
            if a > b:
                gram[a, b] = value / gram[b, b]
            elif value <= 1e-12 * pivot or pivot <= 0.0:
                return False
            else:
                gram[a, a] = sqrt(value)
    return True


@njit(cache=True)
def _solve(factor, right):  # type: ignore[no-untyped-def]
    """Solve L L^T x = right in place; return the sum of squares of L^-1 right."""
    total = 0.0
    for a in range(right.size):
        for k in range(a):
            right[a] -= factor[a, k] * right[k]
        right[a] /= factor[a, a]
        total += right[a] * right[a]
    for a in range(right.size - 1, -1, -1):
        for k in range(a + 1, right.size):
            right[a] -= factor[k, a] * right[k]
        right[a] /= factor[a, a]
    return total


@njit(cache=True)
def _penalised(tau, t, z, scale, others, mean, weight, gram, right, row):  # type: ignore[no-untyped-def]
    """Least penalised sum of squares at `tau`; leaves factor and coefficients in gram, right."""
    gram[:] = 0.0
    right[:] = 0.0
    total = 0.0
    for k in range(right.size - 2):
        gram[2 + k, 2 + k] = weight[k]
        right[2 + k] = weight[k] * mean[k]
        total += weight[k] * mean[k] * mean[k]
    for i in range(t.size):
        _design_row(tau, t[i], scale, others, row)
        total += z[i] * z[i]
        for a in range(right.size):
            right[a] += row[a] * z[i]
            for b in range(a + 1):
                gram[a, b] += row[a] * row[b]
    if not _factor(gram):
        return np.inf
    return total - _solve(gram, right)


@njit(cache=True)
def _search(low, high, steps, t, z, scale, others, mean, weight, gram, right, row):  # type: ignore[no-untyped-def]
    """Grid, then golden section about its best node; NaN if none fits.

    Leaves the fit at the instant returned in the workspace.
    """
    width = (high - low) / steps
    best, at = np.inf, np.nan
    a, b = low, high
    left, left_value, right_value = True, np.inf, np.inf
    for k in range(steps + 1 + 2 + GOLDEN_STEPS + 1):
        golden = k - steps - 1
        if golden < 0:
            tau = low + k * width
        elif golden == GOLDEN_STEPS + 2:
            tau = 0.5 * (a + b)
        else:
            if golden == 0:
                a, b = max(at - width, low), min(at + width, high)
            elif golden >= 2:
                left = left_value < right_value
                if left:
                    b, right_value = a + GOLDEN * (b - a), left_value
                else:
                    a, left_value = b - GOLDEN * (b - a), right_value
            else:
                left = False
            tau = b - GOLDEN * (b - a) if left else a + GOLDEN * (b - a)
        value = _penalised(tau, t, z, scale, others, mean, weight, gram, right, row)
        if golden < 0:
            if value < best:
                best, at = value, tau
        elif left:
            left_value = value
        else:
            right_value = value
        if golden == -1 and isnan(at):
            return np.nan
    return tau


@njit(cache=True)
def _summary(tau, t, z, scale, others, weight, factor, coefficients, row, out):  # type: ignore[no-untyped-def]
    """Write the variances of the coefficients to `out`; return those of the fit as a whole.

    Gauss-Newton with the instant as one more parameter, eliminated by its Schur complement. Returns
    the variance of the instant per unit of noise variance, the sum of squared residuals, and the
    effective number of parameters, the instant included.
    """
    size = coefficients.size
    cross, unit = np.zeros(size), np.zeros(size)
    own, misfit = 0.0, 0.0
    for i in range(t.size):
        slope = _slope_by_instant(tau, t[i], scale, others, coefficients)
        _design_row(tau, t[i], scale, others, row)
        own += slope * slope
        residual = z[i]
        for a in range(size):
            cross[a] += row[a] * slope
            residual -= row[a] * coefficients[a]
        misfit += residual * residual
    parameters = 1.0 + size
    for a in range(-1, size):  # first the instant, then each coefficient
        if a < 0:
            unit[:] = cross
        else:
            unit[:] = 0.0
            unit[a] = 1.0
        _solve(factor, unit)
        if a < 0:
            for k in range(size):
                own -= cross[k] * unit[k]
                out[k] = unit[k] * unit[k]
        else:
            out[a] = unit[a] + out[a] / own
            if a >= 2:
                parameters -= weight[a - 2] * unit[a]
    return (scale * scale / own if own > 0.0 else np.inf), misfit, parameters


@njit(cache=True)
def fit_all(time, height, start, stop, foot, low, high, steps, others, mean, weight, scale, out):  # type: ignore[no-untyped-def]
    """Fit every problem p: foot `foot[p]`, frames start[p]:stop[p], instants low[p] to high[p].

    Writes to `out[p]`: instant, its variance per unit noise variance, misfit, degrees of
    freedom, frames before and after, then the coefficients (floor, velocity, acceleration, then
    the changes of acceleration and jerk at each other contact; scaled) and their variances.
    """
    full = 3 + 2 * others.shape[1]
    columns = np.arange(full)
    all_t, all_z = np.empty(out.shape[1] + np.max(stop - start)), np.empty(
        out.shape[1] + np.max(stop - start)
    )
    for p in range(start.size):
        n = 0
        before = 0
