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
    margin_of,
    time_resolution,
)
from hopdata.hybrid.driver.sleep import wake_for
from hopdata.hybrid.layout import Memory

# The check points of a step: where guards are known, with a cubic between consecutive
# ones.
#
# Usually these are the step's two ends. A Taylor step may span most of an oscillation,
# in which a guard can fall and rise again unseen from the ends; such a step has check
# points inside, too.

#: Degree of a series up to which the step's two ends suffice.
#: Unit: 1. Origin: derived: the degree that 1.5 radians of its fastest motion need.
ONE_PIECE = 22

#: Degree of a series up to which one check point inside suffices.
#: Unit: 1. Origin: derived: the degree that 3 radians of its fastest motion need.
TWO_PIECES = 28

THIRD = 1.0 / 3.0

# Margin and slope at the start of an interval, then at its end.
Ends = tuple[float, float, float, float]


@kernel
def check_point(m: Memory, number: int) -> int:
    """Return the guards' row at a check point; the row of their rates is the next."""
    if number == m.counts[at.PIECES]:
        return at.H1
    return at.H0 + 2 * number


@kernel
def ends_between(
    m: Memory, k: int, lock: int, start: int, end: int, span: float
) -> Ends:
    """Return margins and slopes (per `span`) of guard k, from the rows of both."""
    g = m.guards
    g0 = lock * g[start, k]
    d0 = lock * g[start + 1, k] * span
    g1 = lock * g[end, k]
    d1 = lock * g[end + 1, k] * span
    return g0, d0, g1, d1


@kernel
def piece_before(m: Memory, piece: int, end: float) -> tuple[int, float, float]:
    """Return the end row, start and length of a piece of the step that ends at `end`.

    The last piece before `end` is cut off there, where the guards were last evaluated.
    """
    part = m.clock[at.PIECE]
    start = piece * part
    if (piece + 1) * part <= end:
        return check_point(m, piece + 1), start, part
    return at.H, start, end - start


@kernel
def look(p: Problem, m: Memory, dt: float, theta: float, row: int) -> None:
    """Evaluate the guards on the interpolant at `theta` into a row.

    Their rates are written into the next row.
    """
    interpolate(p, m, theta, at.SCRATCH, 1.0 / dt)
    eval_guards(p, m, m.clock[at.T] + theta * dt, at.SCRATCH, at.SLOPE, row, row + 1)


@kernel
def set_check_points(p: Problem, m: Memory, dt: float) -> None:
    """Choose the check points of a step, and evaluate the guards at the inner ones."""
    m.counts[at.PIECES] = 1
    m.clock[at.PIECE] = 1.0
    if p.methods[m.counts[at.METHOD], at.IN_POWERS] == 0:
        return
    prepare_interpolant(p, m, dt)
    if m.counts[at.DEGREE] <= ONE_PIECE:
        return
    if m.counts[at.DEGREE] <= TWO_PIECES:
        m.counts[at.PIECES] = 2
        m.clock[at.PIECE] = 0.5
    else:
        m.counts[at.PIECES] = 3
        m.clock[at.PIECE] = THIRD
    for number in range(1, m.counts[at.PIECES]):
        look(p, m, dt, number * m.clock[at.PIECE], at.H0 + 2 * number)


# The guards that a step may concern: those that have no clearance.

#: Fraction of the step's margins: a dip that comes nearer is examined closely.
#: Unit: 1. Origin: chosen.
GRAZE = 1e-2


@kernel
def clearance(g0: float, d0: float, g1: float, d1: float) -> float:
    """Return a number that is positive if a cubic stays clear.

    It has these margins and slopes. Slopes are per step. The number is the least Bezier
    point, a lower bound of the cubic.
    """
    return min(g0, g0 + THIRD * d0, g1 - THIRD * d1, g1) - GRAZE * max(g0, g1)


@kernel
def after(g: float, d: float, c: float, dt: float) -> float:
    """Return the least possible margin within `dt`, from margin, rate and bend."""
    return g + dt * (min(d, 0.0) + 0.5 * dt * min(c, 0.0))


@kernel
def facing(lock: int, value: float) -> float:
    """Return the value as seen from the lock's side.

    It is ``lock * value`` without a conversion.
    """
    return value if lock > 0 else -value


@kernel_in_loop
def gather_unclear(p: Problem, m: Memory) -> int:
    """Put the guards that have no clearance into NEAR, and return their number.

    A first loop, compiled into vector instructions, counts them and finds the first
    one. The second loop is not vectorised, but usually it has nothing to do or a single
    guard to record.
    """
    n_awake = m.counts[at.N_AWAKE]
    unclear = 0
    first = n_awake
    for position in range(n_awake):
        clear = m.guards[at.CLEARANCE, awake(p, m, position)] > 0.0
        unclear += 0 if clear else 1
        first = min(first, n_awake if clear else position)
    count = 0
    position = first
    while count < unclear:
        k = awake(p, m, position)
        m.lists[at.NEAR, count] = k  # overwritten by the next one if it is clear
        count += 0 if m.guards[at.CLEARANCE, k] > 0.0 else 1
        position += 1
    m.counts[at.N_NEAR] = count
    return count


@kernel_apart
def gather_near(p: Problem, m: Memory, dt: float) -> int:
    """Put the guards that may flip within the step into NEAR; return their number.

    They are judged by the ends of the step.
    """
    g = m.guards
    for a in range(m.counts[at.N_AWAKE]):
        k = awake(p, m, a)
        lock = p.mode[k]
        g0 = facing(lock, g[at.H0, k])
        d0 = facing(lock, g[at.RATE0, k]) * dt
        g1 = facing(lock, g[at.H1, k])
        d1 = facing(lock, g[at.RATE1, k]) * dt
        g[at.CLEARANCE, k] = clearance(g0, d0, g1, d1)
    return gather_unclear(p, m)


@kernel_apart
def gather_near_by_pieces(p: Problem, m: Memory, dt: float) -> int:
    """Do the same by all check points of the step.

    A guard must stay clear between each two consecutive ones.
    """
    span = dt * m.clock[at.PIECE]
    for a in range(m.counts[at.N_AWAKE]):
        k = awake(p, m, a)
        least = np.inf
        for piece in range(m.counts[at.PIECES]):
            start = at.H0 + 2 * piece
            end = check_point(m, piece + 1)
            g0, d0, g1, d1 = ends_between(m, k, p.mode[k], start, end, span)
            least = min(least, clearance(g0, d0, g1, d1))
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
    """Put the guards that may reach their surface within `dt` into NEAR.

    They are judged by their rate and bend.
    """
    g = m.guards
    for a in range(m.counts[at.N_AWAKE]):
        k = awake(p, m, a)
        lock = p.mode[k]
        margin = facing(lock, g[at.H0, k])
        rate = facing(lock, g[at.RATE0, k])
        bend = facing(lock, g[at.BEND, k])
        g[at.CLEARANCE, k] = after(margin, rate, bend, dt)
    return gather_unclear(p, m)


# Length of a step before a flip: not far past it.
#
# A step that spans an event is used only up to the event. The farther it reaches past
# it, the more of it is wasted, and the more guards seem to flip in it. The step is
# therefore clipped to slightly more than the time to the nearest flip, predicted from
# the guard's value, its rate, and its bend in the last step.

# The shortest lengths are in time resolutions. The step that the field allows is no
# measure here: in a landing on thousands of springs it is a million times longer than
# the time between two of their events.

#: The next flip is first sought within this many intervals of the last two events.
#: Unit: 1. Origin: chosen.
SOON = 4.0

#: Factor past the predicted flip, so that the step contains it.
#: Unit: 1. Origin: chosen.
OVERSHOOT = 1.2

#: Events closer than this are left to localisation.
#: Unit: time resolutions. Origin: chosen.
CLIP_MOST = 1e3

#: Steps shorter than this say nothing about the bend of a guard.
#: Unit: time resolutions. Origin: chosen.
TOO_SHORT = 1e6


@kernel_apart
def carry_guards(p: Problem, m: Memory, dt: float) -> None:
    """Carry the guards at the step's end over to its start, with their bends.

    These are secants over the step, unless it is too short to show them: then those of
    the last step remain, except for guards that bend, for which they are useless.
    """
    g = m.guards
    shows_bend = dt > TOO_SHORT * time_resolution(m.clock[at.T], dt)
    per_s = 1.0 / dt
    for a in range(m.counts[at.N_AWAKE]):
        k = awake(p, m, a)
        bend = (g[at.RATE1, k] - g[at.RATE0, k]) * per_s
        g[at.BEND, k] = bend if shows_bend else g[at.BEND, k]
        g[at.H0, k] = g[at.H1, k]
        g[at.RATE0, k] = g[at.RATE1, k]
    if not shows_bend and m.counts[at.N_BENT] > 0:
        for k in range(m.flags.width):
            g[at.BEND, k] = g[at.BEND, k] if m.flags[at.BENT, k] == 0 else 0.0


@kernel
def flip_time(g: float, d: float, c: float) -> float:
    """Return when g + d t + c t^2 / 2 falls through zero; 0 if it does not."""
    discriminant = d * d - 2.0 * g * c
    if discriminant <= 0.0:
        return 0.0
    root = sqrt(discriminant)
    if d < 0.0:
        return 2.0 * g / (root - d)
    if c < 0.0:
        return -(d + root) / c
    return 0.0


@kernel
def clipped(p: Problem, m: Memory, dt: float) -> float:
    """Return `dt`, or less if a guard is predicted to flip earlier.

    Sleeping guards that might flip by then wake, the nearest first.
    """
    soon = SOON * m.clock[at.GAP]
    soonest = dt
    if soon < dt:
        soonest = clipped_by_coming(p, m, soon)
    if soonest < min(soon, dt):
        dt = soonest
    else:
        dt = clipped_by_coming(p, m, dt)
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
    """Return `dt`, or slightly more than the time to the flip of guard k if earlier."""
    margin = margin_of(p, m, k, at.H0)
    rate = margin_of(p, m, k, at.RATE0)
    bend = margin_of(p, m, k, at.BEND)
    if after(margin, rate, bend, dt) > 0.0:
        return dt
    time = OVERSHOOT * flip_time(max(margin, 0.0), rate, bend)
    shortest = CLIP_MOST * time_resolution(m.clock[at.T], 0.0)
    if shortest < time < dt:
        return time
    return dt
