"""Find where in a step the first guard flips, by a bracketed search on the interpolant.

That it flips, and only once in a piece of the step, is known (see `proof`). The search
starts where the guard's cubic over this piece vanishes.
"""

from math import inf

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.driver.dense import interpolate
from hopdata.hybrid.driver.problem import (
    EPS,
    Problem,
    blur,
    eval_guard,
    eval_listed,
    margin_of,
    time_resolution,
)
from hopdata.hybrid.layout import Memory

NONE = -1  # no guard

# Value of CLEARANCE: a guard falls throughout the piece in which it flips.
FALLS = -inf

# The root of the cubic through two values and two slopes of an event function. It works
# on the unit interval: slopes are per piece, not per second.

NOWHERE = 2.0  # outside the unit interval: there is no such location

#: Most iterations for a root of a cubic.
#: Unit: 1. Origin: chosen.
ITERATIONS = 40

#: Relative accuracy of the last approximation but one of a cubic's root; Newton's
#: method doubles the digits.
#: Unit: 1. Origin: chosen.
ACCURACY = 1e-4


@kernel
def cubic(g0: float, d0: float, g1: float, d1: float, x: float) -> float:
    """Return the value at `x` of the cubic with these values and slopes at 0 and 1."""
    rise = g1 - g0
    return g0 + x * (d0 + x * (3.0 * rise - 2.0 * d0 - d1 + x * (d0 + d1 - 2.0 * rise)))


@kernel
def cubic_root(
    g0: float, d0: float, g1: float, d1: float, low: float, high: float
) -> float:
    """Return a root in [low, high] where the cubic falls from above to below zero.

    The first guess comes from the cubic interpolant of the inverse function, if there
    is one.
    """
    rise = g1 - g0
    a = 3.0 * (d0 + d1 - 2.0 * rise)
    b = 3.0 * rise - 2.0 * d0 - d1
    x = NOWHERE
    if d0 < 0.0 and d1 < 0.0 and g1 < 0.0 < g0:
        x = cubic(0.0, rise / d0, 1.0, rise / d1, -g0 / rise)
    if not low < x < high:
        x = 0.5 * (low + high)
    for _ in range(ITERATIONS):
        value = cubic(g0, d0, g1, d1, x)
        slope = d0 + x * (2.0 * b + x * a)
        if value > 0.0:
            low = x
        else:
            high = x
        new = NOWHERE  # a rise leads away from the root
        if slope < 0.0:
            new = x - value / slope
        inside = low < new < high
        if abs(new - x) <= ACCURACY * x:
            return new if inside else x
        x = new if inside else 0.5 * (low + high)
    return x


# The location itself, on the interpolant.

#: Fraction of the step by which a guard has left its surface, if it ever does.
#: Unit: 1. Origin: chosen.
LEAVING = 1e-12

#: Multiple of its rate at the start at which a guard that returns has clearly left.
#: Unit: 1. Origin: chosen.
SURELY_BACK = 1000.0

#: Relative accuracy of the last approximation but one of a location; Newton's method
#: doubles the digits.
#: Unit: 1. Origin: chosen.
ROOT_ACCURACY = 1e-8

#: Relative accuracy at a discontinuous event function.
#: Unit: 1. Origin: rounding: four units in the last place of a double.
JUMP_ACCURACY = 4 * EPS

#: Largest correction of Newton's step by the cubic, as its fraction: for larger ones
#: the cubic is useless.
#: Unit: 1. Origin: chosen.
MOST_PUT_RIGHT = 0.5

#: Correction of Newton's step, as its fraction, below which the series is exact.
#: Unit: 1. Origin: chosen.
LITTLE_PUT_RIGHT = 1e-3

#: Most iterations for a location on the interpolant.
#: Unit: 1. Origin: chosen.
MAX_ROOT = 250

#: Iterations in which the bracket must become half as long, or else it is halved.
#: Newton's method takes a thousand steps down an exponential.
#: Unit: 1. Origin: chosen.
PATIENCE = 4


@kernel_apart
def probe(p: Problem, m: Memory, dt: float, k: int, theta: float) -> None:
    """Evaluate guard k on the interpolant at `theta`, into H and RATE.

    If the system gives all guards at once, all are evaluated.
    """
    interpolate(p, m, theta, at.SCRATCH, 1.0 / dt)
    t = m.clock[at.T] + theta * dt
    if p.guards != 0:
        eval_listed(p, m, at.NEAR, t, at.SCRATCH, at.SLOPE, at.H, at.RATE)
        return
    m.counts[at.NGEV] += 1
    eval_guard(p, m, t, at.SCRATCH, at.SLOPE, k, at.H, at.RATE)


@kernel_apart
def leave(p: Problem, m: Memory, dt: float, k: int, low: float) -> float:
    """Return a theta, at most `low`, where guard k is clear of its surface, or 0.

    Clear means by more than rounding: a lower flight cannot be distinguished from none.
    """
    g = m.guards
    resolution = time_resolution(m.clock[at.T], dt)
    while low > LEAVING:
        probe(p, m, dt, k, low)
        noise = blur(g[at.SIZE, k], g[at.RATE, k], resolution)
        if margin_of(p, m, k, at.H) > noise:
            return low
        low *= 0.25
    return 0.0


@kernel_apart
def back(p: Problem, m: Memory, dt: float, k: int, end: float) -> float:
    """Return where guard k is back at its surface.

    Its departure from there is below its rounding. It returns as fast as it left. Its
    mean acceleration is taken up to a location at which the interpolant resolves it.
    """
    first_rate = abs(m.guards[at.RATE0, k])
    rate = 0.0
    x = 0.25 * LEAVING
    while rate > -SURELY_BACK * first_rate and x < end:
        x = min(4.0 * x, end)
        probe(p, m, dt, k, x)
        rate = margin_of(p, m, k, at.RATE)
    if rate < first_rate:
        return min(2.0 * x * first_rate / (first_rate - rate), end)
    return end


@kernel
def just_left(p: Problem, m: Memory, dt: float, k: int) -> bool:
    """Return whether guard k is, to within rounding, still where it last flipped.

    At the start of such a step the sign of h is meaningless: acting on it would flip
    the guard back.
    """
    margin = margin_of(p, m, k, at.H0)
    rate = margin_of(p, m, k, at.RATE0)
    noise = blur(m.guards[at.SIZE, k], rate, time_resolution(m.clock[at.T], dt))
    return margin <= 0.0 or (margin <= noise and rate > 0.0)


@kernel
def way_to_root(
    x: float, g: float, d: float, x1: float, g1: float, d1: float
) -> tuple[float, bool]:
    """Return the distance from x to a falling function's root, and whether it is final.

    Newton's method from x is corrected by the cubic through both points, values and
    slopes, whose root is taken as a series. The error is Newton's times the square of
    the distance to x1.
    """
    newton = -g / d
    run = x1 - x
    rise = g1 - g
    if abs(newton) <= max(ROOT_ACCURACY * x, JUMP_ACCURACY):
        return newton, True
    per = 1.0 / (d * run)  # the cubic in units of the run, with the slope 1 at x
    u = -g * per
    slope_ahead = d1 * run * per
    mean = rise * per
    bend = 3.0 * mean - 2.0 - slope_ahead
    twist = 1.0 + slope_ahead - 2.0 * mean
    correction = u * (bend - u * (2.0 * bend * bend - twist))
    if not abs(correction) <= MOST_PUT_RIGHT:
        return newton, False
    close = abs(newton) <= abs(run) and abs(newton * run) <= ROOT_ACCURACY * x * x
    final = close and abs(correction) <= LITTLE_PUT_RIGHT
    return newton - newton * correction, final


@kernel
def guess_between(
    p: Problem, m: Memory, dt: float, k: int, low: float, high: float, right: int
) -> float:
    """Return where the cubic of guard k between two places vanishes.

    Its values and rates at `high` are in the rows `right`.
    """
    left = at.H0
    if low > 0.0:
        probe(p, m, dt, k, low)
        left = at.H
    span = (high - low) * dt
    g0 = margin_of(p, m, k, left)
    d0 = margin_of(p, m, k, left + 1) * span
    g1 = margin_of(p, m, k, right)
    d1 = margin_of(p, m, k, right + 1) * span
    return low + (high - low) * cubic_root(g0, d0, g1, d1, 0.0, 1.0)


@kernel_apart
def crossing(  # noqa: C901 (one search, whose cases share its bracket)
    p: Problem, m: Memory, dt: float, k: int, low: float, high: float, right: int
) -> float:
    """Return where guard k falls through zero on the interpolant.

    The iteration is bracketed: the guard is past its surface at `high`, where its value
    and rate are in the rows `right`, and clear of it at `low`. If it is still at the
    surface of its last flip, the interpolant decides where it is clear.
    """
    x1 = high
    g1 = margin_of(p, m, k, right)
    d1 = margin_of(p, m, k, right + 1) * dt
    if just_left(p, m, dt, k):
        low = leave(p, m, dt, k, low if low > 0.0 else 0.5 * high)
        if low == 0.0:
            m.counts[at.LOW] = 1
            falls = m.guards[at.CLEARANCE, k] == FALLS
            if margin_of(p, m, k, at.RATE0) > 0.0 and not falls:
                return back(p, m, dt, k, high)
            return 0.0
    x = guess_between(p, m, dt, k, low, high, right)
    width = high - low
    for turn in range(MAX_ROOT):
        if turn % PATIENCE == PATIENCE - 1:
            if high - low > 0.5 * width:
                x = 0.5 * (low + high)
            width = high - low
        if not low < x < high:
            x = 0.5 * (low + high)
        probe(p, m, dt, k, x)
        g = margin_of(p, m, k, at.H)
        d = margin_of(p, m, k, at.RATE) * dt
        if g > 0.0:
            low = x
        else:
            high = x
        way = -x  # a rise leads away from the root: halve the bracket
        final = False
        if d < 0.0:
            way, final = way_to_root(x, g, d, x1, g1, d1)
        if final:
            if low < x + way < high:
                return x + way
            if abs(way) <= max(ROOT_ACCURACY * x, JUMP_ACCURACY):
                return x
        if high - low <= JUMP_ACCURACY * high:
            break  # the event function jumps: end just past it
        x1 = x
        g1 = g
        d1 = d
        x = x + way
    return high


@kernel_apart
def first_root(
    p: Problem, m: Memory, dt: float, low: float, high: float, right: int
) -> tuple[int, float]:
    """Return the guard in NEAR that falls through zero first, and where.

    All of them fall once between `low` and `high`, where their values and rates are in
    the rows `right`.
    """
    k = m.lists[at.NEAR, 0]
    theta = crossing(p, m, dt, k, low, high, right)
    are_known = False  # all guards, evaluated together, at theta
    for a in range(1, m.counts[at.N_NEAR]):
        rival = m.lists[at.NEAR, a]
        if not low < theta:
            break
        if not are_known:
            probe(p, m, dt, rival, theta)
            are_known = p.guards != 0
        if margin_of(p, m, rival, at.H) >= 0.0:
            continue
        # Copied, because the search overwrites the rows of `probe`.
        m.guards[at.H_RIGHT, rival] = m.guards[at.H, rival]
        m.guards[at.RATE_RIGHT, rival] = m.guards[at.RATE, rival]
        place = crossing(p, m, dt, rival, low, theta, at.H_RIGHT)
        are_known = False
        if place < theta:
            k = rival
            theta = place
    return k, theta
