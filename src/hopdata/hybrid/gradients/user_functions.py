"""One call of a user's function: recorded, with its derivatives where they are wanted.

A line belongs here if it calls the field, the guards or the handler; nothing else in
this folder does. The machine code that is called is made by `recorders`. Each function
puts its inputs on the tape, which has been rewound or begun by its caller.
"""

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid.compiled.kernel import copy, kernel_apart
from hopdata.hybrid.gradients.recorders import (
    Recorders,
    call_field,
    call_guards,
    call_handler,
)
from hopdata.hybrid.gradients.sweep import clear, put, put_all, seed, sweep
from hopdata.hybrid.gradients.tape import IN_USE
from hopdata.hybrid.gradients.workspace import F_BEFORE, GUARD_BY_STATE, Room


@kernel_apart
def field(code: Recorders, room: Room, t: float, y: FloatArray, mode: IntArray) -> None:
    """Record the field in `room.dy`."""
    put_all(room, room.y, y, len(y))
    held = min(max(t, room.limits[0]), room.limits[1])
    call_field(
        code.field, held, room.y.ctypes.data, mode.ctypes.data, len(mode),
        room.params.ctypes.data, len(room.params), room.dy.ctypes.data,
    )  # fmt: skip


@kernel_apart
def field_value(
    code: Recorders, room: Room, t: float, y: FloatArray, mode: IntArray, row: int
) -> None:
    """Write the field into a row of plain numbers, and nothing on the tape."""
    first = room.links[IN_USE]
    field(code, room, t, y, mode)
    for i in range(len(y)):
        room.rows[row, i] = room.dy[i, 0]
    room.links[IN_USE] = first


@kernel_apart
def guards(code: Recorders, room: Room, t: float, y: FloatArray, mode: IntArray) -> int:
    """Record the guards at a state; return the place of the time.

    The places of the states follow. The guards see the rates of the states in F_BEFORE.
    """
    moment = put(room, room.time, 0, t)
    put_all(room, room.y, y, len(y))
    call_guards(
        code.guards, room.time.ctypes.data, room.y.ctypes.data,
        room.rows[F_BEFORE].ctypes.data, mode.ctypes.data, len(mode),
        room.params.ctypes.data, len(room.params),
        room.h.ctypes.data, room.hdot.ctypes.data,
    )  # fmt: skip
    return moment


@kernel_apart
def differentiate_guard(
    code: Recorders, room: Room, k: int, t: float, y: FloatArray, mode: IntArray
) -> float:
    """Return guard k's derivative by the time.

    That by the states is written into GUARD_BY_STATE, and that by the parameters is
    added to their adjoint.
    """
    moment = guards(code, room, t, y, mode)
    clear(room, moment)
    seed(room, room.h, k, 1.0)
    sweep(room, moment, room.links[IN_USE])
    for i in range(len(y)):
        room.rows[GUARD_BY_STATE, i] = room.adjoint[moment + 1 + i]
    return room.adjoint[moment]


@kernel_apart
def handler(
    code: Recorders,
    room: Room,
    t: float,
    y: FloatArray,
    mode: IntArray,
    k: int,
    direction: int,
) -> int:
    """Record a handler; return the place of the time.

    The places of the states follow. The handler changes `room.y`, `room.changed` and
    `mode`.
    """
    moment = put(room, room.time, 0, t)
    put_all(room, room.y, y, len(y))
    for j in range(len(room.params)):
        copy(room.params[j], room.changed[j])
    if code.handler != 0:
        call_handler(
            code.handler, room.time.ctypes.data, room.y.ctypes.data,
            mode.ctypes.data, len(mode),
            room.changed.ctypes.data, len(room.changed), k, direction,
        )  # fmt: skip
    return moment
