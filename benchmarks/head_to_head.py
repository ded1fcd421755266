"""Our integrator and the best of each peer, turn by turn, at the same error.

    python benchmarks/head_to_head.py --out head_to_head.csv

Each solver runs at the loosest of its tolerances, a decade apart, with which the final state errs
by at most 1e-9; of each package the fastest takes part, of ours one in calls of its own and one in
a batch. They are timed in turn, and each turn gives a ratio: whatever slows the machine down for a
while slows down both. `work_precision.py` has all solvers at all tolerances, and interpolates; this
has fewer, and steadier ratios. A package that does not get to the error, or is not installed, has a
row that says so.
"""

from __future__ import annotations

import one_thread  # noqa: F401

# isort: split
import warnings

import numpy as np
import pandas as pd
from equal_error import EQUAL_ERROR, OUR_BATCH, OUR_CALL, OURS
from peers import solvers_of
from peers.problems import Problem
from peers.solver import Solver
from work_precision import Entry, asked, entered

TRIAL = 15  # timings by which the fastest is found
LEVELS = {"q25": 25, "median": 50, "q75": 75}


def loosest(solver: Solver, problem: Problem) -> Entry | None:
    """Return a solver at its loosest setting that reaches the error; None if none does."""
    for setting in sorted(solver.settings, reverse=True):
        entry = entered(solver, problem, setting, TRIAL)
        if entry.run is not None and entry.error <= EQUAL_ERROR:
            return entry
    return None


def contender(entry: Entry) -> str:
    """Return what an entry competes for: our two ways by themselves, a peer as one package."""
    return entry.solver.way if entry.solver.package == OURS else entry.solver.package


def fastest(entries: list[Entry]) -> dict[str, Entry]:
    """Return the fastest entry of each contender, by a few timings in turn."""
    take_turns(entries, TRIAL)
    best: dict[str, Entry] = {}
    for entry in sorted(entries, key=lambda one: np.median(one.times)):
        best.setdefault(contender(entry), entry)
    return best


def take_turns(entries: list[Entry], turns: int) -> None:
    """Time all entries so often, in turn; what they had before is forgotten."""
    for entry in entries:
        entry.times.clear()
    for _ in range(turns):
        for entry in entries:
            entry.time_block()


def row(problem: Problem, name: str, best: dict[str, Entry]) -> dict[str, object]:
    """Return what is written of a contender: its time, and its ratios to our two ways."""
    entry = best[name]
    s, times = entry.solver, np.array(entry.times)
    ratios = {"call": times / best[OUR_CALL].times, "batch": times / best[OUR_BATCH].times}
    return {
        "scene": problem.name, "package": s.package, "way": s.way, "method": s.method,
        "setting": entry.setting, "error_max": entry.error, "turns": len(times),
        "time_median_us": 1e6 * np.median(times),
    } | {
        f"over_{way}_{level}": np.percentile(sample, at)
        for way, sample in ratios.items() for level, at in LEVELS.items()
    } | {"note": ""}  # fmt: skip


def measure(problem: Problem, turns: int) -> list[dict[str, object]]:
    """Return the rows of a scene."""
    solvers, absent = solvers_of(problem)
    best = fastest([entry for s in solvers if (entry := loosest(s, problem)) is not None])
    take_turns(list(best.values()), turns)
    late = {s.package for s in solvers} - {entry.solver.package for entry in best.values()}
    notes = dict.fromkeys(sorted(late), f"does not reach {EQUAL_ERROR:g}")
    notes |= {package: f"absent: {reason}" for package, reason in absent.items()}
    return [row(problem, name, best) for name in best] + [
        {"scene": problem.name, "package": package, "note": note} for package, note in notes.items()
    ]


def main() -> None:
    out, turns, chosen = asked(__doc__, 60)
    warnings.simplefilter("ignore")
    table = pd.DataFrame([line for one in chosen for line in measure(one, turns)])
    table.to_csv(out, index=False)
    shown = ["scene", "package", "way", "method", "error_max", "time_median_us", "over_call_median"]
    print(table[[*shown, "over_batch_median", "note"]].to_string(index=False))


if __name__ == "__main__":
    main()
