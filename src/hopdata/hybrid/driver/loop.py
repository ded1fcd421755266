"""The loop: step, look for the first flip, land on it, let it happen, go on.

`_run` keeps its whole memory in the arrays that it is given, so it can return whenever its output
arrays are full, or to let Python handle Ctrl-C, and be called again. It takes the callbacks by
address and is compiled once per install (see `callbacks` and `cache`). Arrays reach it by the desk
(see `workspace`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import njit, types

from hopdata.hybrid.compiled.cache import cache_directory
from hopdata.hybrid.compiled.digest import driver_digest
from hopdata.hybrid.compiled.kernel import kernel, kernel_in_loop
from hopdata.hybrid.compiled.views import (
    FloatTable,
    FloatVector,
    IntTable,
    IntVector,
    float_table,
    float_vector,
    int_table,
    int_vector,
    view,
)
from hopdata.hybrid.driver.firing import Log, fire_all
from hopdata.hybrid.driver.landing import end_at_first_flip
from hopdata.hybrid.driver.layout import (
    ATOL,
    CLOCK,
    COUNT_SLOTS,
    COUNTS,
    CULPRIT,
    END,
    ERROR,
    EVENT_ROWS,
    EVENTS,
    FIELD,
    FLAG_TABLE,
    FLIPS,
    GUARD_ROWS,
    GUARD_TABLE,
    GUARDS,
    H0,
    H1,
    INSTANT,
    K1,
    K7,
    LAST_LOG_ERROR,
    LOG_AFTER,
    LOG_BEFORE,
    LOG_DIRECTION,
    LOG_GUARD,
    LOG_MODE,
    LOG_TIME,
    MODE,
    NEXT_DT,
    ON_EVENT,
    RATE0,
    RATE1,
    RATE_ABOVE,
    RATE_BELOW,
    ROW_TABLE,
    ROW_TIME,
    ROWS,
    RULES,
    SAMPLE_TABLE,
    SIZE,
    SPAN,
    STATE_ROWS,
    STATE_TABLE,
    STEPS,
    WANTED,
    FloatArray,
    IntArray,
    Memory,
    T,
    Y,
)
from hopdata.hybrid.driver.output import Output, rewrite_row, sample_start, sample_step, write_row
from hopdata.hybrid.driver.prediction import remember_bend
from hopdata.hybrid.driver.problem import Problem, copy_row, fill_row, first_not_finite
from hopdata.hybrid.driver.start import settle_locks
from hopdata.hybrid.driver.stepping import LOG_ERROR_FLOOR, accepted_step, first_step
from hopdata.hybrid.driver.surface import mark_due, time_resolution
from hopdata.hybrid.status import (
    BAD_START,
    FINISHED,
    NEEDS_ROOM,
    PAUSED,
    RUNNING,
    TOO_MANY_EVENTS,
    TOO_MANY_STEPS,
)

STEPS_PER_CALL = 200_000  # then return to Python for a moment
EVENTS_PER_INSTANT = 2  # of each guard, at most


@kernel
def move_on(p: Problem, m: Memory, out: Output, dt: float) -> None:
    """Make the end of the step the start of the next, and write it down."""
    t_new = p.t_end if dt == p.t_end - m.clock[T] else m.clock[T] + dt
    sample_step(m, out, t_new, dt)
    remember_bend(m, dt, m.clock[NEXT_DT])
    m.clock[T] = t_new
    copy_row(m.states, END, Y)
    copy_row(m.states, K7, K1)
    copy_row(m.guards, H1, H0)
    copy_row(m.guards, RATE1, RATE0)
    write_row(m, out)


@kernel
def fire(p: Problem, m: Memory, out: Output, log: Log) -> int:
    """Let the events of this instant happen, and write down the state after them."""
    status = fire_all(p, m, log)
    rewrite_row(m, out)
    return status


@kernel_in_loop
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


@kernel
def clear(m: Memory, y0: FloatVector, t: float, step: float) -> bool:
    """Make the memory that of an integration from `y0`; tell whether `y0` is finite."""
    for row in range(STATE_ROWS):
        fill_row(m.states, row, 0.0)
    for row in range(GUARD_ROWS):
        fill_row(m.guards, row, 0.0)
    for k in range(m.flags.width):
        m.flags[FLIPS, k] = 0
    for slot in range(COUNT_SLOTS):
        m.counts[slot] = 0
    m.counts[CULPRIT] = -1
    m.clock[T], m.clock[NEXT_DT], m.clock[LAST_LOG_ERROR] = t, step, LOG_ERROR_FLOOR
    m.clock[INSTANT], m.clock[RATE_BELOW], m.clock[RATE_ABOVE] = -np.inf, 0.0, 0.0
    m.clock[SPAN], m.clock[ERROR] = 0.0, 0.0
    for i in range(m.states.width):
        m.states[Y, i] = y0[i]
    return first_not_finite(m.states, Y) < 0


@kernel
def start(p: Problem, m: Memory, out: Output, log: Log) -> int:
    """Settle the locks at t0, choose the first step, and fire what is past its surface already."""
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


@kernel
def lacks_room(m: Memory, out: Output, log: Log) -> bool:
    """Tell whether the next step might not find room for its output."""
    events = m.counts[EVENT_ROWS] + EVENTS_PER_INSTANT * m.guards.width
    return events > log.time.width or (out.every_step and m.counts[ROWS] >= out.time.width)


@kernel
def vector_on(desk: IntArray, slot: int) -> FloatVector:
    """Return the view of the floats whose address and width stand at a slot of the desk."""
    return float_vector(desk[slot], desk[slot + 1])


@kernel
def table_on(desk: IntArray, slot: int) -> FloatTable:
    """Return the view of a table of floats."""
    return float_table(desk[slot], desk[slot + 1])


@kernel
def int_vector_on(desk: IntArray, slot: int) -> IntVector:
    """Return the view of integers."""
    return int_vector(desk[slot], desk[slot + 1])


@kernel
def int_table_on(desk: IntArray, slot: int) -> IntTable:
    """Return the view of a table of integers."""
    return int_table(desk[slot], desk[slot + 1])


def _run(
    desk: IntArray, y0: FloatArray, params: FloatArray, t_start: float, t_end: float,
    rtol: float, max_step: float, step: float, max_steps: int, max_events: int,
    every_step: bool, resume: bool,
) -> int:  # fmt: skip
    """Integrate until something ends it, or needs room; return a status."""
    m = Memory(
        table_on(desk, STATE_TABLE), table_on(desk, GUARD_TABLE), int_table_on(desk, FLAG_TABLE),
        vector_on(desk, CLOCK), int_vector_on(desk, COUNTS),
    )  # fmt: skip
    p = Problem(
        desk[FIELD], desk[GUARDS], desk[ON_EVENT], view(params), int_vector_on(desk, MODE),
        int_table_on(desk, RULES), rtol, vector_on(desk, ATOL), max_step, t_end,
    )  # fmt: skip
    out = Output(
        vector_on(desk, WANTED), table_on(desk, SAMPLE_TABLE),
        vector_on(desk, ROW_TIME), table_on(desk, ROW_TABLE), every_step,
    )  # fmt: skip
    log = Log(
        vector_on(desk, LOG_TIME), int_vector_on(desk, LOG_GUARD),
        int_vector_on(desk, LOG_DIRECTION), table_on(desk, LOG_BEFORE), table_on(desk, LOG_AFTER),
        int_table_on(desk, LOG_MODE),
    )  # fmt: skip
    status = RUNNING
    if not resume:
        status = start(p, m, out, log) if clear(m, view(y0), t_start, step) else BAD_START
    pause = m.counts[STEPS] + STEPS_PER_CALL
    while status == RUNNING:
        if m.clock[T] >= p.t_end:
            return FINISHED
        if lacks_room(m, out, log):
            return NEEDS_ROOM
        if m.counts[STEPS] >= pause:
            return PAUSED
        if m.counts[STEPS] >= max_steps:
            return TOO_MANY_STEPS
        if m.counts[EVENTS] >= max_events:
            return TOO_MANY_EVENTS
        status = advance(p, m, out, log)
    return status


_INT, _FLOAT, _BOOL = types.int64, types.float64, types.boolean
_INTS, _FLOATS = types.int64[::1], types.float64[::1]

SIGNATURE = _INT(
    _INTS, _FLOATS, _FLOATS, _FLOAT, _FLOAT, _FLOAT, _FLOAT, _FLOAT, _INT, _INT, _BOOL, _BOOL
)


@cache
def compiled_driver() -> Callable[..., Any]:
    """Return the driver's machine code: from the cache, or compiled now (some seconds)."""
    with cache_directory(_run, driver_digest()) as cached:
        return njit(SIGNATURE, cache=cached, nogil=True, error_model="numpy")(_run)


@cache
def driver_entry() -> Callable[..., int]:
    """Return the driver without the search for a signature that fits: arguments must be exact."""
    (compiled,) = compiled_driver().overloads.values()  # type: ignore[attr-defined]
    entry: Callable[..., int] = compiled.entry_point
    return entry
