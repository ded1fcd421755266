"""The loop: step, look for the first flip, land on it, let it happen, go on.

`_run` keeps its whole memory in the arrays that it is given, so it can return whenever its output
arrays are full, or to let Python handle Ctrl-C, and be called again. It takes the callbacks by
address and is compiled once per install (see `callbacks` and `cache`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from numba import njit, types

from hopdata.hybrid.cache import cache_directory
from hopdata.hybrid.digest import package_digest
from hopdata.hybrid.firing import Log, fire_all
from hopdata.hybrid.landing import end_at_first_flip
from hopdata.hybrid.layout import (
    END,
    EVENT_ROWS,
    EVENTS,
    H0,
    H1,
    K1,
    K7,
    LAST_ERROR,
    NEXT_DT,
    RATE0,
    RATE1,
    ROWS,
    SIZE,
    STARTED,
    STEPS,
    FloatArray,
    IntArray,
    Memory,
    T,
    Y,
)
from hopdata.hybrid.output import Output, rewrite_row, sample_start, sample_step, write_row
from hopdata.hybrid.problem import Problem, copy_row
from hopdata.hybrid.start import settle_locks
from hopdata.hybrid.status import (
    FINISHED,
    NEEDS_ROOM,
    RUNNING,
    TOO_MANY_EVENTS,
    TOO_MANY_STEPS,
)
from hopdata.hybrid.stepping import accepted_step, first_step
from hopdata.hybrid.surface import mark_due, time_resolution
from hopdata.hybrid.views import view

STEPS_PER_CALL = 200_000  # then return to Python for a moment
FIRST_ERROR = 1e-4
EVENTS_PER_INSTANT = 2  # of each guard, at most


@njit
def move_on(p: Problem, m: Memory, out: Output, dt: float) -> None:
    """Make the end of the step the start of the next, and write it down."""
    t_new = p.t_end if dt == p.t_end - m.clock[T] else m.clock[T] + dt
    sample_step(m, out, t_new, dt)
    m.clock[T] = t_new
    copy_row(m.states, END, Y)
    copy_row(m.states, K7, K1)
    copy_row(m.guards, H1, H0)
    copy_row(m.guards, RATE1, RATE0)
    write_row(m, out)


@njit
def fire(p: Problem, m: Memory, out: Output, log: Log) -> int:
    """Let the events of this instant happen, and write down the state after them."""
    status = fire_all(p, m, log)
    rewrite_row(m, out)
    return status


@njit
def advance(p: Problem, m: Memory, out: Output, log: Log) -> int:
    """Take one step, to its end or to the first flip in it, and let the flips happen."""
    dt = accepted_step(p, m)
    if dt < 0.0:
        return int(dt)
    dt, n_due = end_at_first_flip(p, m, dt)
    if dt > 0.0:
        move_on(p, m, out, dt)
    if n_due > 0:
        return fire(p, m, out, log)
    return RUNNING


@njit
def start(p: Problem, m: Memory, out: Output, log: Log) -> int:
    """Settle the locks at t0, choose the first step, and fire what is past its surface already."""
    m.counts[STARTED] = 1
    m.clock[LAST_ERROR] = FIRST_ERROR
    status = settle_locks(p, m)
    if status != RUNNING:
        return status
    if not m.clock[NEXT_DT] > 0.0:
        m.clock[NEXT_DT] = first_step(p, m)
    sample_start(m, out)
    write_row(m, out)
    for k in range(m.guards.width):
        m.guards[SIZE, k] = abs(m.guards[H0, k])
    if mark_due(p, m, H0, RATE0, time_resolution(m.clock[T], 0.0)) > 0:
        status = fire(p, m, out, log)
    return status


@njit
def lacks_room(m: Memory, out: Output, log: Log) -> bool:
    """Tell whether the next step might not find room for its output."""
    events = m.counts[EVENT_ROWS] + EVENTS_PER_INSTANT * m.guards.width
    return events > log.time.width or (out.every_step and m.counts[ROWS] >= out.time.width)


def _run(
    field: int, guards: int, on_event: int, params: FloatArray, mode: IntArray, rules: IntArray,
    rtol: float, atol: FloatArray, max_step: float, t_end: float,
    max_steps: int, max_events: int, every_step: bool,
    states: FloatArray, guard_rows: FloatArray, flags: IntArray,
    clock: FloatArray, counts: IntArray,
    wanted: FloatArray, samples: FloatArray, time: FloatArray, rows: FloatArray,
    log_time: FloatArray, log_guard: IntArray, log_direction: IntArray,
    log_before: FloatArray, log_after: FloatArray, log_mode: IntArray,
) -> int:  # fmt: skip
    """Integrate until something ends it, or needs room; return a status."""
    p = Problem(
        field, guards, on_event, view(params), view(mode), view(rules),
        rtol, view(atol), max_step, t_end,
    )  # fmt: skip
    m = Memory(view(states), view(guard_rows), view(flags), view(clock), view(counts))
    out = Output(view(wanted), view(samples), view(time), view(rows), every_step)
    log = Log(
        view(log_time), view(log_guard), view(log_direction),
        view(log_before), view(log_after), view(log_mode),
    )  # fmt: skip
    pause = m.counts[STEPS] + STEPS_PER_CALL
    status = RUNNING if m.counts[STARTED] else start(p, m, out, log)
    while status == RUNNING:
        if m.clock[T] >= p.t_end:
            return FINISHED
        if lacks_room(m, out, log) or m.counts[STEPS] >= pause:
            return NEEDS_ROOM
        if m.counts[STEPS] >= max_steps:
            return TOO_MANY_STEPS
        if m.counts[EVENTS] >= max_events:
            return TOO_MANY_EVENTS
        status = advance(p, m, out, log)
    return status


_INT, _FLOAT, _BOOL = types.int64, types.float64, types.boolean
_INTS, _FLOATS = types.int64[::1], types.float64[::1]
_INT_TABLE, _FLOAT_TABLE = types.int64[:, ::1], types.float64[:, ::1]

SIGNATURE = _INT(
    _INT, _INT, _INT, _FLOATS, _INTS, _INT_TABLE, _FLOAT, _FLOATS, _FLOAT, _FLOAT,
    _INT, _INT, _BOOL,
    _FLOAT_TABLE, _FLOAT_TABLE, _INT_TABLE, _FLOATS, _INTS,
    _FLOATS, _FLOAT_TABLE, _FLOATS, _FLOAT_TABLE,
    _FLOATS, _INTS, _INTS, _FLOAT_TABLE, _FLOAT_TABLE, _INT_TABLE,
)  # fmt: skip


@cache
def compiled_driver() -> Callable[..., Any]:
    """Return the driver's machine code: from the cache, or compiled now (some seconds)."""
    with cache_directory(_run, package_digest()) as cached:
        compiled: Callable[..., Any] = njit(SIGNATURE, cache=cached, nogil=True)(_run)
    return compiled
