"""Events at an instant, in each lane its own, and open locks at the start.

One guard flips, its handler is called, field and guards are evaluated again, and so on
until no guard is due. The order of the flips is the driver's (see `driver.instant`).
"""

from math import inf
from typing import Any

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import copy, kernel
from hopdata.hybrid.compiled.memory import row
from hopdata.hybrid.driver.problem import ROUNDING
from hopdata.hybrid.lanes.method import STAGES
from hopdata.hybrid.lanes.proof import (
    begin_proofs,
    mark,
    note_flip,
    note_instant,
    resolution_of,
)
from hopdata.hybrid.lanes.room import (
    CULPRIT,
    DUE,
    EVENTS,
    GIVEN_UP,
    INDEX,
    JUMPED,
    LAST,
    ONCE,
    OPEN,
    SAMPLES,
    STATUS,
    TIME,
    TWICE,
    call_field,
    call_guards,
    call_on_event,
    give_up,
    group,
    state,
)
from hopdata.hybrid.lanes.vectors import (
    WIDTH,
    absolute,
    bits,
    lane,
    mask_of,
    spread,
    where,
)

#: Rounds until open locks agree: rates on the surface may depend on the other locks.
#: Unit: 1. Origin: convention: as in `driver.instant`.
MOST_ROUNDS = 4


@kernel
def begin_instant(j: int, r: Any) -> None:
    """Forget the flips of the last instant in lane j."""
    r.book[LAST, j] = -1
    r.book[JUMPED, j] = 0
    r.book[ONCE, j] = 0
    r.book[TWICE, j] = 0


# The start of a run.


@kernel
def take_system(j: int, system: int, r: Any) -> None:
    """Give a system to lane j."""
    for i in range(r.n):
        r.table[i, j] = r.y0[system, i]
    copy(row(r.given, system % r.n_given), row(r.own_params, j))
    for i in range(r.n_own):
        r.params[i, j] = r.own_params[j, i]
    copy(row(r.mode, 0), row(r.modes, j))
    r.book[INDEX, j] = system
    r.book[CULPRIT, j] = -1
    r.book[STATUS, j] = at.FINISHED
    r.book[EVENTS, j] = 0
    r.book[SAMPLES, j] = 0
    r.book[DUE, j] = 0
    r.book[OPEN, j] = 0
    begin_instant(j, r)
    begin_proofs(j, r)
    if r.times.width > 0 and r.times[0] == r.t_start:
        copy(row(r.y0, system), row(r.samples, system * r.times.width))
        r.book[SAMPLES, j] = 1


@kernel
def take_systems(want: int, first: int, last: int, r: Any) -> tuple[int, int]:
    """Give the next systems, up to `last`, to these lanes.

    Returns the lanes that got one, and the next system.
    """
    started = 0
    for j in range(WIDTH):
        if want >> j & 1 and first != last:
            take_system(j, first, r)
            first += 1
            started |= 1 << j
    return started, first


@kernel
def settle(started: int, r: Any) -> int:
    """Decide open locks by the guards' sides.

    Returns the lanes with a guard on its surface. Such a lock stays open, because the
    guard's rate decides it.
    """
    for i in range(r.n):
        r.work[i] = 0.0
    for j in range(WIDTH):
        for g in range(r.n_guards if started >> j & 1 else 0):
            if r.modes[j, g] == 0:
                r.book[OPEN, j] |= 1 << g
                r.modes[j, g] = -1
    group(r)
    call_guards(r.guards, r.course[TIME], r.y, r.work, r, r.h, r.rate)
    mine = mask_of(started)
    open_ones = 0
    for g in range(r.n_guards):
        r.size[g] = where(mine, absolute(r.h[g]), r.size[g])
        above = bits(r.h[g] > 0.0)
        level = bits(r.h[g] == 0.0)
        for j in range(WIDTH):
            if started >> j & 1 == 0:
                continue
            if r.book[OPEN, j] >> g & 1 and above >> j & 1:
                r.modes[j, g] = 1
            if level >> j & 1 == 0:
                r.book[OPEN, j] &= ~(1 << g)
            r.locks[g, j] = r.modes[j, g]
            open_ones |= 1 << j if r.book[OPEN, j] != 0 else 0
    return open_ones


@kernel
def close(open_ones: int, r: Any) -> tuple[int, int]:
    """Decide the locks still open in these lanes by their guards' rates.

    Returns the lanes in which a lock has changed, and those with a rate of zero, to be
    given up.
    """
    changed = 0
    resting = 0
    for g in range(r.n_guards):
        rising = bits(r.rate0[g] > 0.0)
        still = bits(r.rate0[g] == 0.0)
        for j in range(WIDTH):
            if open_ones >> j & 1 == 0 or r.book[OPEN, j] >> g & 1 == 0:
                continue
            resting |= still & 1 << j
            lock = 1 if rising >> j & 1 else -1
            if lock != r.modes[j, g]:
                r.modes[j, g] = lock
                r.locks[g, j] = lock
                r.book[DUE, j] = 0
                changed |= 1 << j
    return changed, give_up(resting, r)


# A single flip.


@kernel
def next_to_flip(j: int, r: Any) -> int:
    """Return the guard that flips next in lane j.

    See `driver.instant` for the order.
    """
    due = r.book[DUE, j]
    last = r.book[LAST, j]
    if r.book[JUMPED, j] != 0 and due >> last & 1:
        return last  # a bounce is over before the next one begins
    first = -1
    for position in range(r.n_guards):
        g = position
        if r.rules[at.WAY, position] < 0:
            g = r.n_guards - 1 - position
        if due >> g & 1:
            if last < 0 or r.rules[at.WAY, g] * (g - last) > 0:
                return g
            if first < 0:
                first = g
    return first


@kernel
def handle_event(j: int, g: int, direction: int, r: Any) -> bool:
    """Call the handler for a flip in lane j; return whether this event ends the run."""
    stop = r.rules[at.TERMINAL, g]
    if r.handler != 0:
        stop |= call_on_event(
            r.handler,
            lane(r.course[TIME], j),
            row(r.own, 0),
            row(r.modes, j),
            row(r.own_params, j),
            g,
            direction,
        )
    r.book[EVENTS, j] += 1
    r.book[CULPRIT, j] = g
    return stop != 0


@kernel
def copy_for_handler(j: int, r: Any) -> None:
    """Copy the state of lane j to where the handler may change it."""
    own = row(r.own, 0)
    for i in range(r.n):
        own[i] = r.table[i, j]


@kernel
def take_from_handler(j: int, r: Any) -> bool:
    """Take state and parameters of lane j back, and return whether the lane is lost.

    It is if its state is NaN or infinite, or if parameters have changed that all
    systems share.
    """
    lost = False
    own = row(r.own, 0)
    own_params = row(r.own_params, j)
    for i in range(r.n):
        r.book[JUMPED, j] |= 1 if own[i] != r.table[i, j] else 0
        lost |= not abs(own[i]) < inf
        r.table[i, j] = own[i]
    for i in range(len(own_params)):
        if r.n_own > 0:
            r.params[i, j] = own_params[i]
        else:
            lost |= own_params[i] != r.params[0, i]
    return lost


@kernel
def fire_one(j: int, r: Any) -> int:
    """Flip the next guard due in lane j, call the handler, and return a status."""
    g = next_to_flip(j, r)
    others = r.book[DUE, j] & ~(1 << g)
    lost = r.book[TWICE, j] >> g & 1 != 0
    r.book[TWICE, j] |= r.book[ONCE, j] & 1 << g
    r.book[ONCE, j] |= 1 << g
    r.book[DUE, j] = 0
    r.book[LAST, j] = g
    note_flip(j, g, r)
    r.book[JUMPED, j] = 0
    if r.handler != 0:
        copy_for_handler(j, r)
    direction = -r.modes[j, g]
    r.modes[j, g] = direction
    ends = False
    if r.rules[at.DIRECTION, g] * direction >= 0:
        ends = handle_event(j, g, direction, r)
    if ends:
        lost |= others != 0
    else:
        lost |= r.book[EVENTS, j] >= r.max_events
    for k in range(r.n_guards):
        r.locks[k, j] = r.modes[j, k]
        lost |= r.modes[j, k] * r.modes[j, k] != 1
    if r.handler != 0:
        lost |= take_from_handler(j, r)
    if lost:
        return GIVEN_UP
    if ends:
        return at.TERMINATED
    return at.RUNNING


@kernel
def fire(lanes: int, r: Any) -> int:
    """Flip one of the guards that are due in each of these lanes, and call the handler.

    Returns the lanes that end or are given up. A lane is given up if its handler
    changes parameters that all systems share or makes the state NaN or infinite, if a
    guard flips for a third time at this instant, or if an event ends the run while
    other guards are due.
    """
    over = 0
    for j in range(WIDTH):
        if lanes >> j & 1:
            if r.book[LAST, j] < 0:
                note_instant(j, r)
            status = fire_one(j, r)
            if status != at.RUNNING:
                r.book[STATUS, j] = status
                over |= 1 << j
    sample_again(lanes, r)
    return over


@kernel
def sample_again(lanes: int, r: Any) -> None:
    """Overwrite the states before an event with those after it, at a requested time."""
    for j in range(WIDTH):
        last = r.book[SAMPLES, j] - 1
        if lanes >> j & 1 and last >= 0 and r.times[last] == lane(r.course[TIME], j):
            for i in range(r.n):
                r.samples[r.book[INDEX, j] * r.times.width + last, i] = r.table[i, j]


# The whole instant.


@kernel
def refresh(fresh: int, r: Any) -> int:
    """Evaluate field and guards again in these lanes.

    Returns the lanes with guards that are due.
    """
    group(r)
    t = r.course[TIME]
    slope = state(r.k, STAGES * r.n)
    mine = mask_of(fresh)
    call_field(r.field, t, r.y, r, slope)
    for i in range(r.n):
        r.k[i] = where(mine, slope[i], r.k[i])
    call_guards(r.guards, t, r.y, slope, r, r.h, r.rate)
    resolution = resolution_of(t, spread(0.0))
    flipping = 0
    for g in range(r.n_guards):
        r.h0[g] = where(mine, r.h[g], r.h0[g])
        r.rate0[g] = where(mine, r.rate[g], r.rate0[g])
        margin = r.lock[g] * r.h0[g]
        rate = r.lock[g] * r.rate0[g]
        noise = ROUNDING * r.size[g] + resolution * absolute(rate)
        r.leaving[g] = where(mine, where(margin <= noise, 1.0, 0.0), r.leaving[g])
        flipping |= mark(fresh, g, margin, rate, noise, r)
    return flipping


@kernel
def fire_until_none_is_due(fresh: int, open_ones: int, over: int, r: Any) -> int:
    """Go on with the instants of these lanes until no guard is due in any of them.

    `open_ones` are the lanes with open locks, at the start of their runs. Returns the
    lanes that are over: those that were, and those that end here.
    """
    rounds = 0
    while fresh != 0:
        due = refresh(fresh, r) & ~over
        changed = 0
        if open_ones != 0:
            changed, resting = close(open_ones, r)
            over |= resting
        rounds += 1
        fresh = changed & ~over
        due &= ~(fresh | over)
        open_ones = 0
        if rounds < MOST_ROUNDS:
            open_ones = fresh  # rates may depend on the locks that have changed
        if due != 0:
            over |= fire(due, r)
            fresh = (fresh | due) & ~over
    return over
