"""SciPy: `solve_ivp`, stopped at each event and started again.

In plain Python every guard is an event function of its own, as a user would write it. With Numba
the field is one compiled call, and the nearest guard the only event function.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from peers.compiled import Compiled, compiled
from peers.problems import Problem
from peers.solver import MOST_EVENTS, FloatArray, LostEventError, Run, Solver

METHODS = ("RK45", "DOP853", "LSODA", "Radau")
Begin = Callable[[], tuple[Any, Any, Any]]  # slope(t, y), events, what to do at an event


def solvers(problem: Problem) -> list[Solver]:
    """Return `solve_ivp` with each method, in plain Python and with compiled functions."""
    functions = compiled(problem)
    kinds = {"Python": partial(begin_plain, problem), "Numba": partial(begin_compiled, functions)}
    return [
        Solver("SciPy", f"SciPy, {kind}", method, partial(prepare, problem, begin, method))
        for kind, begin in kinds.items()
        for method in METHODS
    ]


def begin_plain(problem: Problem) -> tuple[Any, Any, Any]:
    """Return the scene in plain Python, at its start."""
    rate, height = problem.slope(math), problem.height(math)
    locks = problem.locks
    state: dict[str, Any] = {"c": tuple(map(float, problem.coefficients(locks)))}

    def guard(k: int) -> Any:
        def value(_: float, y: FloatArray) -> float:
            return height(y.tolist(), k)

        value.terminal, value.direction = True, -locks[k]  # type: ignore[attr-defined]
        return value

    events = [guard(k) for k in range(problem.n_guards)]

    def at_event(_: FloatArray, times: list[FloatArray]) -> None:
        for k, found in enumerate(times):
            if len(found) > 0:
                locks[k] = -locks[k]
                events[k].direction = -locks[k]
        state["c"] = tuple(map(float, problem.coefficients(locks)))

    return lambda _, y: rate(y.tolist(), state["c"]), events, at_event


def begin_compiled(functions: Compiled) -> tuple[Any, Any, Any]:
    """Return the scene in compiled functions, at its start."""
    field, nearest, data = functions.field, functions.nearest, functions.data.copy()

    def event(_: float, y: FloatArray) -> float:
        return nearest(y, data)

    event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
    return lambda _, y: field(y, data), event, lambda y, _: functions.flip(y, data)


def prepare(problem: Problem, begin: Begin, method: str, tolerance: float) -> Run:
    """Return the loop over the events."""
    ivp: Any = solve_ivp
    end = problem.t_span[1]

    def run() -> FloatArray:
        slope, events, at_event = begin()
        now, y = problem.t_span[0], problem.start
        for _ in range(MOST_EVENTS):
            part = ivp(
                slope, (now, end), y, method=method, events=events, rtol=tolerance, atol=tolerance
            )
            now, y = part.t[-1], part.y[:, -1]
            if part.status < 0:
                raise LostEventError(part.message)
            if part.status == 0:
                return y
            at_event(np.ascontiguousarray(y), part.t_events)
        raise LostEventError(f"more than {MOST_EVENTS} events")

    return run
