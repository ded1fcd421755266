"""Whether the forecast of a model tells which robots will reach a point, and which not.

    python benchmarks/steering/forecasts.py --out forecasts.csv [--seeds 10] [--first 1]
        [--robots NAME ...]

Each robot of `robots.py` but the hopper, which `worlds.py` covers, is steered to a point
from 30 starts by the planner, with models of several kinds: learned from 100 strides of
the robot itself, from 12, from 100 of the robot before it was changed, and from 100
whose outcomes are exchanged at random. Before that, `forecast` scores each model on 60
further strides of the robot that it will steer.

There is one row per robot, model and seed: how many of the runs arrived, which share is
expected to, and whether the model is named. Nothing was chosen on these robots: the
threshold is that of the hopper.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from robots import LINE, POINT, STARTS, Task, run

from hopdata.jobs import write_table
from hopdata.steering import child
from hopdata.steering.control.forecast import LEAST_ARRIVED, Way, forecast
from hopdata.steering.control.planner import planner
from hopdata.steering.excitation import excitation
from hopdata.steering.models.training import trained_process
from hopdata.steering.robots.interface import SimulatedRobot, Simulation, excited
from hopdata.steering.robots.planar_hopper import PlanarHopper
from hopdata.steering.robots.quadruped import SteeredQuadruped
from hopdata.steering.strides import Strides

LEARNED, FEW, LEFT = 100, 12, 60
EXPECTED_STARTS = 200

#: Each robot, its task, and what it is when it has been changed.
ROBOTS: dict[str, tuple[SimulatedRobot, Task, dict[str, SimulatedRobot]]] = {
    "planar hopper": (
        PlanarHopper(),
        LINE,
        {
            "a softer leg": PlanarHopper(stiffness_n_m=190.0),
            "a kilogram more": PlanarHopper(mass_kg=3.7, preload_n=90.0),
        },
    ),
    "quadruped": (
        SteeredQuadruped(),
        POINT,
        {
            "longer strides": SteeredQuadruped(stride_m=0.4),
            "10 % more preload on a leg": SteeredQuadruped(
                preload_shares=(1.02, 0.97, 0.99, 1.12)
            ),
        },
    ),
}


def recorded(robot: SimulatedRobot, seed: np.random.SeedSequence) -> Strides:
    """Return strides of an excitation."""
    rng = np.random.default_rng(child(seed, 0))
    inputs = excitation(robot.axes, LEARNED + LEFT + 5, rng)
    return excited(Simulation(robot, seed=child(seed, 1)), inputs).strides().used()


def exchanged(strides: Strides, rng: np.random.Generator) -> Strides:
    """Return strides whose outcomes are those of others."""
    order = rng.permutation(len(strides))
    change = strides.change[order]
    return replace(strides, change=change, next_state=strides.next_state[order])


def models(
    name: str, seed: np.random.SeedSequence
) -> Iterator[tuple[str, SimulatedRobot, Strides, Strides]]:
    """Yield each model's name, whom it steers, what it learns from and is tested on."""
    robot, _, changes = ROBOTS[name]
    strides = recorded(robot, child(seed, 0))
    learned = strides.rows(np.arange(LEARNED))
    rest = strides.rows(np.arange(LEARNED, len(strides)))
    yield "learned anew", robot, learned, rest
    yield "12 strides", robot, learned.rows(np.arange(FEW)), rest
    rng = np.random.default_rng(child(seed, 1))
    yield "outcomes exchanged", robot, exchanged(learned, rng), rest
    for what, changed in changes.items():
        others = recorded(changed, child(seed, 2))
        fresh = others.rows(np.arange(LEARNED, len(others)))
        yield f"as it was before {what}", changed, learned, fresh
        yield f"anew after {what}", changed, others.rows(np.arange(LEARNED)), fresh


def rows(name: str, number: int) -> Iterator[dict[str, Any]]:
    """Yield the rows of a robot and a seed."""
    task = ROBOTS[name][1]
    seed = np.random.SeedSequence(20261130, spawn_key=(number,))
    rng = np.random.default_rng(child(seed, 3))
    ahead = [task.start(rng) for _ in range(EXPECTED_STARTS)]
    starts = [task.start(rng) for _ in range(STARTS)]
    for what, robot, learned, rest in models(name, seed):
        process = trained_process(learned)
        n_states = len(robot.axes.states)
        expected = forecast(
            process,
            rest,
            way=Way(width_m=task.near, strides=task.strides),
            starts=ahead,
            state=np.zeros(n_states),
        )
        controller = planner(process)
        ends = [
            run(robot, task, controller, pose, child(seed, 4, k))[1]
            for k, pose in enumerate(starts)
        ]
        yield {
            "seed": number,
            "robot": name,
            "model": what,
            "runs": len(ends),
            "arrived": sum(ends),
            "expected": expected.arrived,
            "named": expected.arrived < LEAST_ARRIVED,
            "error_over_width": expected.error_m / expected.width_m,
            "step_over_width": expected.step_m / expected.width_m,
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=list(ROBOTS))
    arguments = parser.parse_args()
    out: Path = arguments.out
    found = pd.read_csv(out).to_dict("records") if out.exists() else []
    for number in range(arguments.first, arguments.first + arguments.seeds):
        for name in arguments.robots:
            if any(row["robot"] == name and row["seed"] == number for row in found):
                continue
            for row in rows(name, number):
                print(*row.values(), sep=", ", flush=True)
                found.append(row)
            write_table(out, pd.DataFrame(found))


if __name__ == "__main__":
    main()
