"""The loop: step, look for the first flip, land on it, process it, continue.

`run` keeps all its memory in the arrays it is given. It can therefore return whenever
the output arrays are full or Python should handle Ctrl-C, and be called again. It takes
the callbacks by address and is compiled once per install (see `compiled`). It receives
arrays through the desk (see `workspace`).
"""

import sys
import time
from collections.abc import Callable
from functools import cache, partial
from math import inf
from pathlib import Path
from typing import Any

from numba import cfunc, config, njit, types

from hopdata.arrays import FloatArray, IntArray
from hopdata.code_cache import compiled_in_cache
from hopdata.hybrid import layout as at
from hopdata.hybrid.arguments import SMALLEST_RTOL
from hopdata.hybrid.compiled import kernel as code
from hopdata.hybrid.compiled import memory
from hopdata.hybrid.compiled.digest import driver_digest
from hopdata.hybrid.compiled.kernel import copy, kernel, kernel_apart, kernel_in_loop
from hopdata.hybrid.compiled.memory import FloatVector, IntVector, address_of, view
from hopdata.hybrid.driver import dense, jacobian, problem, stepping
from hopdata.hybrid.driver.branches import AT_BRANCH, MOST_BARREN, end_at_branch
from hopdata.hybrid.driver.end_step import end_at_first_flip
from hopdata.hybrid.driver.instant import fire_all, settle_locks
from hopdata.hybrid.driver.log import Log, forget_mode
from hopdata.hybrid.driver.sleep import travel_on
from hopdata.hybrid.driver.watch import carry_guards, gather_reached
from hopdata.hybrid.driver.windows import LONGEST, measure, watched
from hopdata.hybrid.layout import Memory

# The desk: a table of addresses where the driver finds its callbacks and arrays.

reader = partial(memory.reader, vars(at))
desk_problem = reader(
    problem.Problem, methods=at.METHOD_TABLE, tangent=at.TANGENT_TABLE
)
desk_memory = reader(
    Memory,
    states=at.STATE_TABLE,
    guards=at.GUARD_TABLE,
    flags=at.FLAG_TABLE,
    lists=at.LIST_TABLE,
)
desk_output = reader(
    dense.Output, samples=at.SAMPLE_TABLE, rows=at.ROW_TABLE, per_step=at.ROWS_PER_STEP
)
desk_log = reader(
    Log,
    floats=at.LOG_TABLE,
    integers=at.LOG_TABLE,
    n_rows=at.N_LOG_ROWS,
    changes=at.CHANGE_TABLE,
)


@kernel
def move_on(p: problem.Problem, m: Memory, out: dense.Output, dt: float) -> None:
    """Make the end of the step the start of the next, and record it."""
    t_new = p.t_end if dt >= p.t_end - m.clock[at.T] else m.clock[at.T] + dt
    dense.sample_step(p, m, out, t_new, dt)
    if out.per_step > 1:
        dense.write_inside(p, m, out, dt)
    carry_guards(p, m, dt)
    travel_on(p, m, dt)
    m.clock[at.T] = t_new
    problem.copy_row(m.states, at.END, m.states, at.Y)
    problem.copy_row(m.states, at.KEND, m.states, at.K1)
    dense.write_row(m, out, t_new, at.Y)


@kernel_apart
def fire(p: problem.Problem, m: Memory, out: dense.Output, log: Log) -> int:
    """Process the events of this instant, and record the state after them.

    If the log is full before the last of them, the instant goes on when there is room.
    """
    status = fire_all(p, m, log)
    if status == at.NEEDS_ROOM:
        dense.take_back_row(m, out)
        return status
    dense.rewrite_row(m, out)
    stepping.choose_after_event(p, m)
    return status


@kernel_in_loop
def advance(p: problem.Problem, m: Memory, out: dense.Output, log: Log) -> int:
    """Take one step, to its end or its first flip, and process the flips."""
    dt = stepping.accepted_step(p, m)
    if dt < 0.0:
        return int(dt)
    if p.branches != 0:
        dt = end_at_branch(p, m, dt)
    if p.branches == 0 or m.counts[at.WATCHED] != AT_BRANCH:
        dt = watched(p, m, dt)
    if dt < 0.0:
        return int(dt)
    dt, n_due = end_at_first_flip(p, m, dt)
    if dt > 0.0:
        if p.first_order:
            shrink = jacobian.first_order(p, jacobian.CARRY, dt, 0, 0, 0)
            if not shrink >= 1.0:  # the Jacobian requires a shorter step
                m.clock[at.NEXT_DT] = shrink * dt
                m.counts[at.REJECTED] += 1
                if not shrink > 0.0:
                    return at.JACOBIAN_NOT_FINITE
                too_short = shrink * dt <= stepping.STEP_FLOOR * abs(m.clock[at.T])
                return at.STEP_UNDERFLOW if too_short else at.RUNNING
        move_on(p, m, out, dt)
    if n_due > 0:
        if m.counts[at.BARREN] <= MOST_BARREN:
            m.counts[at.BARREN] = 0
        return fire(p, m, out, log)
    stepping.choose_after_step(p, m)
    return at.RUNNING


@kernel_apart
def clear(p: problem.Problem, m: Memory, log: Log) -> bool:
    """Reset the memory to the start of an integration; return whether the start is finite."""
    for row in range(at.GUARD_ROWS):
        problem.fill_row(m.guards, row, 0.0)
    for k in range(m.flags.width):
        m.flags[at.LAST_FLIP, k], m.flags[at.BENT, k], m.flags[at.FIRED, k] = 0, 0, 0
        m.flags[at.FLIPS, k] = 0
        m.flags[at.AT_JUMP, k] = 0
        m.flags[at.BOUNCED, k] = 0
        m.lists[at.AWAKE, k] = k
    memory.array_of(m.counts)[:] = 0
    m.counts[at.CULPRIT], m.counts[at.N_AWAKE] = -1, m.flags.width
    memory.array_of(m.clock)[:] = 0.0
    forget_mode(log)
    m.clock[at.T], m.clock[at.SEGMENT], m.clock[at.INSTANT] = p.t_start, p.t_start, -inf
    m.clock[at.MOTION], m.clock[at.WINDOW] = inf, LONGEST * (p.t_end - p.t_start)
    m.clock[at.NEXT_DT], m.clock[at.LAST_LOG_ERROR] = (
        p.first_step,
        stepping.LOG_ERROR_FLOOR,
    )
    for i in range(m.states.width):
        m.states[at.Y, i] = p.start_state[i]
        if p.first_order != 0:
            p.tangent[jacobian.single(m, at.PHI_PART), i] = 1.0
    return problem.first_not_finite(m.states, at.Y) < 0


@kernel_apart
def start(p: problem.Problem, m: Memory, out: dense.Output, log: Log) -> int:
    """Settle the locks at t0, choose the first step, and fire guards already past their surface."""
    m.counts[at.METHOD] = stepping.first_method(p)
    status = settle_locks(p, m)
    if status != at.RUNNING:
        return status
    if not m.clock[at.NEXT_DT] > 0.0:
        m.clock[at.NEXT_DT] = stepping.first_step(p, m)
    measure(p, m)
    dense.sample_start(m, out)
    dense.write_row(m, out, m.clock[at.T], at.Y)
    for k in range(m.guards.width):
        m.guards[at.SIZE, k] = abs(m.guards[at.H0, k])
    resolution = problem.time_resolution(m.clock[at.T], 0.0)
    gather_reached(p, m, at.H0, at.RATE0, resolution)
    if problem.mark_due(p, m, at.H0, at.RATE0, resolution) > 0:
        status = fire(p, m, out, log)
    return status


@kernel
def run(desk: IntVector, flags: int) -> int:
    """Integrate until the run ends or needs room, and return a status."""
    p, m, out, log = (
        desk_problem(desk),
        desk_memory(desk),
        desk_output(desk),
        desk_log(desk),
    )
    status = at.RUNNING
    if flags & at.RESUMED == 0:
        for k in range(p.mode.width if flags & at.GIVEN_MODE == 0 else 0):
            p.mode[k] = 0
        status = start(p, m, out, log) if clear(p, m, log) else at.BAD_START
    elif m.counts[at.BEGUN] != 0:
        dense.write_row(m, out, m.clock[at.T], at.Y)
        status = fire(p, m, out, log)
    pause = m.counts[at.STEPS] + desk[at.PATIENCE]  # then return to Python briefly
    while status == at.RUNNING:
        if m.clock[at.T] >= p.t_end:
            return at.FINISHED
        if m.counts[at.ROWS] + out.per_step > out.n_rows:
            return at.NEEDS_ROOM
        if p.methods[m.counts[at.METHOD], at.STEP] == 0:
            return at.NEEDS_METHOD
        if m.counts[at.STEPS] >= pause:
            return at.PAUSED
        if m.counts[at.STEPS] >= p.max_steps:
            return at.TOO_MANY_STEPS
        if m.counts[at.EVENTS] >= p.max_events:
            return at.TOO_MANY_EVENTS
        status = advance(p, m, out, log)
    return status


# Python's entry into the driver: one integration, or many in a row.
#
# The driver itself is compiled once per install, as a C function; its callers are
# small.

_INT, _FLOAT = types.int64, types.float64

RUN_NATIVE = _INT(_INT, _INT)
NOT_KEPT = "no cache folder is writable: set NUMBA_CACHE_DIR to one that is"

call_run = code.caller(RUN_NATIVE)


@kernel
def can_be_done(desk: IntVector, numbers: FloatVector) -> bool:
    """Return whether the numbers on the desk are valid; same checks as `arguments.check_numbers`.

    A relative tolerance below rounding is raised to it.
    """
    in_order = -inf < numbers[at.T_START] <= numbers[at.T_END]
    positive = (
        numbers[at.MAX_STEP] > 0.0
        and desk[at.MAX_STEPS] >= 1
        and desk[at.MAX_EVENTS] >= 1
    )
    rtol_is_right = 0.0 <= numbers[at.RTOL] < 1.0
    numbers[at.RTOL] = max(numbers[at.RTOL], SMALLEST_RTOL)
    return in_order and positive and rtol_is_right


# An infinite time span is a sequence of finite ones, each of twice the length: the
# driver judges by the length of the time span how densely it looks at the guards. The
# first is this fraction of a second or, if it starts far from zero, of its start. If it
# were 1.5 times longer, nothing shorter than a microsecond would be looked for less
# densely.
FIRST_SPAN = 2.0**-20


@kernel
def run_to_the_end(desk: IntVector, numbers: FloatVector, here: int, flags: int) -> int:
    """Run the driver to the end of the time span; if that is infinite, until something ends it."""
    start = numbers[at.T_START]
    if flags & at.RESUMED == 0:
        desk[at.ENDLESS] = 1 if numbers[at.T_END] == inf else 0
        if desk[at.ENDLESS] != 0:
            numbers[at.T_END] = start + FIRST_SPAN * max(1.0, abs(start))
    status = call_run(desk[at.RUN], here, flags)
    while status == at.FINISHED and desk[at.ENDLESS] != 0:
        farther = start + 2.0 * (numbers[at.T_END] - start)
        if not farther < inf:
            return at.NO_END
        numbers[at.T_END] = farther
        status = call_run(desk[at.RUN], here, at.RESUMED)
    return status


def _run(desk: int, flags: int) -> int:
    """Run the driver on the desk at this address."""
    return run(memory.int_vector(desk, at.DESK_SLOTS), flags)


def _first_order(
    desk: int, part: int, dt: float, which: int, k: int, way: int
) -> float:
    """Run a part of the flow's Jacobian; `which` is a row of the log, a flag, or a kind of flip."""
    slots = memory.int_vector(desk, at.DESK_SLOTS)
    p, m = desk_problem(slots), desk_memory(slots)
    if part == jacobian.CARRY:
        return jacobian.carry_jacobian(p, m, dt)
    if part == jacobian.SALTATE:
        return float(jacobian.saltate(p, m, k, which))
    if part == jacobian.RESET:
        return (
            1.0
            if jacobian.carry_reset(p, m, desk_log(slots).floats, which, k, way)
            else 0.0
        )
    return 1.0 if jacobian.saltate_handlers(p, m, which != 0) else 0.0


def _enter(desk: int, flags: int) -> int:
    """Run the driver on the desk at this address if the request there is valid."""
    slots = memory.int_vector(desk, at.DESK_SLOTS)
    numbers = memory.float_vector(desk, at.DESK_SLOTS)
    if flags & at.RESUMED == 0 and not can_be_done(slots, numbers):
        return at.BAD_NUMBERS
    return run_to_the_end(slots, numbers, desk, flags)


@cache
def compiled_run() -> Any:
    """Return the driver's machine code, from the cache or compiled now with a note on stderr."""

    def compile_it(cached: bool) -> Any:
        compiler = cfunc(RUN_NATIVE, cache=cached, **code.ENTRY)
        folder = Path(config.CACHE_DIR) if cached else None  # type: ignore[attr-defined]
        if folder and any(
            folder.glob(f"*/*{_run.__name__}-*.nbi")
        ):  # compiled meanwhile
            return compiler(_run)
        _say("compiling the integrator, some 15 s of one core; later processes load it")
        started, driver = time.monotonic(), compiler(_run)
        where = f"it is kept in {folder.parent}" if folder else NOT_KEPT
        _say(f"compiled in {time.monotonic() - started:.0f} s; {where}")
        return driver

    return compiled_in_cache(_run, driver_digest(), compile_it)


def _say(what: str) -> None:
    print(f"hopdata: {what}", file=sys.stderr, flush=True)


@cache
def compiled_first_order() -> Any:
    """Return the machine code that carries Jacobians, which the driver calls by address."""
    return _compiled(
        _first_order, partial(cfunc, jacobian.FIRST_ORDER_NATIVE, **code.ENTRY)
    )


def _compiled(function: Callable[..., Any], make: Callable[..., Any]) -> Any:
    return compiled_in_cache(
        function, driver_digest(), lambda kept: make(cache=kept)(function)
    )


@cache
def entry(function: Callable[..., Any], native: Any) -> Callable[..., int]:
    """Return a small compiled function that releases the interpreter's lock.

    It is called without matching signatures, so the argument types must be exact.
    """
    compiled = _compiled(function, partial(njit, native, nogil=True, **code.ENTRY))
    (one,) = compiled.overloads.values()
    found: Callable[..., int] = one.entry_point
    return found


def driver_entry() -> Callable[..., int]:
    """Return the machine code of `_enter`."""
    return entry(_enter, RUN_NATIVE)


# Many integrations in a row, without returning to Python.

_INTS, _FLOATS = types.int64[:, ::1], types.float64[:, ::1]
BYTES = 8
END_STATE = 3  # first column of the state in `ends`, after time and the culprit's rates

MANY_NATIVE = _INT(
    types.int64[::1], _INT, _INT, _FLOATS, _FLOATS, _INTS,
    _INTS, _FLOATS, _INTS, _INTS, types.float64[:, :, ::1], types.float64[:, :, ::1],
    _FLOAT, _FLOAT, _FLOAT, _FLOAT, _FLOAT, _INT, _INT,
)  # fmt: skip


def _enter_many(
    desk: IntArray, first: int, last: int, y0: FloatArray, params: FloatArray, modes: IntArray,
    status: IntArray, ends: FloatArray, end_modes: IntArray,
    counts: IntArray, samples: FloatArray, jacobians: FloatArray,
    t_start: float, t_end: float, rtol: float, max_step: float, step: float,
    max_steps: int, max_events: int,
) -> int:  # fmt: skip
    """Integrate from the rows `first` to `last` of y0; return the first row not done.

    Rows of `params` and `modes` are taken in turn; a single row serves all. `ends`
    receives time, rates and state, and `counts` the driver's counters. `samples` and
    `jacobians`, unless empty, receive the states at the requested times and the flow's
    Jacobians.
    """
    n, n_wanted = y0.shape[1], desk[at.WANTED + 1]
    clock = memory.float_vector(desk[at.CLOCK], 0)
    mode = memory.array_of(memory.int_vector(desk[at.MODE], modes.shape[1]))
    count = memory.array_of(memory.int_vector(desk[at.COUNTS], counts.shape[1]))
    state = memory.row(memory.float_table(desk[at.STATE_TABLE], n), at.Y)
    start = memory.array_of(memory.float_vector(desk[at.START_STATE], n))
    phi = memory.square(memory.float_table(desk[at.TANGENT_TABLE], n), 0)
    own = memory.array_of(memory.float_vector(desk[at.PARAMS], params.shape[1]))
    here, room = address_of(view(desk)), address_of(view(samples))
    numbers = memory.float_vector(here, len(desk))
    slots = memory.int_vector(here, len(desk))
    numbers[at.T_START], numbers[at.RTOL] = t_start, rtol
    numbers[at.MAX_STEP], numbers[at.FIRST_STEP] = max_step, step
    desk[at.MAX_STEPS], desk[at.MAX_EVENTS] = max_steps, max_events
    desk[at.ROWS_PER_STEP] = 0
    desk[at.KEEP_EVENTS] = 0
    for b in range(first, last):
        copy(params[b % len(params)], own)
        copy(modes[b % len(modes)], mode)
        copy(y0[b], start)
        if n_wanted > 0:
            desk[at.SAMPLE_TABLE] = room + b * n_wanted * n * BYTES
        for k in range(n * n if len(jacobians) > 0 else 0):
            phi[k // n, k % n] = 1.0 if k // n == k % n else 0.0
        numbers[at.T_END] = (
            t_end  # of each: an infinite one is replaced by a finite one
        )
        ended = run_to_the_end(slots, numbers, here, at.GIVEN_MODE)
        while ended == at.PAUSED:
            ended = run_to_the_end(slots, numbers, here, at.RESUMED)
        if ended == at.NEEDS_METHOD:
            return b
        status[b, 0], ends[b, 0] = ended, clock[at.T]
        ends[b, 1], ends[b, 2] = clock[at.RATE_BELOW], clock[at.RATE_ABOVE]
        copy(state, ends[b, END_STATE:])
        copy(mode, end_modes[b])
        copy(count, counts[b])
        for i in range(n if len(jacobians) > 0 else 0):
            copy(phi[i], jacobians[b, i])
    return last


def many_entry() -> Callable[..., int]:
    """Return the machine code of `_enter_many`."""
    return entry(_enter_many, MANY_NATIVE)
