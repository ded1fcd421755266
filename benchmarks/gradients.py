# ruff: noqa: ARG001 (the functions of a system have prescribed arguments)
"""What a gradient through events costs: forward and backward, for many parameters.

A ball bounces on a floor under a thrust that follows a table over time, whose entries
are the parameters, after the restitution. The derivative of the final height is wanted.
`benchmarks/peers/diffrax_gradient.py` does the
same with diffrax.

    python benchmarks/gradients.py --out gradients.csv
"""

import argparse
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd

from hopdata.hybrid import System, field, guards, on_event, solve
from hopdata.hybrid.gradients import gradient

COUNTS = (2, 10, 100)
SPAN = (0.0, 4.0)
START = [1.0, 0.0]
RTOL, ATOL = 1e-8, 1e-10
REPEATS = 100
LONGEST_S = 2.0  # for the repetitions


@field
def ball(t, y, mode, params, dy):
    last = len(params) - 2
    place = min(max(0.25 * t, 0.0), 0.999999) * last
    entry = int(place)
    part = place - entry
    weight = part**3 * (10.0 - 15.0 * part + 6.0 * part**2)
    following = min(entry + 2, len(params) - 1)
    dy[0] = y[1]
    dy[1] = -9.81 + params[entry + 1] * (1.0 - weight) + params[following] * weight


@guards
def floor(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = -y[0], -dy[0]


@on_event
def bounce(t, y, mode, params, guard, direction):
    if direction > 0:
        y[1] *= -params[0]
    return 0


BALL = System(ball, floor, bounce, n_states=2, guard_names=("floor",))


def height(t, y, params):
    return y[0]


def parameters(count: int) -> Any:
    """Return the restitution and the entries of the table."""
    return np.array([0.85, *(2.0 * np.sin(np.arange(count - 1)))])


def least_us(run: Any) -> float:
    """Return the least time of a call, in microseconds."""
    run()
    times = []
    started = perf_counter()
    while len(times) < REPEATS and perf_counter() - started < LONGEST_S:
        begin = perf_counter()
        run()
        times.append(perf_counter() - begin)
    return 1e6 * min(times)


def row_of(count: int) -> dict[str, Any]:
    """Return what the gradient costs with this number of parameters."""
    options = {
        "params": parameters(count),
        "rtol": RTOL,
        "atol": ATOL,
        "method": "dop853",
    }

    def plain() -> Any:
        return solve(BALL, SPAN, START, **options)

    def forward() -> Any:
        return solve(BALL, SPAN, START, jacobian="params", **options)

    def backward() -> Any:
        return gradient(BALL, SPAN, START, at_end=height, **options)

    base_us = least_us(plain)
    sensitivity = forward().sensitivity[0]
    apart = np.abs(backward().by_params - sensitivity).max()
    return {
        "parameters": count,
        "solve_us": base_us,
        "forward": least_us(forward) / base_us,
        "backward": least_us(backward) / base_us,
        "largest_difference": apart / np.abs(sensitivity).max(),
    }


def main() -> None:
    """Write the table, and print it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    table = pd.DataFrame([row_of(count) for count in COUNTS])
    table.to_csv(arguments.out, index=False)
    print(table.to_string(index=False, float_format="%.3g"))


if __name__ == "__main__":
    main()
