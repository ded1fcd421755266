"""How even the steered hopper's legs are, and where the printed search begins: what they decide.

    python benchmarks/steering_legs.py --out steering_legs.csv

Each row is random starts with one hopper, one controller and one way to begin its search. Neither
the unevenness of the robot nor the start of the search is printed; the legs of the first rows are
the default. Models are learned from 100 random hops of a printed excitation as motion capture
sees them (three recordings, which the starts take turns with); the planner stands beside. Success:

- "facing": from 1 m, facing the origin, within 0.2 m of it in at most 16 hops;
- "turn": by 180 degrees, to within 15 degrees in at most 25 hops;
- "any heading": from 1 m within 0.15 m in at most 60 hops, and within 0.25 m for the next ten.

`drift_...` is the frame change of the settled hopper with its boom in neutral. Intervals are those
of Clopper and Pearson, 95 %.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import one_thread  # noqa: F401  first, since it sets the number of threads
import pandas as pd
from best_plan import STARTS, GradientController
from steering_control import to_origin, turning
from steering_setting import EXCITATIONS, LIMIT, ROBOT, excited

from hopdata.rigid import relative
from hopdata.steering.control.planner import planner
from hopdata.steering.experiments.outcomes import rate_interval
from hopdata.steering.models.tabulated import TabulatedMap, tabulated
from hopdata.steering.models.training import trained_process
from hopdata.steering.robot import SteeredHopper, released, steer_hop

# Preload of each leg as a share; the default first.
LEGS = (ROBOT.preload_shares, (0.985, 1.02, 0.995), (1.0, 1.04, 0.96), (1.0, 1.06, 0.94))


def models(robot: SteeredHopper, seed: int) -> list[TabulatedMap]:
    """Return what is learned of a hopper."""
    hops = [excited(seed, number, robot) for number in range(EXCITATIONS)]
    return [tabulated(trained_process(some), LIMIT) for some in hops]


def drift(robot: SteeredHopper, hops: int = 12) -> dict[str, float]:
    """Return the frame change with the boom in neutral."""
    still, rng = robot.still(), np.random.default_rng(0)
    apex, poses = released(still, np.zeros(3)), []
    for _ in range(hops):
        hop = steer_hop(still, apex, 0.0, rng=rng)
        apex = hop.end
        poses.append(hop.stance.pose)
    x, y, turn = relative(poses[-2], poses[-1])
    return {"drift_x_mm": 1e3 * x, "drift_y_mm": 1e3 * y, "drift_deg": float(np.degrees(turn))}


def rows(robot: SteeredHopper, starts: int, seed: int) -> Iterator[dict[str, Any]]:
    """Yield the rows of one hopper."""
    learned = models(robot, seed)
    printed = GradientController(model=learned[0])
    cases = [
        (name, f"printed, {begun}", [replace(printed, model=m, start=begun) for m in learned])
        for begun in STARTS
        for name in ("facing", "turn")
    ]
    cases.append(("any heading", "planner", [planner(model) for model in learned]))
    for name, controller, makers in cases:
        trial = turning if name == "turn" else to_origin
        good = sum(
            trial(makers[number % EXCITATIONS], name, number, seed, robot).success
            for number in range(starts)
        )
        low, high = rate_interval(good, starts)
        yield {
            "preload_shares": " ".join(map(str, robot.preload_shares)), **drift(robot),
            "task": name, "controller": controller, "starts": starts, "successes": good,
            "share": good / starts, "low": low, "high": high,
        }  # fmt: skip


def main() -> None:
    """Measure and tabulate."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument("--starts", type=int, default=30)
    parser.add_argument("--seed", type=int, default=20261122)
    options = parser.parse_args()
    found = []
    for shares in LEGS:
        for row in rows(replace(ROBOT, preload_shares=shares), options.starts, options.seed):
            print(row, flush=True)
            found.append(row)
    pd.DataFrame(found).to_csv(options.out, index=False, float_format="%.6g")


if __name__ == "__main__":
    main()
