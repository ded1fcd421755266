"""The functions of the end and of an event: their values and derivatives.

A line belongs here if it calls `at_end` or `at_event`. The third kind of loss, `along`,
is a state of its own (`extended`), and needs no line in the pass but its first.
"""

from hopdata.arrays import FloatArray
from hopdata.hybrid.compiled.kernel import kernel_apart
from hopdata.hybrid.gradients.recorders import Recorders, call_at_end, call_at_event
from hopdata.hybrid.gradients.sweep import clear, put, put_all, rewind, seed, sweep
from hopdata.hybrid.gradients.tape import IN_USE
from hopdata.hybrid.gradients.workspace import BY_STATE, Flips, Room


@kernel_apart
def lose_at_end(
    code: Recorders, room: Room, t: float, y: FloatArray, n_shown: int
) -> tuple[float, float]:
    """Begin the derivative by the state with that of the loss at the end.

    Returns the value of the loss, and its derivative by the time.
    """
    if code.at_end == 0:
        return 0.0, 0.0
    moment = put(room, room.time, 0, t)
    states = put_all(room, room.y, y, n_shown)
    call_at_end(
        code.at_end, room.time.ctypes.data, room.y.ctypes.data,
        room.params.ctypes.data, len(room.params), room.result.ctypes.data,
    )  # fmt: skip
    clear(room, moment)
    seed(room, room.result, 0, 1.0)
    sweep(room, moment, room.links[IN_USE])
    for i in range(n_shown):
        room.rows[BY_STATE, i] = room.adjoint[states + i]
    return room.result[0, 0], room.adjoint[moment]


@kernel_apart
def lose_at_event(
    code: Recorders, room: Room, t: float, flips: Flips, e: int, n_shown: int
) -> tuple[float, float]:
    """Differentiate the loss of an event by the states before and after it.

    The derivatives are written into `room.event_loss`. Returns the value of the loss,
    and its derivative by the event's time.
    """
    by_states = room.event_loss
    for i in range(by_states.shape[1]):
        by_states[0, i] = 0.0
        by_states[1, i] = 0.0
    if code.at_event == 0 or flips.counts[e] == 0:
        return 0.0, 0.0
    rewind(room, len(room.params))
    moment = put(room, room.time, 0, t)
    before = put_all(room, room.y, flips.before[e], n_shown)
    after = put_all(room, room.after, flips.after[e], n_shown)
    call_at_event(
        code.at_event, room.time.ctypes.data, room.y.ctypes.data,
        room.after.ctypes.data, flips.told_guard[e], flips.told_direction[e],
        room.params.ctypes.data, len(room.params), room.result.ctypes.data,
    )  # fmt: skip
    clear(room, moment)
    seed(room, room.result, 0, 1.0)
    sweep(room, moment, room.links[IN_USE])
    for i in range(n_shown):
        by_states[0, i] = room.adjoint[before + i]
        by_states[1, i] = room.adjoint[after + i]
    return room.result[0, 0], room.adjoint[moment]
