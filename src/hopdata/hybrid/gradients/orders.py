"""Whether it matters in which order the guards of an instant flip, for the way back.

The rule is that of `driver.orders`: every pair, whichever of the others have flipped.
A line belongs here if it compares two orders; what is carried back stands in
`together`.
"""

from hopdata.arrays import IntArray
from hopdata.hybrid.compiled.kernel import copy, kernel, kernel_apart
from hopdata.hybrid.driver.orders import (
    MOST_AT_ONCE,
    NO_JUMP,
    SAME_ORDER,
    holds,
    jumps_in_order,
)
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
    FlipInstant,
    Flips,
    Room,
    Run,
)

# Rows of plain numbers: the fields before both flips, after one of them, and after
# both; the derivatives of both guards.
NONE, FIRST, SECOND, BOTH = F_BEFORE, F_AFTER, AHEAD, SCRATCH
FIRST_GUARD, SECOND_GUARD = KEPT, GUARD_BY_STATE


@kernel
def rate_by(room: Room, gradient: int, field: int, by_time: float) -> float:
    """Return a guard's rate along the field in a row."""
    rate = by_time
    for i in range(room.rows.shape[1]):
        rate += room.rows[gradient, i] * room.rows[field, i]
    return rate


@kernel_apart
def size_of(room: Room, run: Run, instant: FlipInstant, i: int) -> float:
    """Return the size of state i: its value, its change, or where tolerances meet."""
    change = instant.since * abs(room.rows[NONE, i])
    least = run.tolerance.absolute[i] / run.tolerance.relative[0]
    return max(abs(run.flips.before[instant.first, i]), change, least)


@kernel_apart
def same_either_way(
    room: Room, run: Run, instant: FlipInstant, by_time: float, other_by_time: float
) -> bool:
    """Return whether two guards' flips change the flow alike in either order.

    `by_time` and `other_by_time` are the guards' derivatives by the time.
    """
    rows = room.rows
    n = rows.shape[1]
    rate = rate_by(room, FIRST_GUARD, NONE, by_time)
    other = rate_by(room, SECOND_GUARD, NONE, other_by_time)
    later = rate_by(room, FIRST_GUARD, SECOND, by_time)
    other_later = rate_by(room, SECOND_GUARD, FIRST, other_by_time)
    if not (rate * later > 0.0 and other * other_later > 0.0):
        return False
    moved = 0.0
    apart = 0.0
    rounding = 0.0
    for i in range(n):
        none = rows[NONE, i]
        both = rows[BOTH, i]
        one = rows[FIRST, i]
        a, b = jumps_in_order(none, one, both, rate, other, other_later)
        one = rows[SECOND, i]
        b_first, a_second = jumps_in_order(none, one, both, other, rate, later)
        size = size_of(room, run, instant, i)
        for j in range(n):
            scale = size_of(room, run, instant, j) / size
            by_a = rows[FIRST_GUARD, j] * scale
            by_b = rows[SECOND_GUARD, j] * scale
            moved = max(moved, abs(a * by_a + b * by_b))
            apart = max(apart, abs((a - a_second) * by_a + (b - b_first) * by_b))
            whole = max(abs(none), abs(both))
            rounding = max(rounding, whole * (abs(by_a / rate) + abs(by_b / other)))
    return apart <= SAME_ORDER * moved + NO_JUMP * rounding


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
    rewind(room, p)
    by_time = differentiate_guard(code, room, a, t, y, locks)
    copy(room.rows[GUARD_BY_STATE], room.rows[FIRST_GUARD])
    rewind(room, p)
    other_by_time = differentiate_guard(code, room, b, t, y, locks)
    flip_set(flips, instant, flipped, locks)
    field_value(code, room, t, y, locks, NONE)
    locks[a] = flips.direction[one]
    field_value(code, room, t, y, locks, FIRST)
    locks[b] = flips.direction[other]
    field_value(code, room, t, y, locks, BOTH)
    locks[a] = -flips.direction[one]
    field_value(code, room, t, y, locks, SECOND)
    return same_either_way(room, run, instant, by_time, other_by_time)


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
