"""SciPy: `solve_ivp`, stopped at each event and restarted; in plain Python, and compiled."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
from numba import njit
from peers import FloatArray, Found, LostEventError, Run, Solver
from scipy.integrate import solve_ivp

from side import MOST_EVENTS, Scene

METHODS = ("RK45", "DOP853", "LSODA")


def solvers(scene: Scene) -> list[Solver]:
    """Return three methods, in plain Python and with functions compiled by Numba."""
    kinds = {"Python": lambda function: function, "Numba": njit}
    return [
        Solver(
            "SciPy", f"SciPy, {kind}", method, partial(prepare, scene, compiled, method)
        )
        for kind, compiled in kinds.items()
        for method in METHODS
    ]


def prepare(scene: Scene, compiled: Any, method: str, tolerance: float) -> Run:
    """Return the loop over the events."""
    ivp: Any = solve_ivp
    rates = compiled(scene.rates(math))
    heights = compiled(scene.heights(math))
    after = scene.after(math)
    end = scene.t_span[1]

    def guard(k: int) -> Any:
        def value(t: float, y: FloatArray, mode: tuple[float, ...]) -> float:
            return heights(t, y, mode)[k]

        value.terminal, value.direction = True, -1  # type: ignore[attr-defined]
        return value

    guards = [guard(k) for k in range(scene.n_guards)]

    def run() -> Found:
        now, y, mode = scene.t_span[0], scene.start, scene.mode
        for count in range(MOST_EVENTS):
            part = ivp(
                rates, (now, end), y, method=method, events=guards, args=(mode,),
                rtol=tolerance, atol=tolerance,
            )  # fmt: skip
            now, y = part.t[-1], part.y[:, -1]
            if part.status < 0:
                raise LostEventError(part.message)
            if part.status == 0:
                return y, count
            k = next(k for k, times in enumerate(part.t_events) if len(times) > 0)
            state, mode = after(now, y, mode, k)
            y = np.array(state)
        raise LostEventError(f"more than {MOST_EVENTS} events")

    return run
