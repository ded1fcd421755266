"""Three robots behind one interface: each learns from 100 strides and is steered.

    python benchmarks/steering/robots.py --out robots.csv [--seeds 10] [--first 1]
        [--robots NAME ...] [--printed]

Each seed has its own excitation, a model of 100 of its strides, and 30 starts. The tasks:

- the planar hopper goes to a point on its line, from 1 to 3 m to either side, within 20
  strides (it has no heading);
- the quadruped goes to a point 1 m away from any heading within 50 strides, and turns to
  the opposite heading within 25 (it always moves ahead, so it need only pass the point);
- so does the steered hopper.

A run has arrived if the true pose of a stance is within 0.11 m of the point, or within
15 degrees of the heading. The controllers get the same starts, kicks and noise: the
planner, random inputs, none (the inputs at rest) and, if asked for, the printed
controller, which takes most of the time.

There is one row per robot, task, controller and seed: how many of the runs arrived, the
median number of strides of these, how many fell, whether each log was replayed to the
bit, and the processor time per stride. A table that is there already is continued.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from hopdata.arrays import FloatArray
from hopdata.jobs import write_table
from hopdata.steering import child
from hopdata.steering.control.interface import Controller, Plan
from hopdata.steering.control.objectives import (
    Horizon,
    Objective,
    ToHeading,
    ToPoint,
    goal_errors,
)
from hopdata.steering.control.planner import planner
from hopdata.steering.control.printed import PrintedController
from hopdata.steering.excitation import excitation
from hopdata.steering.goals import ARRIVED_M, TURNED_RAD
from hopdata.steering.models.training import trained_process
from hopdata.steering.robots.interface import (
    Log,
    SimulatedRobot,
    Simulation,
    at_rest,
    excited,
    replayed,
    steered,
)
from hopdata.steering.robots.planar_hopper import PlanarHopper
from hopdata.steering.robots.quadruped import SteeredQuadruped
from hopdata.steering.robots.steered_hopper import StridingHopper
from hopdata.steering.strides import StrideAxes

LEARNED, STARTS = 100, 30
NEAR_M, NEAR_RAD = ARRIVED_M, TURNED_RAD


def on_the_line(rng: np.random.Generator) -> FloatArray:
    return np.array([rng.choice([-1, 1]) * rng.uniform(1.0, 3.0), 0.0, 0.0])


def around(rng: np.random.Generator) -> FloatArray:
    place = rng.uniform(-np.pi, np.pi)
    return np.array([np.cos(place), np.sin(place), rng.uniform(-np.pi, np.pi)])


def to_origin(_pose: FloatArray) -> Objective:
    return ToPoint()


def half_a_turn(pose: FloatArray) -> Objective:
    return ToHeading(heading_rad=float(pose[2]) + np.pi)


@dataclass(frozen=True)
class Task:
    """What a robot is to do, from where, and within how many strides."""

    name: str
    start: Callable[[np.random.Generator], FloatArray]
    goal: Callable[[FloatArray], Objective]
    near: float
    strides: int


LINE = Task("to a point on its line", on_the_line, to_origin, NEAR_M, 20)
POINT = Task("to a point", around, to_origin, NEAR_M, 50)
HEADING = Task("half a turn", around, half_a_turn, NEAR_RAD, 25)
ROBOTS: dict[str, tuple[Callable[[], SimulatedRobot], tuple[Task, ...]]] = {
    "planar hopper": (PlanarHopper, (LINE,)),
    "quadruped": (SteeredQuadruped, (POINT, HEADING)),
    "steered hopper": (StridingHopper, (POINT, HEADING)),
}


@dataclass(frozen=True)
class Unheeding:
    """Inputs at random within their limits, or at rest."""

    axes: StrideAxes
    rng: np.random.Generator | None

    def towards(self, _objective: Objective) -> Unheeding:
        """Return itself: it heeds no objective."""
        return self

    def plan(self, *_: object) -> Plan:
        """Return the inputs of one stride."""
        inputs = at_rest(self.axes)
        if self.rng is not None:
            inputs = self.rng.uniform(self.axes.lower, self.axes.upper)
        return Plan(inputs[None], np.full((2, 3), np.nan), np.nan)


def run(
    robot: SimulatedRobot,
    task: Task,
    controller: Any,
    pose: FloatArray,
    seed: np.random.SeedSequence,
) -> tuple[Log, bool, Controller]:
    """Steer from one start; tell whether it arrived, and who steered."""
    goal = task.goal(pose)
    simulation = Simulation(robot, pose, seed=seed)

    def arrived(_seen: FloatArray) -> bool:
        return bool(goal_errors(goal, simulation.true_pose) <= task.near)

    steers = controller.towards(goal)
    log = steered(simulation, steers, strides=task.strides, arrived=arrived)
    return log, arrived(pose) and not log.fell, steers


def rows(name: str, number: int, *, printed: bool) -> Iterator[dict[str, object]]:
    make, tasks = ROBOTS[name]
    robot = make()
    seed = np.random.SeedSequence(20261129, spawn_key=(number,))
    inputs = excitation(robot.axes, LEARNED + 1, np.random.default_rng(child(seed, 0)))
    strides = excited(Simulation(robot, seed=child(seed, 1)), inputs).strides().used()
    model = trained_process(strides.rows(np.arange(LEARNED)))
    for place, task in enumerate(tasks):
        goal = task.goal(np.zeros(3))
        planned = planner(model, goal)
        controllers: dict[str, Any] = {
            "planner": planned,
            "random": Unheeding(robot.axes, np.random.default_rng(child(seed, 2))),
            "none": Unheeding(robot.axes, None),
        }
        if printed:
            controllers["printed"] = PrintedController(
                model=planned.model, objective=goal, horizon=Horizon()
            )
        rng = np.random.default_rng(child(seed, 3, place))
        starts = [task.start(rng) for _ in range(STARTS)]
        for who, controller in controllers.items():
            begun = time.process_time()
            runs = [
                run(robot, task, controller, pose, child(seed, 4, place, k))
                for k, pose in enumerate(starts)
            ]
            took = time.process_time() - begun
            n_strides = np.array([len(log.stances) - 1 for log, _, _ in runs])
            good = np.array([came for _, came, _ in runs])
            again = all(
                np.array_equal(replayed(log, steers), log.inputs, equal_nan=True)
                for log, _, steers in runs[:3]
            )
            yield {
                "robot": name, "task": task.name, "controller": who, "seed": number,
                "runs": len(runs), "arrived": int(good.sum()),
                "strides": np.median(n_strides[good]) if good.any() else np.nan,
                "fell": sum(log.fell for log, _, _ in runs),
                "replayed": again and who != "random",
                "ms_per_stride": round(1e3 * took / n_strides.sum(), 2),
            }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=list(ROBOTS))
    parser.add_argument("--printed", action="store_true")
    arguments = parser.parse_args()
    out: Path = arguments.out
    found = pd.read_csv(out).to_dict("records") if out.exists() else []
    for number in range(arguments.first, arguments.first + arguments.seeds):
        for name in arguments.robots:
            if any(row["robot"] == name and row["seed"] == number for row in found):
                continue
            found += rows(name, number, printed=arguments.printed)
            write_table(out, pd.DataFrame(found))
    table = pd.DataFrame(found)
    by_task = table.groupby(["robot", "task", "controller"], sort=False)
    print(by_task["arrived"].agg(["min", "median", list]).to_string())


if __name__ == "__main__":
    main()
