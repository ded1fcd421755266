# ruff: noqa: ARG001, ARG005 (the integrators prescribe the signatures)
"""Ten thousand pendulums and their events: batches of ours, in lanes and by the driver, and peers'.

    python benchmarks/batches.py --out batches.csv

x'' = -sin x from rest at x0 in [-2, 2] (seed 0) for 10 s, at a tolerance of 1e-9; the guard x = 0
is crossed three times or so. Times are CPU time of the process for one system (of the clock where
it has two threads), the median of the repeats, which all solvers take in turn, without what is
compiled before (`compile_s`). Errors are of the final state, against our driver's at the tightest
tolerance; `events_lost` counts systems whose number of events is not its. heyoka's batch steps
eight systems together, with an event callback in Python, or none and no events; diffrax runs under
`vmap`, with fewer systems. `lanes` is how many systems run in a lane each.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from math import sin
from pathlib import Path

import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
import pandas as pd
from peers import Problem

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid import System, field, guards, solve_batch
from hopdata.hybrid.arguments import SMALLEST_RTOL
from hopdata.hybrid.lanes.vectors import WIDTH

SPAN, TOLERANCE, EIGHT = (0.0, 10.0), 1e-9, 8
FEW = 200  # of them by diffrax, whose systems all take as many steps as the slowest
Found = tuple[FloatArray, IntArray | None]  # final states and numbers of events
Run = Callable[[], Found]


@field
def pendulum(t, y, mode, params, dy):
    dy[0], dy[1] = y[1], -sin(y[0])


@guards
def bottom(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = y[0], dy[0]


SWING = System(pendulum, bottom, n_states=2, guard_names=("bottom",))


def ours(y0: FloatArray, lanes: bool, workers: int, tolerance: float = TOLERANCE) -> Found:
    batch = solve_batch(
        SWING, SPAN, y0, rtol=tolerance, atol=tolerance, lanes=lanes, workers=workers,
        method="dop853" if lanes or tolerance < TOLERANCE else "auto",
    )  # fmt: skip
    assert batch.success
    assert not lanes or batch.lanes.all(), batch.lanes_reason
    return batch.y_end, batch.n_events


def heyoka(y0: FloatArray, together: int, events: bool) -> Run:
    """Return a run of heyoka's integrator of one or of eight systems, as often as it takes."""
    import heyoka as hy

    x, v = hy.make_vars("x", "v")
    equations, counts = [(x, v), (v, -hy.sin(x))], np.zeros(len(y0), dtype=np.int64)
    first = [0]

    def count(*given: object) -> None:  # integrator, time, sign, and in a batch the place in it
        counts[first[0] + (given[3] if together > 1 else 0)] += 1

    if together == 1:
        seen = [hy.nt_event(x, callback=count)] if events else []
        one = hy.taylor_adaptive(equations, y0[0], tol=TOLERANCE, nt_events=seen)
    else:
        seen = [hy.nt_event_batch(x, callback=count)] if events else []
        some = np.ascontiguousarray(y0[:together].T)
        one = hy.taylor_adaptive_batch(equations, some, tol=TOLERANCE, nt_events=seen)

    def run() -> Found:
        ends = np.empty_like(y0)
        counts[:] = 0
        for first[0] in range(0, len(y0), together):
            rows = slice(first[0], first[0] + together)
            one.state[:] = y0[first[0]] if together == 1 else y0[rows].T
            if together == 1:
                one.time = SPAN[0]
                one.propagate_until(SPAN[1])
            else:
                one.set_time(SPAN[0])
                one.propagate_until([SPAN[1]] * together)
            ends[rows] = one.state.T
        return ends, counts.copy() if events else None

    return run


def diffrax(y0: FloatArray) -> Run:
    """Return a run of diffrax under vmap, restarted at each event as in `peers.diffrax_peer`."""
    import jax
    from peers.diffrax_peer import FINDERS, METHODS, trajectory

    problem = Problem(
        "pendulum", SPAN, tuple(y0[0]), 1, lambda m: lambda y, c: (y[1], -m.sin(y[0])),
        lambda m: lambda y, k: y[k], lambda locks: (), SWING, (), y0[0],
    )  # fmt: skip

    def one(start):
        signed = jax.numpy.where(start[0] > 0, 1.0, -1.0)  # x to -x: all begin on one side
        _, y, count = trajectory(
            problem, METHODS["Dopri8"](), FINDERS["bisection"], signed * start, TOLERANCE
        )
        return signed * y, count - 1

    assert y0[0, 0] > 0
    call = jax.jit(jax.vmap(one))

    def run() -> Found:
        ends, counts = jax.block_until_ready(call(y0))
        return np.asarray(ends), np.asarray(counts)

    return run


def solvers(y0: FloatArray) -> dict[tuple[str, int, int, int], Callable[[], Run]]:
    """Return what makes each run, by its name, lanes, threads and systems."""
    n = len(y0)
    some = y0[y0[:, 0] > 0][:FEW]
    return {
        ("hopdata, driver", 1, 1, n): lambda: partial(ours, y0, False, 1),
        ("hopdata, lanes", WIDTH, 1, n): lambda: partial(ours, y0, True, 1),
        ("hopdata, lanes", WIDTH, 2, n): lambda: partial(ours, y0, True, 2),
        ("heyoka", 1, 1, n): lambda: heyoka(y0, 1, True),
        ("heyoka, batch", EIGHT, 1, n): lambda: heyoka(y0, EIGHT, True),
        ("heyoka, batch, no events", EIGHT, 1, n): lambda: heyoka(y0, EIGHT, False),
        ("diffrax, vmap", FEW, 1, FEW): lambda: diffrax(some),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument("--systems", type=int, default=10_000, help="pendulums, a multiple of 8")
    parser.add_argument("--repeats", type=int, default=7)
    given = parser.parse_args()
    y0 = np.zeros((given.systems, 2))
    y0[:, 0] = np.random.default_rng(0).uniform(-2.0, 2.0, given.systems)
    right, events = ours(y0, False, 1, SMALLEST_RTOL)
    runs, rows = {}, {}
    for key, make in solvers(y0).items():
        row = dict(zip(("solver", "lanes", "threads", "systems"), key, strict=True))
        start = time.perf_counter()
        try:
            runs[key] = make()
            ends, counts = runs[key]()
        except Exception as error:  # whatever a peer raises is its result
            runs.pop(key, None)
            rows[key] = row | {"status": f"{type(error).__name__}: {error}".splitlines()[0]}
            continue
        chosen = slice(None) if len(ends) == len(y0) else np.flatnonzero(y0[:, 0] > 0)[: len(ends)]
        off = np.abs(ends - right[chosen]).max(axis=1)
        lost = np.nan if counts is None else int((counts != events[chosen]).sum())
        rows[key] = row | {
            "compile_s": time.perf_counter() - start, "error_max": off.max(),
            "error_median": np.median(off), "events_lost": lost, "status": "ok",
        }  # fmt: skip
    times: dict[tuple[str, int, int, int], list[float]] = {key: [] for key in runs}
    for _ in range(given.repeats):
        for key, run in runs.items():
            clock = time.perf_counter if key[2] > 1 else time.process_time
            start = clock()
            run()
            times[key].append(1e6 * (clock() - start) / key[3])
    for key, found in times.items():
        rows[key]["us_per_system"], rows[key]["us_least"] = np.median(found), min(found)
    table = pd.DataFrame(list(rows.values()))
    given.out.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(given.out, index=False)
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
