"""Slopes of a system's functions along directions, from their machine code for duals.

A function for duals (see `numbers.derivatives`) reads and writes rows of numbers: each
dual is a value and its slopes along the `width` directions that it carries at once.
Here these rows are filled and read, in several passes if there are more directions.

Directions 0 to n - 1 are the columns of an (n, n) matrix of seeds, or the states
themselves. Direction n, of guards and handlers, is a motion of the states together with
the time. Matrices and rows are given by their addresses; 0 stands for the states
themselves as seeds, and for states that do not move with the time.
"""

import numpy as np
from numba import types

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid.compiled.calls import caller
from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.compiled.memory import (
    FloatTable,
    FloatVector,
    IntVector,
    address_of,
    float_vector,
    int_vector,
    start_of,
)

BYTES = 8  # of a number
_FLOAT = types.float64
_INT = types.int64

# Slots of the table of machine code and rooms: addresses of the code for field, guards
# and handler (0: none), the directions that their duals carry, and the addresses of
# rooms: for time, states, rates of states, guards, their rates, parameters and mode. If
# the duals of the field carry all directions at once, its code has a room of its own.
# The last slot has the address of the identity, (n, n).
FIELD, GUARD, HANDLER = np.arange(3, dtype=np.int64)
FIELD_WIDTH, WIDTH = np.arange(3, 5, dtype=np.int64)
MOMENT, STATES, RATES, VALUES, HDOTS, MEMORY, MODES = np.arange(5, 12, dtype=np.int64)
IDENTITY = np.int64(12)
ALONG_SLOTS = 13

# Signatures of the machine code, in which rows of duals are given by their addresses.
# t, states, mode and its length, params and their number, rates; for few states instead
# of rows of duals: the states, the results (n, n), and the seeds (n, n)
FIELD_NATIVE = types.void(_FLOAT, _INT, _INT, _INT, _INT, _INT, _INT, _INT)
# moment, states, dy, mode and its length, params and their number, k, h, hdot
GUARD_NATIVE = types.void(*(10 * [_INT]))
# moment, states, mode, params, number of parameters, guard, direction
HANDLER_NATIVE = types.void(*(7 * [_INT]))

call_field = caller(FIELD_NATIVE)
call_guard = caller(GUARD_NATIVE)
call_handler = caller(HANDLER_NATIVE)


@kernel
def seed(
    room: int, n: int, width: int, y: int, first: int, seeds: int, last: int
) -> None:
    """Make duals of the n states at `y`, with directions from number `first` on."""
    duals = float_vector(room, 0)
    values = float_vector(y, 0)
    columns = float_vector(seeds, 0)
    motion = float_vector(last, 0)
    count = min(width, n - first)
    for i in range(n):
        place = i * (1 + width)
        duals[place] = values[i]
        for j in range(count):
            if seeds != 0:
                duals[place + 1 + j] = columns[i * n + first + j]
            else:
                duals[place + 1 + j] = 1.0 if first + j == i else 0.0
        for j in range(count, width):
            moves = last != 0 and first + j == n
            duals[place + 1 + j] = motion[i] if moves else 0.0


@kernel
def harvest(
    room: int, n: int, width: int, first: int, into: int, into_last: int
) -> None:
    """Write the slopes of n duals, along directions from number `first` on.

    Those along direction n are written if there is room for them.
    """
    duals = float_vector(room, 0)
    columns = float_vector(into, 0)
    motion = float_vector(into_last, 0)
    count = min(width, n - first)
    for i in range(n):
        place = i * (1 + width)
        for j in range(count):
            columns[i * n + first + j] = duals[place + 1 + j]
        if into_last != 0 and count < width:
            motion[i] = duals[place + 1 + count]


@kernel
def set_moment(room: int, width: int, t: float, first: int, n: int) -> None:
    """Make a dual of the time, which changes along direction n."""
    moment = float_vector(room, 0)
    moment[0] = t
    for j in range(width):
        moment[1 + j] = 1.0 if first + j == n else 0.0


@kernel
def field_along(
    along: IntVector,
    t: float,
    y: int,
    n: int,
    mode: IntArray,
    params: FloatArray,
    seeds: int,
    into: int,
) -> None:
    """Write the field's derivative at a fixed time, times the seeds, (n, n)."""
    width = along[FIELD_WIDTH]
    if width >= n:
        if seeds == 0:
            seeds = along[IDENTITY]
        call_field(
            along[FIELD], t, y, start_of(mode), len(mode), start_of(params),
            len(params), into, seeds,
        )  # fmt: skip
        return
    states = along[STATES]
    rates = along[RATES]
    for first in range(0, n, width):
        seed(states, n, width, y, first, seeds, 0)
        call_field(
            along[FIELD], t, states, start_of(mode), len(mode), start_of(params),
            len(params), rates, 0,
        )  # fmt: skip
        harvest(rates, n, width, first, into, 0)


@kernel
def guard_gradient(  # noqa: PLR0913 (the guards' arguments)
    along: IntVector,
    t: float,
    y: int,
    n: int,
    s: FloatTable,
    dy: int,
    mode: IntVector,
    params: FloatVector,
    k: int,
    into: int,
) -> float:
    """Write the derivatives of guard k by the states, (n,); return that by the time.

    The rates of the states are in row `dy` of the table s.
    """
    width = along[WIDTH]
    gradient = float_vector(into, 0)
    found = float_vector(along[VALUES], 0)
    in_time = 0.0
    for first in range(0, n + 1, width):
        seed(along[STATES], n, width, y, first, 0, 0)
        set_moment(along[MOMENT], width, t, first, n)
        call_guard(
            along[GUARD], along[MOMENT], along[STATES],
            address_of(s) + BYTES * n * dy, address_of(mode), mode.width,
            address_of(params), params.width, k, along[VALUES], along[HDOTS],
        )  # fmt: skip
        count = min(width, n - first)
        slopes = k * (1 + width) + 1
        for j in range(count):
            gradient[first + j] = found[slopes + j]
        if count < width:
            in_time = found[slopes + count]
    return in_time


@kernel
def guard_along(  # noqa: PLR0913 (the guards' arguments, and the directions)
    along: IntVector,
    t: float,
    y: int,
    n: int,
    s: FloatTable,
    dy: int,
    mode: IntVector,
    params: FloatVector,
    k: int,
    seeds: int,
    last: int,
    into: int,
) -> float:
    """Write the slopes of guard k along n directions; return that along the last one.

    The rates of the states are in row `dy` of the table s.
    """
    width = along[WIDTH]
    slopes = float_vector(into, 0)
    found = float_vector(along[VALUES], 0)
    along_last = 0.0
    for first in range(0, n + 1, width):
        seed(along[STATES], n, width, y, first, seeds, last)
        set_moment(along[MOMENT], width, t, first, n)
        call_guard(
            along[GUARD], along[MOMENT], along[STATES],
            address_of(s) + BYTES * n * dy, address_of(mode), mode.width,
            address_of(params), params.width, k, along[VALUES], along[HDOTS],
        )  # fmt: skip
        count = min(width, n - first)
        place = k * (1 + width) + 1
        for j in range(count):
            slopes[first + j] = found[place + j]
        if count < width:
            along_last = found[place + count]
    return along_last


@kernel
def handler_along(  # noqa: PLR0913 (the handler's arguments, and the directions)
    along: IntVector,
    t: float,
    y: int,
    n: int,
    mode: IntVector,
    params: FloatVector,
    guard: int,
    direction: int,
    seeds: int,
    last: int,
    into: int,
    into_last: int,
) -> None:
    """Write the slopes of the state after a handler: (n, n), and (n,) for direction n.

    Mode and parameters remain as they are. The handler receives copies, and the
    parameters as duals, because it may store states in them.
    """
    width = along[WIDTH]
    states = along[STATES]
    modes = int_vector(along[MODES], mode.width)
    memory = float_vector(along[MEMORY], 0)
    for first in range(0, n + 1, width):
        seed(states, n, width, y, first, seeds, last)
        set_moment(along[MOMENT], width, t, first, n)
        for i in range(mode.width):
            modes[i] = mode[i]
        for i in range(params.width):
            memory[i * (1 + width)] = params[i]
            for j in range(width):
                memory[i * (1 + width) + 1 + j] = 0.0
        call_handler(
            along[HANDLER], along[MOMENT], states, along[MODES], along[MEMORY],
            params.width, guard, direction,
        )  # fmt: skip
        harvest(states, n, width, first, into, into_last)
