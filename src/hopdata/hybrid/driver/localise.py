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
    time_resolution,
)
from hopdata.hybrid.driver.watch import (
    GRAZE,
    clearance,
    ends_between,
    knot,
    piece_before,
)
from hopdata.hybrid.layout import Memory

# Turning points and roots of the cubic through two values and two slopes of an event
# function.
#
# All functions work on the unit interval: slopes are per step, not per second.

NOWHERE = 2.0
ITERATIONS, ACCURACY = (
    40,
    1e-4,
)  # accuracy of the last root but one; Newton doubles the digits


@kernel
def cubic(g0: float, d0: float, g1: float, d1: float, x: float) -> float:
    """Return the value at `x` of the cubic with values g0, g1 and slopes d0, d1 at 0 and 1."""
    rise = g1 - g0
    return g0 + x * (d0 + x * (3.0 * rise - 2.0 * d0 - d1 + x * (d0 + d1 - 2.0 * rise)))


@kernel
def turning_points(g0: float, d0: float, g1: float, d1: float) -> tuple[float, float]:
    """Return the places in (0, 1) of the cubic's maximum and minimum, NOWHERE where absent."""
    rise = g1 - g0
    a = 3.0 * (d0 + d1 - 2.0 * rise)
    b = 3.0 * rise - 2.0 * d0 - d1  # slope = d0 + 2 b x + a x^2
    root = b * b - a * d0
    if root <= 0.0:
        return NOWHERE, NOWHERE
    # At the minimum the slope rises, 2 b + 2 a x = +2 sqrt(root); at the maximum it
    # falls.
    q = -(b + sqrt(root)) if b >= 0.0 else sqrt(root) - b
    near, far = d0 / q, q / a if a != 0.0 else NOWHERE
    minimum, maximum = (near, far) if b >= 0.0 else (far, near)
    minimum = minimum if 0.0 < minimum < 1.0 else NOWHERE
    return maximum if 0.0 < maximum < 1.0 else NOWHERE, minimum


@kernel
def cubic_root(
    g0: float, d0: float, g1: float, d1: float, low: float, high: float
) -> float:
    """Return a root in [low, high] where the cubic falls from above to below zero.

    The first guess comes from the cubic interpolant of the inverse function, if there
    is one.
    """
    rise, x = g1 - g0, NOWHERE
    b, a = 3.0 * rise - 2.0 * d0 - d1, 3.0 * (d0 + d1 - 2.0 * rise)
    if d0 < 0.0 and d1 < 0.0 and g1 < 0.0 < g0:
        x = cubic(0.0, rise / d0, 1.0, rise / d1, -g0 / rise)
    if not low < x < high:
        x = 0.5 * (low + high)
    for _ in range(ITERATIONS):
        value, slope = cubic(g0, d0, g1, d1, x), d0 + x * (2.0 * b + x * a)
        if value > 0.0:
            low = x
        else:
            high = x
        new = (
            x - value / slope if slope < 0.0 else NOWHERE
        )  # a rise leads away from the root
        inside = low < new < high
        if abs(new - x) <= ACCURACY * x:
            return new if inside else x
        x = new if inside else 0.5 * (low + high)
    return x


# Guards that may flip within a step, and roughly where: judged by the cubics between
# its knots.
#
# A cubic matches values and rates at both ends of its piece of the step. Where it falls
# through zero, the guard is past its surface; where it only comes near, the interpolant
# decides.

PASS, CROSSING, DIP = 0, 1, 2
NONE = -1  # no guard
Suspicion = tuple[
    int, int, float, float, int
]  # kind, guard, guess, a place before it, piece

EDGE = 1e-6  # fraction of a piece: a dip this close to an end counts as that end
STEEPEST = (
    0.34  # rise over slope above which a cubic cannot turn back (1/3, rounded up)
)
UNSURE = 0.5  # fraction of a dip's depth by which its cubic may be wrong


@kernel
def is_monotone(rise: float, d0: float, d1: float) -> bool:
    """Return whether a cubic with these slopes is certainly monotone (Fritsch and Carlson)."""
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
    """Judge a guard between consecutive knots of the step that ends at its fraction `end`.

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
    """Return (kind, guard, guess, low, piece) of the suspect guard with the earliest guess.

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


LEAVING = (
    1e-12  # fraction of the step by which a guard has left its surface, if it ever does
)
SURELY_BACK = 1000.0  # multiple of the rate at which a guard has left
ROOT_ACCURACY = (
    1e-8  # accuracy of the last approximation but one; Newton doubles the digits
)
JUMP_ACCURACY = 4 * EPS  # relative accuracy at a discontinuous event function
MOST_PUT_RIGHT = (
    0.5  # fraction of Newton's step: the cubic is useless for larger corrections
)
LITTLE_PUT_RIGHT = (
    1e-3  # fraction of Newton's step: the series is exact for smaller corrections
)
MAX_ROOT, MAX_DIP, PATIENCE, MOST_RIVALS = 120, 40, 8, 2


@kernel_apart
def probe(p: Problem, m: Memory, dt: float, theta: float) -> None:
    """Evaluate the guards in NEAR on the interpolant at `theta`, into H and RATE."""
    interpolate(p, m, theta, at.SCRATCH, 1.0 / dt)
    eval_listed(
        p, m, at.NEAR, m.clock[at.T] + theta * dt, at.SCRATCH, at.SLOPE, at.H, at.RATE
    )


@kernel_apart
def lowest_point(
    p: Problem, m: Memory, dt: float, k: int, theta: float, piece: int, end: float
) -> float:
    """Refine the minimum of guard k on the interpolant: a root of its rate, by bisection at worst.

    It lies in the piece `piece` of the step that ends at `end`.
    """
    lock = p.mode[k]
    last, low, part = piece_before(m, piece, end)
    high = low + part
    _, slope_low, _, slope_high = ends_between(m, k, lock, at.H0 + 2 * piece, last, 1.0)
    for tries in range(MAX_DIP):
        probe(p, m, dt, theta)
        slope = lock * m.guards[at.RATE, k]
        if slope < 0.0:
            low, slope_low = theta, slope
        else:
            high, slope_high = theta, slope
        if not slope_low < 0.0 <= slope_high:
            return theta
        guess = low - slope_low * (high - low) / (slope_high - slope_low)
        if high - low < 4.0 * EDGE or slope == 0.0:
            return guess
        if tries >= PATIENCE or not low < guess < high:
            guess = 0.5 * (low + high)
        elif (
            abs(guess - theta) < EDGE
        ):  # converged, unless the rate is flat: bracket it
            guess += EDGE if slope < 0.0 else -EDGE
        theta = guess
    return theta


@kernel_apart
def leave(p: Problem, m: Memory, dt: float, k: int, low: float) -> float:
    """Return a theta, at most `low`, where guard k is clear of its surface; 0 if there is none.

    Clear means by more than rounding: a lower flight cannot be distinguished from none.
    """
    g, resolution = m.guards, time_resolution(m.clock[at.T], dt)
    while low > LEAVING:
        probe(p, m, dt, low)
        if p.mode[k] * g[at.H, k] > blur(g[at.SIZE, k], g[at.RATE, k], resolution):
            return low
        low *= 0.25
    return 0.0


@kernel_apart
def back(p: Problem, m: Memory, dt: float, k: int, end: float) -> float:
    """Return where guard k, whose departure is below its rounding, is back at its surface.

    It returns as fast as it left. Its mean acceleration is taken up to a place at which
    the interpolant resolves it.
    """
    left, x, rate = abs(m.guards[at.RATE0, k]), 0.25 * LEAVING, 0.0
    while rate > -SURELY_BACK * left and x < end:
        x = min(4.0 * x, end)
        probe(p, m, dt, x)
        rate = p.mode[k] * m.guards[at.RATE, k]
    return min(2.0 * x * left / (left - rate), end) if rate < left else end


@kernel
def just_left(p: Problem, m: Memory, dt: float, k: int) -> bool:
    """Return whether guard k is, to within rounding, still at the surface of its last flip.

    At the start of such a step the sign of h is meaningless: acting on it would flip
    the guard back.
    """
    margin, rate = p.mode[k] * m.guards[at.H0, k], p.mode[k] * m.guards[at.RATE0, k]
    noise = blur(m.guards[at.SIZE, k], rate, time_resolution(m.clock[at.T], dt))
    return margin <= 0.0 or (margin <= noise and rate > 0.0)


@kernel
def way_to_root(
    x: float, g: float, d: float, x1: float, g1: float, d1: float
) -> tuple[float, bool]:
    """Return the distance from x to a falling function's root, and whether it is nearly exact.

    Newton's method from x is corrected by the cubic through both places, values and
    slopes, whose root is taken as a series. The error is Newton's times the square of
    the distance to x1.
    """
    way, run, rise = -g / d, x1 - x, g1 - g
    if abs(way) <= max(ROOT_ACCURACY * x, JUMP_ACCURACY):
        return way, True
    per = 1.0 / (d * run)
    u, ahead, mean = -g * per, d1 * run * per, rise * per
    bend, twist = 3.0 * mean - 2.0 - ahead, 1.0 + ahead - 2.0 * mean
    right = u * (bend - u * (2.0 * bend * bend - twist))
    if not abs(right) <= MOST_PUT_RIGHT:
        return way, False
    close = abs(way) <= abs(run) and abs(way * run) <= ROOT_ACCURACY * x * x
    return way - way * right, close and abs(right) <= LITTLE_PUT_RIGHT


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
    """Return where guard k falls through zero on the interpolant, by a bracketed iteration.

    The guard is past its surface at `end` or at the end of the piece. Its cubic is
    clear at `low`. If it is still at the surface of its last flip, the interpolant
    decides where it is clear.
    """
    lock, x1, last = p.mode[k], (piece + 1) * m.clock[at.PIECE], knot(m, piece + 1)
    g1, d1 = lock * m.guards[last, k], lock * m.guards[last + 1, k] * dt
    end = min(end, x1)
    if just_left(p, m, dt, k):
        low = leave(p, m, dt, k, low if low > 0.0 else 0.5 * end)
        if low == 0.0:
            m.counts[at.LOW] = 1
            return back(p, m, dt, k, end) if lock * m.guards[at.RATE0, k] > 0.0 else 0.0
    x, high = guess, end
    for _ in range(MAX_ROOT):
        x = x if low < x < high else 0.5 * (low + high)
        probe(p, m, dt, x)
        g, d = lock * m.guards[at.H, k], lock * m.guards[at.RATE, k] * dt
        if g > 0.0:
            low = x
        else:
            high = x
        way, exact = way_to_root(x, g, d, x1, g1, d1) if d < 0.0 else (-x, False)
        new, x1, g1, d1 = x + way, x, g, d
        if exact and low < new < high:
            return new
        if exact and abs(way) <= max(ROOT_ACCURACY * x, JUMP_ACCURACY):
            return x
        if (
            high - low <= JUMP_ACCURACY * high
        ):  # the event function jumps: end just past it
            break
        x = new
    return high


@kernel_apart
def first_cut(p: Problem, m: Memory, dt: float) -> tuple[int, int, float]:
    """Return (kind, guard, theta): where the step must end for a guard in NEAR, and why.

    The earliest guess need not be the earliest place, so each place found is checked
    for rivals before it.
    """
    kind, k, theta = PASS, NONE, 1.0
    for _ in range(MOST_RIVALS * m.counts[at.N_NEAR]):
        rival, other, guess, low, piece = first_suspect(p, m, dt, k, theta)
        if rival == PASS:
            break
        prepare_interpolant(p, m, dt)
        if rival == DIP:
            place = lowest_point(p, m, dt, other, guess, piece, theta)
        else:
            place = crossing(p, m, dt, other, guess, low, piece, theta)
        if k != NONE and not place < theta:
            break
        kind, k, theta = rival, other, place
    return kind, k, theta
