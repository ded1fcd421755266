"""Compiled core of the kink fit: the contact instant of largest marginal likelihood.

A problem is one contact: frames in order of time, with times in units of the window;
the contact instants of other feet; and a prior of each coefficient but the first two.
The coefficients are floor, velocity, own acceleration, the changes of acceleration and
jerk (for the same foot: velocity) at each other contact, and the creep of the standing
foot.

Numba compiles the code on a user's first run, so it is plain loops with few call sites
per function. For the same reason no count is passed as the literal 0, for which Numba
would compile everything once more. `fit_all` owns all arrays and the others get them in
tuples, so the functions do not count references to them (``_nrt=False``), which would
take half of the time.
"""

from math import exp, isnan, log, sqrt
from typing import NamedTuple

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.code_cache import kept_njit

#: Share of an interval at which the golden section divides it.
#: Unit: 1. Origin: derived: (3 - sqrt(5)) / 2.
GOLDEN = 0.3819660112501051

#: Largest number of refinements after the grid.
#: Unit: 1. Origin: chosen.
REFINEMENTS = 10

#: Resolution at which the refinement ends, in steps of the grid.
#: Unit: steps. Origin: chosen.
CLOSE = 0.004

#: The refinement also ends when the instant lies between ends this many resolutions
#: apart.
#: Unit: 1. Origin: chosen.
NARROW = 4.0

#: Fewest frames that are fitted.
#: Unit: frames. Origin: chosen.
LEAST_FRAMES = 4

#: Pivot of a Cholesky factor, as a share of the diagonal, at which a matrix counts as
#: singular.
#: Unit: 1. Origin: rounding.
SINGULAR = 1e-12

#: Ratio of the two sides of an interval below which it is too lopsided for a parabola.
#: Unit: 1. Origin: chosen.
LOPSIDED = 0.02

#: Share of a side of an interval by which a point to try keeps away from its end.
#: Unit: 1. Origin: chosen.
OFF_END = 0.05

_T = "f8[:,::1]"  # type of a table


class Problem(NamedTuple):
    """What is fitted: the frames of one contact, and the other contacts about it."""

    frames: int  # how many of the frames are used
    time: FloatArray
    height: FloatArray
    contacts: int  # how many of the others are used
    others: FloatArray  # instant of each, and 1 if it is a marker of the same foot
    compliance: float  # time constant of the contact; 0 for a hard one
    kept: float  # share of the velocity that a soft contact does not take at once
    size: int  # number of coefficients; even if the last one is the creep


class Prior(NamedTuple):
    """Priors of the coefficients from the third on."""

    mean: FloatArray
    weight: FloatArray  # inverse variance per unit of inverse noise variance
    noise2: float  # variance of a height


class Work(NamedTuple):
    """Arrays that every function may write to."""

    gram: FloatArray  # normal matrix; its Cholesky factor after `_misfit`
    right: FloatArray  # right-hand side; the coefficients after `_solve`
    row: FloatArray  # a row of the design
    cross: FloatArray  # products of the design with the slope by the instant
    unit: FloatArray  # a column of the inverse
    variance: FloatArray  # of each coefficient, per unit of noise variance
    grid: FloatArray  # misfits on the grid


@kept_njit(_nrt=False, inline="always")
def _design_row(s, tau, t, live, problem, row):  # type: ignore[no-untyped-def]
    """Fill `row` with the derivatives of the height at `t` by the coefficients.

    The frame is `s` after the contact `tau`. Before the contact, only the entries of
    the first `live` other contacts are filled.
    """
    size = problem.size
    soft = problem.compliance
    others = problem.others
    row[0] = 1.0
    if s >= 0.0:
        for a in range(1, size):
            row[a] = 0.0
        if soft > 0.0:
            row[1] = problem.kept * soft * (1.0 - exp(-s / soft))
        if size % 2 == 0:
            row[size - 1] = s
        return
    row[1] = s
    row[2] = 0.5 * s * s
    for j in range(live):
        top = max(tau - others[j, 0], 0.0)
        now = max(t - others[j, 0], 0.0)
        row[3 + 2 * j] = (now * now - top * top) / 2 - s * top
        if others[j, 1] > 0.0:
            row[4 + 2 * j] = now - top
            if top > 0.0:
                row[4 + 2 * j] -= s
        else:
            row[4 + 2 * j] = (now * now * now - top * top * top) / 6 - s * top * top / 2
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
            if b < a:
                gram[a, b] = value / gram[b, b]
            elif value <= SINGULAR * gram[a, a] or gram[a, a] <= 0.0:
                return False
            else:
                gram[a, b] = sqrt(value)
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
def _start_from_prior(size, prior, work):  # type: ignore[no-untyped-def]
    """Fill the normal equations with the prior; return what it adds to the misfit."""
    gram = work.gram
    right = work.right
    total = 0.0
    for a in range(size):
        right[a] = 0.0
        for b in range(a + 1):
            gram[a, b] = 0.0
        if a >= 2:
            weight = prior.weight[a - 2]
            mean = prior.mean[a - 2]
            gram[a, a] = weight
            right[a] = weight * mean
            total += right[a] * mean - prior.noise2 * log(weight)
    return total


@kept_njit(_nrt=False)
def _misfit(tau, problem, prior, work):  # type: ignore[no-untyped-def]
    """Return -2 noise2 times the log marginal likelihood of `tau`, up to a constant.

    It is the smallest penalised sum of squares plus a term for the volume of the
    coefficients. Without that term a late instant would be favoured, with the pushes of
    other feet in place of the floor. The factor is left in gram, and what remains to be
    substituted backward in right.
    """
    size = problem.size
    gram = work.gram
    right = work.right
    row = work.row
    total = _start_from_prior(size, prior, work)
    live = 0  # number of contacts before this one; later ones do not affect the flight
    while live < problem.contacts and problem.others[live, 0] < tau:
        live += 1
    for i in range(problem.frames):
        s = problem.time[i] - tau
        z = problem.height[i]
        total += z * z
        _design_row(s, tau, problem.time[i], live, problem, row)
        if s < 0.0:
            used = 3 + 2 * live
        elif size % 2 == 0:
            used = size
        else:
            used = 2
        for a in range(used):
            if row[a] == 0.0:  # as most entries of the stance
                continue
            right[a] += row[a] * z
            for b in range(a + 1):
                gram[a, b] += row[a] * row[b]
    if not _factor(size, gram):
        return np.inf
    for a in range(size):
        total += 2 * prior.noise2 * log(gram[a, a])
    return total - _solve(np.int64(0), size, size, gram, right)


@kept_njit(_nrt=False)
def _next_trial(left, value_left, x, value, right, value_right, close):  # type: ignore[no-untyped-def]
    """Return the next point to try in (left, right).

    It is the vertex of the parabola through three points, or the golden section where
    the parabola does not serve.
    """
    low = x - left
    high = right - x
    golden = x - GOLDEN * low
    if high > low:
        golden = x + GOLDEN * high
    rise_left = value_left - value
    rise_right = value_right - value
    if not (rise_left < np.inf and rise_right < np.inf):
        return golden
    if min(low, high) < LOPSIDED * max(low, high):
        return golden
    bend = rise_left * high + rise_right * low
    if bend <= 0.0:
        return golden
    vertex = x + (rise_left * high * high - rise_right * low * low) / (2.0 * bend)
    if abs(vertex - x) < close:
        # Step to the longer side, so that its far end moves in as well.
        if high > low:
            vertex = x + close
        else:
            vertex = x - close
    return min(max(vertex, left + OFF_END * low), right - OFF_END * high)


@kept_njit(_nrt=False)
def _on_grid(bound, reach, steps, problem, prior, work):  # type: ignore[no-untyped-def]
    """Fill the grid from -reach to reach with misfits; return the best node and value.

    Nothing before the bound is tried. The node is -1 if nothing fits.
    """
    width = 2.0 * reach / steps
    best_node = -1
    best = np.inf
    for k in range(steps + 1):
        tau = -reach + k * width
        work.grid[k] = np.inf
        if tau < bound:
            continue
        value = _misfit(tau, problem, prior, work)
        work.grid[k] = value
        if value < best:
            best = value
            best_node = k
    return best_node, best


@kept_njit(_nrt=False)
def _search(bound, reach, steps, problem, prior, work):  # type: ignore[no-untyped-def]
    """Search a grid, then parabolas about its best node.

    Return the instant and its misfit, or (NaN, inf) if nothing fits. Nothing before the
    bound is tried. What `_misfit` leaves in gram and right is that of the instant
    returned.
    """
    node, best = _on_grid(bound, reach, steps, problem, prior, work)
    if node < 0:
        return np.nan, np.inf
    width = 2.0 * reach / steps
    close = CLOSE * width
    x = -reach + node * width
    end_low = max(x - width, -reach, bound)
    end_high = min(x + width, reach)
    value_low = np.inf
    if node > 0:
        value_low = work.grid[node - 1]
    value_high = np.inf
    if node < steps:
        value_high = work.grid[node + 1]
    tau = np.nan
    for k in range(REFINEMENTS + 1):
        is_narrow = k > 0 and end_high - end_low < NARROW * close
        if k == REFINEMENTS or is_narrow:
            if tau == x:
                return tau, best
            tau = x
        else:
            tau = _next_trial(end_low, value_low, x, best, end_high, value_high, close)
        value = _misfit(tau, problem, prior, work)
        if tau == x:
            return tau, value
        if value < best:
            if tau > x:
                end_low = x
                value_low = best
            else:
                end_high = x
                value_high = best
            x = tau
            best = value
        elif tau > x:
            end_high = tau
            value_high = value
        else:
            end_low = tau
            value_low = value
    return np.nan, np.inf


@kept_njit(_nrt=False)
def _acceleration(tau, problem, coefficient):  # type: ignore[no-untyped-def]
    """Return the foot's acceleration just before the contact."""
    acceleration = coefficient[2]
    for j in range(problem.contacts):
        since = max(tau - problem.others[j, 0], 0.0)
        jerk = coefficient[4 + 2 * j] * since * (1.0 - problem.others[j, 1])
        acceleration += coefficient[3 + 2 * j] + jerk
    return acceleration


@kept_njit(_nrt=False)
def _residuals(tau, problem, work):  # type: ignore[no-untyped-def]
    """Return the sums of squares of the slopes by the instant, and of the residuals.

    Fill `cross` with the products of slopes and design.
    """
    size = problem.size
    contacts = problem.contacts
    soft = problem.compliance
    coefficient = work.right
    row = work.row
    slopes = 0.0
    misfit = 0.0
    acceleration = _acceleration(tau, problem, coefficient)
    for a in range(size):
        work.cross[a] = 0.0
    creep = 0.0
    if size > 3 + 2 * contacts:
        creep = coefficient[3 + 2 * contacts]
    for i in range(problem.frames):
        s = problem.time[i] - tau
        _design_row(s, tau, problem.time[i], contacts, problem, row)
        if s < 0.0:
            slope = -coefficient[1] - s * acceleration
        elif soft > 0.0:
            slope = -creep - coefficient[1] * problem.kept * exp(-s / soft)
        else:
            slope = -creep
        residual = problem.height[i]
        for a in range(size):
            work.cross[a] += row[a] * slope
            residual -= row[a] * coefficient[a]
        slopes += slope * slope
        misfit += residual * residual
    return slopes, misfit


@kept_njit(_nrt=False)
def _summary(tau, problem, prior, work):  # type: ignore[no-untyped-def]
    """Fill in the variances of the coefficients, per unit of noise variance.

    The method is Gauss-Newton with the instant as one more parameter, eliminated by its
    Schur complement. Return the variance of the instant, the sum of squared residuals,
    and the effective number of parameters, including the instant. Variances are
    infinite if the frames do not determine the instant.
    """
    size = problem.size
    unit = work.unit
    precision, misfit = _residuals(tau, problem, work)
    parameters = 1.0 + size
    for a in range(-1, size):  # first the instant, then each coefficient
        for k in range(size):
            unit[k] = 0.0
            if a < 0:
                unit[k] = work.cross[k]
        if a >= 0:
            unit[a] = 1.0
        _solve(max(a, 0), max(a, 0), size, work.gram, unit)
        if a < 0:
            for k in range(size):
                precision -= work.cross[k] * unit[k]
                work.variance[k] = unit[k] * unit[k]
            continue
        if precision > 0.0:
            work.variance[a] = unit[a] + work.variance[a] / precision
        else:
            work.variance[a] = np.inf
        if a >= 2:
            parameters -= prior.weight[a - 2] * unit[a]
    if precision > 0.0:
        return 1 / precision, misfit, parameters
    return np.inf, misfit, parameters


@kept_njit(_nrt=False)
def _seen(times, heights, t, z):  # type: ignore[no-untyped-def]
    """Fill `t` and `z` with the frames that show the foot; return their number."""
    n = 0
    for i in range(len(times)):
        if not isnan(heights[i]):
            t[n] = times[i]
            z[n] = heights[i]
            n += 1
    return n


@kept_njit(
    f"void({_T},{_T},f8[::1],f8,i8,i8[::1],f8[:,:,::1],f8,f8,b1,{_T},{_T},f8,{_T})"
)
def fit_all(  # type: ignore[no-untyped-def]  # noqa: PLR0913 (compiled: plain arrays)
    times,
    heights,
    bounds,
    reach,
    steps,
    contacts,
    others,
    soft,
    kept,
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
    kept : float
        Share of the velocity that a soft contact does not take at once, 0 to 1.
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
    width = times.shape[1]
    prior = Prior(np.zeros(full), np.zeros(full), noise2)
    work = Work(
        np.zeros((full, full)),
        np.zeros(full),
        np.zeros(full),
        np.zeros(full),
        np.zeros(full),
        np.zeros(full),
        np.zeros(steps + 1),
    )
    t = np.zeros(width)
    z = np.zeros(width)
    for p in range(times.shape[0]):
        n = _seen(times[p], heights[p], t, z)
        if n < LEAST_FRAMES:
            continue
        m = contacts[p]
        flight = 1 + 2 * m
        size = 2 + flight
        if creeps:
            size += 1
        for a in range(flight):
            prior.mean[a] = mean[p, a]
            prior.weight[a] = weight[p, a]
        # The creep comes last for any number of contacts.
        prior.mean[flight] = mean[p, full - 3]
        prior.weight[flight] = weight[p, full - 3]
        problem = Problem(n, t, z, m, others[p], soft, kept, size)
        tau, value = _search(bounds[p], reach, steps, problem, prior, work)
        if isnan(tau):
            continue
        _solve(size, np.int64(0), size, work.gram, work.right)
        variance, misfit, parameters = _summary(tau, problem, prior, work)
        out[p, 0] = tau
        out[p, 1] = variance
        out[p, 2] = misfit
        out[p, 3] = n - parameters
        out[p, 4] = 0.0
        out[p, 5] = 0.0
        out[p, 6] = value
        for i in range(n):
            if t[i] < tau:
                out[p, 4] += 1.0
            else:
                out[p, 5] += 1.0
        for a in range(full):
            is_creep = creeps and a == full - 1
            if is_creep or a < 2 + flight:
                k = a
                if is_creep:
                    k = size - 1
                out[p, 7 + a] = work.right[k]
                out[p, 7 + full + a] = work.variance[k]
            else:  # the data say nothing of it, so it is as the prior says
                out[p, 7 + a] = mean[p, a - 2]
                out[p, 7 + full + a] = 1 / weight[p, a - 2]
