"""Whether it matters in which order the guards of an instant flip, for the way back.

The rule is that of `driver.orders`: every pair, whichever of the others have flipped.
A line belongs here if it compares two orders; what is carried back stands in
`together`.
"""

from hopdata.arrays import IntArray
from hopdata.hybrid.compiled.kernel import copy, kernel, kernel_apart
from hopdata.hybrid.driver.orders import MOST_AT_ONCE, Rows, holds, same_either_way
from hopdata.hybrid.gradients.recorders import Recorders
from hopdata.hybrid.gradients.sweep import (
    begin_tape,
    restore_params,
    rewind,
    set_params_aside,
)
from hopdata.hybrid.gradients.user_functions import differentiate_guard, field_value
from hopdata.hybrid.gradients.workspace import (
    AHEAD,
    F_AFTER,
    F_BEFORE,
    GUARD_BY_STATE,
    KEPT,
    SCRATCH,
    SIZES,
    FlipInstant,
    Flips,
    Room,
    Run,
)

ROWS = Rows(
    none=F_BEFORE,
    first=F_AFTER,
    second=AHEAD,
    both=SCRATCH,
    first_guard=KEPT,
    second_guard=GUARD_BY_STATE,
    sizes=SIZES,
)


@kernel_apart
def write_sizes(room: Room, run: Run, instant: FlipInstant) -> None:
    """Write the sizes of the states: value, change, or where tolerances meet."""
    y = run.flips.before[instant.first]
    for i in range(len(y)):
        change = instant.since * abs(room.rows[F_BEFORE, i])
        least = run.tolerance.absolute[i] / run.tolerance.relative[0]
        room.rows[SIZES, i] = max(abs(y[i]), change, least)


@kernel
def flip_set(flips: Flips, instant: FlipInstant, chosen: int, mode: IntArray) -> None:
    """Set the locks of those flips of an instant whose bits are set."""
    for e in range(instant.first, instant.last):
        if chosen >> (e - instant.first) & 1:
            mode[flips.guard[e]] = flips.direction[e]


@kernel_apart
def commute(
    code: Recorders,
    room: Room,
    run: Run,
    instant: FlipInstant,
    one: int,
    other: int,
    flipped: int,
) -> bool:
    """Return whether two flips may be in either order.

    Those flips of the instant whose bits are set in `flipped` have been before them.
    """
    flips = run.flips
    t = instant.t
    p = len(room.params)
    y = flips.before[instant.first]
    locks = room.locked
    a, b = flips.guard[one], flips.guard[other]
    copy(run.replayed.mode[instant.first], locks)
    field_value(code, room, t, y, locks, F_BEFORE)
    write_sizes(room, run, instant)
    rewind(room, p)
    by_time = differentiate_guard(code, room, a, t, y, locks)
    copy(room.rows[GUARD_BY_STATE], room.rows[KEPT])
    rewind(room, p)
    other_by_time = differentiate_guard(code, room, b, t, y, locks)
    flip_set(flips, instant, flipped, locks)
    field_value(code, room, t, y, locks, ROWS.none)
    locks[a] = flips.direction[one]
    field_value(code, room, t, y, locks, ROWS.first)
    locks[b] = flips.direction[other]
    field_value(code, room, t, y, locks, ROWS.both)
    locks[a] = -flips.direction[one]
    field_value(code, room, t, y, locks, ROWS.second)
    same = same_either_way(room.rows, ROWS, len(y), by_time, other_by_time)
    return bool(same)


@kernel_apart
def pairs_commute(
    code: Recorders, room: Room, run: Run, instant: FlipInstant, flipped: int
) -> bool:
    """Return whether all pairs of flips commute after those of the set."""
    total = instant.last - instant.first
    for second in range(total):
        for first in range(second):
            if holds(flipped, first, second):
                continue
            one = instant.first + first
            other = instant.first + second
            if not commute(code, room, run, instant, one, other, flipped):
                return False
    return True


@kernel_apart
def order_matters(code: Recorders, room: Room, run: Run, instant: FlipInstant) -> bool:
    """Return whether the flow has no derivative where the guards of an instant meet."""
    p = len(room.params)
    total = instant.last - instant.first
    sets = 1 << total if total <= MOST_AT_ONCE else 1
    begin_tape(room, run.replayed.params[instant.first])
    set_params_aside(room, p)
    matters = False
    for flipped in range(sets):
        if not matters:
            matters = not pairs_commute(code, room, run, instant, flipped)
    restore_params(room, p, 0.0)
    return matters
