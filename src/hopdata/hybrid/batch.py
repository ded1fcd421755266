"""`solve_batch`: integrate one system from many initial states, in parallel."""

import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import cache
from itertools import islice
from math import inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.hybrid import arguments
from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.caught import Caught
from hopdata.hybrid.derived import ask_derived, goes_back
from hopdata.hybrid.driver.loop import (
    END_STATE,
    Request,
    Results,
    Starts,
    many_entry,
)
from hopdata.hybrid.known_instants import NONE, Instants
from hopdata.hybrid.methods.table import MethodTable
from hopdata.hybrid.system import System
from hopdata.hybrid.workspace import FIRST_PATIENCE

# A job runs in threads, chunk by chunk, and shows its progress.

CHUNK = 64  # integrations that a thread takes at a time; results do not depend on it
# Most steps in a chunk of more than one integration: Ctrl-C takes effect only between
# chunks.
STEPS_AT_A_TIME = 200_000
#: Number of systems from which a batch is integrated in lanes by default.
#: Unit: 1. Origin: measured: compilation takes 0.5 s, and each system saves 10 to
#: 20 us.
LARGE = 50_000
BETWEEN_S = 0.1  # interval of progress messages on stderr


def run_in_threads(
    run: Callable[[int, int], int],
    done: int,
    total: int,
    workers: int | None,
    progress: bool,
    chunk: int = CHUNK,
) -> None:
    """Run a job on the indices from `done` up to `total`, in chunks and threads.

    A single worker runs in the calling thread, because starting a thread takes as long
    as a hundred small integrations.

    Parameters
    ----------
    run : callable
        ``run(first, last)`` processes the indices first <= i < last and returns their
        number.
    done, total : int
        Number of indices already done, and total number.
    workers : int, optional
        Number of threads; by default one for each core that this process may use.
    progress : bool
        Whether to report progress on stderr.
    chunk : int
        Number of indices that a thread takes at a time.
    """
    chunks = [(first, min(first + chunk, total)) for first in range(done, total, chunk)]
    n_workers = min(workers or available_cores(), len(chunks))
    start = time.monotonic()
    last_shown = -inf
    for count in _counts(run, chunks, n_workers):
        done += count
        now = time.monotonic()
        is_last = done == total
        if progress and (is_last or now - last_shown > BETWEEN_S):
            last_shown = now
            line = f"\r{done} of {total} integrations, {now - start:.1f} s"
            end = "\n" if is_last else ""
            print(line, end=end, file=sys.stderr, flush=True)


def _counts(
    run: Callable[[int, int], int], chunks: list[tuple[int, int]], workers: int
) -> Iterator[int]:
    """Run the chunks and yield the number of indices done as each chunk ends.

    After an exception or Ctrl-C, no further chunks are started.
    """
    if workers <= 1:
        yield from (run(*chunk) for chunk in chunks)
        return
    pool = ThreadPoolExecutor(workers)
    waiting = iter(chunks)
    # Queue few chunks: Ctrl-C during a submit may surface as an error of the threads'
    # lock
    try:
        under_way = {pool.submit(run, *c) for c in islice(waiting, 2 * workers)}
        while under_way:
            ended, under_way = wait(under_way, return_when=FIRST_COMPLETED)
            under_way |= {pool.submit(run, *c) for c in islice(waiting, len(ended))}
            yield from (job.result() for job in ended)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@dataclass(frozen=True, repr=False)
class BatchSolution:
    """Final states of many (B) integrations.

    Parameters
    ----------
    status : (B,) array of int
        How each ended, as in `Solution`.
    t_end : (B,) array
        Times reached, s.
    y_end : (B, n) array
        States reached.
    mode : (B, m) array of int
        Modes at the end.
    n_events, n_steps, nfev : (B,) array of int
        Events, accepted steps, field evaluations.
    n_unproven, n_close : (B,) array of int
        Steps in which it is not proven that no guard flips unseen, and those in which
        one turned too close to tell, as in `Solution`.
    culprit : (B,) array of int
        Index of the guard that the status is about, -1 if none.
    rates : (B, 2) array
        Rates of this guard before its last two flips, rising and falling, 1/s.
    guard_names : tuple of str
        Names of all guards.
    lanes : (B,) array of bool
        Which integrations ran in lanes.
    lanes_reason : str
        Why none ran in lanes; empty if some did.
    t : (N,) array, optional
        `t_eval`, if given.
    y : (B, n, N) array, optional
        States at these times; NaN after an integration has ended.
    jacobian : (B, n, n) array, optional
        Derivatives of the final states with respect to the initial states, if
        requested.
    sensitivity : (B, n, p) array, optional
        Derivatives of the final states with respect to the parameters, if requested.
    by_differences : str
        Functions whose derivatives are by finite differences, as in `Solution`.
    instants : str
        What the derivatives by the parameters leave out because it is not known how
        instants of the field move with them; "" if nothing.
    """

    status: IntArray
    t_end: FloatArray
    y_end: FloatArray
    mode: IntArray
    n_events: IntArray
    n_steps: IntArray
    nfev: IntArray
    n_unproven: IntArray
    n_close: IntArray
    culprit: IntArray
    rates: FloatArray
    guard_names: tuple[str, ...]
    lanes: BoolArray
    lanes_reason: str
    t: FloatArray | None = None
    y: FloatArray | None = None
    jacobian: FloatArray | None = None
    sensitivity: FloatArray | None = None
    by_differences: str = ""
    instants: str = ""

    def __len__(self) -> int:
        return len(self.status)

    def __repr__(self) -> str:
        return f"BatchSolution of {len(self)} integrations\n{self.message}"

    @property
    def success(self) -> bool:
        """Whether all reached the end of the time span or a terminal event."""
        return bool((self.status >= 0).all())

    @property
    def proven(self) -> BoolArray:
        """Of which integrations it is proven that no guard flips unseen; (B,)."""
        return self.n_unproven == 0

    @property
    def message(self) -> str:
        """How the integrations ended: a line for each status, with how often."""
        _, first_runs, counts = np.unique(
            self.status, return_index=True, return_counts=True
        )
        lines = []
        for run, count in zip(first_runs, counts, strict=True):
            sentence = at.describe(
                int(self.status[run]),
                time=self.t_end[run],
                culprit=self.culprit[run],
                names=self.guard_names,
                rates=self.rates[run],
            )
            lines.append(f"{count} of {len(self)}, such as number {run}: {sentence}")
        if self.by_differences:
            lines.append(at.BY_DIFFERENCES.format(reasons=self.by_differences))
        if self.instants:
            lines.append(self.instants)
        return "\n".join(lines)


class _Output:
    """Arrays that the threads fill; each thread writes its own rows."""

    def __init__(
        self, n_runs: int, system: System, n_times: int, jacobian: bool
    ) -> None:
        n = system.n_states
        n_sampled = n_runs if n_times > 0 else 0
        n_jacobians = n_runs if jacobian else 0
        self.status = np.zeros((n_runs, 1), dtype=np.int64)
        self.ends = np.empty((n_runs, END_STATE + n))
        self.modes = np.empty((n_runs, system.n_modes), dtype=np.int64)
        self.counts = np.empty((n_runs, at.COUNT_SLOTS), dtype=np.int64)
        self.samples = np.empty((n_sampled, n_times, n))
        self.jacobians = np.empty((n_jacobians, n, n))
        self.arrays = tuple(vars(self).values())  # in the order above


# Looked up once: the key of the compiled code takes longer than a short integration.
_entry = cache(many_entry)


@dataclass(frozen=True)
class _Batch:
    """What all integrations of a batch share, and where their results go."""

    system: System
    method: str
    jacobian: bool
    states: FloatArray
    numbers: FloatArray  # parameters and memory, one row, or one for each integration
    modes: IntArray
    times: FloatArray
    atol: ArrayLike
    options: tuple[float, float, float, float, float, int, int]
    output: _Output
    known: Instants = NONE

    def in_lanes(self) -> tuple[Callable[[int, int], int] | None, str]:
        """Return what integrates in lanes, or None and the reason."""
        from hopdata.hybrid.lanes.batch import lane_runner

        tolerance = np.empty(self.system.n_states)
        arguments.set_tolerance(tolerance, self.atol)
        inputs = (self.states, self.numbers, self.modes)
        arrays = (*inputs, *self.output.arrays[:-1], self.times, tolerance)
        return lane_runner(
            self.system, self.method, self.jacobian, arrays, self.options
        )

    def run(self, first: int, last: int) -> int:
        """Integrate from the states first <= i < last, one by one."""
        methods = self.system.methods(self.method, self.jacobian)
        work = self.system.take_workspace()
        done = first
        try:
            times = self.times if len(self.times) > 0 else None
            work.begin(methods, times, self.jacobian)
            work.make_params_room(self.numbers.shape[1] - self.system.n_memory)
            work.set_tolerance(self.atol)
            if methods.unchecked:
                self._check_pattern(methods, first)
            work.block[at.PATIENCE] = np.iinfo(np.int64).max // 2  # it never pauses
            starts = Starts(self.states, self.numbers, self.modes, *self.known)
            results = Results(*self.output.arrays)
            request = Request(*self.options)
            enter = _entry()
            with Caught() as caught:
                while done < last and not caught:
                    before = time.thread_time()
                    done = enter(work.block, done, last, starts, results, request)
                    methods.seconds += time.thread_time() - before
                    if done < last:
                        methods.provide(int(work.counts[at.METHOD]))
            if caught:
                raise caught[0]
        finally:
            work.forget_samples()
            work.set_instants(NONE)
            work.block[at.PATIENCE] = FIRST_PATIENCE
            self.system.idle.append(work)
        return last - first

    def _check_pattern(self, methods: MethodTable, which: int) -> None:
        """Compare the field with the pattern of its Jacobian, at one of the starts."""
        methods.check_pattern(
            self.options[0],
            self.states[which],
            self.modes[which % len(self.modes)],
            self.system.n_guards,
            self.numbers[which % len(self.numbers)],
        )

    def run_rows(self, rows: IntArray) -> int:
        """Integrate from the states of these rows, and return their number."""
        if rows[-1] - rows[0] == len(rows) - 1:  # there are no gaps
            return self.run(int(rows[0]), int(rows[-1]) + 1)
        gaps = np.flatnonzero(np.diff(rows) > 1)
        for piece in np.split(rows, gaps + 1):
            self.run(int(piece[0]), int(piece[-1]) + 1)
        return len(rows)


def solve_batch(  # noqa: PLR0913 (each parameter is an option of the user's)
    system: System,
    t_span: tuple[float, float],
    y0: ArrayLike,
    *,
    params: ArrayLike = (),
    mode: Sequence[int] | None = None,
    rtol: float = 1e-9,
    atol: ArrayLike = 1e-12,
    max_step: float = np.inf,
    first_step: float | None = None,
    t_eval: ArrayLike | None = None,
    max_steps: int = arguments.MOST,
    max_events: int = arguments.MOST,
    method: str = "auto",
    jacobian: bool | str = False,
    memory: ArrayLike | None = None,
    workers: int | None = None,
    progress: bool = False,
    lanes: bool | None = None,
    tstops: Any = None,
) -> BatchSolution:
    """Integrate a system from many initial states; options as in `solve`.

    Each result has the same bytes as with `solve`, whatever the number of workers. In
    lanes, its bytes likewise depend only on its row and the options. Trajectories and
    events are not kept; use `t_eval`, or `solve` for single integrations.

    Parameters
    ----------
    y0 : (B, n) array_like
        Initial states.
    params : (p,) or (B, p) array_like
        Parameters shared by all integrations, or one row for each.
    workers : int, optional
        Number of threads; by default one for each core that this process may use.
    progress : bool
        Whether to report progress on stderr.
    lanes : bool, optional
        Whether to integrate many systems at a time in the lanes of the processor's
        vectors where possible (see `BatchSolution.lanes_reason`). By default from
        `LARGE` systems on.
    tstops
        As in `solve`: shared by all integrations. A system's own, if they are a
        function of the parameters, are those of each.

    Returns
    -------
    BatchSolution

    Raises
    ------
    ValueError
        If an argument is out of range or of the wrong shape.
    Exception
        Whatever the system's functions raise.
    """
    system = system.current()
    states = _states(y0, system.n_states)
    known = NONE
    has_more = not system.is_plain
    if type(tstops) is Instants:  # those of a derived system
        known = tstops
    else:
        has_more = has_more or tstops is not None or system.has_instants
    if goes_back(t_span) or isinstance(jacobian, str) or has_more:
        return ask_derived(
            solve_batch,
            system,
            t_span=t_span,
            y0=states,
            params=params,
            t_eval=t_eval,
            atol=atol,
            jacobian=jacobian,
            mode=mode,
            rtol=rtol,
            max_step=max_step,
            first_step=first_step,
            max_steps=max_steps,
            max_events=max_events,
            method=method,
            memory=memory,
            workers=workers,
            progress=progress,
            lanes=lanes,
            tstops=tstops,
        )
    options = arguments.check_numbers(
        t_span, rtol, max_step, first_step, max_steps, max_events
    )
    arguments.check_infinite_end(system, options[1], *options[5:])
    if workers is not None:
        workers = arguments.check_count("workers", workers)
    jacobian = arguments.check_flag("jacobian", jacobian)
    numbers = arguments.check_rows(params, len(states))
    numbers = arguments.with_memory(numbers, memory, system.n_memory)
    system.check_params_length(numbers.shape[1])
    modes = np.zeros((1, system.n_modes), dtype=np.int64)
    if mode is not None:
        arguments.set_mode(modes[0], system.n_guards, mode)
    times = np.empty(0)
    if t_eval is not None:
        times = arguments.check_times(t_eval, *options[:2])
    if lanes is None:
        wants_lanes = len(states) >= LARGE
    else:
        wants_lanes = arguments.check_flag("lanes", lanes)
    batch = _Batch(
        system=system,
        method=method,
        jacobian=jacobian,
        states=states,
        numbers=numbers,
        modes=modes,
        times=times,
        atol=atol,
        options=options,
        output=_Output(len(states), system, len(times), jacobian),
        known=known,
    )
    remaining = np.arange(len(states))
    reason = "they were not requested"
    if wants_lanes:
        remaining, reason = _run_in_lanes(batch, workers, progress)
    _run_one_by_one(batch, remaining, workers, progress)
    return _solution(batch, remaining, reason)


def _run_in_lanes(
    batch: _Batch, workers: int | None, progress: bool
) -> tuple[IntArray, str]:
    """Integrate in lanes, and return the rows that remain, and why if all do."""
    from hopdata.hybrid.lanes.room import GIVEN_UP

    total = len(batch.states)
    in_lanes, reason = batch.in_lanes()
    if in_lanes is None:
        return np.arange(total), reason
    share = total // (4 * (workers or available_cores()))
    chunk = min(max(share, 4 * CHUNK), 64 * CHUNK)
    run_in_threads(in_lanes, 0, total, workers, progress, chunk)
    return np.flatnonzero(batch.output.status[:, 0] == GIVEN_UP), reason


def _run_one_by_one(
    batch: _Batch, remaining: IntArray, workers: int | None, progress: bool
) -> None:
    """Integrate from the states of the remaining rows."""
    total = len(batch.states)
    n_in_lanes = total - len(remaining)

    def run(first: int, last: int) -> int:
        return batch.run_rows(remaining[first - n_in_lanes : last - n_in_lanes])

    done = n_in_lanes
    chunk = CHUNK
    if len(remaining) > 0:
        # The first runs alone, because it compiles what is not compiled yet.
        methods = batch.system.methods(batch.method, batch.jacobian)
        before = methods.seconds
        done += run(done, done + 1)
        steps = int(batch.output.counts[remaining[0], at.STEPS])
        methods.specialise((methods.seconds - before) * len(remaining))
        chunk = min(STEPS_AT_A_TIME // (steps + 1) + 1, CHUNK)
    if done < total or progress:
        run_in_threads(run, done, total, workers, progress, chunk)


def _states(y0: ArrayLike, n_states: int) -> FloatArray:
    states = arguments.numbers_of("y0", y0)
    fits = states.ndim == 2 and states.shape[1] == n_states
    arguments.expect(fits, "y0", f"shape (B, {n_states})", states.shape)
    finite = np.isfinite(states)
    if finite.all():
        return states
    for row in np.flatnonzero(~finite.all(axis=1)):
        arguments.expect(False, "y0", "finite numbers", f"{states[row]} in row {row}")
    return states


def _about_instants(system: System, counts: IntArray) -> str:
    """Return what derivatives by the parameters leave out of the field's instants."""
    told = []
    if system.unsought:
        told.append(at.UNSOUGHT_INSTANTS.format(reason=system.unsought))
    held = int(counts[:, at.HELD_FIXED].sum())
    if held > 0:
        told.append(at.HELD_INSTANTS.format(count=held))
    missed = int(counts[:, at.UNSOUGHT].sum())
    if missed > 0:
        told.append(at.MISSED_INSTANTS.format(count=missed))
    return " ".join(told)


def _solution(batch: _Batch, remaining: IntArray, reason: str) -> BatchSolution:
    """Return the results, with the user's states, parameters and times only."""
    system = batch.system
    output = batch.output
    counts = output.counts
    shown = system.n_shown
    t = None
    y = None
    if len(batch.times) > 0:
        t = system.way * batch.times
        ended = np.arange(len(batch.times)) >= counts[:, at.SAMPLES, None]
        output.samples[ended] = np.nan
        y = np.ascontiguousarray(np.swapaxes(output.samples[..., :shown], 1, 2))
    jacobian = None
    told = ""
    if batch.jacobian:
        methods = system.methods(batch.method, True)
        told = system.derivatives.told(by_field=methods.by_field)
        jacobian = output.jacobians[:, :shown, :shown]
    sensitivity = None
    instants = ""
    if shown < system.n_states:
        sensitivity = output.jacobians[:, :shown, shown:]
        instants = _about_instants(system, counts)
    status = output.status[:, 0]
    modes = output.modes
    culprit = counts[:, at.CULPRIT]
    if system.slides is not None:
        status = system.slides.status(status, modes)
        culprit = system.slides.guards(culprit)
        modes = system.slides.modes(modes)
    in_lanes = np.ones(len(output.status), dtype=bool)
    in_lanes[remaining] = False
    return BatchSolution(
        status=status,
        t_end=system.way * output.ends[:, 0],
        y_end=output.ends[:, END_STATE : END_STATE + shown],
        mode=modes,
        n_events=counts[:, at.EVENTS],
        n_steps=counts[:, at.STEPS],
        nfev=counts[:, at.NFEV],
        n_unproven=counts[:, at.UNPROVEN],
        n_close=counts[:, at.CLOSE],
        t=t,
        y=y,
        jacobian=jacobian,
        sensitivity=sensitivity,
        by_differences=told,
        instants=instants,
        culprit=culprit,
        rates=output.ends[:, 1:END_STATE],
        guard_names=system.shown_guard_names,
        lanes=in_lanes,
        lanes_reason=reason,
    )
