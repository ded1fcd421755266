"""Compiled core of the kink fit: the contact instant of largest marginal likelihood.

A problem is n frames (t, z) with times in units of the window, the instants of m other feet's
contacts, and a prior (mean, weight) of each coefficient but the first two. The code is plain loops
with one call site for each function, since Numba compiles it on a user's first run.
"""

from __future__ import annotations

from math import isnan, log, sqrt

import numpy as np
from numba import njit

GOLDEN = 0.6180339887498949
GOLDEN_STEPS = 15  # half a frame to 0.1 % of a frame
LEAST_FRAMES = 4


@njit(cache=True)
def _design_row(tau, t, m, others, row):  # type: ignore[no-untyped-def]
    """Fill `row` with the derivatives of the height at `t` by the coefficients."""
    s = t - tau
    row[0] = 1.0
    row[1] = s
    row[2] = 0.5 * s * s
    for j in range(m):
        top, now = max(tau - others[j], 0.0), max(t - others[j], 0.0)
        row[3 + 2 * j] = (now * now - top * top) / 2
        row[4 + 2 * j] = (now * now * now - top * top * top) / 6
    if s >= 0.0:
        for a in range(1, 3 + 2 * m):
            row[a] = 0.0


@njit(cache=True)
def _factor(size, gram):  # type: ignore[no-untyped-def]
    """Cholesky-factor `gram` in place (lower triangle); False if it is singular."""
    for a in range(size):
        pivot = gram[a, a]
        for b in range(a):
            for k in range(b):
                gram[a, b] -= gram[a, k] * gram[b, k]
            gram[a, b] /= gram[b, b]
            gram[a, a] -= gram[a, b] * gram[a, b]
        if gram[a, a] <= 1e-12 * pivot or pivot <= 0.0:
            return False
        gram[a, a] = sqrt(gram[a, a])
    return True


@njit(cache=True)
def _solve(size, factor, right):  # type: ignore[no-untyped-def]
    """Solve L L^T x = right in place; return the sum of squares of L^-1 right."""
    total = 0.0
    for a in range(size):
        for k in range(a):
            right[a] -= factor[a, k] * right[k]
        right[a] /= factor[a, a]
        total += right[a] * right[a]
    for a in range(size - 1, -1, -1):
        for k in range(a + 1, size):
            right[a] -= factor[k, a] * right[k]
        right[a] /= factor[a, a]
    return total


@njit(cache=True)
def _misfit(tau, n, t, z, m, others, mean, weight, noise2, gram, right, row):  # type: ignore[no-untyped-def]
    """Return -2 noise2 times the log marginal likelihood of `tau`, but for a constant.

    The least penalised sum of squares, and the volume that its coefficients could have had: without
    it a late instant would pay, with the pushes of other feet in the place of the floor. Leaves the
    factor and the coefficients in gram and right.
    """
    size = 3 + 2 * m
    total = 0.0
    for a in range(size):
        right[a] = 0.0
        for b in range(a + 1):
            gram[a, b] = 0.0
        if a >= 2:
            gram[a, a] = weight[a - 2]
            right[a] = weight[a - 2] * mean[a - 2]
            total += right[a] * mean[a - 2]
    for i in range(n):
        _design_row(tau, t[i], m, others, row)
        total += z[i] * z[i]
        for a in range(size):
            right[a] += row[a] * z[i]
            for b in range(a + 1):
                gram[a, b] += row[a] * row[b]
    if not _factor(size, gram):
        return np.inf
    for a in range(size):
        total += 2 * noise2 * log(gram[a, a])
    return total - _solve(size, gram, right)


@njit(cache=True)
def _search(low, high, steps, n, t, z, m, others, mean, weight, noise2, gram, right, row):  # type: ignore[no-untyped-def]
    """Grid, then golden section about its best node; NaN if none fits.

    Leaves the fit at the instant that it returns in gram and right. Where the section ends at an
    instant that cannot be fitted, as a gap in the frames can make it, that is the node.
    """
    width = (high - low) / steps
    best, node, tau, value = np.inf, np.nan, np.nan, np.inf
    a, b, value_c, value_d = 0.0, 0.0, np.inf, np.inf
    lower = False
    for k in range(steps + GOLDEN_STEPS + 5):
        golden = k - steps - 1  # 0 and 1 are the first two inner points, then one a step
        last = golden == GOLDEN_STEPS + 3
        if last and value < np.inf:
            return tau
        if golden == 0:
            if isnan(node):
                return np.nan
            a, b, lower = max(node - width, low), min(node + width, high), True
        elif golden == 1:
            lower = False
        elif golden >= 2:
            lower = value_c < value_d
            if lower:
                b, value_d = a + GOLDEN * (b - a), value_c
            else:
                a, value_c = b - GOLDEN * (b - a), value_d
        tau = low + k * width if golden < 0 else a + (1 - GOLDEN if lower else GOLDEN) * (b - a)
        tau = node if last else tau
        value = _misfit(tau, n, t, z, m, others, mean, weight, noise2, gram, right, row)
        if golden < 0 and value < best:
            best, node = value, tau
        elif lower:
            value_c = value
        else:
            value_d = value
    return tau


@njit(cache=True)
def _summary(tau, n, t, z, m, others, weight, factor, right, row, cross, unit, variance):  # type: ignore[no-untyped-def]
    """Fill the variances of the coefficients, per unit of noise variance.

    Gauss-Newton with the instant as one more parameter, eliminated by its Schur complement. Returns
    the variance of the instant, the sum of squared residuals, and the effective number of
    parameters, the instant included. Variances are infinite where the frames do not fix it.
    """
    size = 3 + 2 * m
    own, misfit = 0.0, 0.0
    for a in range(size):
        cross[a] = 0.0
    for i in range(n):
        _design_row(tau, t[i], m, others, row)
        slope = -(right[1] + right[2] * (t[i] - tau))
        for j in range(m):
            top = max(tau - others[j], 0.0)
            slope -= right[3 + 2 * j] * top + right[4 + 2 * j] * top * top / 2
        if t[i] >= tau:
            slope = 0.0
        residual = z[i]
        for a in range(size):
            cross[a] += row[a] * slope
            residual -= row[a] * right[a]
        own += slope * slope
        misfit += residual * residual
    parameters = 1.0 + size
    for a in range(-1, size):  # first the instant, then each coefficient
        for k in range(size):
            unit[k] = cross[k] if a < 0 else (1.0 if k == a else 0.0)
        _solve(size, factor, unit)
        if a < 0:
            for k in range(size):
                own -= cross[k] * unit[k]
                variance[k] = unit[k] * unit[k]
        else:
            variance[a] = unit[a] + (variance[a] / own if own > 0.0 else np.inf)
            if a >= 2:
                parameters -= weight[a - 2] * unit[a]
    return (1 / own if own > 0.0 else np.inf), misfit, parameters


@njit(cache=True)
def fit_all(times, heights, low, high, steps, contacts, others, mean, weight, noise2, out):  # type: ignore[no-untyped-def]
    """Fit P problems of at most W frames, with F coefficients each.

    Parameters
    ----------
    times, heights : (P, W) array
        Frames; NaN heights are skipped.
    low, high : (P,) array
        Where to search for the instant.
    steps : int
        Steps of the grid.
    contacts : (P,) int array
        How many of `others` (P, (F - 3) / 2), the instants of other contacts, to take.
    mean, weight : (P, F - 2) array
        Priors: means and inverse variances per unit of inverse noise variance.
    noise2 : float
        Variance of a height.
    out : (P, 6 + 2 F) array
        Filled with the instant, its variance per unit of noise variance, the sum of squared
        residuals, the degrees of freedom, the frames before and after, then the coefficients
        (floor, velocity, acceleration, then the changes of acceleration and jerk at each other
        contact) and their variances. Rows without a fit are left as they are.
    """
    full = 2 + mean.shape[1]
    gram, right, row = np.zeros((full, full)), np.zeros(full), np.zeros(full)
    cross, unit, variance = np.zeros(full), np.zeros(full), np.zeros(full)
    t, z = np.zeros(times.shape[1]), np.zeros(times.shape[1])
    for p in range(times.shape[0]):
        n = 0
        for i in range(times.shape[1]):
            if not isnan(heights[p, i]):
                t[n], z[n] = times[p, i], heights[p, i]
                n += 1
        if n < LEAST_FRAMES:
            continue
        m, other, priors, weights = contacts[p], others[p], mean[p], weight[p]
        tau = _search(
            low[p], high[p], steps, n, t, z, m, other, priors, weights, noise2, gram, right, row
        )
        if isnan(tau):
            continue
        out[p, 1], out[p, 2], parameters = _summary(
            tau, n, t, z, m, other, weights, gram, right, row, cross, unit, variance
        )
        out[p, 0], out[p, 3], out[p, 4], out[p, 5] = tau, n - parameters, 0.0, 0.0
        for i in range(n):
            out[p, 4 if t[i] < tau else 5] += 1.0
        for a in range(full):
            used = a < 3 + 2 * m
            out[p, 6 + a] = right[a] if used else priors[a - 2]
            out[p, 6 + full + a] = variance[a] if used else 1 / weights[a - 2]
