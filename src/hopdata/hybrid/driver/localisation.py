"""Find where in a step the first guard flips: judge by a cubic, then search the interpolant.

The Hermite cubic through (h0, hdot0, h1, hdot1) says which guards to look at and where to begin;
a bracketed iteration on the interpolant finds the root to interpolation error.
"""

from __future__ import annotations

from math import inf

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.driver.dense import interpolate_with_slope, prepare_interpolant
from hopdata.hybrid.driver.hermite import NOWHERE, cubic, cubic_root, turning_points
from hopdata.hybrid.driver.knots import knot, piece_ends
from hopdata.hybrid.driver.layout import (
    H0,
    N_NEAR,
    NEAR,
    PIECE,
    PIECES,
    RATE,
    RATE0,
    SIZE,
    H,
    Memory,
    T,
    index_numbers,
)
from hopdata.hybrid.driver.near import GRAZE, clearance
from hopdata.hybrid.driver.problem import Problem, near_inside
from hopdata.hybrid.driver.surface import EPS, blur, time_resolution

PASS, CROSSING, DIP = 0, 1, 2
ANY, PAST = index_numbers(2)  # which guards to suspect

EDGE = 1e-6  # a dip this near to an end of the step is that end
UNSURE = 0.5  # of a dip's depth: by so much may its cubic be wrong
LEAVING = 1e-12  # a guard that has not left its surface by this part of the step never left
ROOT_ACCURACY = 1e-8  # of the last but one approximation; Newton doubles the digits
JUMP_ACCURACY = 4 * EPS  # of an event function that is not continuous
MOST_PUT_RIGHT = 0.5  # of Newton's step: beyond, the cubic tells nothing
LITTLE_PUT_RIGHT = 1e-3  # of Newton's step, up to which the series of the cubic's root is exact
MAX_ROOT, MAX_DIP, PATIENCE = 120, 40, 8


@kernel
def probe(p: Problem, m: Memory, dt: float, theta: float) -> None:
    """Evaluate the guards on the interpolant at `theta`, into H and RATE."""
    interpolate_with_slope(p, m, theta, dt)
    near_inside(p, m, m.clock[T] + theta * dt)


@kernel
def suspect(g0: float, d0: float, g1: float, d1: float, noise: float) -> tuple[int, float, float]:
    """Judge a guard by its cubic, which does not stay clear.

    Takes margin and slope (per step) at both ends, and what rounding may make of a margin that is
    zero; returns the kind of suspicion, where to look first, and a place before that.
    """
    # A guard that has just flipped, and leaves, may still be on its old side by rounding.
    crossed = g1 < -noise or (g1 <= 0.0 and d1 < 0.0)
    if not crossed and d0 >= 0.0 and d1 >= 0.0 and g1 >= g0 + 0.34 * max(d0, d1):
        return PASS, 1.0, 0.0  # monotone (Fritsch and Carlson)
    top, bottom = turning_points(g0, d0, g1, d1)
    low = top if g0 == 0.0 and top < bottom else 0.0
    deep = inf
    if EDGE < bottom < 1.0 - EDGE:
        deep = cubic(g0, d0, g1, d1, bottom)
    if crossed:
        high = bottom if deep < 0.0 and bottom > low else 1.0
        return CROSSING, cubic_root(g0, d0, g1, d1, low, high), low
    if g0 <= noise and (d0 < 0.0 or g1 <= noise) and deep >= -noise:
        return PASS, 1.0, 0.0  # at its surface for all that rounding can tell, and stays there
    if deep < max(GRAZE * max(g0, g1), UNSURE * (min(g0, g1) - deep)):
        return DIP, bottom, low
    return PASS, 1.0, 0.0


@kernel
def suspect_by_pieces(
    m: Memory, k: int, lock: int, dt: float, resolution: float
) -> tuple[int, float, float, int]:
    """Judge a guard between each two knots of the step.

    Returns what `suspect` does of the first piece in which it does not stay clear, and that.
    """
    g, part = m.guards, m.clock[PIECE]
    for piece in range(m.counts[PIECES]):
        g0, d0, g1, d1 = piece_ends(m, k, lock, piece, dt)
        if clearance(g0, d0, g1, d1) > 0.0:
            continue
        noise = blur(g[SIZE, k], g[knot(m, piece + 1) + 1, k], resolution)
        kind, guess, low = suspect(max(g0, 0.0), d0, g1, d1, noise)
        if kind != PASS:
            return kind, (piece + guess) * part, (piece + low) * part, piece
    return PASS, 1.0, 0.0, 0


@kernel
def first_suspect(
    p: Problem, m: Memory, dt: float, among: int
) -> tuple[int, int, float, float, int]:
    """Return (kind, guard, guess, low, piece) of the suspect guard with the earliest guess.

    With ANY all that are near are asked, with PAST those of them past their surface in row H.
    """
    g = m.guards
    best = (PASS, -1, NOWHERE, 0.0, 0)
    resolution = time_resolution(m.clock[T], dt)
    for a in range(m.counts[N_NEAR]):
        k = m.lists[NEAR, a]
        lock = p.mode[k]
        if among == PAST and not lock * g[H, k] < 0.0:
            continue
        kind, guess, low, piece = suspect_by_pieces(m, k, lock, dt, resolution)
        if kind != PASS and guess < best[2]:
            best = (kind, k, guess, low, piece)
    return best


@kernel
def lowest_point(p: Problem, m: Memory, dt: float, k: int, theta: float, piece: int) -> float:
    """Refine the minimum of guard k on the interpolant: its rate's root, by bisection at worst."""
    lock, part = p.mode[k], m.clock[PIECE]
    low, high = piece * part, (piece + 1) * part
    _, slope_low, _, slope_high = piece_ends(m, k, lock, piece, 1.0)
    for tries in range(MAX_DIP):
        probe(p, m, dt, theta)
        slope = lock * m.guards[RATE, k]
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
        elif abs(guess - theta) < EDGE:  # as good as there, unless the rate is flat: bracket it
            guess += EDGE if slope < 0.0 else -EDGE
        theta = guess
    return theta


@kernel
def leave(p: Problem, m: Memory, dt: float, k: int, low: float) -> float:
    """Return a theta, at most `low`, where guard k is clear of its surface; 0 if there is none."""
    while low > LEAVING:
        probe(p, m, dt, low)
        if p.mode[k] * m.guards[H, k] > 0.0:
            return low
        low *= 0.25
    return 0.0


@kernel
def just_left(p: Problem, m: Memory, dt: float, k: int) -> bool:
    """Tell whether guard k is at its surface since its last flip, for all that rounding can tell.

    At the start of such a step the sign of h says nothing: to go by it is to flip the guard back.
    """
    margin, rate = p.mode[k] * m.guards[H0, k], p.mode[k] * m.guards[RATE0, k]
    noise = blur(m.guards[SIZE, k], rate, time_resolution(m.clock[T], dt))
    return margin <= 0.0 or (margin <= noise and rate > 0.0)


@kernel
def way_to_root(
    x: float, g: float, d: float, x1: float, g1: float, d1: float
) -> tuple[float, bool]:
    """Return how far from x a falling function vanishes, and whether that is all but exact.

    Newton's method from x, put right by the cubic through both places, values and slopes: its root
    as a series. The error is that of Newton's method times the square of the distance to x1.
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


@kernel
def crossing(
    p: Problem, m: Memory, dt: float, k: int, guess: float, low: float, piece: int, end: float
) -> float:
    """Return where guard k falls through zero on the interpolant: a bracketed iteration.

    At `end` it is past its surface, or where the piece ends. At `low` it is clear by its cubic;
    whether by the interpolant, too, is asked where the iteration would go on before: mostly it does
    not.
    """
    lock, x1, last = p.mode[k], (piece + 1) * m.clock[PIECE], knot(m, piece + 1)
    g1, d1 = lock * m.guards[last, k], lock * m.guards[last + 1, k] * dt
    end = min(end, x1)
    inner, high = low if low > 0.0 else 0.5 * end, end
    clear = not just_left(p, m, dt, k)
    doubt = not clear and not lock * m.guards[RATE0, k] > 0.0
    x = guess
    for _ in range(MAX_ROOT):
        if doubt:
            low, high, clear = leave(p, m, dt, k, inner), end, True
            if low == 0.0:
                return 0.0
        x = x if low < x < high else 0.5 * (low + high)
        probe(p, m, dt, x)
        g, d = lock * m.guards[H, k], lock * m.guards[RATE, k] * dt
        if g > 0.0:
            low, clear = x, True
        else:
            high = x
        way, exact = way_to_root(x, g, d, x1, g1, d1) if d < 0.0 else (-x, False)
        new, x1, g1, d1 = x + way, x, g, d
        if exact and low < new < high:
            return new
        if exact and abs(way) <= max(ROOT_ACCURACY * x, JUMP_ACCURACY):
            return x
        if high - low <= JUMP_ACCURACY * high:  # the event function jumps: directly behind it
            return high
        doubt, x = not clear and new <= low, new
    return high


@kernel
def first_cut(p: Problem, m: Memory, dt: float) -> tuple[int, int, float]:
    """Return (kind, guard, theta): where the step must end for a guard in NEAR, and why."""
    kind, k, guess, low, piece = first_suspect(p, m, dt, ANY)
    if kind == PASS:
        return PASS, -1, 1.0
    prepare_interpolant(p, m, dt)
    theta = 1.0
    for _ in range(m.counts[N_NEAR]):
        if kind == DIP:
            theta = lowest_point(p, m, dt, k, guess, piece)
        else:
            theta = crossing(p, m, dt, k, guess, low, piece, theta)
        rival, other, rival_guess, rival_low, rival_piece = first_suspect(p, m, dt, PAST)
        if rival != CROSSING or other == k:
            break
        kind, k, guess, low, piece = rival, other, rival_guess, rival_low, rival_piece
    return kind, k, theta
