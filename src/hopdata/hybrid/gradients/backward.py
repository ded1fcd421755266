"""The backward pass: a gradient through the steps and events of a solution.

Each step is that of an explicit Runge-Kutta method whose stages are recorded again
from the state at its start, and read backward (the discrete adjoint: Hager 2000,
Sandu 2006). At an event the adjoint passes the transpose of the saltation matrix: with
the reset R, the field f- before and f+ after it, and the instant tau of h(tau, y) = 0,

    dy+ = D R dy- + (D R f- + dR/dt - f+) dtau,
    dtau = -(D h dy- + dh/dp dp) / (D h f- + dh/dt).

Several flips at one instant are a sequence. If one guard meets its surface, the
handlers of all flips are one reset. If several do, each is passed with the field
between the flips before and after it, as the driver's Jacobian has it
(`driver.jacobian`); handlers must then leave the state alone.
"""

from collections.abc import Callable
from functools import cache
from math import inf
from typing import Any, NamedTuple

from numba import njit

from hopdata.arrays import FloatArray, IntArray
from hopdata.code_cache import compiled_in_cache
from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import ENTRY, copy, kernel, kernel_apart
from hopdata.hybrid.compiled.memory import int_table
from hopdata.hybrid.driver import moving_instants as moving
from hopdata.hybrid.driver.jacobian import LEAST_LOOK, LOOK, NO_JUMP
from hopdata.hybrid.gradients.recorders import (
    Recorders,
    call_at_end,
    call_at_event,
    call_field,
    call_guards,
    call_handler,
    own_digest,
)
from hopdata.hybrid.gradients.tape import CELLS, HEAD, RECORD
from hopdata.hybrid.gradients.timed import Timed

#: Distance from its surface within which a guard has met it at an instant.
#: Unit: 1, of its way since the last event. Origin: chosen.
MET = 1e-7

#: Distance from its surface that rounding of the states may cause.
#: Unit: 1, of the terms of the guard. Origin: chosen.
ROUNDED = 1e-12

# What the backward pass returns besides a status of the driver's: the tape is full, or
# a handler does not repeat what it did.
TAPE_FULL = 100
NOT_REPEATED = 101

#: Largest difference of the state after a handler from that of the solution.
#: Unit: 1, of the state. Origin: rounding: both are the same code on the same numbers.
SAME = 1e-12


class Steps(NamedTuple):
    """The steps of a solution: times (S + 1,) and states after events (S + 1, n)."""

    t: FloatArray
    y: FloatArray


class Flips(NamedTuple):
    """The flips of a solution (E,), in chronological order.

    `row` is the number of the time in `Steps` at which a flip is. `counts` is 1 for
    those that are events of the user's, who is told `told_guard` and `told_direction`.
    """

    row: IntArray
    guard: IntArray
    direction: IntArray
    counts: IntArray
    told_guard: IntArray
    told_direction: IntArray
    before: FloatArray
    after: FloatArray


class Replayed(NamedTuple):
    """Mode (E + 1, m) and parameters (E + 1, p) at the start and after each flip."""

    mode: IntArray
    params: FloatArray


class Tableau(NamedTuple):
    """Coefficients of an explicit method: a (s, s), b (s,), c (s,)."""

    a: FloatArray
    b: FloatArray
    c: FloatArray


class Tolerance(NamedTuple):
    """Relative tolerance, (1,), and absolute one of each state, (n,)."""

    relative: FloatArray
    absolute: FloatArray


class Room(NamedTuple):
    """Memory of the backward pass.

    A tape with its adjoint; rows of traced numbers, as pairs of the same memory as
    floats and as integers; and rows of plain numbers.
    """

    tape: FloatArray
    links: IntArray  # the tape as integers
    adjoint: FloatArray  # of each place, and n + 2 that are not on the tape
    full: IntArray  # (1,), 1 once the tape was too short
    y: FloatArray  # states, (n, CELLS)
    other: FloatArray  # states, (n, CELLS)
    dy: FloatArray  # rates of the states, (n, CELLS)
    params: FloatArray  # (p, CELLS)
    changed: FloatArray  # parameters that a handler may change, (p, CELLS)
    h: FloatArray  # guards, (n_guards, CELLS)
    hdot: FloatArray  # their rates, (n_guards, CELLS)
    one: FloatArray  # the time, and a result, (2, CELLS)
    slopes: FloatArray  # slopes of the stages, (s, n)
    parts: FloatArray  # adjoints of the stages' states, (s, n)
    places: IntArray  # places of the stages' slopes, (s, n)
    bounds: IntArray  # first and last place of each stage, (s, 2)
    kept: FloatArray  # adjoint of the parameters meanwhile, (p,)
    mode: IntArray  # (m,)
    lock: IntArray  # the mode with a guard's new lock, (m,)
    limits: FloatArray  # first and last time that the field sees, (2,)
    losses: FloatArray  # derivatives by the states before and after an event, (2, n)
    rows: FloatArray  # plain numbers, (6, n), and what each holds:


F_BEFORE, F_AFTER, GRADIENT, AHEAD, PLAIN, ADJOINT = range(6)


# The tape: inputs, records, and the way back.


@kernel
def fill(vector: FloatArray, value: float) -> None:
    """Set all entries."""
    for i in range(len(vector)):
        vector[i] = value


@kernel
def rewind(room: Room, p: int) -> int:
    """Forget all but the parameters; return the first free place."""
    if room.links[0] > room.links[1]:
        room.full[0] = 1
    room.links[0] = 1 + p
    return 1 + p


@kernel
def begin(room: Room, params: FloatArray) -> None:
    """Empty the tape, and put the parameters on its first places."""
    p = len(params)
    room.links[1] = len(room.adjoint) - room.rows.shape[1] - 2
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
    place = room.links[0]
    room.links[0] = place + 1
    cells = int_table(row.ctypes.data, CELLS)
    row[i, 0] = value
    cells[i, 1] = 0
    cells[i, 2] = room.tape.ctypes.data
    if place >= room.links[1]:
        return room.links[1]
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
    first = min(room.links[0], room.links[1])
    for i in range(count):
        put(room, row, i, values[i])
    return first


@kernel
def is_full(room: Room) -> bool:
    """Return whether the tape was too short for what was recorded."""
    return room.full[0] != 0 or room.links[0] > room.links[1]


@kernel_apart
def clear(room: Room, first: int) -> None:
    """Set the adjoint of the places from `first` on to zero."""
    for place in range(first, min(room.links[0], room.links[1])):
        room.adjoint[place] = 0.0


@kernel_apart
def sweep(room: Room, first: int, last: int) -> None:
    """Read the records of the places first ... last - 1 backward."""
    for place in range(min(last, room.links[1]) - 1, first - 1, -1):
        weight = room.adjoint[place]
        if weight != 0.0:
            cell = HEAD + RECORD * place
            room.adjoint[room.links[cell]] += weight * room.tape[cell + 2]
            room.adjoint[room.links[cell + 1]] += weight * room.tape[cell + 3]


@kernel
def seed(room: Room, row: FloatArray, i: int, weight: float) -> None:
    """Add to the adjoint of a traced number; a constant has none."""
    place = int_table(row.ctypes.data, CELLS)[i, 1]
    if place > 0:
        room.adjoint[place] += weight


@kernel_apart
def take_params(room: Room, p: int) -> None:
    """Take the adjoint of the parameters from the tape, and leave zeros."""
    for i in range(p):
        room.kept[i] = room.adjoint[1 + i]
        room.adjoint[1 + i] = 0.0


@kernel_apart
def give_params(room: Room, p: int, weight: float) -> None:
    """Add `weight` times the adjoint on the tape to the one that was taken."""
    for i in range(p):
        found = weight * room.adjoint[1 + i] if weight != 0.0 else 0.0
        room.adjoint[1 + i] = room.kept[i] + found


# The user's functions.


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
    """Write the field into a row of plain numbers."""
    first = room.links[0]
    field(code, room, t, y, mode)
    for i in range(len(y)):
        room.rows[row, i] = room.dy[i, 0]
    room.links[0] = first


@kernel_apart
def guards(code: Recorders, room: Room, t: float, y: FloatArray, mode: IntArray) -> int:
    """Record the guards at a state; return the place of the time.

    The places of the states follow.
    """
    moment = put(room, room.one, 0, t)
    put_all(room, room.y, y, len(y))
    call_guards(
        code.guards, room.one.ctypes.data, room.y.ctypes.data,
        room.rows[F_BEFORE].ctypes.data, mode.ctypes.data, len(mode),
        room.params.ctypes.data, len(room.params),
        room.h.ctypes.data, room.hdot.ctypes.data,
    )  # fmt: skip
    return moment


@kernel_apart
def gradient_of(
    code: Recorders, room: Room, k: int, t: float, y: FloatArray, mode: IntArray
) -> float:
    """Write guard k's derivative by the states into GRADIENT; return that by the time.

    Its derivative by the parameters is added to their adjoint.
    """
    moment = guards(code, room, t, y, mode)
    clear(room, moment)
    seed(room, room.h, k, 1.0)
    sweep(room, moment, room.links[0])
    for i in range(len(y)):
        room.rows[GRADIENT, i] = room.adjoint[moment + 1 + i]
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
    moment = put(room, room.one, 0, t)
    put_all(room, room.y, y, len(y))
    for j in range(len(room.params)):
        copy(room.params[j], room.changed[j])
    if code.handler != 0:
        call_handler(
            code.handler, room.one.ctypes.data, room.y.ctypes.data,
            mode.ctypes.data, len(mode),
            room.changed.ctypes.data, len(room.changed), k, direction,
        )  # fmt: skip
    return moment


# Forward: mode and parameters after each flip.


@kernel_apart
def replay(
    code: Recorders, room: Room, steps: Steps, flips: Flips, all_of: Replayed
) -> int:
    """Fill the modes and parameters after the first; return a status."""
    n = steps.y.shape[1]
    for e in range(len(flips.row)):
        begin(room, all_of.params[e])
        mode = all_of.mode[e + 1]
        copy(all_of.mode[e], mode)
        k = flips.guard[e]
        mode[k] = flips.direction[e]
        copy(all_of.params[e], all_of.params[e + 1])
        if flips.counts[e] == 0:
            continue
        t = steps.t[flips.row[e]]
        handler(code, room, t, flips.before[e], mode, k, flips.direction[e])
        if is_full(room):
            return TAPE_FULL
        for i in range(n):
            off = abs(room.y[i, 0] - flips.after[e, i])
            if not off <= SAME * (abs(flips.after[e, i]) + abs(flips.before[e, i])):
                return NOT_REPEATED
        for j in range(len(room.changed)):
            all_of.params[e + 1, j] = room.changed[j, 0]
    return at.RUNNING


# Backward: a step.


@kernel_apart
def record_stages(
    code: Recorders,
    room: Room,
    method: Tableau,
    t: float,
    dt: float,
    y: FloatArray,
    mode: IntArray,
) -> None:
    """Record the stages of a step, one after the other."""
    n = len(y)
    state = room.rows[PLAIN]
    places = int_table(room.dy.ctypes.data, CELLS)
    for k in range(len(method.b)):
        for i in range(n):
            total = 0.0
            for j in range(k):
                total += method.a[k, j] * room.slopes[j, i]
            state[i] = y[i] + dt * total
        room.bounds[k, 0] = room.links[0]
        field(code, room, t + method.c[k] * dt, state, mode)
        room.bounds[k, 1] = room.links[0]
        for i in range(n):
            room.slopes[k, i] = room.dy[i, 0]
            room.places[k, i] = places[i, 1]


@kernel_apart
def sweep_stages(room: Room, method: Tableau, dt: float, n: int) -> None:
    """Read the stages of a step backward, and carry the adjoint to its start."""
    adjoint = room.rows[ADJOINT]
    n_stages = len(method.b)
    for k in range(n_stages - 1, -1, -1):
        begins = room.bounds[k, 0]
        for i in range(n):
            weight = method.b[k] * adjoint[i]
            for j in range(k + 1, n_stages):
                weight += method.a[j, k] * room.parts[j, i]
            if room.places[k, i] > 0:
                room.adjoint[room.places[k, i]] += dt * weight
        sweep(room, begins + n, room.bounds[k, 1])
        for i in range(n):
            room.parts[k, i] = room.adjoint[begins + i]
    for k in range(n_stages):
        for i in range(n):
            adjoint[i] += room.parts[k, i]


@kernel
def step_back(
    code: Recorders,
    room: Room,
    method: Tableau,
    t: float,
    dt: float,
    y: FloatArray,
    mode: IntArray,
) -> bool:
    """Carry the adjoint from the end of a step to its start; False if it was in vain.

    It is in vain if the tape is too short.
    """
    first = rewind(room, len(room.params))
    record_stages(code, room, method, t, dt, y, mode)
    if is_full(room):
        return False
    clear(room, first)
    sweep_stages(room, method, dt, len(y))
    return True


# Backward: an instant.


@kernel_apart
def reset_back(
    code: Recorders,
    room: Room,
    t: float,
    y: FloatArray,
    mode: IntArray,
    k: int,
    direction: int,
) -> float:
    """Carry the adjoint of states and parameters to before a handler.

    Returns the derivative by the handler's time.
    """
    p = len(room.params)
    adjoint = room.rows[ADJOINT]
    rewind(room, p)
    copy(mode, room.mode)
    moment = handler(code, room, t, y, room.mode, k, direction)
    clear(room, moment)
    take_params(room, p)
    for j in range(p):
        seed(room, room.changed, j, room.kept[j])
    for i in range(len(y)):
        seed(room, room.y, i, adjoint[i])
    sweep(room, moment, room.links[0])
    for i in range(len(y)):
        adjoint[i] = room.adjoint[moment + 1 + i]
    return room.adjoint[moment]


@kernel_apart
def lose_at_event(
    code: Recorders,
    room: Room,
    t: float,
    flips: Flips,
    e: int,
    shown: int,
    parts: FloatArray,
) -> tuple[float, float]:
    """Differentiate the loss of an event by the states before and after it.

    The derivatives are written into the two rows of `parts`. Returns the value of the
    loss, and its derivative by the event's time.
    """
    for i in range(parts.shape[1]):
        parts[0, i] = 0.0
        parts[1, i] = 0.0
    if code.at_event == 0 or flips.counts[e] == 0:
        return 0.0, 0.0
    rewind(room, len(room.params))
    moment = put(room, room.one, 0, t)
    before = put_all(room, room.y, flips.before[e], shown)
    after = put_all(room, room.other, flips.after[e], shown)
    call_at_event(
        code.at_event, room.one.ctypes.data, room.y.ctypes.data,
        room.other.ctypes.data, flips.told_guard[e], flips.told_direction[e],
        room.params.ctypes.data, len(room.params), room.one[1].ctypes.data,
    )  # fmt: skip
    clear(room, moment)
    seed(room, room.one, 1, 1.0)
    sweep(room, moment, room.links[0])
    for i in range(shown):
        parts[0, i] = room.adjoint[before + i]
        parts[1, i] = room.adjoint[after + i]
    return room.one[1, 0], room.adjoint[moment]


@kernel_apart
def has_met(
    code: Recorders,
    room: Room,
    k: int,
    t: float,
    y: FloatArray,
    mode: IntArray,
    since: float,
) -> bool:
    """Return whether guard k is at its surface, `since` s after the last event."""
    rewind(room, len(room.params))
    take_params(room, len(room.params))
    in_time = gradient_of(code, room, k, t, y, mode)
    give_params(room, len(room.params), 0.0)
    rate = in_time
    size = abs(in_time * t)
    for i in range(len(y)):
        slope = room.rows[GRADIENT, i]
        f = room.rows[F_BEFORE, i]
        rate += slope * f
        size += abs(slope) * (abs(y[i]) + since * abs(f))
    return abs(room.h[k, 0]) <= MET * since * abs(rate) + ROUNDED * size


@kernel_apart
def grazes(
    code: Recorders,
    room: Room,
    tolerance: Tolerance,
    k: int,
    where: tuple[float, float, float],
    y: FloatArray,
    mode: IntArray,
    rate: float,
) -> bool:
    """Return whether the rate may be zero within the uncertainty of the instant.

    `where` holds the time, the time since the last event, and the whole time span. The
    guard's derivative is in GRADIENT, and the field in F_BEFORE.
    """
    t, since, span = where
    n = len(y)
    ahead = max(LOOK * since, LEAST_LOOK * span)
    unsure = 0.0
    for i in range(n):
        allowed = tolerance.absolute[i] + tolerance.relative[0] * abs(y[i])
        unsure += abs(room.rows[GRADIENT, i]) * allowed
        room.rows[AHEAD, i] = y[i] + ahead * room.rows[F_BEFORE, i]
    rewind(room, len(room.params))
    moved = room.rows[AHEAD]
    field_value(code, room, t + ahead, moved, mode, PLAIN)
    rate_ahead = gradient_of(code, room, k, t + ahead, moved, mode)
    for i in range(n):
        rate_ahead += room.rows[GRADIENT, i] * room.rows[PLAIN, i]
    bend = abs(rate_ahead - rate) / ahead
    return not unsure / abs(rate) * bend <= 0.5 * abs(rate)


@kernel_apart
def project_back(
    code: Recorders,
    room: Room,
    tolerance: Tolerance,
    k: int,
    where: tuple[float, float, float],
    y: FloatArray,
    mode: IntArray,
    weight: float,
) -> int:
    """Carry `weight`, the derivative by a guard's instant, to state and parameters.

    Returns a status.
    """
    p = len(room.params)
    n = len(y)
    rewind(room, p)
    take_params(room, p)
    rate = gradient_of(code, room, k, where[0], y, mode)
    for i in range(n):
        rate += room.rows[GRADIENT, i] * room.rows[F_BEFORE, i]
    factor = 0.0
    if weight != 0.0:
        factor = -weight / rate
    give_params(room, p, factor)
    for i in range(n):
        room.rows[ADJOINT, i] += factor * room.rows[GRADIENT, i]
    take_params(room, p)
    grazed = grazes(code, room, tolerance, k, where, y, mode, rate)
    give_params(room, p, 0.0)
    return at.GRAZING_IN_JACOBIAN if grazed else at.RUNNING


@kernel_apart
def alone_back(  # noqa: PLR0913 (an instant: its flips, time and place)
    code: Recorders,
    room: Room,
    tolerance: Tolerance,
    flips: Flips,
    all_of: Replayed,
    of: tuple[int, int],
    where: tuple[float, float, float],
    goes_on: bool,
    instant_s: float,
    shown: int,
    found: FloatArray,
) -> int:
    """Carry the adjoint across flips of[0] ... of[1] - 1; one met its surface.

    Returns a status. `instant_s` is the derivative of the loss by the end, if the
    instant is the end. The losses of events are added to `found[0]`.
    """
    t, since, _ = where
    first, last = of
    n = flips.before.shape[1]
    adjoint = room.rows[ADJOINT]
    parts = room.losses
    weight = instant_s
    if goes_on:
        weight = 0.0
        begin(room, all_of.params[last])
        field_value(code, room, t, flips.after[last - 1], all_of.mode[last], F_AFTER)
        for i in range(n):
            weight -= adjoint[i] * room.rows[F_AFTER, i]
    for e in range(last - 1, first - 1, -1):
        begin(room, all_of.params[e])
        k = flips.guard[e]
        value, by_time = lose_at_event(code, room, t, flips, e, shown, parts)
        found[0] += value
        weight += by_time
        for i in range(n):
            adjoint[i] += parts[1, i]
        if flips.counts[e] != 0:
            mode = room.lock
            copy(all_of.mode[e], mode)
            mode[k] = flips.direction[e]
            y = flips.before[e]
            weight += reset_back(code, room, t, y, mode, k, flips.direction[e])
        for i in range(n):
            adjoint[i] += parts[0, i]
    y = flips.before[first]
    mode = all_of.mode[first]
    k = flips.guard[first]
    begin(room, all_of.params[first])
    field_value(code, room, t, y, mode, F_BEFORE)
    if since == 0.0 and not has_met(code, room, k, t, y, mode, since):
        return at.RUNNING  # past its surface at the start: so are its neighbours
    for i in range(n):
        weight += adjoint[i] * room.rows[F_BEFORE, i]
    return project_back(code, room, tolerance, k, where, y, mode, weight)


@kernel
def same(one: FloatArray, other: FloatArray) -> bool:
    """Return whether two rows hold the same numbers."""
    differ = 0
    for i in range(len(one)):
        differ += 1 if one[i] != other[i] else 0
    return differ == 0


@kernel_apart
def is_lock_alone(
    code: Recorders, room: Room, flips: Flips, all_of: Replayed, e: int, t: float
) -> bool:
    """Return whether flip `e` changes nothing but a lock, and the field by the lock.

    The field after it is written into F_AFTER. The adjoint of the parameters passes the
    handler.
    """
    k = flips.guard[e]
    y = flips.before[e]
    if not same(y, flips.after[e]):
        return False
    lock = room.lock
    copy(all_of.mode[e], lock)
    lock[k] = flips.direction[e]
    begin(room, all_of.params[e])
    if flips.counts[e] != 0:
        copy(room.rows[ADJOINT], room.rows[AHEAD])
        reset_back(code, room, t, y, lock, k, flips.direction[e])
        if not same(room.rows[AHEAD], room.rows[ADJOINT]):
            return False
    field_value(code, room, t, y, lock, PLAIN)
    begin(room, all_of.params[e + 1])
    field_value(code, room, t, y, all_of.mode[e + 1], F_AFTER)
    return same(room.rows[PLAIN], room.rows[F_AFTER])


@kernel_apart
def together_back(  # noqa: PLR0913 (an instant: its flips, time and place)
    code: Recorders,
    room: Room,
    tolerance: Tolerance,
    flips: Flips,
    all_of: Replayed,
    of: tuple[int, int],
    where: tuple[float, float, float],
    shown: int,
    found: FloatArray,
) -> int:
    """Carry the adjoint across flips of guards that met their surfaces together.

    Returns a status.
    """
    t = where[0]
    n = flips.before.shape[1]
    adjoint = room.rows[ADJOINT]
    parts = room.losses
    for e in range(of[1] - 1, of[0] - 1, -1):
        y = flips.before[e]
        begin(room, all_of.params[e])
        value, weight = lose_at_event(code, room, t, flips, e, shown, parts)
        found[0] += value
        if not is_lock_alone(code, room, flips, all_of, e, t):
            return at.TIE_IN_JACOBIAN
        begin(room, all_of.params[e])
        if turns_back(code, room, flips, of, e, where, all_of):
            return at.TIE_IN_JACOBIAN
        field_value(code, room, t, y, all_of.mode[e], F_BEFORE)
        for i in range(n):
            jump = room.rows[F_BEFORE, i] - room.rows[F_AFTER, i]
            at_event = parts[0, i] + parts[1, i]
            weight += adjoint[i] * jump + at_event * room.rows[F_BEFORE, i]
            adjoint[i] += at_event
        mode = all_of.mode[e]
        k = flips.guard[e]
        status = project_back(code, room, tolerance, k, where, y, mode, weight)
        if status != at.RUNNING:
            return status
    return at.RUNNING


@kernel_apart
def turns_back(
    code: Recorders,
    room: Room,
    flips: Flips,
    of: tuple[int, int],
    e: int,
    where: tuple[float, float, float],
    all_of: Replayed,
) -> bool:
    """Return whether flip `e` turns back its own guard or one that flips after it."""
    t = where[0]
    y = flips.before[e]
    for i in range(len(y)):
        room.rows[F_BEFORE, i] = room.rows[F_AFTER, i]
    p = len(room.params)
    turned = False
    take_params(room, p)
    for other in range(e, of[1]):
        k = flips.guard[other]
        rewind(room, p)
        rate = gradient_of(code, room, k, t, y, all_of.mode[e + 1])
        for i in range(len(y)):
            rate += room.rows[GRADIENT, i] * room.rows[F_BEFORE, i]
        turned = turned or not rate * flips.direction[other] > 0.0
    give_params(room, p, 0.0)
    return turned


@kernel_apart
def n_met(
    code: Recorders,
    room: Room,
    flips: Flips,
    all_of: Replayed,
    of: tuple[int, int],
    where: tuple[float, float, float],
) -> int:
    """Return how many guards met their surfaces at an instant."""
    t, since, _ = where
    first, last = of
    y = flips.before[first]
    mode = all_of.mode[first]
    begin(room, all_of.params[first])
    field_value(code, room, t, y, mode, F_BEFORE)
    total = 1
    for e in range(first + 1, last):
        k = flips.guard[e]
        again = False
        for other in range(first, e):
            again = again or flips.guard[other] == k
        if not again and has_met(code, room, k, t, y, mode, since):
            total += 1
    return total


# Backward: a known instant.


@kernel
def set_limits(room: Room, first: float, last: float) -> None:
    """Let the field see times from `first` to `last` only."""
    room.limits[0] = first
    room.limits[1] = last


@kernel
def is_declared(timed: Timed, t: float) -> bool:
    """Return whether an instant is declared at time t."""
    declared = False
    for one in timed.declared:
        declared = declared or abs(one - t) <= timed.margin[0]
    return declared


@kernel_apart
def jump_at(
    timed: Timed, span: float, t: float, y: FloatArray, mode: IntArray, p: FloatArray
) -> int:
    """Return what the field's code tells of a jump at time t; -1 if there is none.

    How it moves with the parameters is written into `timed.moves`.
    """
    n = len(timed.moves) - len(p)
    states = timed.rows[0]
    for i in range(n):
        states[i] = y[i]
    for j in range(len(p)):
        states[n + j] = p[j]
    margin = timed.margin[0]
    jump = moving.Jump(
        timed.code[0], t - margin, t + margin, max(abs(t), span),
        timed.rows.ctypes.data, n + len(p), n,
        mode.ctypes.data, len(mode), p.ctypes.data, 0, timed.told.ctypes.data,
    )  # fmt: skip
    found = moving.movements(jump, states.ctypes.data, timed.moves.ctypes.data)
    if found == moving.NONE and not is_declared(timed, t):
        return -1
    return found


@kernel_apart
def end_back(
    code: Recorders,
    room: Room,
    timed: Timed,
    jump: int,
    where: tuple[float, bool, bool],
    y: FloatArray,
    mode: IntArray,
) -> int:
    """Go back from after an end of a step to before the jump there, if there is one.

    `where` holds the time, and whether it is the start or the end of the run. Returns a
    status. Afterwards, the field sees the times before the jump.
    """
    t, is_start, is_end = where
    set_limits(room, -inf, inf)
    if jump < 0:
        return at.RUNNING
    set_limits(room, -inf, t - timed.margin[0])
    if is_end:
        return at.RUNNING
    status = jump_back(code, room, timed, jump, t, y, mode, is_start)
    if is_full(room):
        return TAPE_FULL
    return status


@kernel_apart
def jump_back(
    code: Recorders,
    room: Room,
    timed: Timed,
    found: int,
    t: float,
    y: FloatArray,
    mode: IntArray,
    is_start: bool,
) -> int:
    """Carry the adjoint across a jump of the field in time; return a status.

    Afterwards, the field sees the times before the jump.
    """
    n = len(y)
    p = len(room.params)
    margin = timed.margin[0]
    set_limits(room, t + margin, inf)
    field_value(code, room, t, y, mode, F_AFTER)
    set_limits(room, -inf, t - margin)
    field_value(code, room, t, y, mode, F_BEFORE)
    size = 0.0
    change = 0.0
    weight = 0.0
    for i in range(n):
        before = room.rows[F_BEFORE, i]
        after = room.rows[F_AFTER, i]
        size = max(size, abs(before), abs(after))
        change = max(change, abs(after - before))
        weight += room.rows[ADJOINT, i] * (before - after)
    if not change > NO_JUMP * size:
        return at.RUNNING
    if found == moving.DIFFERENT:
        return at.INSTANTS_IN_JACOBIAN
    if found != moving.TOLD:
        timed.held[0] += 1
        return at.RUNNING
    moves = False
    first = len(timed.moves) - p
    for j in range(p):
        one = timed.moves[first + j]
        moves = moves or abs(one * room.params[j, 0]) > margin
        room.adjoint[1 + j] += weight * one
    if is_start and moves:
        return at.INSTANTS_IN_JACOBIAN
    return at.RUNNING


# The whole pass.


@kernel_apart
def lose_at_end(
    code: Recorders, room: Room, t: float, y: FloatArray, shown: int
) -> tuple[float, float]:
    """Begin the adjoint with the loss at the end.

    Returns its value, and its derivative by the time.
    """
    if code.at_end == 0:
        return 0.0, 0.0
    moment = put(room, room.one, 0, t)
    states = put_all(room, room.y, y, shown)
    call_at_end(
        code.at_end, room.one.ctypes.data, room.y.ctypes.data,
        room.params.ctypes.data, len(room.params), room.one[1].ctypes.data,
    )  # fmt: skip
    clear(room, moment)
    seed(room, room.one, 1, 1.0)
    sweep(room, moment, room.links[0])
    for i in range(shown):
        room.rows[ADJOINT, i] = room.adjoint[states + i]
    return room.one[1, 0], room.adjoint[moment]


@kernel
def first_of_instant(flips: Flips, last: int) -> int:
    """Return the number of the first flip at the instant of flip `last` - 1."""
    first = last - 1
    while first > 0 and flips.row[first - 1] == flips.row[last - 1]:
        first -= 1
    return first


@kernel_apart
def instant_back(  # noqa: PLR0913 (an instant: its flips, time and place)
    code: Recorders,
    room: Room,
    tolerance: Tolerance,
    steps: Steps,
    flips: Flips,
    all_of: Replayed,
    of: tuple[int, int],
    at_end: tuple[bool, float],
    shown: int,
    found: FloatArray,
) -> int:
    """Carry the adjoint across an instant; return a status.

    `at_end` says whether it ends the integration, and holds the derivative of the loss
    by the end's time.
    """
    ends, by_end = at_end
    row = flips.row[of[0]]
    before = 0
    if of[0] > 0:
        before = flips.row[of[0] - 1]
    span = steps.t[len(steps.t) - 1] - steps.t[0]
    where = (steps.t[row], steps.t[row] - steps.t[before], span)
    together = False
    if of[1] - of[0] > 1:
        together = n_met(code, room, flips, all_of, of, where) > 1
    if together and ends:
        status = at.TIE_IN_JACOBIAN
    elif together:
        status = together_back(
            code, room, tolerance, flips, all_of, of, where, shown, found
        )
    else:
        status = alone_back(
            code, room, tolerance, flips, all_of, of, where, not ends, by_end, shown,
            found,
        )  # fmt: skip
    if is_full(room):
        return TAPE_FULL
    return status


@kernel_apart
def write_found(room: Room, p: int, found: FloatArray) -> int:
    """Write the gradient after the loss; return a status."""
    n = room.rows.shape[1]
    for i in range(n):
        found[1 + i] = room.rows[ADJOINT, i]
    for j in range(p):
        found[1 + n + j] = room.adjoint[1 + j]
    for one in found:
        if not abs(one) < inf:
            return at.JACOBIAN_NOT_FINITE
    return at.RUNNING


def backward(  # noqa: PLR0913 (the parts of a solution)
    code: Recorders,
    room: Room,
    method: Tableau,
    tolerance: Tolerance,
    steps: Steps,
    flips: Flips,
    all_of: Replayed,
    timed: Timed,
    shown: int,
    ended_by_event: bool,
    found: FloatArray,
) -> int:
    """Fill in the gradient; return a status.

    `found` (1 + n + p,) receives the loss, and its derivatives by the initial state and
    by the parameters. The last state is an integral along the way, if there are more
    states than the `shown` ones.
    """
    room.full[0] = 0
    room.links[0] = 0
    room.links[1] = 0
    status = replay(code, room, steps, flips, all_of)
    if status != at.RUNNING:
        return status
    last = len(flips.row)
    row = len(steps.t) - 1
    fill(room.rows[ADJOINT], 0.0)
    fill(room.adjoint, 0.0)
    begin(room, all_of.params[last])
    found[0], by_end = lose_at_end(code, room, steps.t[row], steps.y[row], shown)
    if is_full(room):
        return TAPE_FULL
    if steps.y.shape[1] > shown:
        found[0] += steps.y[row, shown]
        room.rows[ADJOINT, shown] += 1.0
    ends = ended_by_event
    timed.held[0] = 0
    span = steps.t[row] - steps.t[0]
    end = row
    jump = jump_at(
        timed, span, steps.t[row], steps.y[row], all_of.mode[last], all_of.params[last]
    )
    while row >= 0:
        t = steps.t[row]
        where = (t, row == 0, row == end)
        y = steps.y[row]
        status = end_back(code, room, timed, jump, where, y, all_of.mode[last])
        if status != at.RUNNING:
            return status
        if last > 0 and flips.row[last - 1] == row:
            first = first_of_instant(flips, last)
            status = instant_back(
                code, room, tolerance, steps, flips, all_of, (first, last),
                (ends, by_end), shown, found,
            )  # fmt: skip
            if status != at.RUNNING:
                return status
            last = first
            begin(room, all_of.params[last])
        ends = False
        row -= 1
        if row >= 0:
            t = steps.t[row]
            dt = steps.t[row + 1] - t
            y = steps.y[row]
            mode = all_of.mode[last]
            jump = jump_at(timed, span, t, y, mode, all_of.params[last])
            if jump >= 0:
                set_limits(room, t + timed.margin[0], room.limits[1])
            if not step_back(code, room, method, t, dt, y, mode):
                return TAPE_FULL
    return write_found(room, all_of.params.shape[1], found)


@cache
def compiled_backward() -> Callable[..., int]:
    """Return the compiled `backward`, the same for all systems."""

    def compile_it(cached: bool) -> Any:
        return njit(cache=cached, **ENTRY)(backward)

    compiled: Callable[..., int] = compiled_in_cache(
        backward, f"{own_digest()}-backward", compile_it
    )
    return compiled
