"""Back across an instant at which the field jumps in time.

A line belongs here if it asks whether there is such an instant, on which side of it the
field is seen, or what its movement with the parameters costs. With the field f- before
and f+ after the instant tau, dy+ = dy- + (f- - f+) dtau.
"""

from math import inf

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.driver import moving_instants as moving
from hopdata.hybrid.driver.orders import NO_JUMP
from hopdata.hybrid.gradients.known import Known
from hopdata.hybrid.gradients.recorders import Recorders
from hopdata.hybrid.gradients.sweep import is_full
from hopdata.hybrid.gradients.user_functions import field_value
from hopdata.hybrid.gradients.workspace import (
    BY_STATE,
    F_AFTER,
    F_BEFORE,
    TAPE_FULL,
    Room,
)

# Instead of what the field's code tells of a jump: there is none.
NO_INSTANT = -1


@kernel
def set_limits(room: Room, first: float, last: float) -> None:
    """Let the field see times from `first` to `last` only."""
    room.limits[0] = first
    room.limits[1] = last


@kernel
def is_declared(known: Known, t: float) -> bool:
    """Return whether an instant is declared at time t."""
    declared = False
    for one in known.declared:
        declared = declared or abs(one - t) <= known.margin[0]
    return declared


@kernel_apart
def jump_at(
    known: Known, span: float, t: float, y: FloatArray, mode: IntArray, p: FloatArray
) -> int:
    """Return what the field's code tells of a jump at time t, or NO_INSTANT.

    How it moves with the parameters is written into `known.moves`.
    """
    n = len(known.moves) - len(p)
    both = known.ranges[0]
    for i in range(n):
        both[i] = y[i]
    for j in range(len(p)):
        both[n + j] = p[j]
    margin = known.margin[0]
    jump = moving.Jump(
        known.code[0], t - margin, t + margin, max(abs(t), span),
        known.ranges.ctypes.data, n + len(p), n,
        mode.ctypes.data, len(mode), p.ctypes.data, 0, known.answers.ctypes.data,
    )  # fmt: skip
    told = moving.movements(jump, both.ctypes.data, known.moves.ctypes.data)
    if told == moving.NONE and not is_declared(known, t):
        return NO_INSTANT
    return told


@kernel_apart
def end_back(
    code: Recorders,
    room: Room,
    known: Known,
    told: int,
    where: tuple[float, bool, bool],
    y: FloatArray,
    mode: IntArray,
) -> int:
    """Go back from after an end of a step to before the jump there, if there is one.

    `told` is what `jump_at` returned. `where` holds the time, and whether it is the
    start or the end of the run. Returns a status. Afterwards, the field sees the times
    before the jump.
    """
    t, is_start, is_end = where
    set_limits(room, -inf, inf)
    if told == NO_INSTANT:
        return at.RUNNING
    set_limits(room, -inf, t - known.margin[0])
    if is_end:
        return at.RUNNING
    status = jump_back(code, room, known, told, t, y, mode, is_start)
    if is_full(room):
        return TAPE_FULL
    return status


@kernel_apart
def jump_back(
    code: Recorders,
    room: Room,
    known: Known,
    told: int,
    t: float,
    y: FloatArray,
    mode: IntArray,
    is_start: bool,
) -> int:
    """Carry the derivatives across a jump of the field in time; return a status.

    Afterwards, the field sees the times before the jump.
    """
    margin = known.margin[0]
    set_limits(room, t + margin, inf)
    field_value(code, room, t, y, mode, F_AFTER)
    set_limits(room, -inf, t - margin)
    field_value(code, room, t, y, mode, F_BEFORE)
    jumps, by_instant = differentiate_jump(room)
    if not jumps:
        return at.RUNNING
    if told == moving.DIFFERENT:
        return at.INSTANTS_IN_JACOBIAN
    if told != moving.TOLD:
        known.n_held[0] += 1
        return at.RUNNING
    moves = move_back(room, known, by_instant)
    if is_start and moves:
        return at.INSTANTS_IN_JACOBIAN
    return at.RUNNING


@kernel_apart
def differentiate_jump(room: Room) -> tuple[bool, float]:
    """Return whether the field jumps, and the loss's derivative by the instant."""
    size = 0.0
    change = 0.0
    by_instant = 0.0
    for i in range(room.rows.shape[1]):
        before = room.rows[F_BEFORE, i]
        after = room.rows[F_AFTER, i]
        size = max(size, abs(before), abs(after))
        change = max(change, abs(after - before))
        by_instant += room.rows[BY_STATE, i] * (before - after)
    return change > NO_JUMP * size, by_instant


@kernel_apart
def move_back(room: Room, known: Known, by_instant: float) -> bool:
    """Carry the derivative by an instant to the parameters; return if they move it."""
    p = len(room.params)
    first = len(known.moves) - p
    moves = False
    for j in range(p):
        by_param = known.moves[first + j]
        moves = moves or abs(by_param * room.params[j, 0]) > known.margin[0]
        room.adjoint[1 + j] += by_instant * by_param
    return moves
