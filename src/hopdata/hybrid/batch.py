"""`solve_batch`: integrate one system from many initial states, in parallel."""

import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import cache, cached_property, partial
from itertools import islice
from math import inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.hybrid import arguments
from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.caught import catch, stop_catching
from hopdata.hybrid.derived import ask_derived, goes_back
from hopdata.hybrid.driver.loop import (
    END_STATE,
    INVALID,
    Results,
    Starts,
    many_entry,
)
from hopdata.hybrid.known_instants import NONE, Instants
from hopdata.hybrid.methods.table import MethodTable
from hopdata.hybrid.solution import Form
from hopdata.hybrid.system import System
from hopdata.hybrid.workspace import NO_TIMES

# A job runs in threads, chunk by chunk, and shows its progress.

CHUNK = 64  # integrations that a thread takes at a time; results do not depend on it
# Most steps in a chunk of more than one integration: Ctrl-C takes effect only between
# chunks.
STEPS_AT_A_TIME = 200_000
#: Number of systems from which a batch is integrated in lanes by default.
#: Unit: 1. Origin: measured: compilation takes 0.5 s, and each system saves 10 to
#: 20 us.
LARGE = 50_000
#: Time after which the rest of a batch runs in threads.
#: Unit: s. Origin: measured: a pool of threads takes 0.3 ms to start and to end.
WORTH_THREADS = 2e-3
GROWTH = 4  # ratio of the chunks of a batch until it runs in threads
NO_NUMBERS = np.empty((1, 0))
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

    What is not asked for is not unpacked.

    Parameters
    ----------
    results : Results
        The driver's records.
    form : Form
        What they show of the system.
    times : (N,) array
        Times at which states were requested.
    n_alone : int
        Number of integrations that did not run in lanes.
    alone : (n_alone,) array of int, optional
        Which did not; all if it is not given.
    lanes_reason : str
        Why none ran in lanes; empty if some did.
    by_differences : str
        Functions whose derivatives are by finite differences, as in `Solution`.
    instants : str
        What the derivatives by the parameters leave out because it is not known how
        instants of the field move with them; "" if nothing.
    """

    results: Results
    form: Form
    times: FloatArray
    alone: IntArray | None
    lanes_reason: str
    by_differences: str = ""
    instants: str = ""

    def __len__(self) -> int:
        return len(self.results.status)

    def __repr__(self) -> str:
        return f"BatchSolution of {len(self)} integrations\n{self.message}"

    @cached_property
    def status(self) -> IntArray:
        """How each ended, as in `Solution`; (B,)."""
        status = self.results.status[:, 0]
        if self.form.slides is not None:
            return self.form.slides.status(status, self.results.modes)
        return status

    @cached_property
    def t_end(self) -> FloatArray:
        """Times reached, s; (B,)."""
        return self.form.way * self.results.ends[:, 0]

    @cached_property
    def y_end(self) -> FloatArray:
        """States reached; (B, n)."""
        return self.results.ends[:, END_STATE : END_STATE + self.form.shown]

    @cached_property
    def mode(self) -> IntArray:
        """Modes at the end; (B, m)."""
        if self.form.slides is not None:
            return self.form.slides.modes(self.results.modes)
        return self.results.modes

    @property
    def n_events(self) -> IntArray:
        """Numbers of events; (B,)."""
        return self.results.counts[:, at.EVENTS]

    @property
    def n_steps(self) -> IntArray:
        """Numbers of accepted steps; (B,)."""
        return self.results.counts[:, at.STEPS]

    @property
    def nfev(self) -> IntArray:
        """Numbers of field evaluations; (B,)."""
        return self.results.counts[:, at.NFEV]

    @property
    def n_unproven(self) -> IntArray:
        """Numbers of steps in which it is not proven that no guard flips unseen."""
        return self.results.counts[:, at.UNPROVEN]

    @property
    def n_close(self) -> IntArray:
        """Numbers of steps in which a guard turned too close to tell; (B,)."""
        return self.results.counts[:, at.CLOSE]

    @cached_property
    def culprit(self) -> IntArray:
        """Index of the guard that each status is about, -1 if none; (B,)."""
        culprit = self.results.counts[:, at.CULPRIT]
        if self.form.slides is not None:
            return self.form.slides.guards(culprit)
        return culprit

    @property
    def rates(self) -> FloatArray:
        """Rates of this guard before its last two flips, rising and falling; (B, 2)."""
        return self.results.ends[:, 1:END_STATE]

    @property
    def guard_names(self) -> tuple[str, ...]:
        """Names of all guards."""
        return self.form.guard_names

    @cached_property
    def lanes(self) -> BoolArray:
        """Which integrations ran in lanes; (B,)."""
        if self.alone is None:
            return np.zeros(len(self), dtype=bool)
        in_lanes = np.ones(len(self), dtype=bool)
        in_lanes[self.alone] = False
        return in_lanes

    @cached_property
    def t(self) -> FloatArray | None:
        """`t_eval`, if there are times in it; (N,)."""
        if len(self.times) == 0:
            return None
        return self.form.way * self.times

    @cached_property
    def y(self) -> FloatArray | None:
        """States at these times, (B, n, N); NaN after an integration has ended."""
        if len(self.times) == 0:
            return None
        reached = self.results.counts[:, at.SAMPLES, None]
        ended = np.arange(len(self.times)) >= reached
        states = np.swapaxes(self.results.samples[..., : self.form.shown], 1, 2).copy()
        np.copyto(states, np.nan, where=ended[:, None])
        return states

    @property
    def jacobian(self) -> FloatArray | None:
        """Derivatives of final by initial states, (B, n, n), if requested."""
        shown = self.form.shown
        if self.results.jacobians.shape[1] == 0:
            return None
        return self.results.jacobians[:, :shown, :shown]

    @property
    def jacobian_error(self) -> FloatArray | None:
        """Estimated errors of `jacobian` and `sensitivity`, as in `Solution`; (B,)."""
        if self.results.jacobians.shape[1] == 0:
            return None
        return self.results.errors[:, 0]

    @property
    def sensitivity(self) -> FloatArray | None:
        """Derivatives of final states by parameters, (B, n, p), if requested."""
        shown = self.form.shown
        if shown == self.form.state:
            return None
        return self.results.jacobians[:, :shown, shown:]

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
        """How the integrations ended: a line for each status, with how often.

        What is not proven or not exact has a line each.
        """
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
                has_handler=self.form.has_handler,
            )
            lines.append(f"{count} of {len(self)}, such as number {run}: {sentence}")
        n_unproven = int(self.n_unproven.sum())
        if n_unproven > 0:
            lines.append(at.why_unproven(n_unproven, self.form.unproven))
        n_close = int(self.n_close.sum())
        if n_close > 0:
            lines.append(at.CLOSE_CALLS.format(count=n_close))
        if self.by_differences:
            lines.append(at.BY_DIFFERENCES.format(reasons=self.by_differences))
        if self.instants:
            lines.append(self.instants)
        return "\n".join(lines)


_NO_SAMPLES = np.empty((0, 0, 0))
N_COUNTS = int(at.COUNT_SLOTS)


def _room(n_runs: int, form: Form, n_times: int, jacobian: bool) -> Results:
    """Return room for results; each thread writes its own rows."""
    n = form.state
    samples = _NO_SAMPLES
    jacobians = _NO_SAMPLES
    if n_times > 0:
        samples = np.empty((n_runs, n_times, n))
    errors = np.empty((0, 1))
    if jacobian:
        jacobians = np.empty((n_runs, n, n))
        errors = np.empty((n_runs, 1))
    return Results(
        np.empty((n_runs, 1), np.int64),
        np.empty((n_runs, END_STATE + n)),
        np.empty((n_runs, form.mode), np.int64),
        np.empty((n_runs, N_COUNTS), np.int64),
        samples,
        jacobians,
        errors,
    )


# Looked up once: the key of the compiled code takes longer than a short integration.
_entry = cache(many_entry)


@dataclass
class _Batch:
    """What all integrations of a batch share, and where their results go.

    `seconds` is the time that the driver has taken.
    """

    system: System
    methods: MethodTable
    jacobian: bool
    starts: Starts
    times: FloatArray
    atol: ArrayLike
    options: arguments.Numbers
    results: Results
    seconds: float = 0.0

    def in_lanes(self) -> tuple[Callable[[int, int], int] | None, str]:
        """Return what integrates in lanes, or None and the reason."""
        from hopdata.hybrid.lanes.batch import lane_runner

        tolerance = np.empty(self.system.n_states)
        arguments.set_tolerance(tolerance, self.atol)
        # Neither instants nor Jacobians, with which there are no lanes.
        arrays = (*self.starts[:3], *self.results[:-2], self.times, tolerance)
        return lane_runner(
            self.system, self.methods.choice, self.jacobian, arrays, self.options
        )

    def run(self, first: int, last: int) -> int:
        """Integrate from the states first <= i < last, one by one."""
        methods = self.methods
        starts = self.starts
        work = self.system.take_workspace()
        caught = work.caught
        caught.clear()
        token = catch(caught)
        try:
            work.begin(methods, self.times, self.jacobian)
            work.make_params_room(starts.params.shape[1] - self.system.n_memory)
            work.write_options(self.options, 0, False)
            work.set_tolerance(self.atol)
            if methods.unchecked:
                self._check_pattern(first)
            enter = _entry()
            done = first
            while done < last and not caught:
                before = time.monotonic()  # in a hundredth of the time of `thread_time`
                done = enter(work.block, done, last, starts, self.results)
                spent = time.monotonic() - before
                self.seconds += spent
                methods.seconds += spent
                assert done != INVALID, self.options
                if done < last:
                    methods.provide(int(work.counts[at.METHOD]))
            if caught:
                raise caught[0]
        finally:
            stop_catching(token)
            caught.clear()
            self.system.idle.append(work)
        return last - first

    def _check_pattern(self, which: int) -> None:
        """Compare the field with the pattern of its Jacobian, at one of the starts."""
        starts = self.starts
        self.methods.check_pattern(
            self.options[0],
            starts.y0[which],
            starts.modes[which % len(starts.modes)],
            self.system.n_guards,
            starts.params[which % len(starts.params)],
        )

    def run_remaining(
        self, remaining: IntArray, n_done: int, begin: int, end: int
    ) -> int:
        """Integrate from the states of some of the remaining rows; return their number.

        The places `begin` and `end` count those that are done.
        """
        rows = remaining[begin - n_done : end - n_done]
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
    if not options[1] < inf:
        arguments.check_infinite_end(system, options[1], *options[5:])
    if workers is not None:
        workers = arguments.check_count("workers", workers)
    jacobian = arguments.check_flag("jacobian", jacobian)
    wants_lanes = len(states) >= LARGE
    if lanes is not None:
        wants_lanes = arguments.check_flag("lanes", lanes)
    times = NO_TIMES
    if t_eval is not None:
        times = arguments.check_times(t_eval, *options[:2])
    batch = _Batch(
        system,
        system.methods(method, jacobian),
        jacobian,
        _starts(system, states, params, memory, mode, known),
        times,
        atol,
        options,
        _room(len(states), _shared(system)[0], len(times), jacobian),
    )
    reason = _why_not_asked(lanes, len(states))
    remaining = None
    if wants_lanes:
        remaining, reason = _run_in_lanes(batch, workers, progress)
    if remaining is None or len(remaining) > 0:
        _run_one_by_one(batch, remaining, workers, progress)
    told = ""
    if jacobian:
        told = system.derivatives.told(by_field=batch.methods.by_field)
    form = _shared(system)[0]
    instants = ""
    if form.shown < form.state:
        instants = _about_instants(system, batch.results.counts)
    return BatchSolution(batch.results, form, times, remaining, reason, told, instants)


def _why_not_asked(lanes: bool | None, n_systems: int) -> str:
    """Return why lanes are not tried, if they are not."""
    if lanes is None:
        return (
            f"a batch of {n_systems} takes them with lanes=True only: from {LARGE} "
            "systems on they are taken unasked"
        )
    return "lanes=False was given"


def _starts(
    system: System,
    states: FloatArray,
    params: ArrayLike,
    memory: ArrayLike | None,
    mode: Sequence[int] | None,
    known: Instants,
) -> Starts:
    """Return where the integrations start."""
    numbers = NO_NUMBERS
    if type(params) is not tuple or len(params) > 0:
        numbers = arguments.check_rows(params, len(states))
    if system.n_memory > 0 or memory is not None:
        numbers = arguments.with_memory(numbers, memory, system.n_memory)
    system.check_params_length(numbers.shape[1])
    modes = _shared(system)[1]
    if mode is not None:
        modes = np.zeros_like(modes)
        arguments.set_mode(modes[0], system.n_guards, mode)
    return Starts(states, numbers, modes, *known)


def _shared(system: System) -> tuple[Form, IntArray]:
    """Return what all batches of a system share: its layout, and a mode of zeros."""
    shared: tuple[Form, IntArray] | None = system.made.get(_shared)
    if shared is None:
        form = Form.of(system)
        shared = form, np.zeros((1, form.mode), dtype=np.int64)
        system.made[_shared] = shared
    return shared


def _run_in_lanes(
    batch: _Batch, workers: int | None, progress: bool
) -> tuple[IntArray | None, str]:
    """Integrate in lanes, and return the rows that remain (None: all), and why."""
    from hopdata.hybrid.lanes.room import GIVEN_UP

    total = len(batch.starts.y0)
    in_lanes, reason = batch.in_lanes()
    if in_lanes is None:
        return None, reason
    share = total // (4 * (workers or available_cores()))
    chunk = min(max(share, 4 * CHUNK), 64 * CHUNK)
    run_in_threads(in_lanes, 0, total, workers, progress, chunk)
    return np.flatnonzero(batch.results.status[:, 0] == GIVEN_UP), reason


def _run_one_by_one(
    batch: _Batch, remaining: IntArray | None, workers: int | None, progress: bool
) -> None:
    """Integrate from the states of the remaining rows; of all if there is none."""
    total = len(batch.starts.y0)
    n_in_lanes = 0
    run: Callable[[int, int], int] = batch.run
    first = 0
    if remaining is not None:
        n_in_lanes = total - len(remaining)
        first = int(remaining[0])
        run = partial(batch.run_remaining, remaining, n_in_lanes)
    done = n_in_lanes
    chunk = CHUNK
    batch.methods.specialise()
    if total == 1 and not progress:
        run(done, total)
        return
    if done < total:
        # The first runs alone, because it compiles what is not compiled yet.
        done += run(done, done + 1)
        steps = int(batch.results.counts[first, at.STEPS])
        batch.methods.specialise(batch.seconds * (total - n_in_lanes))
        chunk = min(STEPS_AT_A_TIME // (steps + 1) + 1, CHUNK)
    few = 1
    # A pool of threads takes as long as hundreds of short ones. How long they are is
    # seen from more and more of them, as the first may have ended at once.
    while done < total and batch.seconds < WORTH_THREADS and not progress:
        few = min(GROWTH * few, chunk, total - done)
        done += run(done, done + few)
    if done < total or progress:
        run_in_threads(run, done, total, workers, progress, chunk)


def _states(y0: ArrayLike, n_states: int) -> FloatArray:
    """Return the initial states as an array of finite numbers."""
    states = arguments.numbers_of("y0", y0)
    if states.ndim != 2 or states.shape[1] != n_states:
        arguments.expect(False, "y0", f"shape (B, {n_states})", states.shape)
    finite = np.isfinite(states)
    if np.count_nonzero(finite) == finite.size:  # in a third of the time of `all`
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
