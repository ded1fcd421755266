"""A run, from what the user gives and what `solve` returns to what the pass reads.

A line belongs here if it turns the user's words (a mode with open locks, events) into
the driver's (a whole mode, flips), or back. Both systems are known here: the user's,
and the extended one that is integrated (`extended`).
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid import arguments, layout
from hopdata.hybrid.first_order.linearise import Instant, field_at, guards_at
from hopdata.hybrid.gradients.workspace import Flips, Replayed, Run, Steps, Tolerance
from hopdata.hybrid.solution import Solution
from hopdata.hybrid.system import System


class Start(NamedTuple):
    """Mode (m,) and parameters (p,), with the memory behind them, at the start."""

    mode: IntArray
    params: FloatArray


def given_to_driver(
    extended: System,
    system: System,
    mode: Sequence[int] | None,
    memory: ArrayLike | None,
) -> tuple[Any, Any]:
    """Return mode and memory at the start, as the extended system has them."""
    if extended.slides is None:
        return mode, memory
    numbers = arguments.with_memory(np.empty(0), memory, system.n_memory)
    start = Start(_mode_of(system, mode), numbers)
    return with_sliding(extended, system, start)


def start_of(
    system: System,
    solution: Solution,
    t_start: float,
    params: FloatArray,
    mode: Sequence[int] | None,
    memory: ArrayLike | None,
) -> Start:
    """Return what holds at the start of a solution, all locks decided.

    The system is the user's.
    """
    numbers = arguments.with_memory(params, memory, system.n_memory)
    full = _mode_of(system, mode)
    is_open = full[: system.n_guards] == 0
    if is_open.any():
        _decide_locks(system, solution, t_start, numbers, full)
    return Start(full, numbers)


def _mode_of(system: System, mode: Sequence[int] | None) -> IntArray:
    """Return the whole mode; a lock of 0 is left open."""
    full = np.zeros(system.n_modes, dtype=np.int64)
    if mode is not None:
        arguments.set_mode(full, system.n_guards, mode)
    return full


def _decide_locks(
    system: System,
    solution: Solution,
    t_start: float,
    params: FloatArray,
    mode: IntArray,
) -> None:
    """Decide the locks that were left open by the sign of h.

    On the surface, a lock is the one from which the guard first flips, or the last one
    if it never does.
    """
    n_guards = system.n_guards
    trial = mode.copy()
    trial[:n_guards][mode[:n_guards] == 0] = -1
    state = solution.y[: system.n_states, 0].copy()
    log = solution.events
    if len(log) and log.time[0] == solution.t[0]:
        state = log.before[0, : system.n_states].copy()
    here = Instant(t_start, state, trial, params.copy())
    h, _ = guards_at(system, here, field_at(system, here))
    for k in np.flatnonzero(mode[:n_guards] == 0):
        flips = log.direction[log.guard == k]
        lock = np.sign(h[k])
        if lock == 0 and len(flips):
            lock = -np.sign(flips[0])
        elif lock == 0:
            lock = solution.mode[k]
        mode[k] = lock


def with_sliding(extended: System, system: System, start: Start) -> Start:
    """Return a start with what the extended system adds if it slides."""
    if extended.slides is None:
        return start
    own = np.zeros(extended.n_memory - system.n_memory)
    locks = extended.slides.start_mode(start.mode)
    return Start(locks, np.concatenate([start.params, own]))


def run_of(
    extended: System,
    system: System,
    solution: Solution,
    start: Start,
    tolerance: Tolerance,
) -> Run:
    """Return a solution as the pass reads it, before it is replayed.

    Where the system slides, the pass reads the log as the driver has it, with guards of
    its own; but `at_event` is told the guard and the direction that the user knows.
    """
    told = solution.events
    plain = replace(solution, form=replace(solution.form, slides=None))
    log = plain.events
    t = np.ascontiguousarray(plain.t)
    flips = Flips(
        row=np.searchsorted(t, log.time).astype(np.int64),
        guard=log.guard,
        direction=log.direction,
        counts=_counts(extended, system, log.guard, log.direction),
        told_guard=told.guard,
        told_direction=told.direction,
        before=log.before,
        after=log.after,
    )
    return Run(
        steps=Steps(t, np.ascontiguousarray(plain.y.T)),
        flips=flips,
        replayed=Replayed(
            np.tile(start.mode, (len(log) + 1, 1)),
            np.tile(start.params, (len(log) + 1, 1)),
        ),
        tolerance=tolerance,
        n_shown=system.n_states,
        ended_by_event=solution.status == layout.TERMINATED,
    )


def _counts(
    extended: System, system: System, guard: IntArray, direction: IntArray
) -> IntArray:
    """Return 1 for each flip that is an event of the user's, and 0 for the others."""
    wanted = np.array(system.directions or (0,) * system.n_guards, dtype=np.int64)
    # The guards by which sliding ends come first, and both their directions count.
    n_ends = extended.n_guards - system.n_guards
    wanted = np.append(np.zeros(n_ends, dtype=np.int64), wanted)[guard]
    return ((wanted == 0) | (wanted == direction)).astype(np.int64)
