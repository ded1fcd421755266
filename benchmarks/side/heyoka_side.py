"""heyoka: Taylor's method, one by one and in batches of eight, guards as terminal events."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import heyoka as hy
import numpy as np
from peers import FloatArray, Found, LostEventError, Run, Solver

from side import Scene

if hasattr(hy.llvm_state, "set_diskcache_enabled"):
    hy.llvm_state.set_diskcache_enabled(False)

REACHED_END = hy.taylor_outcome.time_limit
LANES = hy.recommended_simd_size()
SPREAD = 1e-3  # relative, between the starts of a batch


def solvers(scene: Scene) -> list[Solver]:
    """Return heyoka's two integrators."""
    return [
        Solver("heyoka", "heyoka", "Taylor", partial(prepare, scene)),
        batch_solver(scene),
    ]


def batch_solver(scene: Scene) -> Solver:
    """Return heyoka's integrator of several systems at once."""
    prepare = partial(prepare_batch, scene)
    return Solver("heyoka", "heyoka, batch", "Taylor", prepare, LANES)


def equations(scene: Scene) -> tuple[list[Any], tuple[Any, ...]]:
    """Return the rates and guards as expressions."""
    y = hy.make_vars(*[f"y{i}" for i in range(len(scene.y0))])
    if len(scene.y0) == 1:
        y = [y] if not isinstance(y, list) else y
    c = [hy.par[i] for i in range(len(scene.mode))]
    rates = scene.rates(hy)(hy.time, y, c)
    return list(zip(y, rates, strict=True)), scene.heights(hy)(hy.time, y, c)


class Clock:
    """What a callback needs: the functions of a system, and the number of events."""

    def __init__(self, scene: Scene, functions: Any) -> None:
        self.after, self.n_modes, self.count = (
            scene.after(functions),
            len(scene.mode),
            0,
        )

    def callback(self, k: int) -> Callable[[Any, int], bool]:
        """Return the callback of guard k."""

        def at_event(integrator: Any, _: int) -> bool:
            state, pars = integrator.state, integrator.pars
            mode = tuple(pars[: self.n_modes])
            y, mode = self.after(integrator.time, state.copy(), mode, k)
            state[:], pars[: self.n_modes] = y, mode
            self.count += 1
            return True

        return at_event


def integrator_of(scene: Scene, clock: Clock, tolerance: float, **options: Any) -> Any:
    """Return a compiled integrator; options are heyoka's."""
    rates, heights = equations(scene)
    kind = options.get("fp_type", float)
    events = [
        hy.t_event(
            h, callback=clock.callback(k), direction=hy.event_direction.negative,
            fp_type=kind,
        )
        for k, h in enumerate(heights)
    ]  # fmt: skip
    start = np.array(scene.y0, dtype=kind)
    return hy.taylor_adaptive(
        rates, start, pars=np.array(scene.mode, dtype=kind), tol=kind(tolerance),
        t_events=events, **options,
    )  # fmt: skip


def prepare(scene: Scene, tolerance: float) -> Run:
    """Compile the integrator; return a function that resets and runs it."""
    clock = Clock(scene, math)
    integrator = integrator_of(scene, clock, tolerance)
    start, end = scene.start, scene.t_span[1]

    def run() -> Found:
        clock.count = 0
        integrator.state[:], integrator.pars[: len(scene.mode)] = start, scene.mode
        integrator.time = scene.t_span[0]
        integrator.reset_cooldowns()
        outcome = integrator.propagate_until(end)[0]
        if outcome != REACHED_END:
            raise LostEventError(str(outcome))
        return integrator.state.copy(), clock.count

    return run


def prepare_batch(scene: Scene, tolerance: float) -> Run:
    """Return a function that runs a batch; its first system is the scene itself."""
    rates, heights = equations(scene)
    after, n_modes, counts = scene.after(math), len(scene.mode), np.zeros(LANES, int)

    def callback(k: int) -> Any:
        def at_event(integrator: Any, _: int, lane: int) -> bool:
            state, pars = integrator.state, integrator.pars
            mode = tuple(pars[:n_modes, lane])
            y, mode = after(integrator.time[lane], state[:, lane].copy(), mode, k)
            state[:, lane], pars[:n_modes, lane] = y, mode
            counts[lane] += 1
            return True

        return at_event

    events = [
        hy.t_event_batch(h, callback=callback(k), direction=hy.event_direction.negative)
        for k, h in enumerate(heights)
    ]
    starts = np.outer(scene.start, 1.0 + SPREAD * np.arange(LANES) / LANES)
    modes = np.tile(np.array(scene.mode)[:, None], LANES)
    integrator = hy.taylor_adaptive_batch(
        rates, starts.copy(), pars=modes.copy(), tol=tolerance, t_events=events
    )
    ends: FloatArray = np.full(LANES, scene.t_span[1])
    begin = np.full(LANES, scene.t_span[0])

    def run() -> Found:
        counts[:] = 0
        integrator.state[:], integrator.pars[:n_modes] = starts, modes
        integrator.set_time(begin)
        integrator.reset_cooldowns()
        integrator.propagate_until(ends)
        outcomes = [one[0] for one in integrator.propagate_res]
        if any(one != REACHED_END for one in outcomes):
            raise LostEventError(str(outcomes))
        return integrator.state[:, 0].copy(), int(counts[0])

    return run


class LongDouble:
    """Elementary functions of long doubles, for callbacks."""

    sin, cos, sqrt = np.sin, np.cos, np.sqrt


def in_long_double(scene: Scene) -> tuple[list[Any], int]:
    """Return the final state, and the number of events, with 64 bits of mantissa."""
    clock = Clock(scene, LongDouble)
    integrator = integrator_of(scene, clock, 1e-18, fp_type=np.longdouble)
    outcome = integrator.propagate_until(np.longdouble(scene.t_span[1]))[0]
    if outcome != REACHED_END:
        raise LostEventError(str(outcome))
    end = [np.format_float_scientific(one, 20) for one in integrator.state]
    return end, clock.count
