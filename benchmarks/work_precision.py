"""Error and time of the integrator beside its peers on three scenes, at all tolerances.

    python benchmarks/work_precision.py --out work_precision.csv

Writes the table and beside it `ratios.csv` (times at an error of 1e-9 over ours). One process, one
thread. At each tolerance all solvers take turns;
times are of one trajectory, in CPU time of the process (other programs count for little), median
and quartiles over the turns. What a solver compiles or builds is not in them but in `compile_s`,
the first call's excess over the second with all that goes before it, on the clock. `setting` is
the relative and absolute tolerance, or MuJoCo's time step, s. `error_max` is the largest deviation
of the final state from the exact one. A solver that fails, or is not installed, has a row that
says so.
"""

from __future__ import annotations

import one_thread  # noqa: F401

# isort: split
import argparse
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from equal_error import EQUAL_ERROR, best_of_way, ratios
from peers import solvers_of
from peers.problems import Problem, problems
from peers.solver import FloatArray, Solver

FAR_OFF = 0.1  # no tolerance here explains it
BLOCK_S = 500e-6  # calls in a row, at least so long, for one timing
MOST_TRIES = 20
BUDGET_S = 0.06  # for all timings of a solver at a setting, ...
FEWEST = 3  # ... but at least so many
COLUMNS = (
    "scene", "package", "way", "method", "setting", "error_max", "time_median_us", "time_q25_us",
    "time_q75_us", "timings", "compile_s", "status",
)  # fmt: skip


@dataclass
class Entry:
    """A solver at one setting: what is known of it, and its timings, s."""

    solver: Solver
    setting: float
    run: Callable[[], FloatArray] | None = None
    error: float = np.nan
    compile_s: float = np.nan
    calls: int = 1
    wanted: int = 0
    status: str = "ok"
    times: list[float] = field(default_factory=list)

    def time_block(self) -> None:
        """Add one timing: the mean of some calls in a row, after one that finds its code again."""
        assert self.run is not None
        self.run()
        start = time.process_time()
        for _ in range(self.calls):
            self.run()
        spent = time.process_time() - start
        self.times.append(spent / (self.calls * self.solver.trajectories))


def entered(solver: Solver, problem: Problem, setting: float, turns: int) -> Entry:
    """Prepare a solver and run it: for its error, and to see how long it takes."""
    entry, start = Entry(solver, setting), time.perf_counter()
    try:
        entry.run = solver.prepare(setting)
        entry.error = float(np.abs(entry.run() - problem.end).max())
        first = time.perf_counter() - start
        warm = least_time(entry.run)
    except Exception as error:  # whatever a peer raises is its result
        entry.run, entry.status = None, f"failed: {type(error).__name__}: {error}".splitlines()[0]
        return entry
    entry.compile_s = max(first - warm, 0.0)
    entry.calls = max(1, round(BLOCK_S / warm))
    entry.wanted = int(np.clip(BUDGET_S / (entry.calls * warm), FEWEST, turns))
    if not entry.error < FAR_OFF:
        entry.status = "far off: perhaps an event was lost"
    return entry


def least_time(run: Callable[[], FloatArray]) -> float:
    """Return the shortest of some calls, s: the first are slower than those in a row will be."""
    times = []
    while sum(times) < BLOCK_S and len(times) < MOST_TRIES:
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return min(times)


def measure(problem: Problem, turns: int) -> list[tuple[object, ...]]:
    """Return the rows of a scene."""
    solvers, absent = solvers_of(problem)
    rows: list[tuple[object, ...]] = [
        (problem.name, package, package, "", *[np.nan] * 5, 0, np.nan, f"absent: {reason}")
        for package, reason in absent.items()
    ]
    for settings in zip_longest(*(solver.settings for solver in solvers)):
        entries = [
            entered(solver, problem, setting, turns)
            for solver, setting in zip(solvers, settings, strict=True)
            if setting is not None
        ]
        for turn in range(turns):
            for entry in entries:
                if turn < entry.wanted:
                    entry.time_block()
        rows += [row(problem, entry) for entry in entries]
    return rows


def row(problem: Problem, entry: Entry) -> tuple[object, ...]:
    """Return what is written of an entry."""
    s, us = entry.solver, 1e6 * np.array(entry.times or [np.nan])
    low, median, high = np.percentile(us, [25, 50, 75])
    return (
        problem.name, s.package, s.way, s.method, entry.setting, entry.error, median, low, high,
        len(entry.times), entry.compile_s, entry.status,
    )  # fmt: skip


def print_ratios(at_equal_error: pd.DataFrame) -> None:
    """Print the best of each package and scene."""
    chosen: Any = at_equal_error[at_equal_error["best_of_package"] | (at_equal_error["note"] != "")]
    for one in chosen.itertuples():
        print(
            f"{one.scene:16}{one.way:22}{one.method:8}{one.time_us:10.1f} us at {EQUAL_ERROR:g}, "
            f"{one.ratio:8.2f} times ours, {one.ratio_to_batch:8.2f} times our batch {one.note}"
        )


def asked(description: str, turns: int) -> tuple[Path, int, list[Problem]]:
    """Return what the command line asks for: the file to write, the turns, and the scenes."""
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument("--turns", type=int, default=turns, help="most timings of each solver")
    parser.add_argument("--scenes", nargs="*", help="names of scenes; all by default")
    given = parser.parse_args()
    given.out.parent.mkdir(parents=True, exist_ok=True)
    chosen = [one for one in problems() if not given.scenes or one.name in given.scenes]
    return given.out, given.turns, chosen


def main() -> None:
    out, turns, chosen = asked(__doc__, 15)
    warnings.simplefilter("ignore")
    rows = [line for problem in chosen for line in measure(problem, turns)]
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    at_equal_error = ratios(table)
    at_equal_error["best_of_way"] = best_of_way(at_equal_error)
    table.to_csv(out, index=False)
    at_equal_error.to_csv(out.with_name("ratios.csv"), index=False)
    print_ratios(at_equal_error)


if __name__ == "__main__":
    main()
