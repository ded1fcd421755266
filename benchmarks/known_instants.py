"""Drives that jump in time: error and cost with known instants, without, and with SciPy.

    python benchmarks/known_instants.py --out known_instants.csv

A linear oscillator, whose motion is known exactly, is driven by each drive of
`tests/hybrid/timed_drives.py` for 10 s. There is one row for each drive, tolerance and
solver: `found` finds the instants in the field's code, `declared` is told them by
`tstops`, `without` does neither. `scipy` is one call of `solve_ivp` (DOP853, the same
tolerances), and `scipy, split` one for each piece between two instants. `error_median`
and `error_worst` are those of the final state, relative to its size, over the `--seeds`
random oscillators and drives; `steps` counts accepted and rejected steps (of SciPy,
accepted ones only), and `us` is the median time of a solve. The constants of the search
were chosen on seeds 0 and 1.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp

TESTS = Path(__file__).resolve().parent.parent / "tests" / "hybrid"
sys.path.insert(0, str(TESTS))

from timed_drives import (  # noqa: E402
    DRIVES,
    SPAN,
    Drive,
    exact_end,
    instants_within,
    oscillator,
    parameters,
)

from hopdata.hybrid import solve  # noqa: E402

START = [1.0, 0.0]
RTOLS = (1e-3, 1e-6, 1e-9, 1e-12)
REPETITIONS = 5
# The end, the steps and the evaluations of a run.
Run = tuple[np.ndarray, int, int]


def ours(system: Any, p: np.ndarray, rtol: float, **options: Any) -> Run:
    solution = solve(
        system, (0.0, SPAN), START, params=p, rtol=rtol, atol=1e-3 * rtol,
        t_eval=(), **options,
    )  # fmt: skip
    steps = solution.n_steps + solution.n_rejected
    return solution.y_end, steps, solution.nfev


def scipys(drive: Drive, p: np.ndarray, rtol: float, times: np.ndarray) -> Run:
    push = drive.function

    def field(t: float, y: np.ndarray) -> list[float]:
        return [y[1], push(t, p) - p[0] * p[0] * y[0] - 2.0 * p[1] * p[0] * y[1]]

    state = np.array(START)
    steps, evaluations = 0, 0
    options = {"method": "DOP853", "rtol": max(rtol, 2.3e-14), "atol": 1e-3 * rtol}
    for begin, end in pairwise(times):
        found = solve_ivp(field, (begin, end), state, **options)
        state = found.y[:, -1]
        steps += len(found.t) - 1
        evaluations += found.nfev
    return state, steps, evaluations


def timed(run: Callable[[], Run], repetitions: int) -> tuple[Run, float]:
    found = run()
    best = np.inf
    for _ in range(repetitions):
        begin = time.perf_counter()
        run()
        best = min(best, time.perf_counter() - begin)
    return found, 1e6 * best


def runs(
    name: str, rtol: float, p: np.ndarray, systems: dict[str, Any]
) -> Iterator[tuple[str, Callable[[], Run], int]]:
    drive = DRIVES[name]
    times = instants_within(drive, p)
    plain = systems["without"]
    stops = times[1:-1]
    yield "found", lambda: ours(systems["found"], p, rtol), REPETITIONS
    yield "declared", lambda: ours(plain, p, rtol, tstops=stops), REPETITIONS
    yield "without", lambda: ours(plain, p, rtol), REPETITIONS
    yield "scipy", lambda: scipys(drive, p, rtol, times[[0, -1]]), 1
    yield "scipy, split", lambda: scipys(drive, p, rtol, times), 1


def rows_of(name: str, seeds: list[int]) -> Iterator[dict[str, object]]:
    drive = DRIVES[name]
    systems = {
        "found": oscillator(drive),
        "without": oscillator(drive, find_tstops=False),
    }
    for rtol in RTOLS:
        found: dict[str, list[tuple[float, int, int, float]]] = {}
        for seed in seeds:
            p = parameters(seed)
            exact = exact_end(drive, p, START)
            size = max(1.0, np.abs(exact).max())
            for solver, run, repetitions in runs(name, rtol, p, systems):
                (end, steps, evaluations), us = timed(run, repetitions)
                error = float(np.abs(end - exact).max() / size)
                found.setdefault(solver, []).append((error, steps, evaluations, us))
        for solver, results in found.items():
            error, steps, evaluations, us = np.median(results, axis=0)
            worst = max(one[0] for one in results)
            yield {
                "drive": name, "rtol": rtol, "solver": solver, "error_median": error,
                "error_worst": worst, "steps": steps, "evaluations": evaluations,
                "us": us,
            }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=int, nargs="+", default=[2, 3, 4, 5, 6])
    given = parser.parse_args()
    rows = []
    for name in DRIVES:
        rows += list(rows_of(name, given.seeds))
    table = pd.DataFrame(rows)
    table.to_csv(given.out, index=False, float_format="%.3g")
    print(table.to_string(index=False, float_format="%.2g"))


if __name__ == "__main__":
    main()
