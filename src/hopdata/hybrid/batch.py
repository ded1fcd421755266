"""`solve_batch`: integrate one system from many initial states, in parallel."""

import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass
from itertools import islice
from math import inf

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.hybrid import arguments
from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.callbacks import Caught
from hopdata.hybrid.derived import ask_derived, goes_back
from hopdata.hybrid.driver.loop import (
    END_STATE,
    Request,
    Results,
    Starts,
    many_entry,
)
from hopdata.hybrid.system import System
from hopdata.hybrid.workspace import FIRST_PATIENCE

# A job runs in threads, chunk by chunk, and shows its progress.

CHUNK = 64  # integrations that a thread takes at a time; results do not depend on it
# Most steps in a chunk of more than one integration: Ctrl-C takes effect only between
# chunks.
STEPS_AT_A_TIME = 200_000
# Number of systems from which lanes pay off: compilation takes 0.5 s, and each system
# saves 10 to 20 us.
LARGE = 50_000
BETWEEN_S = 0.1  # interval of progress messages on stderr


def run_in_threads(
    run: Callable[[int, int], int], done: int, total: int, workers: int | None, progress: bool,
    chunk: int = CHUNK,
) -> None:  # fmt: skip
    """Run a job on the indices from `done` up to `total`, one chunk at a time in each thread.

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
    start, last = time.monotonic(), -inf
    for count in _counts(run, chunks, min(workers or available_cores(), len(chunks))):
        done, now = done + count, time.monotonic()
        if progress and (done == total or now - last > BETWEEN_S):
            last, end = now, "\n" if done == total else ""
            line = f"\r{done} of {total} integrations, {now - start:.1f} s"
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
    pool, rest = ThreadPoolExecutor(workers), iter(chunks)
    # Queue few chunks: Ctrl-C during a submit may surface as an error of the threads'
    # lock
    try:
        under_way = {pool.submit(run, *c) for c in islice(rest, 2 * workers)}
        while under_way:
            ended, under_way = wait(under_way, return_when=FIRST_COMPLETED)
            under_way |= {pool.submit(run, *c) for c in islice(rest, len(ended))}
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
    n_unproven : (B,) array of int
        Steps in which guards that branch were only sampled, as in `Solution`.
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
    """

    status: IntArray
    t_end: FloatArray
    y_end: FloatArray
    mode: IntArray
    n_events: IntArray
    n_steps: IntArray
    nfev: IntArray
    n_unproven: IntArray
    culprit: IntArray
    rates: FloatArray
    guard_names: tuple[str, ...]
    lanes: BoolArray
    lanes_reason: str
    t: FloatArray | None = None
    y: FloatArray | None = None
    jacobian: FloatArray | None = None
    sensitivity: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.status)

    def __repr__(self) -> str:
        return f"BatchSolution of {len(self)} integrations\n{self.message}"

    @property
    def success(self) -> bool:
        """Whether all reached the end of the time span or a terminal event."""
        return bool((self.status >= 0).all())

    @property
    def message(self) -> str:
        """How the integrations ended: one line for each status, with the number of runs."""
        _, places, numbers = np.unique(
            self.status, return_index=True, return_counts=True
        )
        return "\n".join(
            f"{count} of {len(self)}, such as number {place}: {self._sentence(place)}"
            for count, place in zip(numbers, places, strict=True)
        )

    def _sentence(self, place: int) -> str:
        return at.describe(
            int(self.status[place]), time=self.t_end[place], culprit=self.culprit[place],
            names=self.guard_names, rates=self.rates[place],
        )  # fmt: skip


class _Room:
    """Arrays that the threads fill; each thread writes its own rows."""

    def __init__(
        self, n_runs: int, system: System, n_wanted: int, jacobian: bool
    ) -> None:
        n = system.n_states
        self.status = np.zeros((n_runs, 1), dtype=np.int64)
        self.ends = np.empty((n_runs, END_STATE + n))
        self.modes = np.empty((n_runs, system.n_modes), dtype=np.int64)
        self.counts = np.empty((n_runs, at.COUNT_SLOTS), dtype=np.int64)
        self.samples = np.empty((n_runs if n_wanted else 0, n_wanted, n))
        self.jacobians = np.empty((n_runs if jacobian else 0, n, n))
        self.arrays = tuple(vars(self).values())  # in the order above


def solve_batch(
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
    if goes_back(t_span) or isinstance(jacobian, str):
        return ask_derived(
            solve_batch, system, t_span=t_span, y0=states, params=params, t_eval=t_eval, atol=atol,
            jacobian=jacobian, mode=mode, rtol=rtol, max_step=max_step, first_step=first_step,
            max_steps=max_steps, max_events=max_events, method=method, memory=memory,
            workers=workers, progress=progress, lanes=lanes,
        )  # fmt: skip
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
    times = (
        np.empty(0) if t_eval is None else arguments.check_times(t_eval, *options[:2])
    )
    room = _Room(len(states), system, len(times), jacobian)
    left, reason = np.arange(len(states)), "they were not requested"
    if len(states) >= LARGE if lanes is None else arguments.check_flag("lanes", lanes):
        from hopdata.hybrid.lanes.batch import lane_runner
        from hopdata.hybrid.lanes.room import GIVEN_UP

        limits = np.empty(system.n_states)
        arguments.set_tolerance(limits, atol)
        arrays = (states, numbers, modes, *room.arrays[:-1], times, limits)
        in_lanes, reason = lane_runner(system, method, jacobian, arrays, options)
        if in_lanes is not None:
            share = len(states) // (4 * (workers or available_cores()))
            chunk = min(max(share, 4 * CHUNK), 64 * CHUNK)
            run_in_threads(in_lanes, 0, len(states), workers, progress, chunk)
            left = np.flatnonzero(room.status[:, 0] == GIVEN_UP)
    begun = len(states) - len(left)

    def run(first: int, last: int) -> int:
        methods, work, done = (
            system.methods(method, jacobian),
            system.take_workspace(),
            first,
        )
        try:
            work.begin(methods, times if len(times) else None, jacobian)
            work.make_params_room(numbers.shape[1] - system.n_memory)
            work.set_tolerance(atol)
            work.desk[at.PATIENCE] = np.iinfo(np.int64).max // 2
            with Caught() as caught:
                while done < last and not caught:
                    done = many_entry()(
                        work.desk,
                        done,
                        last,
                        Starts(states, numbers, modes),
                        Results(*room.arrays),
                        Request(*options),
                    )
                    if done < last:
                        methods.provide(int(work.counts[at.METHOD]))
            if caught:
                raise caught[0]
            methods.steps += int(room.counts[first:last, at.STEPS].sum())
        finally:
            work.forget_samples()
            work.desk[at.PATIENCE] = FIRST_PATIENCE
            system.idle.append(work)
        return last - first

    def run_left(first: int, last: int) -> int:
        rows = left[first - begun : last - begun]
        for piece in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            run(int(piece[0]), int(piece[-1]) + 1)
        return last - first

    done, chunk = begun, CHUNK
    if (
        len(left) > 0
    ):  # run the first alone, because it compiles what is not compiled yet
        done += run_left(begun, begun + 1)
        steps = int(room.counts[left[0], at.STEPS])
        system.methods(method, jacobian).specialise(steps * len(left))
        chunk = min(STEPS_AT_A_TIME // (steps + 1) + 1, CHUNK)
    run_in_threads(run_left, done, len(states), workers, progress, chunk)
    return _solution(room, times, jacobian, system, left, reason)


def _states(y0: ArrayLike, n_states: int) -> FloatArray:
    states = arguments.numbers_of("y0", y0)
    fits = states.ndim == 2 and states.shape[1] == n_states
    arguments.expect(fits, "y0", f"shape (B, {n_states})", states.shape)
    for row in np.flatnonzero(~np.isfinite(states).all(axis=1)):
        arguments.expect(False, "y0", "finite numbers", f"{states[row]} in row {row}")
    return states


def _solution(
    room: _Room,
    times: FloatArray,
    jacobian: bool,
    system: System,
    left: IntArray,
    reason: str,
) -> BatchSolution:
    y, shown = None, system.n_shown
    if len(times):
        room.samples[np.arange(len(times)) >= room.counts[:, at.SAMPLES, None]] = np.nan
        y = np.ascontiguousarray(np.swapaxes(room.samples[..., :shown], 1, 2))
    return BatchSolution(
        status=room.status[:, 0], t_end=system.way * room.ends[:, 0],
        y_end=room.ends[:, END_STATE : END_STATE + shown], mode=room.modes,
        n_events=room.counts[:, at.EVENTS], n_steps=room.counts[:, at.STEPS],
        nfev=room.counts[:, at.NFEV], n_unproven=room.counts[:, at.UNPROVEN],
        t=system.way * times if len(times) else None, y=y,
        jacobian=room.jacobians[:, :shown, :shown] if jacobian else None,
        sensitivity=room.jacobians[:, :shown, shown:] if shown < system.n_states else None,
        culprit=room.counts[:, at.CULPRIT], rates=room.ends[:, 1:END_STATE],
        guard_names=system.guard_names, lanes=~np.isin(np.arange(len(room.status)), left),
        lanes_reason=reason,
    )  # fmt: skip
