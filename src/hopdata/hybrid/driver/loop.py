"""The loop: step, look for the first flip, land on it, process it, continue.

`run` keeps all its memory in the arrays it is given. It can therefore return whenever
the output arrays are full or Python should handle Ctrl-C, and be called again. It takes
the callbacks by address and is compiled once per install (see `compiled`). It receives
arrays through the argument block (see `workspace`).
"""

import time
from collections.abc import Callable
from functools import cache, partial
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

from numba import cfunc, config, njit, types

from hopdata.arrays import FloatArray, IntArray
from hopdata.code_cache import compiled_in_cache
from hopdata.hybrid import layout as at
from hopdata.hybrid.arguments import SMALLEST_RTOL
from hopdata.hybrid.compiled import kernel as code
from hopdata.hybrid.compiled import memory, records
from hopdata.hybrid.compiled.aloud import say
from hopdata.hybrid.compiled.digest import driver_digest
from hopdata.hybrid.compiled.kernel import copy, kernel, kernel_apart, kernel_in_loop
from hopdata.hybrid.compiled.memory import FloatVector, IntVector, address_of, view
from hopdata.hybrid.driver import dense, jacobian, known, problem, stepping
from hopdata.hybrid.driver.ahead import forget_box
from hopdata.hybrid.driver.end_step import end_at_first_flip
from hopdata.hybrid.driver.instant import fire_all, refresh, settle_locks
from hopdata.hybrid.driver.log import Log, forget_mode
from hopdata.hybrid.driver.resets import carry_reset
from hopdata.hybrid.driver.sleep import REACH, travel_on
from hopdata.hybrid.driver.tangents import carry_jacobian, grown_error, single
from hopdata.hybrid.driver.watch import carry_guards, gather_reached
from hopdata.hybrid.layout import Memory

# The argument block: a table of addresses where the driver finds its callbacks and
# arrays. Each of these functions reads one group of them from it.

reader = partial(records.reader, vars(at))
problem_of = reader(
    problem.Problem,
    methods=at.METHOD_TABLE,
    tangent=at.TANGENT_TABLE,
    along=at.DUAL_TABLE,
)
memory_of = reader(
    Memory,
    states=at.STATE_TABLE,
    guards=at.GUARD_TABLE,
    flags=at.FLAG_TABLE,
    lists=at.LIST_TABLE,
)
output_of = reader(
    dense.Output, samples=at.SAMPLE_TABLE, rows=at.ROW_TABLE, per_step=at.ROWS_PER_STEP
)
log_of = reader(
    Log,
    floats=at.LOG_TABLE,
    integers=at.LOG_TABLE,
    n_rows=at.N_LOG_ROWS,
    changes=at.CHANGE_TABLE,
)


@kernel
def end_of_step(p: problem.Problem, m: Memory, dt: float) -> float:
    """Return the time at which a step of length `dt` ends."""
    end = problem.next_end(p, m)
    if dt >= end - m.clock[at.T]:
        return end
    return m.clock[at.T] + dt


@kernel
def record(p: problem.Problem, m: Memory, out: dense.Output, dt: float) -> bool:
    """Record the states within a step; return whether its polynomial has them.

    It overflows where states are near the largest number and the step is long.
    """
    if not dense.sample_step(p, m, out, end_of_step(p, m, dt), dt):
        return False
    return out.per_step <= 1 or dense.write_inside(p, m, out, dt)


@kernel
def move_on(p: problem.Problem, m: Memory, out: dense.Output, dt: float) -> None:
    """Make the end of the step the start of the next, and record it."""
    t_new = end_of_step(p, m, dt)
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
    forget_box(m)
    if status == at.NEEDS_ROOM:
        dense.take_back_row(m, out)
        return status
    dense.rewrite_row(m, out)
    stepping.choose_after_event(p, m)
    if p.has_stops != 0:
        known.seek_anew(p, m)  # the mode may have changed
    return status


@kernel
def fire_at_start(p: problem.Problem, m: Memory, out: dense.Output, log: Log) -> int:
    """Fire the guards that are past their surface, by their values in H0."""
    resolution = problem.time_resolution(m.clock[at.T], 0.0)
    gather_reached(p, m, at.H0, at.RATE0, resolution)
    if problem.mark_due(p, m, at.H0, at.RATE0, resolution) > 0:
        return fire(p, m, out, log)
    return at.RUNNING


@kernel_apart
def meet_instants(p: problem.Problem, m: Memory, out: dense.Output, log: Log) -> int:
    """Begin anew behind a known instant that is reached, and look for the next."""
    passed = False
    moves = p.first_order != 0 and p.n_varying < m.states.width
    n_unsought = m.counts[at.UNSOUGHT]
    m.clock[at.PASSED] = inf
    while known.meet(p, m):
        passed = True
    if moves and m.counts[at.UNSOUGHT] > n_unsought:
        return at.UNSOUGHT_IN_JACOBIAN
    if not passed:
        return at.RUNNING
    forget_box(m)
    if moves:
        before = single(m, at.F_BEFORE)
        problem.copy_row(m.states, at.K1, p.tangent, before)
    status = refresh(p, m)
    if status == at.RUNNING and moves:
        status = int(jacobian.first_order(p, jacobian.INSTANT, 0.0, 0, 0, 0))
    if status != at.RUNNING:
        return status
    stepping.choose_after_event(p, m)
    return fire_at_start(p, m, out, log)


#: Length of the next step, where the polynomial of one overflows.
#: Unit: length of that step. Origin: chosen.
OVERFLOW_SHRINK = 0.25


@kernel
def try_shorter_step(m: Memory, dt: float, shrink: float) -> int:
    """Discard the step of length `dt`; return a status.

    Its Jacobian is too inexact, or its polynomial overflows. The next one has the
    fraction `shrink` of its length, which is NaN where the Jacobian is not finite.
    """
    m.clock[at.NEXT_DT] = shrink * dt
    m.counts[at.REJECTED] += 1
    if not shrink > 0.0:
        return at.JACOBIAN_NOT_FINITE
    if shrink * dt <= stepping.STEP_FLOOR * abs(m.clock[at.T]):
        return at.STEP_UNDERFLOW
    return at.RUNNING


@kernel_in_loop
def advance(p: problem.Problem, m: Memory, out: dense.Output, log: Log) -> int:
    """Take one step, to its end or its first flip, and process the flips."""
    n_samples = m.counts[at.SAMPLES]
    n_rows = m.counts[at.ROWS]
    dt = stepping.accepted_step(p, m)
    if dt < 0.0:
        return int(dt)
    dt, n_due = end_at_first_flip(p, m, dt)
    if dt > 0.0:
        shrink = 1.0 if record(p, m, out, dt) else OVERFLOW_SHRINK
        if p.first_order and shrink == 1.0:
            shrink = jacobian.first_order(p, jacobian.CARRY, dt, 0, 0, 0)
        if not shrink >= 1.0:
            m.counts[at.SAMPLES] = n_samples
            m.counts[at.ROWS] = n_rows
            return try_shorter_step(m, dt, shrink)
        move_on(p, m, out, dt)
    if n_due > 0:
        return fire(p, m, out, log)
    stepping.choose_after_step(p, m)
    return at.RUNNING


@kernel_apart
def clear(p: problem.Problem, m: Memory, log: Log) -> bool:
    """Reset the memory to the start of an integration.

    Returns whether the initial state is finite.
    """
    for row in range(at.GUARD_ROWS):
        problem.fill_row(m.guards, row, 0.0)
    for k in range(m.flags.width):
        m.flags[at.LAST_FLIP, k] = 0
        m.flags[at.BRANCHED, k] = 0
        m.flags[at.FIRED, k] = 0
        m.flags[at.FLIPS, k] = 0
        m.flags[at.AT_JUMP, k] = 0
        m.flags[at.BOUNCED, k] = 0
        m.lists[at.AWAKE, k] = k
    memory.array_of(m.counts)[:] = 0
    m.counts[at.CULPRIT] = -1
    m.counts[at.N_AWAKE] = m.flags.width
    memory.array_of(m.clock)[:] = 0.0
    m.clock[at.T] = p.t_start
    m.clock[at.SEGMENT] = p.t_start
    m.clock[at.INSTANT] = -inf
    m.clock[at.MOTION] = inf
    m.clock[at.PIECE] = inf
    m.clock[at.REACH] = 1.0
    m.clock[at.LEFT_REACH] = REACH
    m.clock[at.NEXT_DT] = p.first_step
    m.clock[at.LAST_LOG_ERROR] = stepping.LOG_ERROR_FLOOR
    known.begin(p, m)
    forget_mode(log)
    for i in range(m.states.width):
        m.states[at.Y, i] = p.start_state[i]
        if p.first_order != 0:
            p.tangent[single(m, at.PHI_PART), i] = 1.0
            p.tangent[single(m, at.PHI_LARGEST), i] = 0.0
            p.tangent[single(m, at.PHI_ERROR), i] = 0.0
            p.tangent[single(m, at.PHI_STEP_ERROR), i] = 0.0
            problem.fill_row(p.tangent, single(m, at.PHI_GROWN) + i, 0.0)
    return problem.first_not_finite(m.states, at.Y) < 0


@kernel_apart
def start(p: problem.Problem, m: Memory, out: dense.Output, log: Log) -> int:
    """Settle the mode at t0, choose a step, and fire guards past their surface."""
    m.counts[at.METHOD] = stepping.first_method(p)
    status = settle_locks(p, m)
    if status != at.RUNNING:
        return status
    if not m.clock[at.NEXT_DT] > 0.0:
        m.clock[at.NEXT_DT] = stepping.first_step(p, m)
    dense.sample_start(m, out)
    dense.write_row(m, out, m.clock[at.T], at.Y)
    for k in range(m.guards.width):
        m.guards[at.SIZE, k] = abs(m.guards[at.H0, k])
        if m.flags[at.OPEN, k] != 0 and m.guards[at.H0, k] == 0.0:
            m.counts[at.ON_SURFACE] += 1
    return fire_at_start(p, m, out, log)


@kernel
def begin(
    p: problem.Problem, m: Memory, out: dense.Output, log: Log, flags: int
) -> int:
    """Begin an integration, or go on with one that was interrupted; return a status."""
    if flags & at.RESUMED == 0:
        if flags & at.GIVEN_MODE == 0:
            for k in range(p.mode.width):
                p.mode[k] = 0
        if not clear(p, m, log):
            return at.BAD_START
        return start(p, m, out, log)
    if m.counts[at.BEGUN] != 0:  # the log was full within an instant
        dense.write_row(m, out, m.clock[at.T], at.Y)
        return fire(p, m, out, log)
    return at.RUNNING


@kernel
def run(block: IntVector, flags: int) -> int:
    """Integrate until the run ends or needs room, and return a status."""
    p = problem_of(block)
    m = memory_of(block)
    out = output_of(block)
    log = log_of(block)
    status = begin(p, m, out, log, flags)
    pause = m.counts[at.STEPS] + block[at.PATIENCE]  # then return to Python briefly
    while status == at.RUNNING:
        if m.clock[at.T] >= p.t_end:
            return at.FINISHED
        if p.has_stops != 0:  # before the method is known, which it may change
            status = meet_instants(p, m, out, log)
            if status != at.RUNNING:
                return status
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

_INT = types.int64
_FLOAT = types.float64

RUN_NATIVE = _INT(_INT, _INT)
NOT_KEPT = "no cache folder is writable: set NUMBA_CACHE_DIR to one that is"

call_run = code.caller(RUN_NATIVE)


@kernel
def can_be_done(block: IntVector, numbers: FloatVector) -> bool:
    """Return whether the numbers in the block are valid.

    The checks are those of `arguments.check_numbers`. A relative tolerance below
    rounding is raised to it.
    """
    in_order = -inf < numbers[at.T_START] <= numbers[at.T_END]
    positive = (
        numbers[at.MAX_STEP] > 0.0
        and block[at.MAX_STEPS] >= 1
        and block[at.MAX_EVENTS] >= 1
    )
    rtol_is_right = 0.0 <= numbers[at.RTOL] < 1.0
    numbers[at.RTOL] = max(numbers[at.RTOL], SMALLEST_RTOL)
    return in_order and positive and rtol_is_right


#: Length of the first finite time span that is tried where the end is infinite, as a
#: fraction of a second or, if the span starts far from zero, of its start. Each further
#: one has twice the length. The driver judges by the length of the time span how
#: densely it looks at the guards: if the first were 1.5 times longer, nothing shorter
#: than a microsecond would be looked for less densely.
#: Unit: s, or 1. Origin: chosen.
FIRST_SPAN = 2.0**-20


@kernel
def run_to_the_end(
    block: IntVector, numbers: FloatVector, here: int, flags: int
) -> int:
    """Run the driver to the end of the time span.

    An infinite span is a sequence of finite ones, until something ends the integration.
    """
    start = numbers[at.T_START]
    if flags & at.RESUMED == 0:
        block[at.ENDLESS] = 0
        if numbers[at.T_END] == inf:
            block[at.ENDLESS] = 1
            numbers[at.T_END] = start + FIRST_SPAN * max(1.0, abs(start))
    status = call_run(block[at.RUN], here, flags)
    while status == at.FINISHED and block[at.ENDLESS] != 0:
        farther = start + 2.0 * (numbers[at.T_END] - start)
        if not farther < inf:
            return at.NO_END
        numbers[at.T_END] = farther
        status = call_run(block[at.RUN], here, at.RESUMED)
    return status


def _run(block: int, flags: int) -> int:
    """Run the driver with the argument block at this address."""
    return run(memory.int_vector(block, at.BLOCK_SLOTS), flags)


def _first_order(
    block: int, part: int, dt: float, which: int, k: int, way: int
) -> float:
    """Run a part of the flow's Jacobian (see `jacobian`).

    `which` is a row of the log, a flag, or a kind of flip.
    """
    slots = memory.int_vector(block, at.BLOCK_SLOTS)
    p = problem_of(slots)
    m = memory_of(slots)
    if part == jacobian.CARRY:
        return carry_jacobian(p, m, dt)
    if part == jacobian.SALTATE:
        return float(jacobian.saltate(p, m, k, which))
    if part == jacobian.INSTANT:
        return float(jacobian.pass_instant(p, m))
    if part == jacobian.RESET:
        jumped = carry_reset(p, m, log_of(slots).floats, which, k, way)
        return 1.0 if jumped else 0.0
    is_known = jacobian.saltate_handlers(p, m, which != 0)
    return 1.0 if is_known else 0.0


def _enter(block: int, flags: int) -> int:
    """Run the driver with the block at this address if the request in it is valid."""
    slots = memory.int_vector(block, at.BLOCK_SLOTS)
    numbers = memory.float_vector(block, at.BLOCK_SLOTS)
    if flags & at.RESUMED == 0 and not can_be_done(slots, numbers):
        return at.BAD_NUMBERS
    return run_to_the_end(slots, numbers, block, flags)


@cache
def compiled_run() -> Any:
    """Return the driver's machine code, from the cache or compiled now.

    Compiling it is announced on stderr.
    """

    def compile_it(cached: bool) -> Any:
        compiler = cfunc(RUN_NATIVE, cache=cached, **code.LARGE_ENTRY)
        return compiled_aloud(_run, compiler, cached, "the integrator, some 15 s")

    return compiled_in_cache(_run, driver_digest(), compile_it)


def compiled_aloud(function: Any, compiler: Any, cached: bool, what: str) -> Any:
    """Return a compiled function, from the cache or compiled now, with lines on stderr.

    Parameters
    ----------
    function : function
        What is compiled.
    compiler : callable
        Compiles it.
    cached : bool
        Whether Numba's folder of this function is writable.
    what : str
        What this is, and how long it takes on one core.
    """
    folder = None
    if cached:
        folder = Path(config.CACHE_DIR)  # type: ignore[attr-defined]
        by_another = folder.glob(f"*/*{function.__name__}-*.nbi")
        if any(by_another):  # compiled meanwhile
            return compiler(function)
    say(f"compiling {what} of one core, minutes on a busy computer")
    say("later processes load it")
    started = time.monotonic()
    compiled = compiler(function)
    where = NOT_KEPT if folder is None else f"it is kept in {folder.parent}"
    say(f"compiled in {time.monotonic() - started:.0f} s; {where}")
    return compiled


@cache
def compiled_first_order() -> Any:
    """Return the machine code of Jacobians, which the driver calls by address."""
    return _compiled(
        _first_order, partial(cfunc, jacobian.FIRST_ORDER_NATIVE, **code.LARGE_ENTRY)
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

BYTES = 8  # of a number
END_STATE = 3  # first column of the state in `ends`, after time and the culprit's rates


class Starts(NamedTuple):
    """Where many integrations start.

    Their rows are taken in turn; a single row serves all. The last two are known
    instants (see `known_instants`).
    """

    y0: FloatArray
    params: FloatArray
    modes: IntArray
    singles: FloatArray
    periods: FloatArray


class Results(NamedTuple):
    """Room for the results of many integrations, a row for each."""

    status: IntArray
    ends: FloatArray  # time, the culprit's rates, and the state
    modes: IntArray
    counts: IntArray  # the driver's counters
    samples: FloatArray  # states at the requested times; empty if there are none
    jacobians: FloatArray  # of the flow; empty if they are not wanted
    errors: FloatArray  # of the Jacobians, estimated; empty like these


_INTS = types.int64[:, ::1]
_FLOATS = types.float64[:, ::1]
_MATRICES = types.float64[:, :, ::1]
STARTS_NATIVE = types.NamedTuple((_FLOATS, _FLOATS, _INTS, _FLOATS, _FLOATS), Starts)
RESULTS_NATIVE = types.NamedTuple(
    (_INTS, _FLOATS, _INTS, _INTS, _MATRICES, _MATRICES, _FLOATS), Results
)
MANY_NATIVE = _INT(types.int64[::1], _INT, _INT, STARTS_NATIVE, RESULTS_NATIVE)

# Slots of the block that many integrations write for each of them.
BORROWED = (
    int(at.PATIENCE),
    int(at.SAMPLE_TABLE),
    int(at.SINGLES),
    int(at.SINGLES) + 1,
    int(at.PERIODS),
    int(at.PERIODS) + 1,
)


@kernel
def write_start(block: Any, number: int, starts: Any) -> None:
    """Write state, parameters and mode of one of many integrations into its memory."""
    n = starts.y0.shape[1]
    n_params = starts.params.shape[1]
    n_modes = starts.modes.shape[1]
    state = memory.array_of(memory.float_vector(block[at.START_STATE], n))
    params = memory.array_of(memory.float_vector(block[at.PARAMS], n_params))
    mode = memory.array_of(memory.int_vector(block[at.MODE], n_modes))
    copy(starts.params[number % len(starts.params)], params)
    copy(starts.modes[number % len(starts.modes)], mode)
    copy(starts.y0[number], state)
    write_instants(block, at.SINGLES, number, starts.singles)
    write_instants(block, at.PERIODS, number, starts.periods)


@kernel
def write_instants(block: Any, place: int, number: int, rows: Any) -> None:
    """Write address and length of one integration's known instants to the block."""
    width = rows.shape[1]
    block[place] = address_of(view(rows)) + number % len(rows) * width * BYTES
    block[place + 1] = width


@kernel
def set_to_identity(block: Any, n: int) -> None:
    """Set the flow's Jacobian, of `n` states, to that of no motion."""
    phi = memory.square(memory.float_table(block[at.TANGENT_TABLE], n), 0)
    for i in range(n):
        for j in range(n):
            phi[i, j] = 1.0 if i == j else 0.0


@kernel
def read_result(block: Any, number: int, n: int, status: int, results: Any) -> None:
    """Copy the end of one of many integrations, of `n` states, into its row."""
    clock = memory.float_vector(block[at.CLOCK], 0)
    mode = memory.int_vector(block[at.MODE], results.modes.shape[1])
    counts = memory.int_vector(block[at.COUNTS], results.counts.shape[1])
    results.status[number, 0] = status
    results.ends[number, 0] = clock[at.T]
    results.ends[number, 1] = clock[at.RATE_BELOW]
    results.ends[number, 2] = clock[at.RATE_ABOVE]
    state = memory.row(memory.float_table(block[at.STATE_TABLE], n), at.Y)
    copy(state, results.ends[number, END_STATE:])
    copy(memory.array_of(mode), results.modes[number])
    copy(memory.array_of(counts), results.counts[number])
    if len(results.jacobians) > 0:
        table = memory.float_table(block[at.TANGENT_TABLE], n)
        phi = memory.square(table, 0)
        for i in range(n):
            copy(phi[i], results.jacobians[number, i])
        results.errors[number, 0] = grown_error(table)


ENDLESS_PATIENCE = 1 << 62  # steps without a return to Python
INVALID = -1  # instead of a row, if the numbers in the block are not valid


def _enter_many(
    block: IntArray, first: int, last: int, starts: Starts, results: Results
) -> int:
    """Integrate from rows `first` to `last` of y0; return the first row not done.

    What they share is in the block, as for one integration, and the block is left as it
    was. None of them pauses.
    """
    n = starts.y0.shape[1]
    n_wanted = block[at.WANTED + 1]
    here = address_of(view(block))
    samples = address_of(view(results.samples))
    numbers = memory.float_vector(here, len(block))
    slots = memory.int_vector(here, len(block))
    if not can_be_done(slots, numbers):
        return INVALID
    own = (
        block[BORROWED[0]],
        block[BORROWED[1]],
        block[BORROWED[2]],
        block[BORROWED[3]],
        block[BORROWED[4]],
        block[BORROWED[5]],
    )
    t_end = numbers[at.T_END]
    block[at.PATIENCE] = ENDLESS_PATIENCE
    done = first
    status = int(at.FINISHED)
    while done < last and status != at.NEEDS_METHOD:
        write_start(block, done, starts)
        if n_wanted > 0:
            block[at.SAMPLE_TABLE] = samples + done * n_wanted * n * BYTES
        if len(results.jacobians) > 0:
            set_to_identity(block, n)
        # Written for each of them: an infinite end is replaced by finite ones.
        numbers[at.T_END] = t_end
        status = run_to_the_end(slots, numbers, here, at.GIVEN_MODE)
        if status != at.NEEDS_METHOD:
            read_result(block, done, n, status, results)
            done += 1
    numbers[at.T_END] = t_end
    for place in range(len(BORROWED)):
        block[BORROWED[place]] = own[place]
    return done


def many_entry() -> Callable[..., int]:
    """Return the machine code of `_enter_many`."""
    return entry(_enter_many, MANY_NATIVE)
