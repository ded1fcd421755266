"""The loop: step, look for the first flip, land on it, let it happen, go on.

`run` keeps its whole memory in the arrays that it is given, so it can return whenever its output
arrays are full, or to let Python handle Ctrl-C, and be called again. It takes the callbacks by
address and is compiled once per install (see `compiled`). Arrays reach it by the desk (see
`workspace`).
"""

from __future__ import annotations

import numpy as np

from hopdata.hybrid.compiled.kernel import kernel, kernel_apart, kernel_in_loop
from hopdata.hybrid.compiled.views import IntVector
from hopdata.hybrid.driver.choice import choose_after_event, choose_after_step, first_method
from hopdata.hybrid.driver.desk import desk_log, desk_memory, desk_output, desk_problem
from hopdata.hybrid.driver.firing import Log, fire_all
from hopdata.hybrid.driver.first_flip import end_at_first_flip
from hopdata.hybrid.driver.layout import (
    AWAKE,
    BENT,
    CLOCK_SLOTS,
    COUNT_SLOTS,
    CULPRIT,
    END,
    EVENT_ROWS,
    EVENTS,
    GIVEN_MODE,
    GUARD_ROWS,
    H0,
    INSTANT,
    K1,
    KEND,
    LAST_FLIP,
    LAST_LOG_ERROR,
    METHOD,
    MOTION,
    N_AWAKE,
    NEXT_DT,
    RATE0,
    REJECTED,
    RESUMED,
    ROWS,
    SEGMENT,
    SIZE,
    STEP,
    STEPS,
    WINDOW,
    Memory,
    T,
    Y,
)
from hopdata.hybrid.driver.linear import carry_jacobian
from hopdata.hybrid.driver.near import gather_reached
from hopdata.hybrid.driver.output import Output, rewrite_row, sample_start, sample_step, write_row
from hopdata.hybrid.driver.prediction import carry_guards
from hopdata.hybrid.driver.problem import Problem, copy_row, fill_row, first_not_finite
from hopdata.hybrid.driver.sleep import travel_on
from hopdata.hybrid.driver.start import settle_locks
from hopdata.hybrid.driver.stepping import (
    LOG_ERROR_FLOOR,
    STEP_FLOOR,
    accepted_step,
    first_step,
)
from hopdata.hybrid.driver.surface import mark_due, time_resolution
from hopdata.hybrid.driver.watch import LONGEST, measure, watched
from hopdata.hybrid.status import (
    BAD_START,
    FINISHED,
    JACOBIAN_NOT_FINITE,
    NEEDS_METHOD,
    NEEDS_ROOM,
    PAUSED,
    RUNNING,
    STEP_UNDERFLOW,
    TOO_MANY_EVENTS,
    TOO_MANY_STEPS,
)

STEPS_PER_CALL = 200_000  # then return to Python for a moment
EVENTS_PER_INSTANT = 2  # of each guard, at most


@kernel
def move_on(p: Problem, m: Memory, out: Output, dt: float) -> None:
    """Make the end of the step the start of the next, and write it down."""
    t_new = p.t_end if dt >= p.t_end - m.clock[T] else m.clock[T] + dt
    sample_step(p, m, out, t_new, dt)
    carry_guards(p, m, dt)
    travel_on(p, m, dt)
    m.clock[T] = t_new
    copy_row(m.states, END, Y)
    copy_row(m.states, KEND, K1)
    write_row(m, out)


@kernel_apart
def fire(p: Problem, m: Memory, out: Output, log: Log) -> int:
    """Let the events of this instant happen, and write down the state after them."""
    status = fire_all(p, m, log)
    rewrite_row(m, out)
    choose_after_event(p, m)
    return status


@kernel
def retry(m: Memory, shrink: float) -> int:
    """Return how it goes on, if the Jacobian asks for a shorter step."""
    if not shrink > 0.0:
        return JACOBIAN_NOT_FINITE
    too_short = m.clock[NEXT_DT] <= STEP_FLOOR * abs(m.clock[T])
    return STEP_UNDERFLOW if too_short else RUNNING


@kernel_in_loop
def advance(p: Problem, m: Memory, out: Output, log: Log) -> int:
    """Take one step, to its end or to the first flip in it, and let the flips happen."""
    dt = accepted_step(p, m)
    if dt < 0.0:
        return int(dt)
    dt = watched(p, m, dt)
    if dt < 0.0:
        return int(dt)
    dt, n_due = end_at_first_flip(p, m, dt)
    if dt > 0.0:
        if p.first_order:
            shrink = carry_jacobian(p, m, dt)
            if not shrink >= 1.0:
                m.clock[NEXT_DT] = shrink * dt
                m.counts[REJECTED] += 1
                return retry(m, shrink)
        move_on(p, m, out, dt)
    if n_due > 0:
        return fire(p, m, out, log)
    choose_after_step(p, m)
    return RUNNING


@kernel_apart
def clear(p: Problem, m: Memory) -> bool:
    """Make the memory that of an integration from the start; tell whether that is finite."""
    for row in range(GUARD_ROWS):
        fill_row(m.guards, row, 0.0)
    for k in range(m.flags.width):
        m.flags[LAST_FLIP, k], m.flags[BENT, k] = 0, 0
        m.lists[AWAKE, k] = k
    for slot in range(COUNT_SLOTS):
        m.counts[slot] = 0
    m.counts[CULPRIT], m.counts[N_AWAKE] = -1, m.flags.width
    for slot in range(CLOCK_SLOTS):
        m.clock[slot] = 0.0
    m.clock[T], m.clock[SEGMENT], m.clock[INSTANT] = p.t_start, p.t_start, -np.inf
    m.clock[MOTION], m.clock[WINDOW] = np.inf, LONGEST * (p.t_end - p.t_start)
    m.clock[NEXT_DT], m.clock[LAST_LOG_ERROR] = p.first_step, LOG_ERROR_FLOOR
    for i in range(m.states.width):
        m.states[Y, i] = p.start_state[i]
    return first_not_finite(m.states, Y) < 0


@kernel_apart
def start(p: Problem, m: Memory, out: Output, log: Log) -> int:
    """Settle the locks at t0, choose the first step, and fire what is past its surface already."""
    m.counts[METHOD] = first_method(p)
    status = settle_locks(p, m)
    if status != RUNNING:
        return status
    if not m.clock[NEXT_DT] > 0.0:
        m.clock[NEXT_DT] = first_step(p, m)
    measure(p, m)
    sample_start(m, out)
    write_row(m, out)
    for k in range(m.guards.width):
        m.guards[SIZE, k] = abs(m.guards[H0, k])
    resolution = time_resolution(m.clock[T], 0.0)
    gather_reached(p, m, H0, RATE0, resolution)
    if mark_due(p, m, H0, RATE0, resolution) > 0:
        status = fire(p, m, out, log)
    return status


@kernel
def lacks_room(m: Memory, out: Output, log: Log) -> bool:
    """Tell whether the next step might not find room for its output."""
    events = m.counts[EVENT_ROWS] + EVENTS_PER_INSTANT * m.guards.width
    return events > log.n_rows or (out.every_step and m.counts[ROWS] >= out.n_rows)


@kernel
def run(desk: IntVector, flags: int) -> int:
    """Integrate until something ends it, or needs room; return a status."""
    p, m, out, log = desk_problem(desk), desk_memory(desk), desk_output(desk), desk_log(desk)
    status = RUNNING
    if flags & RESUMED == 0:
        for k in range(p.mode.width if flags & GIVEN_MODE == 0 else 0):
            p.mode[k] = 0
        status = start(p, m, out, log) if clear(p, m) else BAD_START
    pause = m.counts[STEPS] + STEPS_PER_CALL
    while status == RUNNING:
        if m.clock[T] >= p.t_end:
            return FINISHED
        if lacks_room(m, out, log):
            return NEEDS_ROOM
        if p.methods[m.counts[METHOD], STEP] == 0:
            return NEEDS_METHOD
        if m.counts[STEPS] >= pause:
            return PAUSED
        if m.counts[STEPS] >= p.max_steps:
            return TOO_MANY_STEPS
        if m.counts[EVENTS] >= p.max_events:
            return TOO_MANY_EVENTS
        status = advance(p, m, out, log)
    return status
