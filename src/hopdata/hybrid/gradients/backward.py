"""The backward pass: a gradient through the steps and events of a solution.

It goes through the rows of the solution from the last to the first. Each step is that
of an explicit Runge-Kutta method whose stages are recorded again from the state at its
start, and read backward (the discrete adjoint: Hager 2000, Sandu 2006). At each row it
goes back across a jump of the field in time, and then across the flips of guards.

A line belongs here if it says in which order that is done.
"""

from collections.abc import Callable
from functools import cache
from math import inf
from typing import Any

from numba import njit

from hopdata.arrays import FloatArray
from hopdata.code_cache import compiled_in_cache
from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.aloud import said_if_long
from hopdata.hybrid.compiled.kernel import ENTRY, kernel, kernel_apart
from hopdata.hybrid.gradients.instant import instant_back, instant_of
from hopdata.hybrid.gradients.jump import NO_INSTANT, end_back, jump_at, set_limits
from hopdata.hybrid.gradients.known import Known
from hopdata.hybrid.gradients.losses import lose_at_end
from hopdata.hybrid.gradients.recorders import Recorders, own_digest
from hopdata.hybrid.gradients.replay import replay
from hopdata.hybrid.gradients.step import step_back
from hopdata.hybrid.gradients.sweep import begin_tape, is_full
from hopdata.hybrid.gradients.workspace import BY_STATE, TAPE_FULL, Room, Run, Tableau


@kernel
def fill(vector: FloatArray, value: float) -> None:
    """Set all entries."""
    for i in range(len(vector)):
        vector[i] = value


@kernel_apart
def begin_at_end(code: Recorders, room: Room, run: Run, found: FloatArray) -> float:
    """Begin with the loss at the end of a run; return its derivative by the end."""
    row = len(run.steps.t) - 1
    t = run.steps.t[row]
    y = run.steps.y[row]
    fill(room.rows[BY_STATE], 0.0)
    fill(room.adjoint, 0.0)
    begin_tape(room, run.replayed.params[len(run.flips.row)])
    found[0], by_end = lose_at_end(code, room, t, y, run.n_shown)
    if len(y) > run.n_shown:  # the last state is the integral of a loss
        found[0] += y[run.n_shown]
        room.rows[BY_STATE, run.n_shown] += 1.0
    return by_end


@kernel_apart
def row_back(
    code: Recorders,
    room: Room,
    method: Tableau,
    run: Run,
    known: Known,
    row: int,
    last: int,
) -> int:
    """Go back from the next row to this one, to before a jump there; return a status.

    `last` is the number of the flip after this row. The last row has no next one.
    """
    times = run.steps.t
    end = len(times) - 1
    t = times[row]
    y = run.steps.y[row]
    mode = run.replayed.mode[last]
    params = run.replayed.params[last]
    told = jump_at(known, times[end] - times[0], t, y, mode, params)
    if row < end:
        if told != NO_INSTANT:
            set_limits(room, t + known.margin[0], room.limits[1])
        if not step_back(code, room, method, t, times[row + 1] - t, y, mode):
            return TAPE_FULL
    return end_back(code, room, known, told, (t, row == 0, row == end), y, mode)


@kernel_apart
def write_found(room: Room, p: int, found: FloatArray) -> int:
    """Write the gradient after the loss; return a status."""
    n = room.rows.shape[1]
    for i in range(n):
        found[1 + i] = room.rows[BY_STATE, i]
    for j in range(p):
        found[1 + n + j] = room.adjoint[1 + j]
    for one in found:
        if not abs(one) < inf:
            return at.JACOBIAN_NOT_FINITE
    return at.RUNNING


def backward(
    code: Recorders,
    room: Room,
    method: Tableau,
    run: Run,
    known: Known,
    found: FloatArray,
) -> int:
    """Fill in the gradient; return a status.

    `found` (1 + n + p,) receives the loss, and its derivatives by the initial state and
    by the parameters.
    """
    status = replay(code, room, run)
    if status != at.RUNNING:
        return status
    by_end = begin_at_end(code, room, run, found)
    if is_full(room):
        return TAPE_FULL
    known.n_held[0] = 0
    end = len(run.steps.t) - 1
    last = len(run.flips.row)
    for row in range(end, -1, -1):
        status = row_back(code, room, method, run, known, row, last)
        if status != at.RUNNING:
            return status
        if last > 0 and run.flips.row[last - 1] == row:
            ends = run.ended_by_event and row == end
            instant = instant_of(run, last)
            status = instant_back(code, room, run, instant, ends, by_end, found)
            if status != at.RUNNING:
                return status
            last = instant.first
            begin_tape(room, run.replayed.params[last])
    return write_found(room, len(room.params), found)


@cache
def _dispatcher() -> Any:
    def compile_it(cached: bool) -> Any:
        return njit(cache=cached, **ENTRY)(backward)

    return compiled_in_cache(backward, f"{own_digest()}-backward", compile_it)


def compiled_backward(*given: Any) -> Callable[..., int]:
    """Return `backward`, compiled for arguments such as these.

    It is the same for all systems. Compiling it is announced on stderr.
    """
    made = _dispatcher()
    if not made.signatures:
        with said_if_long("the functions of the pass backward"):
            made.compile(tuple(made.typeof_pyval(one) for one in given))
    compiled: Callable[..., int] = made
    return compiled
