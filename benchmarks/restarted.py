"""SciPy's `solve_ivp`, stopped at each event and restarted in the new mode.

It calls the same Numba-compiled field and guards as our solver, with one terminal event
per guard in the direction that its lock allows. It does not handle systems with a
handler.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numba import njit
from scipy.integrate import solve_ivp

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid import System

Restarted = Callable[..., tuple[FloatArray, int]]


def restarted(
    system: System,
    params: Sequence[float],
    t_span: tuple[float, float],
    y0: Sequence[float],
) -> Restarted:
    """Return a function of `solve_ivp`'s options that gives final state and field evaluations.

    The option `first_step` applies to the start; after an event scipy chooses its own.
    """
    ivp: Any = solve_ivp
    assert system.guards is not None
    assert system.on_event is None
    rates_of, heights_of = njit(system.field.function), njit(system.guards.function)
    numbers, n_guards = np.array(params, dtype=np.float64), system.n_guards

    def slope(t: float, y: FloatArray, mode: IntArray) -> FloatArray:
        dy = np.empty_like(y)
        rates_of(t, y, mode, numbers, dy)
        return dy

    def heights(t: float, y: FloatArray, mode: IntArray) -> FloatArray:
        h, rates = np.empty(n_guards), np.empty(n_guards)
        heights_of(t, y, slope(t, y, mode), mode, numbers, h, rates)
        return h

    def event(k: int, lock: int) -> Callable[..., float]:
        def value(t: float, y: FloatArray, mode: IntArray) -> float:
            return heights(t, y, mode)[k]

        value.terminal, value.direction = True, -lock  # type: ignore[attr-defined]
        return value

    def run(
        *, first_step: float | None = None, **options: Any
    ) -> tuple[FloatArray, int]:
        now, state, evaluations = t_span[0], np.array(y0, dtype=np.float64), 0
        mode = np.full(n_guards, -1)
        mode[:] = np.where(heights(now, state, mode) > 0, 1, -1)
        while now < t_span[1]:
            part = ivp(
                slope, (now, t_span[1]), state, args=(mode,), first_step=first_step,
                events=[event(k, lock) for k, lock in enumerate(mode)], **options,
            )  # fmt: skip
            now, state, evaluations = part.t[-1], part.y[:, -1], evaluations + part.nfev
            first_step = None
            for k, times in enumerate(part.t_events):
                if len(times) > 0:
                    mode[k] = -mode[k]
        return state, evaluations

    return run
