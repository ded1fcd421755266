"""heyoka: Taylor's method, with every guard a terminal event whose callback changes parameters.

The coefficients of the scene are `par[]`. A callback looks them up by the set of locks;
they are computed when a set first occurs, which is before the timing. The tolerance is
compiled in.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import heyoka as hy
import numpy as np

from peers import FloatArray, Found, LostEventError, Problem, Run, Solver

if hasattr(hy.llvm_state, "set_diskcache_enabled"):
    hy.llvm_state.set_diskcache_enabled(
        False
    )  # so that `compile_s` is the cost of a new system

REACHED_END = hy.taylor_outcome.time_limit


def solvers(problem: Problem) -> list[Solver]:
    """Return the adaptive Taylor integrator."""
    return [Solver("heyoka", "heyoka", "Taylor", partial(prepare, problem))]


class Coefficients:
    """Coefficients for each set of locks that occurs; bit k of the set is lock k."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.start = sum(1 << k for k, lock in enumerate(problem.locks) if lock > 0)
        self.known: dict[int, FloatArray] = {}
        self.locks, self.events = self.start, 0

    def now(self) -> FloatArray:
        """Return the coefficients for the current locks."""
        values = self.known.get(self.locks)
        if values is None:
            bits = self.locks >> np.arange(self.problem.n_guards) & 1
            values = np.array(
                self.problem.coefficients(2.0 * bits - 1.0), dtype=np.float64
            )
            self.known[self.locks] = values
        return values


def at_event(
    guard: int, coefficients: Coefficients, pars: list[FloatArray]
) -> Callable[..., bool]:
    """Return the callback of a guard: the sign of its rate is its new lock."""
    bit = 1 << guard

    def callback(_: Any, sign: int) -> bool:
        coefficients.events += 1
        if sign > 0:
            coefficients.locks |= bit
        else:
            coefficients.locks &= ~bit
        pars[0][:] = coefficients.now()
        return True

    return callback


def prepare(problem: Problem, tolerance: float) -> Run:
    """Compile the integrator; return a function that resets and runs it."""
    n = len(problem.y0)
    y = hy.make_vars(*[f"y{i}" for i in range(n)])
    coefficients = Coefficients(problem)
    first = coefficients.now()
    c, height = [hy.par[i] for i in range(len(first))], problem.height(hy)
    rates = problem.slope(hy)(y, c)
    pars: list[FloatArray] = []
    events = [
        hy.t_event(height(y, k), callback=at_event(k, coefficients, pars))
        for k in range(problem.n_guards)
    ]
    integrator = hy.taylor_adaptive(
        list(zip(y, rates, strict=True)),
        problem.start,
        pars=first,
        tol=tolerance,
        t_events=events,
    )
    pars.append(integrator.pars)
    state, start, end = integrator.state, problem.start, problem.t_span[1]

    def run() -> Found:
        coefficients.locks, coefficients.events = coefficients.start, 0
        state[:], pars[0][:], integrator.time = start, first, problem.t_span[0]
        integrator.reset_cooldowns()
        outcome = integrator.propagate_until(end)[0]
        if outcome != REACHED_END:
            raise LostEventError(str(outcome))
        return state.copy(), coefficients.events

    return run
