"""The few guards that an instant or a step may concern, and the length of the step.

Guards are left out at an instant if they have not reached their surface, and before a
step if from what is known at its start they will not reach it.
"""

from math import sqrt

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart, kernel_in_loop
from hopdata.hybrid.driver.dense import interpolate
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


@kernel
def look(p: Problem, m: Memory, dt: float, theta: float, row: int) -> None:
    """Evaluate the guards on the interpolant at `theta` into a row.

    Their rates are written into the next row.
    """
    interpolate(p, m, theta, at.SCRATCH, 1.0 / dt)
    eval_guards(p, m, m.clock[at.T] + theta * dt, at.SCRATCH, at.SLOPE, row, row + 1)


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
    the last step remain.
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
