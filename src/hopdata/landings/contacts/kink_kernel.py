"""Compiled core of the kink fit: the contact instant with the largest marginal likelihood.

A problem consists of n frames (t, z) in order of time, with times in units of the
window; the contact instants of m other feet (each with a 1 if it is a marker of the
same foot, else 0); and a prior (mean, weight) of each coefficient but the first two.
The coefficients are floor, velocity, own acceleration, the changes of acceleration and
jerk (for the same foot: velocity) at each other contact, and the creep of the standing
foot. Numba compiles the code on a user's first run, so it is plain loops with one call
site per function. For the same reason no count is passed as the literal 0, for which
Numba would compile everything once more. The callers own all arrays, so the functions
do not count references to them (``_nrt=False``), which would take half of the time.
"""

from math import exp, isnan, log, sqrt

import numpy as np

from hopdata.code_cache import kept_njit

GOLDEN = 0.3819660112501051
REFINEMENTS = 10  # largest number of refinements after the grid
CLOSE = 0.004  # resolution at which the refinement ends, in steps of the grid
LEAST_FRAMES = 4  # fewest frames that are fitted
_T = "f8[:,::1]"  # type of a table


@kept_njit(_nrt=False, inline="always")
def _design_row(s, tau, t, m, others, soft, size, row):  # type: ignore[no-untyped-def]
    """Fill `row` with the derivatives of the height at `t` = tau + s by the coefficients.

    If `size` is even, the last coefficient is the creep. Before the contact, only the
    entries of m other contacts are filled.
    """
    row[0] = 1.0
    if s >= 0.0:
        for a in range(1, size):
            row[a] = 0.0
        row[1] = soft * (1.0 - exp(-s / soft)) if soft > 0.0 else 0.0
        if size % 2 == 0:
            row[size - 1] = s
        return
    row[1] = s
    row[2] = 0.5 * s * s
    for j in range(m):
        top, now = max(tau - others[j, 0], 0.0), max(t - others[j, 0], 0.0)
        row[3 + 2 * j] = (now * now - top * top) / 2 - s * top
        row[4 + 2 * j] = (now * now * now - top * top * top) / 6 - s * top * top / 2
        if others[j, 1] > 0.0:
            row[4 + 2 * j] = now - top - (s if top > 0.0 else 0.0)
    if size % 2 == 0:
        row[size - 1] = 0.0


@kept_njit(_nrt=False)
def _factor(size, gram):  # type: ignore[no-untyped-def]
    """Cholesky-factor `gram` in place (lower triangle); False if it is singular."""
    for a in range(size):
        for b in range(a + 1):
            value = gram[a, b]
            for k in range(b):
                value -= gram[a, k] * gram[b, k]
            if b == a and (value <= 1e-12 * gram[a, a] or gram[a, a] <= 0.0):
                return False
            gram[a, b] = sqrt(value) if b == a else value / gram[b, b]
    return True


@kept_njit(_nrt=False)
def _solve(first, last, size, factor, right):  # type: ignore[no-untyped-def]
    """Solve L L^T x = right in place; return the sum of squares of L^-1 right.

    The forward substitution begins at the entry `first`, before which all are 0; the
    backward one ends at the entry `last`.
    """
    total = 0.0
    for a in range(first, size):
        value = right[a]
        for k in range(first, a):
            value -= factor[a, k] * right[k]
        right[a] = value / factor[a, a]
        total += right[a] * right[a]
    for a in range(size - 1, last - 1, -1):
        value = right[a]
        for k in range(a + 1, size):
            value -= factor[k, a] * right[k]
        right[a] = value / factor[a, a]
    return total


@kept_njit(_nrt=False)
def _misfit(
    tau, n, t, z, m, others, soft, size, mean, weight, noise2, gram, right, row
):  # type: ignore[no-untyped-def]
    """Return -2 noise2 times the log marginal likelihood of `tau`, up to a constant.

    It is the smallest penalised sum of squares plus a term for the volume of the
    coefficients. Without that term a late instant would be favoured, with the pushes of
    other feet in place of the floor. The factor is left in gram, and what remains to be
    substituted backward in right.
    """
    total = 0.0
    for a in range(size):
        right[a] = 0.0
        for b in range(a + 1):
            gram[a, b] = 0.0
        if a >= 2:
            gram[a, a] = weight[a - 2]
            right[a] = weight[a - 2] * mean[a - 2]
            total += right[a] * mean[a - 2] - noise2 * log(weight[a - 2])
    live = 0  # number of contacts before this one; later ones do not affect the flight
    while live < m and others[live, 0] < tau:
        live += 1
    for i in range(n):
        s = t[i] - tau
        total += z[i] * z[i]
        _design_row(s, tau, t[i], live, others, soft, size, row)
        for a in range(3 + 2 * live if s < 0.0 else size if size % 2 == 0 else 2):
            if row[a] == 0.0:  # as most entries of the stance
                continue
            right[a] += row[a] * z[i]
            for b in range(a + 1):
                gram[a, b] += row[a] * row[b]
    if not _factor(size, gram):
        return np.inf
    for a in range(size):
        total += 2 * noise2 * log(gram[a, a])
    return total - _solve(np.int64(0), size, size, gram, right)


@kept_njit(_nrt=False)
def _vertex(left, value_left, x, value, right, value_right, close):  # type: ignore[no-untyped-def]
    """Return the next point to try in (left, right): a parabola's vertex, or the golden section."""
    low, high = x - left, right - x
    golden = x + GOLDEN * high if high > low else x - GOLDEN * low
    rise_left, rise_right = value_left - value, value_right - value
    if not (rise_left < np.inf and rise_right < np.inf) or min(low, high) < 0.02 * max(
        low, high
    ):
        return golden
    bend = rise_left * high + rise_right * low
    if bend <= 0.0:
        return golden
    u = x + (rise_left * high * high - rise_right * low * low) / (2.0 * bend)
    if (
        abs(u - x) < close
    ):  # step to the longer side, so that its far end moves in as well
        u = x + close if high > low else x - close
    return min(max(u, left + 0.05 * low), right - 0.05 * high)


@kept_njit(_nrt=False)
def _search(  # type: ignore[no-untyped-def]
    bound, low, high, steps, n, t, z, m, others, soft, size, mean, weight, noise2, gram, right, row,
    grid,
):  # fmt: skip
    """Search a grid, then parabolas about its best node; return (NaN, inf) if nothing fits.

    Nothing before the bound is tried. `_misfit` at the returned instant is left in gram
    and right.
    """
    width = (high - low) / steps
    close = CLOSE * width
    node, best, tau = -1, np.inf, np.nan
    x, end_low, end_high, value_low, value_high = 0.0, 0.0, 0.0, np.inf, np.inf
    for k in range(steps + REFINEMENTS + 2):
        if k <= steps:
            tau, grid[k] = low + k * width, np.inf
            if tau < bound:
                continue
        elif k == steps + REFINEMENTS + 1 or (
            k > steps + 1 and end_high - end_low < 4 * close
        ):
            if tau == x:
                return tau, best
            tau = x
        else:
            if k == steps + 1:
                if node < 0:
                    return np.nan, np.inf
                x = low + node * width
                end_low, end_high = max(x - width, low, bound), min(x + width, high)
                value_low = grid[node - 1] if node > 0 else np.inf
                value_high = grid[node + 1] if node < steps else np.inf
            tau = _vertex(end_low, value_low, x, best, end_high, value_high, close)
        value = _misfit(
            tau, n, t, z, m, others, soft, size, mean, weight, noise2, gram, right, row
        )
        if k <= steps:
            grid[k] = value
            if value < best:
                best, node = value, k
        elif tau == x:
            return tau, value
        elif value < best:
            if tau > x:
                end_low, value_low = x, best
            else:
                end_high, value_high = x, best
            x, best = tau, value
        elif tau > x:
            end_high, value_high = tau, value
        else:
            end_low, value_low = tau, value
    return np.nan, np.inf


@kept_njit(_nrt=False)
def _summary(  # type: ignore[no-untyped-def]
    tau,
    n,
    t,
    z,
    m,
    others,
    soft,
    size,
    weight,
    factor,
    right,
    row,
    cross,
    unit,
    variance,
):
    """Fill in the variances of the coefficients, per unit of noise variance.

    The method is Gauss-Newton with the instant as one more parameter, eliminated by its
    Schur complement. Return the variance of the instant, the sum of squared residuals,
    and the effective number of parameters, including the instant. Variances are
    infinite if the frames do not determine the instant.
    """
    own, misfit = 0.0, 0.0
    push = right[2]  # acceleration just before the contact
    for a in range(size):
        cross[a] = 0.0
    for j in range(m):
        since = max(tau - others[j, 0], 0.0)
        push += right[3 + 2 * j] + right[4 + 2 * j] * since * (1.0 - others[j, 1])
    creep = right[3 + 2 * m] if size > 3 + 2 * m else 0.0
    for i in range(n):
        s = t[i] - tau
        _design_row(s, tau, t[i], m, others, soft, size, row)
        slope = -right[1] - s * push
        if s >= 0.0:
            slope = -creep - (right[1] * exp(-s / soft) if soft > 0.0 else 0.0)
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
        _solve(max(a, 0), max(a, 0), size, factor, unit)
        if a < 0:
            for k in range(size):
                own -= cross[k] * unit[k]
                variance[k] = unit[k] * unit[k]
        else:
            variance[a] = unit[a] + (variance[a] / own if own > 0.0 else np.inf)
            if a >= 2:
                parameters -= weight[a - 2] * unit[a]
    return (1 / own if own > 0.0 else np.inf), misfit, parameters


@kept_njit(_nrt=False)
def _seen(times, heights, t, z):  # type: ignore[no-untyped-def]
    """Fill `t` and `z` with the frames that show the foot; return their number."""
    n = 0
    for i in range(len(times)):
        if not isnan(heights[i]):
            t[n], z[n] = times[i], heights[i]
            n += 1
    return n


@kept_njit(f"void({_T},{_T},f8[::1],f8,i8,i8[::1],f8[:,:,::1],f8,b1,{_T},{_T},f8,{_T})")
def fit_all(  # type: ignore[no-untyped-def]
    times,
    heights,
    bounds,
    reach,
    steps,
    contacts,
    others,
    soft,
    creeps,
    mean,
    weight,
    noise2,
    out,
):
    """Fit P problems of at most W frames and F coefficients each.

    Parameters
    ----------
    times, heights : (P, W) array
        Frames; NaN heights are skipped.
    bounds : (P,) array
        Instants before which no contact is sought.
    reach : float
        Half width of the search.
    steps : int
        Steps of the grid.
    contacts : (P,) int array
        How many of `others` (P, (F - 4) / 2, 2) to use, in order of time. `others`
        holds contact instants, and 1 for each that is of the same foot.
    soft : float
        Time constant with which a contact takes up the foot's velocity; 0 for a hard
        contact.
    creeps : bool
        Whether a standing foot may creep.
    mean, weight : (P, F - 2) array
        Priors: means and inverse variances per unit of inverse noise variance.
    noise2 : float
        Variance of a height.
    out : (P, 7 + 2 F) array
        Filled with the instant, its variance per unit of noise variance, the sum of
        squared residuals, the degrees of freedom, the frames before and after, -2
        noise2 times the log marginal likelihood, then the coefficients (floor,
        velocity, acceleration, the changes of acceleration and jerk at each other
        contact, creep) and their variances. Rows without a fit are left as they are.
    """
    full = 2 + mean.shape[1]
    gram, right, row = np.zeros((full, full)), np.zeros(full), np.zeros(full)
    cross, unit, variance = np.zeros(full), np.zeros(full), np.zeros(full)
    priors, weights = np.zeros(full), np.zeros(full)
    t, z, grid = np.zeros(times.shape[1]), np.zeros(times.shape[1]), np.zeros(steps + 1)
    for p in range(times.shape[0]):
        n = _seen(times[p], heights[p], t, z)
        if n < LEAST_FRAMES:
            continue
        m, other = contacts[p], others[p]
        flight = 1 + 2 * m
        size = 2 + flight + (1 if creeps else 0)
        for a in range(flight + 1):  # the creep comes last for any number of contacts
            last = full - 3 if a == flight else a
            priors[a], weights[a] = mean[p, last], weight[p, last]
        tau, value = _search(
            bounds[p], -reach, reach, steps, n, t, z, m, other, soft, size, priors, weights, noise2,
            gram, right, row, grid,
        )  # fmt: skip
        if isnan(tau):
            continue
        _solve(size, np.int64(0), size, gram, right)
        out[p, 1], out[p, 2], parameters = _summary(
            tau,
            n,
            t,
            z,
            m,
            other,
            soft,
            size,
            weights,
            gram,
            right,
            row,
            cross,
            unit,
            variance,
        )
        out[p, 0], out[p, 3], out[p, 4], out[p, 5] = tau, n - parameters, 0.0, 0.0
        out[p, 6] = value
        for i in range(n):
            out[p, 4 if t[i] < tau else 5] += 1.0
        for a in range(full):
            is_creep = creeps and a == full - 1
            k = size - 1 if is_creep else a
            used = is_creep or a < 2 + flight
            out[p, 7 + a] = right[k] if used else mean[p, a - 2]
            out[p, 7 + full + a] = variance[k] if used else 1 / weight[p, a - 2]
