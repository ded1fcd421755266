"""Back across the flips of an instant at which one guard met its surface.

The handlers of all these flips are one reset R of the state. With the fields f- before
and f+ after them and the instant tau of the guard (`surface`), the derivatives pass the
transpose of the saltation matrix:

    dy+ = D R dy- + (D R f- + dR/dt - f+) dtau.
"""

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import copy, kernel_apart
from hopdata.hybrid.gradients.losses import lose_at_event
from hopdata.hybrid.gradients.recorders import Recorders
from hopdata.hybrid.gradients.surface import has_met, meeting_back
from hopdata.hybrid.gradients.sweep import (
    begin_tape,
    clear,
    rewind,
    seed,
    set_params_aside,
    sweep,
)
from hopdata.hybrid.gradients.tape import IN_USE
from hopdata.hybrid.gradients.user_functions import field_value, handler
from hopdata.hybrid.gradients.workspace import (
    BY_STATE,
    F_AFTER,
    F_BEFORE,
    FlipInstant,
    Room,
    Run,
)


@kernel_apart
def handler_back(
    code: Recorders,
    room: Room,
    t: float,
    y: FloatArray,
    mode: IntArray,
    k: int,
    direction: int,
) -> float:
    """Carry the derivatives by states and parameters to before a handler.

    `mode` has the guard's new lock already. Returns the derivative by the handler's
    time.
    """
    p = len(room.params)
    by_state = room.rows[BY_STATE]
    rewind(room, p)
    copy(mode, room.mode)
    moment = handler(code, room, t, y, room.mode, k, direction)
    clear(room, moment)
    set_params_aside(room, p)
    for j in range(p):
        seed(room, room.changed, j, room.set_aside[j])
    for i in range(len(y)):
        seed(room, room.y, i, by_state[i])
    sweep(room, moment, room.links[IN_USE])
    for i in range(len(y)):
        by_state[i] = room.adjoint[moment + 1 + i]
    return room.adjoint[moment]


@kernel_apart
def by_leaving(code: Recorders, room: Room, run: Run, instant: FlipInstant) -> float:
    """Return the derivative by the instant, as far as the field after it acts later."""
    begin_tape(room, run.replayed.params[instant.last])
    y = run.flips.after[instant.last - 1]
    mode = run.replayed.mode[instant.last]
    field_value(code, room, instant.t, y, mode, F_AFTER)
    by_instant = 0.0
    for i in range(len(y)):
        by_instant -= room.rows[BY_STATE, i] * room.rows[F_AFTER, i]
    return by_instant


@kernel_apart
def reset_back(code: Recorders, room: Room, run: Run, e: int, t: float) -> float:
    """Carry derivatives to before the handler of flip `e`, on its tape.

    Returns the derivative by the handler's time.
    """
    flips = run.flips
    if flips.counts[e] == 0:
        return 0.0
    k = flips.guard[e]
    direction = flips.direction[e]
    mode = room.locked
    copy(run.replayed.mode[e], mode)
    mode[k] = direction
    return float(handler_back(code, room, t, flips.before[e], mode, k, direction))


@kernel_apart
def flip_back(
    code: Recorders, room: Room, run: Run, e: int, t: float, by_instant: float
) -> tuple[float, float]:
    """Carry the derivatives across the loss and the handler of flip `e`.

    Returns the value of the loss, and the derivative by the instant of all flips from
    this one on.
    """
    flips = run.flips
    by_state = room.rows[BY_STATE]
    n = len(by_state)
    begin_tape(room, run.replayed.params[e])
    value, by_time = lose_at_event(code, room, t, flips, e, run.n_shown)
    by_instant += by_time
    for i in range(n):
        by_state[i] += room.event_loss[1, i]
    by_instant += reset_back(code, room, run, e, t)
    for i in range(n):
        by_state[i] += room.event_loss[0, i]
    return value, by_instant


@kernel_apart
def first_meeting_back(
    code: Recorders, room: Room, run: Run, instant: FlipInstant, by_instant: float
) -> int:
    """Carry derivatives from before the first handler to before the instant.

    Returns a status. `by_instant` is the derivative by the instant so far.
    """
    first = instant.first
    k = run.flips.guard[first]
    y = run.flips.before[first]
    mode = run.replayed.mode[first]
    begin_tape(room, run.replayed.params[first])
    field_value(code, room, instant.t, y, mode, F_BEFORE)
    if instant.since == 0.0 and not has_met(code, room, k, instant, y, mode):
        return at.RUNNING  # past its surface at the start: so are its neighbours
    for i in range(len(y)):
        by_instant += room.rows[BY_STATE, i] * room.rows[F_BEFORE, i]
    return int(meeting_back(code, room, run.tolerance, k, instant, y, mode, by_instant))


@kernel_apart
def event_back(
    code: Recorders,
    room: Room,
    run: Run,
    instant: FlipInstant,
    ends: bool,
    by_end: float,
    found: FloatArray,
) -> int:
    """Carry the derivatives across the flips of an instant; one met its surface.

    Returns a status. `ends` says whether the run ends there, and `by_end` is the
    derivative of the loss by the run's end. The losses of events are added to
    `found[0]`.
    """
    by_instant = by_end
    if not ends:
        by_instant = by_leaving(code, room, run, instant)
    for e in range(instant.last - 1, instant.first - 1, -1):
        value, by_instant = flip_back(code, room, run, e, instant.t, by_instant)
        found[0] += value
    return first_meeting_back(code, room, run, instant, by_instant)
