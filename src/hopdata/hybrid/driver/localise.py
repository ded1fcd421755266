"""Find where in a step the first guard flips, by a bracketed search on the interpolant.

The search starts where the guard's cubic vanishes or is lowest.
"""

from math import inf, sqrt

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.driver.dense import interpolate, prepare_interpolant
from hopdata.hybrid.driver.problem import (
    EPS,
    Problem,
    blur,
    eval_listed,
    is_leaving,
    margin_of,
    time_resolution,
)
from hopdata.hybrid.driver.watch import (
    GRAZE,
    check_point,
    clearance,
    ends_between,
    piece_before,
)
from hopdata.hybrid.layout import Memory

# Turning points and roots of the cubic through two values and two slopes of an event
# function.
#
# All functions work on the unit interval: slopes are per step, not per second.

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
def turning_points(g0: float, d0: float, g1: float, d1: float) -> tuple[float, float]:
    """Return where in (0, 1) the cubic has its maximum and its minimum, or NOWHERE."""
    rise = g1 - g0
    a = 3.0 * (d0 + d1 - 2.0 * rise)
    b = 3.0 * rise - 2.0 * d0 - d1  # slope = d0 + 2 b x + a x^2
    root = b * b - a * d0
    if root <= 0.0:
        return NOWHERE, NOWHERE
    # At the minimum the slope rises, 2 b + 2 a x = +2 sqrt(root); at the maximum it
    # falls.
    q = -(b + sqrt(root)) if b >= 0.0 else sqrt(root) - b
    near = d0 / q
    far = q / a if a != 0.0 else NOWHERE
    if b >= 0.0:
        minimum = near
        maximum = far
    else:
        minimum = far
        maximum = near
    if not 0.0 < minimum < 1.0:
        minimum = NOWHERE
    if not 0.0 < maximum < 1.0:
        maximum = NOWHERE
    return maximum, minimum


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


# Guards that may flip within a step, and roughly where: judged by the cubics between
# its check points.
#
# A cubic matches values and rates at both ends of its piece of the step. Where it falls
# through zero, the guard is past its surface; where it only comes near, the interpolant
# decides.

PASS = 0
CROSSING = 1
DIP = 2
NONE = -1  # no guard
Suspicion = tuple[int, int, float, float, int]  # kind, guard, guess, low end, piece

#: A dip this close to an end of a piece, as a fraction of the piece, counts as that
#: end.
#: Unit: 1. Origin: chosen.
EDGE = 1e-6

#: Rise over slope above which a cubic cannot turn back.
#: Unit: 1. Origin: derived: 1/3 (Fritsch and Carlson), rounded up.
STEEPEST = 0.34

#: Fraction of a dip's depth by which its cubic may be wrong.
#: Unit: 1. Origin: chosen.
UNSURE = 0.5


@kernel
def is_monotone(rise: float, d0: float, d1: float) -> bool:
    """Return whether a cubic is certainly monotone (Fritsch and Carlson)."""
    if d0 >= 0.0:
        return d1 >= 0.0 and rise >= STEEPEST * max(d0, d1)
    return d1 <= 0.0 and rise <= STEEPEST * min(d0, d1)


@kernel
def suspect(
    g0: float, d0: float, g1: float, d1: float, noise: float
) -> tuple[int, float, float]:
    """Judge a guard whose cubic does not stay clear of its surface.

    Takes margins and slopes (per step) at both ends, and the rounding error `noise` of
    a margin of zero. Returns the kind of suspicion, where to look first, and a place
    before that.
    """
    # A guard that has just flipped and is leaving may still be on its old side by
    # rounding.
    crossed = g1 < -noise or (g1 <= 0.0 and d1 < 0.0)
    if not crossed and is_monotone(g1 - g0, d0, d1):
        return PASS, 1.0, 0.0
    top, bottom = turning_points(g0, d0, g1, d1)
    low = top if g0 == 0.0 and top < bottom else 0.0
    deep = cubic(g0, d0, g1, d1, bottom) if EDGE < bottom < 1.0 - EDGE else inf
    if crossed:
        high = bottom if deep < 0.0 and bottom > low else 1.0
        return CROSSING, cubic_root(g0, d0, g1, d1, low, high), low
    if g0 <= noise and (d0 < 0.0 or g1 <= noise) and deep >= -noise:
        return PASS, 1.0, 0.0  # on its surface to within rounding, and stays there
    if deep < max(GRAZE * max(g0, g1), UNSURE * (min(g0, g1) - deep)):
        return DIP, bottom, low
    return PASS, 1.0, 0.0


@kernel
def suspect_before(
    m: Memory, k: int, lock: int, dt: float, end: float, resolution: float
) -> tuple[int, float, float, int]:
    """Judge a guard between check points of the step that ends at its fraction `end`.

    Returns the result of `suspect` for the first piece in which the guard does not stay
    clear, and the piece.
    """
    g = m.guards
    for piece in range(m.counts[at.PIECES]):
        last, start, part = piece_before(m, piece, end)
        if not part > 0.0:
            break
        g0, d0, g1, d1 = ends_between(m, k, lock, at.H0 + 2 * piece, last, part * dt)
        if clearance(g0, d0, g1, d1) > 0.0:
            continue
        if g1 < 0.0 < d0 and is_leaving(m, k, d1, (start + part) * dt, resolution):
            continue
        noise = blur(g[at.SIZE, k], g[last + 1, k], resolution)
        kind, guess, low = suspect(max(g0, 0.0), d0, g1, d1, noise)
        if kind != PASS:
            return kind, start + guess * part, start + low * part, piece
    return PASS, 1.0, 0.0, 0


@kernel
def first_suspect(p: Problem, m: Memory, dt: float, k: int, end: float) -> Suspicion:
    """Return the suspect guard with the earliest guess (see `Suspicion`).

    The first call, with k = NONE, checks all guards in NEAR and sets the clearance of
    suspects to -inf. Later calls check only these and the guards past their surface in
    row H, because they may flip before guard k does, at `end`.
    """
    g = m.guards
    best = (PASS, NONE, NOWHERE, 0.0, 0)
    resolution = time_resolution(m.clock[at.T], dt)
    for a in range(m.counts[at.N_NEAR]):
        j = m.lists[at.NEAR, a]
        lock = p.mode[j]
        asked = g[at.CLEARANCE, j] == -inf or lock * g[at.H, j] < 0.0
        if k != NONE and (j == k or not asked):
            continue
        kind, guess, low, piece = suspect_before(m, j, lock, dt, end, resolution)
        if kind != PASS and k == NONE:
            g[at.CLEARANCE, j] = -inf
        if kind != PASS and guess < best[2]:
            best = (kind, j, guess, low, piece)
    return best


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
MAX_ROOT = 120

#: Most iterations for the minimum of a guard on the interpolant.
#: Unit: 1. Origin: chosen.
MAX_DIP = 40

#: Iterations for a minimum after which the bracket is halved.
#: Unit: 1. Origin: chosen.
PATIENCE = 8

#: Searches for an earlier cut, for each guard that may flip within the step.
#: Unit: 1. Origin: chosen.
MOST_RIVALS = 2


@kernel_apart
def probe(p: Problem, m: Memory, dt: float, theta: float) -> None:
    """Evaluate the guards in NEAR on the interpolant at `theta`, into H and RATE."""
    interpolate(p, m, theta, at.SCRATCH, 1.0 / dt)
    t = m.clock[at.T] + theta * dt
    eval_listed(p, m, at.NEAR, t, at.SCRATCH, at.SLOPE, at.H, at.RATE)


@kernel_apart
def lowest_point(
    p: Problem, m: Memory, dt: float, k: int, theta: float, piece: int, end: float
) -> float:
    """Return the location of the minimum of guard k on the interpolant, near `theta`.

    It is a root of the guard's rate, found by bisection at worst, in the piece `piece`
    of the step that ends at `end`.
    """
    lock = p.mode[k]
    last, low, part = piece_before(m, piece, end)
    high = low + part
    _, slope_low, _, slope_high = ends_between(m, k, lock, at.H0 + 2 * piece, last, 1.0)
    for tries in range(MAX_DIP):
        probe(p, m, dt, theta)
        slope = margin_of(p, m, k, at.RATE)
        if slope < 0.0:
            low = theta
            slope_low = slope
        else:
            high = theta
            slope_high = slope
        if not slope_low < 0.0 <= slope_high:
            return theta
        guess = low - slope_low * (high - low) / (slope_high - slope_low)
        if high - low < 4.0 * EDGE or slope == 0.0:
            return guess
        if tries >= PATIENCE or not low < guess < high:
            guess = 0.5 * (low + high)
        elif abs(guess - theta) < EDGE:
            # It has converged, unless the rate is flat: bracket it.
            guess += EDGE if slope < 0.0 else -EDGE
        theta = guess
    return theta


@kernel_apart
def leave(p: Problem, m: Memory, dt: float, k: int, low: float) -> float:
    """Return a theta, at most `low`, where guard k is clear of its surface, or 0.

    Clear means by more than rounding: a lower flight cannot be distinguished from none.
    """
    g = m.guards
    resolution = time_resolution(m.clock[at.T], dt)
    while low > LEAVING:
        probe(p, m, dt, low)
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
        probe(p, m, dt, x)
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


@kernel_apart
def crossing(
    p: Problem,
    m: Memory,
    dt: float,
    k: int,
    guess: float,
    low: float,
    piece: int,
    end: float,
) -> float:
    """Return where guard k falls through zero on the interpolant.

    The iteration is bracketed. The guard is past its surface at `end` or at the end of
    the piece. Its cubic is clear at `low`. If it is still at the surface of its last
    flip, the interpolant decides where it is clear.
    """
    x1 = (piece + 1) * m.clock[at.PIECE]
    last = check_point(m, piece + 1)
    g1 = margin_of(p, m, k, last)
    d1 = margin_of(p, m, k, last + 1) * dt
    end = min(end, x1)
    if just_left(p, m, dt, k):
        low = leave(p, m, dt, k, low if low > 0.0 else 0.5 * end)
        if low == 0.0:
            m.counts[at.LOW] = 1
            if margin_of(p, m, k, at.RATE0) > 0.0:
                return back(p, m, dt, k, end)
            return 0.0
    x = guess
    high = end
    for _ in range(MAX_ROOT):
        if not low < x < high:
            x = 0.5 * (low + high)
        probe(p, m, dt, x)
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
def first_cut(p: Problem, m: Memory, dt: float) -> tuple[int, int, float]:
    """Return (kind, guard, theta): where the step must end, and why.

    It must end there for a guard in NEAR. The earliest guess need not be the earliest
    location, so each location is checked for rivals before it.
    """
    kind = PASS
    k = NONE
    theta = 1.0
    for _ in range(MOST_RIVALS * m.counts[at.N_NEAR]):
        rival, other, guess, low, piece = first_suspect(p, m, dt, k, theta)
        if rival == PASS:
            break
        prepare_interpolant(p, m, dt)
        if rival == DIP:
            location = lowest_point(p, m, dt, other, guess, piece, theta)
        else:
            location = crossing(p, m, dt, other, guess, low, piece, theta)
        if k != NONE and not location < theta:
            break
        kind = rival
        k = other
        theta = location
    return kind, k, theta
