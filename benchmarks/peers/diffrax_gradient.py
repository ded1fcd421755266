"""The gradient of `benchmarks/gradients.py` with diffrax, for its table.

It needs diffrax and NumPy alone:

    python benchmarks/peers/diffrax_gradient.py
"""

from time import perf_counter
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix

jax.config.update("jax_enable_x64", True)
COUNTS = (2, 10, 100)
END = 4.0
RTOL, ATOL = 1e-8, 1e-10
BOUNCES = 8  # that the solution has in this time
REPEATS = 100
LONGEST_S = 3.0  # for the repetitions


def rate(t: Any, y: Any, params: Any) -> Any:
    """Return the rates of height and velocity."""
    last = len(params) - 2
    place = jnp.clip(0.25 * t, 0.0, 0.999999) * last
    entry = jnp.floor(place).astype(int)
    part = place - entry
    weight = part**3 * (10.0 - 15.0 * part + 6.0 * part**2)
    following = jnp.minimum(entry + 2, len(params) - 1)
    thrust = params[entry + 1] * (1.0 - weight) + params[following] * weight
    return jnp.array([y[1], -9.81 + thrust])


def piece(t: Any, y: Any, params: Any, to_floor: bool) -> Any:
    """Return time and state at the next impact, or at the end."""
    event = None
    if to_floor:
        event = diffrax.Event(
            lambda _t, y, _args, **_: y[0],
            optimistix.Newton(rtol=1e-10, atol=1e-10),
            direction=False,
        )
    found = diffrax.diffeqsolve(
        diffrax.ODETerm(rate), diffrax.Dopri8(), t, END, None, y, params,
        stepsize_controller=diffrax.PIDController(rtol=RTOL, atol=ATOL),
        event=event, max_steps=256,
    )  # fmt: skip
    return found.ts[-1], found.ys[-1]


def height(params: Any) -> Any:
    """Return the final height."""

    def bounce(now: Any, _: Any) -> Any:
        t, y = piece(*now, params, True)
        return (t, jnp.array([0.0, -params[0] * y[1]])), t

    now, times = jax.lax.scan(
        bounce, (jnp.array(0.0), jnp.array([1.0, 0.0])), length=BOUNCES
    )
    return piece(*now, params, False)[1][0], times


def least_us(run: Any) -> float:
    """Return the least time of a call, in microseconds."""
    jax.block_until_ready(run())
    times = []
    started = perf_counter()
    while len(times) < REPEATS and perf_counter() - started < LONGEST_S:
        begin = perf_counter()
        jax.block_until_ready(run())
        times.append(perf_counter() - begin)
    return 1e6 * min(times)


def main() -> None:
    """Print the table."""
    print("| parameters | solve, us | backward | first gradient, s | gradient |")
    print("|---|---|---|---|---|")
    for count in COUNTS:
        params = jnp.array([0.85, *(2.0 * np.sin(np.arange(count - 1)))])
        value = jax.jit(height)
        slope = jax.jit(jax.grad(lambda one: height(one)[0]))
        begin = perf_counter()
        found = jax.block_until_ready(slope(params))
        first = perf_counter() - begin
        base = least_us(lambda value=value, params=params: value(params))
        cost = least_us(lambda slope=slope, params=params: slope(params))
        print(
            f"| {count} | {base:.0f} | {cost / base:.1f} | {first:.1f} | "
            f"{np.asarray(found[:2])} |"
        )
        print(value(params))


if __name__ == "__main__":
    main()
