"""Find where in a step the first guard flips: a bracketed search on the interpolant.

It begins where the guard's cubic vanishes or is lowest (see `suspicion`).
"""

from __future__ import annotations

from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.driver.dense import interpolate_with_slope, prepare_interpolant
from hopdata.hybrid.driver.knots import ends_between, knot, piece_before
from hopdata.hybrid.driver.layout import (
    H0,
    N_NEAR,
    PIECE,
    RATE,
    RATE0,
    SIZE,
    H,
    Memory,
    T,
)
from hopdata.hybrid.driver.problem import Problem, near_inside
from hopdata.hybrid.driver.surface import EPS, blur, time_resolution
from hopdata.hybrid.driver.suspicion import DIP, EDGE, NONE, PASS, first_rival, first_suspect

LEAVING = 1e-12  # a guard that has not left its surface by this part of the step never left
ROOT_ACCURACY = 1e-8  # of the last but one approximation; Newton doubles the digits
JUMP_ACCURACY = 4 * EPS  # of an event function that is not continuous
MOST_PUT_RIGHT = 0.5  # of Newton's step: beyond, the cubic tells nothing
LITTLE_PUT_RIGHT = 1e-3  # of Newton's step, up to which the series of the cubic's root is exact
MAX_ROOT, MAX_DIP, PATIENCE, MOST_RIVALS = 120, 40, 8, 2


@kernel_apart
def probe(p: Problem, m: Memory, dt: float, theta: float) -> None:
    """Evaluate the guards on the interpolant at `theta`, into H and RATE."""
    interpolate_with_slope(p, m, theta, dt)
    near_inside(p, m, m.clock[T] + theta * dt)


@kernel_apart
def lowest_point(
    p: Problem, m: Memory, dt: float, k: int, theta: float, piece: int, end: float
) -> float:
    """Refine the minimum of guard k on the interpolant: its rate's root, by bisection at worst.

    It lies in a piece of the step that ends at `end`.
    """
    lock = p.mode[k]
    last, low, part = piece_before(m, piece, end)
    high = low + part
    _, slope_low, _, slope_high = ends_between(m, k, lock, H0 + 2 * piece, last, 1.0)
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


@kernel_apart
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


@kernel_apart
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


@kernel_apart
def first_cut(p: Problem, m: Memory, dt: float) -> tuple[int, int, float]:
    """Return (kind, guard, theta): where the step must end for a guard in NEAR, and why.

    The earliest guess need not be the earliest place: each place that is found is asked for rivals
    before it.
    """
    kind, k, theta = PASS, NONE, 1.0
    rival, other, guess, low, piece = first_suspect(p, m, dt)
    for _ in range(MOST_RIVALS * m.counts[N_NEAR]):
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
        rival, other, guess, low, piece = first_rival(p, m, dt, k, theta)
    return kind, k, theta
