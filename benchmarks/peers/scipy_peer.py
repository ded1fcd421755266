"""SciPy: `solve_ivp`, stopped at each event and restarted.

In plain Python, every guard is a separate event function, as a user would write it.
With Numba, the field is one compiled call and the nearest guard is the only event
function.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np
from numba import njit
from scipy.integrate import solve_ivp

from peers import (
    HYSTERESIS,
    MOST_EVENTS,
    FloatArray,
    Found,
    LostEventError,
    Problem,
    Run,
    Solver,
)

# The functions of a scene, compiled by Numba for the peers that take callbacks.


@dataclass(frozen=True, eq=False)
class Compiled:
    """Compiled functions of ``data``, which holds the coefficients and then the locks.

    Parameters
    ----------
    data : array
        Coefficients and locks at the start.
    field : callable
        ``field(y, data)`` returns the rate of the state.
    fill : callable
        ``fill(y, data, dy)`` writes the rate of the state to ``dy``.
    nearest : callable
        ``nearest(y, data)`` is the least distance to a guard, positive until one is
        crossed.
    flip : callable
        ``flip(y, data)`` flips the locks of crossed guards, sets the coefficients, and
        returns the number of flips.
    """

    data: FloatArray
    field: Any
    fill: Any
    nearest: Any
    flip: Any


@cache
def compiled(problem: Problem) -> Compiled:
    """Compile a scene (each function at its first call)."""
    rate, height = njit(problem.slope(math)), njit(problem.height(math))
    coefficients, n_guards = njit(problem.coefficients), problem.n_guards
    start = np.array(problem.coefficients(problem.locks), dtype=np.float64)
    first = len(start)

    @njit(error_model="numpy")
    def field(y: FloatArray, data: FloatArray) -> FloatArray:
        return np.array(rate(y, data))

    @njit(error_model="numpy")
    def fill(y: FloatArray, data: FloatArray, dy: FloatArray) -> None:
        rates = rate(y, data)
        for i in range(len(rates)):
            dy[i] = rates[i]

    @njit(error_model="numpy")
    def nearest(y: FloatArray, data: FloatArray) -> float:
        least = np.inf
        for k in range(n_guards):
            least = min(least, data[first + k] * height(y, k))
        return least + HYSTERESIS

    @njit(error_model="numpy")
    def flip(y: FloatArray, data: FloatArray) -> int:
        locks, count = data[first:], 0
        for k in range(n_guards):
            if locks[k] * height(y, k) <= 0.0:
                locks[k], count = -locks[k], count + 1
        values = coefficients(locks)
        for i in range(first):
            data[i] = values[i]
        return count

    return Compiled(np.concatenate([start, problem.locks]), field, fill, nearest, flip)


METHODS = ("RK45", "DOP853", "LSODA", "Radau")
Begin = Callable[[], tuple[Any, Any, Any]]  # slope(t, y), events, action at an event


def solvers(problem: Problem) -> list[Solver]:
    """Return `solve_ivp` with each method, in plain Python and with compiled functions."""
    functions = compiled(problem)
    kinds = {
        "Python": partial(begin_plain, problem),
        "Numba": partial(begin_compiled, functions),
    }
    return [
        Solver(
            "SciPy", f"SciPy, {kind}", method, partial(prepare, problem, begin, method)
        )
        for kind, begin in kinds.items()
        for method in METHODS
    ]


def begin_plain(problem: Problem) -> tuple[Any, Any, Any]:
    """Return the scene in plain Python at its start."""
    rate, height = problem.slope(math), problem.height(math)
    locks = problem.locks
    state: dict[str, Any] = {"c": tuple(map(float, problem.coefficients(locks)))}

    def guard(k: int) -> Any:
        def value(_: float, y: FloatArray) -> float:
            return height(y.tolist(), k)

        value.terminal, value.direction = True, -locks[k]  # type: ignore[attr-defined]
        return value

    events = [guard(k) for k in range(problem.n_guards)]

    def at_event(_: FloatArray, times: list[FloatArray]) -> int:
        for k, found in enumerate(times):
            if len(found) > 0:
                locks[k] = -locks[k]
                events[k].direction = -locks[k]
        state["c"] = tuple(map(float, problem.coefficients(locks)))
        return sum(len(found) > 0 for found in times)

    return lambda _, y: rate(y.tolist(), state["c"]), events, at_event


def begin_compiled(functions: Compiled) -> tuple[Any, Any, Any]:
    """Return the scene in compiled functions at its start."""
    field, nearest, data = functions.field, functions.nearest, functions.data.copy()

    def event(_: float, y: FloatArray) -> float:
        return nearest(y, data)

    event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
    return lambda _, y: field(y, data), event, lambda y, _: functions.flip(y, data)


def prepare(problem: Problem, begin: Begin, method: str, tolerance: float) -> Run:
    """Return the loop over the events."""
    ivp: Any = solve_ivp
    end = problem.t_span[1]

    def run() -> Found:
        slope, events, at_event = begin()
        now, y, count = problem.t_span[0], problem.start, 0
        for _ in range(MOST_EVENTS):
            part = ivp(
                slope,
                (now, end),
                y,
                method=method,
                events=events,
                rtol=tolerance,
                atol=tolerance,
            )
            now, y = part.t[-1], part.y[:, -1]
            if part.status < 0:
                raise LostEventError(part.message)
            if part.status == 0:
                return y, count
            count += at_event(np.ascontiguousarray(y), part.t_events)
        raise LostEventError(f"more than {MOST_EVENTS} events")

    return run
