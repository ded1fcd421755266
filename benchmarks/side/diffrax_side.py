"""diffrax: solves that end at an event, in a loop over the events, all in one compiled call."""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from peers import Found, LostEventError, Run, Solver

from side import MOST_EVENTS, Scene

jax.config.update("jax_enable_x64", True)

METHODS = {"Tsit5": diffrax.Tsit5, "Dopri8": diffrax.Dopri8}
# Bisection is exact, but takes one guard only.
BISECTION = optimistix.Bisection(rtol=1e-15, atol=1e-15, flip="detect")
NEWTON = optimistix.Newton(rtol=1e-10, atol=1e-10)
MOST_STEPS = 20_000  # between two events


def solvers(scene: Scene) -> list[Solver]:
    """Return a method of order 5 and one of order 8."""
    return [
        Solver("diffrax", "diffrax", name, partial(prepare, scene, name))
        for name in METHODS
    ]


def prepare(scene: Scene, method: str, tolerance: float) -> Run:
    """Compile once for all tolerances; return a function that runs it."""
    call, start = compiled_trajectory(scene, method), jnp.array(scene.start)
    traced = jnp.asarray(tolerance)

    def run() -> Found:
        now, y, count = jax.block_until_ready(call(start, traced))
        if not now >= scene.t_span[1]:
            raise LostEventError(f"stopped at {float(now)} after {int(count)} events")
        return np.asarray(y), int(count)

    return run


@cache
def compiled_trajectory(scene: Scene, method: str) -> Any:
    """Compile the trajectory: (y0, tolerance) -> (time and state, number of events)."""
    shapes = (jnp.array(scene.start), jnp.asarray(1e-6))
    function = partial(trajectory, scene, METHODS[method]())
    return jax.jit(function).lower(*shapes).compile()


def trajectory(scene: Scene, method: Any, y0: Any, tolerance: Any) -> Any:
    """Return the time and state reached, and the number of events."""
    rates, heights, after = (
        of(jnp) for of in (scene.rates, scene.heights, scene.after)
    )
    end = scene.t_span[1]

    def slope(t: Any, y: Any, mode: Any) -> Any:
        return jnp.stack(rates(t, y, mode))

    def guard(k: int) -> Any:
        return lambda t, y, args, **_: heights(t, y, args)[k]

    event = diffrax.Event(guard(0), BISECTION, direction=False)
    if scene.n_guards > 1:
        guards = [guard(k) for k in range(scene.n_guards)]
        event = diffrax.Event(guards, NEWTON, direction=False)

    def to_next_event(carry: Any) -> Any:
        now, y, mode, count = carry
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(slope), method, now, end, None, y, args=mode,
            stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
            saveat=diffrax.SaveAt(t1=True), event=event, adjoint=diffrax.ForwardMode(),
            max_steps=MOST_STEPS, throw=False,
        )  # fmt: skip
        now, y = solution.ts[-1], solution.ys[-1]
        happened = jax.tree.leaves(solution.event_mask)
        state, new_mode = y, mode
        for k in range(scene.n_guards):
            changed, next_mode = after(now, y, tuple(mode), k)
            state = jnp.where(happened[k], jnp.stack(changed), state)
            if scene.mode:
                new_mode = jnp.where(
                    happened[k], jnp.stack([1.0 * one for one in next_mode]), new_mode
                )
        stopped = jnp.stack(happened).any()
        now = jnp.where(stopped | (now >= end), now, jnp.inf * 0.0)
        return now, state, new_mode, count + stopped

    def unfinished(carry: Any) -> Any:
        return (carry[0] < end) & (carry[3] < MOST_EVENTS)

    start = (jnp.asarray(scene.t_span[0]), y0, jnp.array(scene.mode), 0)
    now, y, _, count = jax.lax.while_loop(unfinished, to_next_event, start)
    return now, y, count
