"""Numbers onto the tape, and the tape read backward.

A line belongs here if it knows how a tape is laid out (`tape`), and nothing of systems.
The parameters have the places 1 ... p, from the beginning of a tape to its end; what
one call of a function recorded comes after them, and is forgotten by `rewind`.
"""

from hopdata.arrays import FloatArray
from hopdata.hybrid.compiled.kernel import kernel, kernel_apart
from hopdata.hybrid.compiled.memory import int_table
from hopdata.hybrid.gradients.tape import CELLS, HEAD, IN_USE, RECORD, THERE_ARE
from hopdata.hybrid.gradients.workspace import Room


@kernel
def rewind(room: Room, p: int) -> int:
    """Forget all but the parameters; return the first free place."""
    if room.links[IN_USE] > room.links[THERE_ARE]:
        room.is_full[0] = 1
    room.links[IN_USE] = 1 + p
    return 1 + p


@kernel
def begin_tape(room: Room, params: FloatArray) -> None:
    """Empty the tape, and put the parameters on its first places."""
    p = len(params)
    room.links[THERE_ARE] = len(room.adjoint) - room.rows.shape[1] - 2
    rewind(room, p)
    tape = room.tape.ctypes.data
    cells = int_table(room.params.ctypes.data, CELLS)
    for i in range(p):
        room.params[i, 0] = params[i]
        cells[i, 1] = 1 + i
        cells[i, 2] = tape


@kernel
def put(room: Room, row: FloatArray, i: int, value: float) -> int:
    """Put a number on the tape as an input; return its place.

    Where the tape is full, that is the place after its last.
    """
    place = room.links[IN_USE]
    room.links[IN_USE] = place + 1
    cells = int_table(row.ctypes.data, CELLS)
    row[i, 0] = value
    cells[i, 1] = 0
    cells[i, 2] = room.tape.ctypes.data
    if place >= room.links[THERE_ARE]:
        return room.links[THERE_ARE]
    cells[i, 1] = place
    first = HEAD + RECORD * place
    room.links[first] = 0
    room.links[first + 1] = 0
    room.tape[first + 2] = 0.0
    room.tape[first + 3] = 0.0
    return place


@kernel_apart
def put_all(room: Room, row: FloatArray, values: FloatArray, count: int) -> int:
    """Put the first numbers on the tape as inputs; return the place of the first."""
    first = min(room.links[IN_USE], room.links[THERE_ARE])
    for i in range(count):
        put(room, row, i, values[i])
    return first


@kernel
def is_full(room: Room) -> bool:
    """Return whether the tape was too short for what was recorded."""
    return room.is_full[0] != 0 or room.links[IN_USE] > room.links[THERE_ARE]


@kernel_apart
def clear(room: Room, first: int) -> None:
    """Set the adjoint of the places from `first` on to zero."""
    for place in range(first, min(room.links[IN_USE], room.links[THERE_ARE])):
        room.adjoint[place] = 0.0


@kernel
def seed(room: Room, row: FloatArray, i: int, weight: float) -> None:
    """Add to the adjoint of a traced number; a constant has none."""
    place = int_table(row.ctypes.data, CELLS)[i, 1]
    if place > 0:
        room.adjoint[place] += weight


@kernel_apart
def sweep(room: Room, first: int, last: int) -> None:
    """Read the records of the places first ... last - 1 backward."""
    for place in range(min(last, room.links[THERE_ARE]) - 1, first - 1, -1):
        weight = room.adjoint[place]
        if weight != 0.0:
            cell = HEAD + RECORD * place
            room.adjoint[room.links[cell]] += weight * room.tape[cell + 2]
            room.adjoint[room.links[cell + 1]] += weight * room.tape[cell + 3]


# The adjoint of the parameters, while that of another number than the loss is found.


@kernel_apart
def set_params_aside(room: Room, p: int) -> None:
    """Set the adjoint of the parameters aside, and leave zeros on the tape."""
    for i in range(p):
        room.set_aside[i] = room.adjoint[1 + i]
        room.adjoint[1 + i] = 0.0


@kernel_apart
def restore_params(room: Room, p: int, weight: float) -> None:
    """Restore what was set aside, and add `weight` times what was found meanwhile."""
    for i in range(p):
        found = weight * room.adjoint[1 + i] if weight != 0.0 else 0.0
        room.adjoint[1 + i] = room.set_aside[i] + found
