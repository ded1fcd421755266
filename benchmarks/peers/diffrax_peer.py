"""diffrax: solves that end at an event, in a loop over the events, all in one compiled call.

The nearest guard is the only event, because of several events diffrax takes the first
in its list that changes sign within a step, not the earliest.
"""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix

from peers import HYSTERESIS, MOST_EVENTS, Found, LostEventError, Problem, Run, Solver

jax.config.update("jax_enable_x64", True)

METHODS = {"Tsit5": diffrax.Tsit5, "Dopri5": diffrax.Dopri5, "Dopri8": diffrax.Dopri8}
# Newton's method takes half the time, but may leave the step on the left and find the
# guard that has just flipped. Its last correction is the square of this tolerance.
FINDERS = {
    "bisection": optimistix.Bisection(rtol=1e-15, atol=1e-15, flip="detect"),
    "Newton": optimistix.Newton(rtol=1e-10, atol=1e-10),
}
CHOICES = (
    ("Tsit5", "bisection"), ("Tsit5", "Newton"), ("Dopri5", "bisection"), ("Dopri5", "Newton"),
    ("Dopri8", "bisection"),
)  # fmt: skip
MOST_STEPS = 100_000  # between two events


def solvers(problem: Problem) -> list[Solver]:
    """Return explicit Runge-Kutta methods with one or both root finders."""
    return [
        Solver(
            "diffrax",
            "diffrax",
            f"{name}, {finder}",
            partial(prepare, problem, name, finder),
        )
        for name, finder in CHOICES
    ]


def prepare(problem: Problem, method: str, finder: str, tolerance: float) -> Run:
    """Compile once for all tolerances; return a function that runs it."""
    call, start = compiled_trajectory(problem, method, finder), jnp.array(problem.start)
    traced = jnp.asarray(tolerance)

    def run() -> Found:
        now, y, count = jax.block_until_ready(call(start, traced))
        if not now >= problem.t_span[1]:
            raise LostEventError(f"stopped at {float(now)} after {int(count)} events")
        return np.asarray(y), int(count)

    return run


@cache
def compiled_trajectory(problem: Problem, method: str, finder: str) -> Any:
    """Compile the trajectory: (y0, tolerance) -> (time and state reached, number of events)."""
    shapes = (jnp.array(problem.start), jnp.asarray(1e-6))
    function = partial(trajectory, problem, METHODS[method](), FINDERS[finder])
    return jax.jit(function).lower(*shapes).compile()


def trajectory(
    problem: Problem, method: Any, finder: Any, y0: Any, tolerance: Any
) -> Any:
    """Return the time and state reached, and the number of events."""
    slope, height, end = problem.slope(jnp), problem.height(jnp), problem.t_span[1]
    guards = np.arange(problem.n_guards)

    def rate(_: Any, y: Any, args: Any) -> Any:
        return jnp.stack(slope(y, args[0]))

    def nearest(t: Any, y: Any, args: Any, **_: Any) -> Any:  # noqa: ARG001
        return jnp.min(args[1] * height(y, guards)) + HYSTERESIS

    event = diffrax.Event(nearest, finder, direction=False)

    def to_next_event(carry: Any) -> Any:
        now, y, locks, count, solves = carry
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(rate), method, now, jnp.where(now < end, end, now + 1.0), None, y,
            args=(problem.coefficients(locks), locks),
            stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
            saveat=diffrax.SaveAt(t1=True), event=event, adjoint=diffrax.ForwardMode(),
            max_steps=MOST_STEPS, throw=False,
        )  # fmt: skip
        now, y = solution.ts[-1], solution.ys[-1]
        crossed = locks * height(y, guards) <= 0
        return (
            now,
            y,
            jnp.where(crossed, -locks, locks),
            count + crossed.sum(),
            solves + 1,
        )

    def unfinished(carry: Any) -> Any:
        return (carry[0] < end) & (carry[4] < MOST_EVENTS)

    start = (jnp.asarray(problem.t_span[0]), y0, jnp.array(problem.locks), 0, 0)
    now, y, _, count, _ = jax.lax.while_loop(unfinished, to_next_event, start)
    return now, y, count
