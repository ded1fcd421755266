"""Flips missed and spurious, unproven and close, over the families of guards.

    python benchmarks/proofs.py --out proofs.csv [--members 300] [--seed 0]

There is one row for each family of `tests/hybrid/families.py` (from where it is
imported) and tolerance: events found, missed and spurious, compared with 200,000
samples of each run's own path (`missed` and `spurious` count crossings and their
returns, `displaced` flips that the path's own error moves); runs that are not proven, and runs that turned closer to a surface than the
tolerance can tell; evaluations of the guards in each step, of ranges and of numbers
together, and the median time of a run without dense output. Rows that are in the file
already are kept, so an interrupted run goes on.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd

TESTS = Path(__file__).resolve().parent.parent / "tests" / "hybrid"
sys.path.insert(0, str(TESTS))

from families import FAMILIES, judged, run  # noqa: E402

RTOLS = (1e-3, 1e-6, 1e-9, 1e-12)


def time_us(name: str, rtol: float, members: int, key: list[int]) -> float:
    """Return the median CPU time of a run; each is the second of its member."""
    times = []
    for member in range(members):
        run(name, rtol, np.random.default_rng([*key, member]))
        start = time.process_time()
        run(name, rtol, np.random.default_rng([*key, member]))
        times.append(time.process_time() - start)
    return 1e6 * float(np.median(times))


def row_of(name: str, rtol: float, members: int, seed: int) -> dict[str, object]:
    key = [seed, *map(ord, name)]
    verdicts = [
        judged(name, rtol, np.random.default_rng([*key, member]))
        for member in range(members)
    ]
    solutions = [one.solution for one in verdicts]
    looks = [one.n_guard_evaluations for one in solutions]
    steps = [one.n_steps for one in solutions]
    return {
        "family": name,
        "rtol": rtol,
        "members": members,
        "seed": seed,
        "events": sum(one.events for one in verdicts),
        "missed": sum(one.missed for one in verdicts),
        "spurious": sum(one.spurious for one in verdicts),
        "displaced": sum(one.displaced for one in verdicts),
        "failed": sum(not one.success for one in solutions),
        "unproven": sum(not one.proven for one in solutions),
        "close": sum(one.n_close > 0 for one in solutions),
        "evaluations_per_step": sum(looks) / sum(steps),
        "time_us": time_us(name, rtol, min(members, 20), key),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--members", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--families", nargs="*", default=list(FAMILIES))
    arguments = parser.parse_args()
    rows = []
    if arguments.out.exists():
        rows = pd.read_csv(arguments.out).to_dict("records")
    done = {(row["family"], row["rtol"], row["seed"]) for row in rows}
    for name in arguments.families:
        for rtol in RTOLS:
            if (name, rtol, arguments.seed) in done:
                continue
            rows.append(row_of(name, rtol, arguments.members, arguments.seed))
            print(rows[-1], flush=True)
            pd.DataFrame(rows).to_csv(arguments.out, index=False)


if __name__ == "__main__":
    main()
