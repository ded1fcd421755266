"""`solve_batch`: one system from many initial states, over the cores."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.hybrid.arguments import (
    check_count,
    check_flag,
    check_numbers,
    check_times,
    numbers_of,
    set_mode,
    with_memory,
)
from hopdata.hybrid.compiled.unraisable import Caught
from hopdata.hybrid.driver.layout import COUNT_SLOTS, CULPRIT, EVENTS, METHOD, NFEV, SAMPLES, STEPS
from hopdata.hybrid.driver.many import END_STATE, many_entry
from hopdata.hybrid.parallel import run_in_threads
from hopdata.hybrid.solution import FloatArray, IntArray
from hopdata.hybrid.status import describe
from hopdata.hybrid.system import System


@dataclass(frozen=True, repr=False)
class BatchSolution:
    """Where many integrations ended; B of them.

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
    t : (N,) array, optional
        `t_eval`, if given.
    y : (B, n, N) array, optional
        States at these times; NaN after an integration has ended.
    jacobian : (B, n, n) array, optional
        Derivatives of the final by the initial states, if asked for.
    culprit : (B,) array of int, optional
        Number of the guard that the status is about, -1 if there is none.
    rates : (B, 2) array, optional
        Its rates before its last two flips, rising and falling, 1/s.
    guard_names : tuple of str
        Names of all guards.
    """

    status: IntArray
    t_end: FloatArray
    y_end: FloatArray
    mode: IntArray
    n_events: IntArray
    n_steps: IntArray
    nfev: IntArray
    t: FloatArray | None = None
    y: FloatArray | None = None
    jacobian: FloatArray | None = None
    culprit: IntArray | None = None
    rates: FloatArray | None = None
    guard_names: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.status)

    def __repr__(self) -> str:
        return f"BatchSolution of {len(self)} integrations\n{self.message}"

    @property
    def success(self) -> bool:
        """Whether all reached the end of the time span, or an event that ends it."""
        return bool((self.status >= 0).all())

    @property
    def message(self) -> str:
        """How many ended in which way."""
        codes, numbers = np.unique(self.status, return_counts=True)
        places = [int(np.flatnonzero(self.status == code)[0]) for code in codes]
        return "\n".join(
            f"{count} of {len(self)}, such as number {place}: {self._sentence(place)}"
            for count, place in zip(numbers, places, strict=True)
        )

    def _sentence(self, place: int) -> str:
        number = -1 if self.culprit is None else int(self.culprit[place])
        guard = self.guard_names[number] if number >= 0 else ""
        time, status = float(self.t_end[place]), int(self.status[place])
        below, above = (0.0, 0.0) if self.rates is None else self.rates[place]
        return describe(status, time=time, guard=guard, rates=(float(below), float(above)))


class _Room:
    """Arrays that the threads fill, each its own rows."""

    def __init__(self, n_runs: int, system: System, n_wanted: int, jacobian: bool) -> None:
        n = system.n_states
        self.status = np.zeros((n_runs, 1), dtype=np.int64)
        self.ends = np.empty((n_runs, END_STATE + n))
        self.modes = np.empty((n_runs, system.n_modes), dtype=np.int64)
        self.counts = np.empty((n_runs, COUNT_SLOTS), dtype=np.int64)
        self.samples = np.empty((n_runs if n_wanted else 0, n_wanted, n))
        self.jacobians = np.empty((n_runs if jacobian else 0, n, n))

    @property
    def arrays(self) -> tuple[Any, ...]:
        return (
            self.status, self.ends, self.modes, self.counts, self.samples, self.jacobians
        )  # fmt: skip


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
    max_steps: int = 10_000_000,
    max_events: int = 10_000_000,
    method: str = "auto",
    jacobian: bool = False,
    memory: ArrayLike | None = None,
    workers: int | None = None,
    progress: bool = False,
) -> BatchSolution:
    """Integrate a system from many initial states; options as in `solve`.

    Each result has the bytes that `solve` gives, whatever the number of workers. Trajectories and
    events are not kept: take `t_eval`, or `solve` for single ones.

    Parameters
    ----------
    y0 : (B, n) array_like
        Initial states.
    params : (p,) or (B, p) array_like
        Parameters of all, or of each.
    workers : int, optional
        Threads; by default one for each core that this process may use.
    progress : bool
        Whether to show on stderr how far it is.

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
    options = check_numbers(t_span, rtol, max_step, first_step, max_steps, max_events)
    if workers is not None:
        workers = check_count("workers", workers)
    jacobian = check_flag("jacobian", jacobian)
    states = _states(y0, system.n_states)
    numbers = with_memory(_parameters(params, len(states)), memory, system.n_memory)
    system.check_params_length(numbers.shape[1])
    modes = np.zeros((1, system.n_modes), dtype=np.int64)
    if mode is not None:
        set_mode(modes[0], system.n_guards, mode)
    times = np.empty(0) if t_eval is None else check_times(t_eval, *options[:2])
    room = _Room(len(states), system, len(times), jacobian)

    def run(first: int, last: int) -> int:
        methods, work = system.methods(method, jacobian), system.take_workspace()
        done = first
        try:
            work.begin(methods, times if len(times) else None, jacobian)
            work.make_params_room(numbers.shape[1] - system.n_memory)
            work.set_tolerance(atol)
            with Caught() as caught:
                while done < last and not caught:
                    done = many_entry()(
                        work.desk, done, last, states, numbers, modes, *room.arrays, *options
                    )
                    if done < last:
                        methods.provide(int(work.counts[METHOD]))
            if caught:
                raise caught[0]
            methods.steps += int(room.counts[first:last, STEPS].sum())
        finally:
            work.forget_samples()
            system.idle.append(work)
        return last - first

    done = run(0, min(1, len(states)))  # alone: it compiles what is not compiled yet
    steps = int(room.counts[:done, STEPS].sum()) * len(states)
    system.methods(method, jacobian).specialise(steps)
    run_in_threads(run, done, len(states), workers, progress)
    return _solution(room, times, jacobian, system.guard_names)


def _states(y0: ArrayLike, n_states: int) -> FloatArray:
    states = numbers_of("y0", y0)
    if states.ndim != 2 or states.shape[1] != n_states:
        raise ValueError(f"y0: expected shape (B, {n_states}), found {states.shape}")
    bad = np.flatnonzero(~np.isfinite(states).all(axis=1))
    if len(bad) > 0:
        raise ValueError(f"y0: expected finite numbers, found {states[bad[0]]} in row {bad[0]}")
    return states


def _parameters(params: ArrayLike, n_runs: int) -> FloatArray:
    numbers = np.atleast_2d(numbers_of("params", params))
    if numbers.ndim != 2 or len(numbers) not in (1, n_runs):
        raise ValueError(f"params: expected shape (p,) or ({n_runs}, p), found {np.shape(params)}")
    return np.ascontiguousarray(numbers)


def _solution(
    room: _Room, times: FloatArray, jacobian: bool, guard_names: tuple[str, ...]
) -> BatchSolution:
    y = None
    if len(times):
        room.samples[np.arange(len(times)) >= room.counts[:, SAMPLES, None]] = np.nan
        y = np.ascontiguousarray(np.swapaxes(room.samples, 1, 2))
    return BatchSolution(
        status=room.status[:, 0],
        t_end=room.ends[:, 0],
        y_end=room.ends[:, END_STATE:],
        mode=room.modes,
        n_events=room.counts[:, EVENTS],
        n_steps=room.counts[:, STEPS],
        nfev=room.counts[:, NFEV],
        t=times if len(times) else None,
        y=y,
        jacobian=room.jacobians if jacobian else None,
        culprit=room.counts[:, CULPRIT],
        rates=room.ends[:, 1:END_STATE],
        guard_names=guard_names,
    )
