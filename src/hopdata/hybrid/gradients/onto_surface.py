"""Whether neighbours follow where a handler puts a guard exactly onto its surface.

A plastic impact that ends in sticking puts the slip of a foot onto zero. If it puts the
neighbours there, too, all go on alike, and the handlers are one reset (`event`). If it
stops this start only, neighbours go on slipping either way, and there is no derivative.

So the value of the guard behind the handlers, at the neighbours' own instants, must
depend neither on the state before them nor on a parameter. It is carried back across
the handlers and the instant as the loss is. The derivatives of the loss are kept
meanwhile. A line belongs here if it decides whether neighbours follow.
"""

from hopdata.arrays import FloatArray
from hopdata.hybrid.compiled.kernel import copy, kernel, kernel_apart
from hopdata.hybrid.driver.jacobian import NOT_MOVED
from hopdata.hybrid.gradients.event import first_meeting_back, reset_back
from hopdata.hybrid.gradients.recorders import Recorders
from hopdata.hybrid.gradients.surface import ROUNDED, guard_at
from hopdata.hybrid.gradients.sweep import begin_tape
from hopdata.hybrid.gradients.together import are_same
from hopdata.hybrid.gradients.user_functions import field_value
from hopdata.hybrid.gradients.workspace import (
    BY_STATE,
    F_BEFORE,
    GUARD_BY_STATE,
    KEPT,
    FlipInstant,
    Flips,
    Room,
    Run,
)


@kernel
def flips_before(flips: Flips, instant: FlipInstant, e: int) -> bool:
    """Return whether the guard of flip `e` flips before it at the same instant."""
    again = False
    for other in range(instant.first, e):
        again = again or flips.guard[other] == flips.guard[e]
    return again


@kernel_apart
def look_behind(
    code: Recorders,
    room: Room,
    run: Run,
    instant: FlipInstant,
    k: int,
    y: FloatArray,
    flip: int,
) -> tuple[float, float, bool]:
    """Look at guard k in state `y`, before flip number `flip`.

    Returns its derivative by the time, its rate, and whether it is on its surface to
    within rounding. Those by states and parameters replace what the adjoint holds.
    """
    begin_tape(room, run.replayed.params[flip])
    mode = run.replayed.mode[flip]
    field_value(code, room, instant.t, y, mode, F_BEFORE)
    for j in range(len(room.params)):
        room.adjoint[1 + j] = 0.0
    by_time, rate, terms = guard_at(code, room, k, instant, y, mode)
    return by_time, rate, abs(room.h[k, 0]) <= ROUNDED * terms


@kernel_apart
def size_by_state(
    room: Room, run: Run, instant: FlipInstant, slopes: FloatArray, y: FloatArray
) -> float:
    """Return how much a function with these slopes changes where the state does.

    A state is as large as its value, its change since the last event, or where its
    absolute tolerance takes over from the relative one.
    """
    total = 0.0
    for i in range(len(y)):
        change = instant.since * abs(room.rows[F_BEFORE, i])
        least = run.tolerance.absolute[i] / run.tolerance.relative[0]
        total += abs(slopes[i]) * max(abs(y[i]), change, least)
    return total


@kernel_apart
def puts_neighbours(
    code: Recorders, room: Room, run: Run, instant: FlipInstant, e: int, by_time: float
) -> bool:
    """Return whether neighbours are on the surface of the guard of flip `e`, too.

    The guard has just been looked at, before the flip.
    """
    slopes = room.rows[GUARD_BY_STATE]
    terms = size_by_state(room, run, instant, slopes, run.flips.before[e])
    copy(slopes, room.rows[BY_STATE])
    for other in range(e - 1, instant.first - 1, -1):
        begin_tape(room, run.replayed.params[other])
        by_time += reset_back(code, room, run, other, instant.t)
    first_meeting_back(code, room, run, instant, by_time)
    before = run.flips.before[instant.first]
    moved = size_by_state(room, run, instant, room.rows[BY_STATE], before)
    for j in range(len(room.params)):
        moved += abs(room.adjoint[1 + j]) * max(abs(room.params[j, 0]), 1.0)
    return moved <= NOT_MOVED * terms


@kernel_apart
def goes_on(
    code: Recorders, room: Room, run: Run, instant: FlipInstant, e: int
) -> bool:
    """Return whether a guard put onto its surface slides or crosses by flip `e`.

    Its handler must leave the state alone.
    """
    flips = run.flips
    y = flips.after[e]
    if not are_same(flips.before[e], y):
        return False
    k = flips.guard[e]
    _, rate, is_on = look_behind(code, room, run, instant, k, y, e + 1)
    slides = not is_on  # its value is set apart
    return slides or rate * flips.direction[e] > 0.0


@kernel_apart
def follows(
    code: Recorders, room: Room, run: Run, instant: FlipInstant, e: int
) -> bool:
    """Return whether neighbours do what flip `e` does, one of those after the first.

    A guard that is pushed across its surface is pushed across by the neighbours, too.
    """
    if flips_before(run.flips, instant, e):
        return True
    k = run.flips.guard[e]
    y = run.flips.before[e]
    by_time, _, is_on = look_behind(code, room, run, instant, k, y, e)
    if not is_on:
        return True
    if not puts_neighbours(code, room, run, instant, e, by_time):
        return False
    return bool(goes_on(code, room, run, instant, e))


@kernel_apart
def neighbours_follow(
    code: Recorders, room: Room, run: Run, instant: FlipInstant
) -> bool:
    """Return whether neighbours do what all flips of an instant do.

    One guard has met its surface at the instant, and the others flip after it.
    """
    p = len(room.params)
    copy(room.rows[BY_STATE], room.rows[KEPT])
    for j in range(p):
        room.kept[j] = room.adjoint[1 + j]
    alike = True
    for e in range(instant.first + 1, instant.last):
        alike = alike and follows(code, room, run, instant, e)
    copy(room.rows[KEPT], room.rows[BY_STATE])
    for j in range(p):
        room.adjoint[1 + j] = room.kept[j]
    return alike
