"""Back across the flips of guards that met their surfaces at the same instant.

Each is passed with the field between the flips before and after it, as the driver's
Jacobian has it (`driver.jacobian`). Handlers must then leave the state alone, no guard
may turn another back, and all orders must agree (`orders`): otherwise there is no
derivative, and the status says so.
"""

from hopdata.arrays import FloatArray
from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import copy, kernel, kernel_apart
from hopdata.hybrid.gradients.event import handler_back
from hopdata.hybrid.gradients.losses import lose_at_event
from hopdata.hybrid.gradients.orders import order_matters
from hopdata.hybrid.gradients.recorders import Recorders
from hopdata.hybrid.gradients.surface import meeting_back
from hopdata.hybrid.gradients.sweep import (
    begin_tape,
    restore_params,
    rewind,
    set_params_aside,
)
from hopdata.hybrid.gradients.user_functions import differentiate_guard, field_value
from hopdata.hybrid.gradients.workspace import (
    AHEAD,
    BY_STATE,
    F_AFTER,
    F_BEFORE,
    GUARD_BY_STATE,
    SCRATCH,
    FlipInstant,
    Room,
    Run,
)


@kernel
def are_same(one: FloatArray, other: FloatArray) -> bool:
    """Return whether two rows hold the same numbers."""
    differ = 0
    for i in range(len(one)):
        differ += 1 if one[i] != other[i] else 0
    return differ == 0


@kernel_apart
def is_lock_alone(code: Recorders, room: Room, run: Run, e: int, t: float) -> bool:
    """Return whether flip `e` changes nothing but a lock, and the field by the lock.

    The field after it is written into F_AFTER. The derivatives by the parameters pass
    the handler.
    """
    flips = run.flips
    replayed = run.replayed
    k = flips.guard[e]
    y = flips.before[e]
    if not are_same(y, flips.after[e]):
        return False
    locked = room.locked
    copy(replayed.mode[e], locked)
    locked[k] = flips.direction[e]
    begin_tape(room, replayed.params[e])
    if flips.counts[e] != 0:
        copy(room.rows[BY_STATE], room.rows[AHEAD])
        handler_back(code, room, t, y, locked, k, flips.direction[e])
        if not are_same(room.rows[AHEAD], room.rows[BY_STATE]):
            return False
    field_value(code, room, t, y, locked, SCRATCH)
    begin_tape(room, replayed.params[e + 1])
    field_value(code, room, t, y, replayed.mode[e + 1], F_AFTER)
    return are_same(room.rows[SCRATCH], room.rows[F_AFTER])


@kernel_apart
def turns_back(
    code: Recorders, room: Room, run: Run, instant: FlipInstant, e: int
) -> bool:
    """Return whether flip `e` turns back its own guard or one that flips after it.

    The field after it is in F_AFTER.
    """
    flips = run.flips
    y = flips.before[e]
    for i in range(len(y)):
        room.rows[F_BEFORE, i] = room.rows[F_AFTER, i]  # which the guards see
    p = len(room.params)
    mode = run.replayed.mode[e + 1]
    turned = False
    set_params_aside(room, p)
    for other in range(e, instant.last):
        k = flips.guard[other]
        rewind(room, p)
        rate = differentiate_guard(code, room, k, instant.t, y, mode)
        for i in range(len(y)):
            rate += room.rows[GUARD_BY_STATE, i] * room.rows[F_BEFORE, i]
        turned = turned or not rate * flips.direction[other] > 0.0
    restore_params(room, p, 0.0)
    return turned


@kernel_apart
def lock_back(
    code: Recorders,
    room: Room,
    run: Run,
    instant: FlipInstant,
    e: int,
    by_time: float,
) -> int:
    """Carry the derivatives across flip `e`, which changes a lock alone.

    Returns a status. `by_time` is the derivative of the loss of this event by its time;
    those by its states are in `room.event_loss`.
    """
    y = run.flips.before[e]
    mode = run.replayed.mode[e]
    by_state = room.rows[BY_STATE]
    by_instant = by_time
    field_value(code, room, instant.t, y, mode, F_BEFORE)
    for i in range(len(y)):
        jump = room.rows[F_BEFORE, i] - room.rows[F_AFTER, i]
        at_event = room.event_loss[0, i] + room.event_loss[1, i]
        by_instant += by_state[i] * jump + at_event * room.rows[F_BEFORE, i]
        by_state[i] += at_event
    k = run.flips.guard[e]
    return meeting_back(code, room, run.tolerance, k, instant, y, mode, by_instant)


@kernel_apart
def together_back(
    code: Recorders, room: Room, run: Run, instant: FlipInstant, found: FloatArray
) -> int:
    """Carry the derivatives across flips of guards that met their surfaces together.

    Returns a status. The losses of events are added to `found[0]`.
    """
    t = instant.t
    if order_matters(code, room, run, instant):
        return at.TIE_IN_JACOBIAN
    for e in range(instant.last - 1, instant.first - 1, -1):
        begin_tape(room, run.replayed.params[e])
        value, by_time = lose_at_event(code, room, t, run.flips, e, run.n_shown)
        found[0] += value
        if not is_lock_alone(code, room, run, e, t):
            return at.TIE_IN_JACOBIAN
        begin_tape(room, run.replayed.params[e])
        if turns_back(code, room, run, instant, e):
            return at.TIE_IN_JACOBIAN
        status = lock_back(code, room, run, instant, e, by_time)
        if status != at.RUNNING:
            return status
    return at.RUNNING
