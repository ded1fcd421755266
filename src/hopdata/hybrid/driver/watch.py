"""The few guards that a step may concern, which alone are examined closely.

Guards are left out in three cases: if their cubic, through values and rates at both
ends of the step, stays clear of their surface; at an instant, if they have not reached
it; and before a step, if from what is known at its start they will not reach it.
"""

from math import sqrt

import numpy as np

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart, kernel_in_loop
from hopdata.hybrid.driver.dense import interpolate, prepare_interpolant
from hopdata.hybrid.driver.problem import (
    Problem,
    awake,
    blur,
    eval_guards,
    time_resolution,
)
from hopdata.hybrid.driver.sleep import wake_for
from hopdata.hybrid.layout import Memory

# The knots of a step: the places where guards are known, with a cubic between
# consecutive ones.
#
# Usually these are the step's two ends. A Taylor step may span most of an oscillation,
# in which a guard can fall and rise again unseen from the ends; such a step has knots
# inside, too.

# Degrees that a series needs for 1.5 and 3 radians of the fastest motion that shows in
# it.
ONE_PIECE, TWO_PIECES = 22, 28
THIRD = 1.0 / 3.0
Ends = tuple[
    float, float, float, float
]  # margin and slope at the start, then at the end


@kernel
def knot(m: Memory, number: int) -> int:
    """Return the row of the guards at a knot; the row of their rates is the next."""
    return at.H1 if number == m.counts[at.PIECES] else at.H0 + 2 * number


@kernel
def ends_between(
    m: Memory, k: int, lock: int, start: int, end: int, span: float
) -> Ends:
    """Return margins and slopes (per `span`) of guard k, from the rows of two places."""
    g = m.guards
    g0, d0 = lock * g[start, k], lock * g[start + 1, k] * span
    return g0, d0, lock * g[end, k], lock * g[end + 1, k] * span


@kernel
def piece_before(m: Memory, piece: int, end: float) -> tuple[int, float, float]:
    """Return the end row, start and length of a piece of the step that ends at `end`.

    The last piece before `end` is cut off there, where the guards were last evaluated.
    """
    part = m.clock[at.PIECE]
    start = piece * part
    if (piece + 1) * part <= end:
        return knot(m, piece + 1), start, part
    return at.H, start, end - start


@kernel
def look(p: Problem, m: Memory, dt: float, theta: float, row: int) -> None:
    """Evaluate the guards on the interpolant at `theta` into a row, their rates into the next."""
    interpolate(p, m, theta, at.SCRATCH, 1.0 / dt)
    eval_guards(p, m, m.clock[at.T] + theta * dt, at.SCRATCH, at.SLOPE, row, row + 1)


@kernel
def set_knots(p: Problem, m: Memory, dt: float) -> None:
    """Choose the knots of a step, and evaluate the guards at the inner ones."""
    m.counts[at.PIECES], m.clock[at.PIECE] = 1, 1.0
    if p.methods[m.counts[at.METHOD], at.IN_POWERS] == 0:
        return
    prepare_interpolant(p, m, dt)
    if m.counts[at.DEGREE] <= ONE_PIECE:
        return
    if m.counts[at.DEGREE] <= TWO_PIECES:
        m.counts[at.PIECES], m.clock[at.PIECE] = 2, 0.5
    else:
        m.counts[at.PIECES], m.clock[at.PIECE] = 3, THIRD
    for number in range(1, m.counts[at.PIECES]):
        look(p, m, dt, number * m.clock[at.PIECE], at.H0 + 2 * number)


GRAZE = (
    1e-2  # fraction of the step's margins: a dip that comes nearer is examined closely
)


@kernel
def clearance(g0: float, d0: float, g1: float, d1: float) -> float:
    """Return a number that is positive if the cubic with these margins and slopes stays clear.

    Slopes are per step. The number is the least Bezier point, a lower bound of the
    cubic.
    """
    return min(g0, g0 + THIRD * d0, g1 - THIRD * d1, g1) - GRAZE * max(g0, g1)


@kernel
def after(g: float, d: float, c: float, dt: float) -> float:
    """Return the least possible margin within `dt`, from a margin, its rate and its bend."""
    return g + dt * (min(d, 0.0) + 0.5 * dt * min(c, 0.0))


@kernel
def facing(lock: int, value: float) -> float:
    """Return the value as seen from the lock's side: ``lock * value`` without a conversion."""
    return value if lock > 0 else -value


@kernel_in_loop
def gather_unclear(p: Problem, m: Memory) -> int:
    """Put the guards that have no clearance into NEAR, and return their number.

    A first loop, compiled into vector instructions, counts them and finds the first
    one. The second loop is not vectorised, but usually it has nothing to do or a single
    guard to record.
    """
    unclear, first = 0, m.counts[at.N_AWAKE]
    for place in range(m.counts[at.N_AWAKE]):
        clear = m.guards[at.CLEARANCE, awake(p, m, place)] > 0.0
        unclear += 0 if clear else 1
        first = min(first, m.counts[at.N_AWAKE] if clear else place)
    count, a = 0, first
    while count < unclear:
        k = awake(p, m, a)
        m.lists[at.NEAR, count] = k
        count += 0 if m.guards[at.CLEARANCE, k] > 0.0 else 1
        a += 1
    m.counts[at.N_NEAR] = count
    return count


@kernel_apart
def gather_near(p: Problem, m: Memory, dt: float) -> int:
    """Put the guards that may flip within the step, by its ends, into NEAR; return their number."""
    g = m.guards
    for a in range(m.counts[at.N_AWAKE]):
        k = awake(p, m, a)
        lock = p.mode[k]
        g[at.CLEARANCE, k] = clearance(
            facing(lock, g[at.H0, k]), facing(lock, g[at.RATE0, k]) * dt,
            facing(lock, g[at.H1, k]), facing(lock, g[at.RATE1, k]) * dt,
        )  # fmt: skip
    return gather_unclear(p, m)


@kernel_apart
def gather_near_by_pieces(p: Problem, m: Memory, dt: float) -> int:
    """Do the same by all knots of the step: a guard must stay clear between consecutive knots."""
    span = dt * m.clock[at.PIECE]
    for a in range(m.counts[at.N_AWAKE]):
        k, least = awake(p, m, a), np.inf
        for piece in range(m.counts[at.PIECES]):
            start, end = at.H0 + 2 * piece, knot(m, piece + 1)
            least = min(
                least, clearance(*ends_between(m, k, p.mode[k], start, end, span))
            )
        m.guards[at.CLEARANCE, k] = least
    return gather_unclear(p, m)


@kernel_apart
def gather_reached(p: Problem, m: Memory, h: int, rate: int, resolution: float) -> int:
    """Put the guards at or past their surface, by rows `h` and `rate`, into NEAR."""
    g = m.guards
    for a in range(m.counts[at.N_AWAKE]):
        k = awake(p, m, a)
        noise = blur(g[at.SIZE, k], g[rate, k], resolution)
        g[at.CLEARANCE, k] = facing(p.mode[k], g[h, k]) - noise
    return gather_unclear(p, m)


@kernel_apart
def gather_coming(p: Problem, m: Memory, dt: float) -> int:
    """Put the guards that may reach their surface within `dt`, by rate and bend, into NEAR."""
    g = m.guards
    for a in range(m.counts[at.N_AWAKE]):
        k = awake(p, m, a)
        lock = p.mode[k]
        g[at.CLEARANCE, k] = after(
            facing(lock, g[at.H0, k]),
            facing(lock, g[at.RATE0, k]),
            facing(lock, g[at.BEND, k]),
            dt,
        )
    return gather_unclear(p, m)


# Length of a step before a flip: not far past it.
#
# A step that spans an event is used only up to the event. The farther it reaches past
# it, the more of it is wasted, and the more guards seem to flip in it. The step is
# therefore clipped to slightly more than the time to the nearest flip, predicted from
# the guard's value, its rate, and its bend in the last step.

# Times the interval of the last two events: the next flip is first sought within this
SOON = 4.0
OVERSHOOT = 1.2  # factor past the predicted flip, so that the step contains it
# Multiples of the time resolution. The step that the field allows is no measure here:
# in a landing on thousands of springs it is a million times longer than the time
# between two of their events.
CLIP_MOST = 1e3  # events closer than this are left to localisation
TOO_SHORT = 1e6  # steps shorter than this say nothing about the bend


@kernel_apart
def carry_guards(p: Problem, m: Memory, dt: float) -> None:
    """Carry the guards at the step's end over to its start, and store their second derivatives.

    These are secants over the step. For a guard that bends, those of longer steps are
    useless.
    """
    g, tells, per_s = (
        m.guards,
        dt > TOO_SHORT * time_resolution(m.clock[at.T], dt),
        1.0 / dt,
    )
    for a in range(m.counts[at.N_AWAKE]):
        k = awake(p, m, a)
        g[at.BEND, k] = (
            (g[at.RATE1, k] - g[at.RATE0, k]) * per_s if tells else g[at.BEND, k]
        )
        g[at.H0, k], g[at.RATE0, k] = g[at.H1, k], g[at.RATE1, k]
    if not tells and m.counts[at.N_BENT] > 0:
        for k in range(m.flags.width):
            g[at.BEND, k] = g[at.BEND, k] if m.flags[at.BENT, k] == 0 else 0.0


@kernel
def flip_time(g: float, d: float, c: float) -> float:
    """Return when g + d t + c t^2 / 2 falls through zero; 0 if it does not."""
    room = d * d - 2.0 * g * c
    if room <= 0.0:
        return 0.0
    root = sqrt(room)
    if d < 0.0:
        return 2.0 * g / (root - d)
    return -(d + root) / c if c < 0.0 else 0.0


@kernel
def clipped(p: Problem, m: Memory, dt: float) -> float:
    """Return `dt`, or less if a guard is predicted to flip earlier.

    Sleeping guards that might flip by then wake, the nearest first.
    """
    soon = SOON * m.clock[at.GAP]
    first = clipped_by_coming(p, m, soon) if soon < dt else dt
    dt = first if first < min(soon, dt) else clipped_by_coming(p, m, dt)
    k = wake_for(p, m, dt)
    while k >= 0:
        dt = clipped_by(p, m, k, dt)
        k = wake_for(p, m, dt)
    return dt


@kernel
def clipped_by_coming(p: Problem, m: Memory, dt: float) -> float:
    """Return `dt`, or slightly more than the time to the first flip within it."""
    for a in range(gather_coming(p, m, dt)):
        dt = clipped_by(p, m, m.lists[at.NEAR, a], dt)
    return dt


@kernel
def clipped_by(p: Problem, m: Memory, k: int, dt: float) -> float:
    """Return `dt`, or slightly more than the time to the flip of guard k if that is earlier."""
    g, lock = m.guards, p.mode[k]
    value, rate, bend = lock * g[at.H0, k], lock * g[at.RATE0, k], lock * g[at.BEND, k]
    if after(value, rate, bend, dt) > 0.0:
        return dt
    time = OVERSHOOT * flip_time(max(value, 0.0), rate, bend)
    return time if CLIP_MOST * time_resolution(m.clock[at.T], 0.0) < time < dt else dt
