"""Robots that are not the hopper, steered to a point by the live loop under faults.

A row is a robot and a seed: the robot learns from 100 strides, as in `robots.py`, and
is then driven from 30 starts by the loop of a live drive on a simulated clock: markers
of its body at 100 Hz with 0.6 mm of noise, observed frame by frame. 5 % of the frames
are lost. In each run there are also two faults of the three below, at random times:

- the coordinates freeze for 0.3 s, though frames come;
- no frame comes for 0.3 s;
- the robot answers no heartbeats and takes no inputs for 0.5 s.

Each must bring the robot to rest (`named`: for this cause), and an operator arms the
drive again 0.3 s after the fault. `arrived` counts runs whose true pose comes within
0.11 m of the point: in 20 strides for the planar hopper, from 1 to 3 m away on its
line; in 50 for the quadruped, from 1 m away and any heading. `unbidden` counts inputs
other than those at rest that were sent between a rest and the next arming, `beyond`
those beyond their limits; both must be 0. `replayed` tells whether the log of the first
run gives the same plans to the bit.

The table grows: seeds that it has are not made again.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from hopdata.arrays import FloatArray
from hopdata.steering.control.objectives import ToPoint
from hopdata.steering.control.planner import planner
from hopdata.steering.excitation import excitation
from hopdata.steering.goals import ARRIVED_M
from hopdata.steering.live.clocked import ClockedDrive, Transport
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.log import DriveLog
from hopdata.steering.live.log_reading import read_log
from hopdata.steering.live.loop import checks_of
from hopdata.steering.live.replay import replay
from hopdata.steering.live.seen_robots import (
    BODY_M,
    DECIDED_S,
    LABELS,
    SeenRobot,
    released,
)
from hopdata.steering.models.training import trained_process
from hopdata.steering.observation.bodies import (
    NothingShown,
    Shown,
    SpeedShown,
    apex_observers,
    body_of,
)
from hopdata.steering.robots.interface import PathRobot, Simulation, excited
from hopdata.steering.robots.planar_hopper import PlanarHopper
from hopdata.steering.robots.quadruped import SteeredQuadruped
from hopdata.steering.strides import at_rest

LEARNED, STARTS = 100, 30
RATE_HZ, LOST, NOISE_M = 100.0, 0.05, 6e-4
GEOMETRY = body_of(LABELS, BODY_M, noise_m=NOISE_M)
LIMITS = Limits(command_s=DECIDED_S, fence_m=6.0)
ARMED_S = 0.3
# How long each fault lasts, s, and the cause that must be named.
FAULTS = {
    "frozen": (0.3, "steering.markers_frozen"),
    "no frame": (0.3, "steering.no_frame"),
    "silent": (0.5, "steering.unacknowledged"),
}


def on_the_line(rng: np.random.Generator) -> FloatArray:
    return np.array([rng.choice([-1, 1]) * rng.uniform(1.0, 3.0), 0.0, 0.0])


def around(rng: np.random.Generator) -> FloatArray:
    place = rng.uniform(-np.pi, np.pi)
    return np.array([np.cos(place), np.sin(place), rng.uniform(-np.pi, np.pi)])


@dataclass(frozen=True)
class Case:
    """A robot, what it shows of its states, where it starts, and its strides."""

    make: Callable[[], PathRobot]
    shown: Callable[[], Shown]
    start: Callable[[np.random.Generator], FloatArray]
    strides: int


CASES = {
    "planar hopper": Case(PlanarHopper, lambda: SpeedShown(RATE_HZ), on_the_line, 20),
    "quadruped": Case(SteeredQuadruped, lambda: NothingShown(1), around, 50),
}


def run(
    case: Case, robot: PathRobot, controller: Any, seed: np.random.SeedSequence,
    log: DriveLog | None,
) -> dict[str, Any]:  # fmt: skip
    """Drive from one start, with two faults."""
    rng = np.random.default_rng(seed.spawn(1)[0])
    actuator = released(robot)
    own = int(rng.integers(2**31))
    seen = SeenRobot(
        robot, actuator, pose=case.start(rng), seed=own, rate_hz=RATE_HZ, noise_m=NOISE_M
    )  # fmt: skip
    drive = ClockedDrive(
        seen,
        apex_observers(GEOMETRY, RATE_HZ, case.shown),
        controller,
        actuator,
        axes=robot.axes,
        limits=LIMITS,
        checks=checks_of(GEOMETRY, RATE_HZ, LIMITS),
        transport=Transport(lost_share=LOST),
        lost=rng,
        on_frames=None if log is None else log.frames,
        on_decision=None if log is None else log.decision,
    )

    def ended() -> bool:
        places = np.array([one.pose[:2] for one in seen.stances])
        is_there = np.hypot(*places.T).min() < ARRIVED_M
        return bool(is_there or len(seen.stances) > case.strides)

    chosen = rng.choice(list(FAULTS), 2, replace=False)
    begin_s = np.sort(rng.uniform([1.0, 3.0], [2.0, 4.0]))
    named = unbidden = had = 0
    rest = at_rest(robot.axes)
    for fault, at_s in zip(chosen, begin_s, strict=True):
        drive.run(at_s, ended=ended)
        if ended():
            break
        had += 1
        lasts_s, code = FAULTS[fault]
        n_rests = len(drive.loop.watch.rests)
        begin(drive, actuator, fault)
        drive.run(at_s + lasts_s)
        drive.cameras = None
        actuator.is_silent = False
        n_sent = len(actuator.sent)
        drive.run(at_s + lasts_s + ARMED_S)
        unbidden += sum(not np.array_equal(s, rest) for s in actuator.sent[n_sent:])
        rests = drive.loop.watch.rests[n_rests:]
        named += bool(rests) and rests[0].cause.code == code
        while drive.loop.arm() is not None:
            drive.run(drive.now_s + 0.05)
    drive.run(60.0, ended=ended)
    if log is not None:
        log.close(drive.now_s, {})
    sent = np.array(actuator.sent)
    is_beyond = (sent < robot.axes.lower) | (sent > robot.axes.upper)
    return {
        "arrived": ended() and len(seen.stances) <= case.strides,
        "strides": len(seen.stances) - 1, "faults": had, "named": named,
        "unbidden": unbidden, "beyond": int(is_beyond.sum()),
        "rests": len(drive.loop.watch.rests),
    }  # fmt: skip


def begin(drive: ClockedDrive, actuator: Any, fault: str) -> None:
    if fault == "silent":
        actuator.silence()
        return
    shown: list[FloatArray] = []

    def cameras(markers: FloatArray) -> FloatArray | None:
        shown.append(markers)
        return shown[0] if fault == "frozen" else None

    drive.cameras = cameras


def row(name: str, number: int) -> dict[str, object]:
    case = CASES[name]
    robot = case.make()
    root = np.random.SeedSequence(20261130, spawn_key=(number,))
    excites, kicks, *starts = root.spawn(2 + STARTS)
    inputs = excitation(robot.axes, LEARNED + 1, np.random.default_rng(excites))
    strides = excited(Simulation(robot, seed=kicks), inputs).strides().used()
    model = trained_process(strides.rows(np.arange(LEARNED)))
    controller = planner(model, ToPoint())
    runs = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "drive.h5")
        for k, start in enumerate(starts):
            log = None
            if k == 0:
                log = DriveLog(path, len(LABELS), setup={}, files={}, axes=robot.axes)
            runs.append(run(case, robot, controller, start, log))
        plans = replay(
            read_log(path),
            apex_observers(GEOMETRY, RATE_HZ, case.shown),
            controller,
            limits=LIMITS,
            checks=checks_of(GEOMETRY, RATE_HZ, LIMITS),
        )
    made = pd.DataFrame(runs)
    good = made[made["arrived"]]
    totals = made[["arrived", "faults", "named", "rests", "unbidden", "beyond"]].sum()
    return {
        "robot": name, "seed": number, "runs": len(runs), **totals.to_dict(),
        "strides": good["strides"].median() if len(good) else np.nan,
        "replayed": bool(len(plans) and plans["same"].all()),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first", type=int, default=11)
    arguments = parser.parse_args()
    out: Path = arguments.out
    found = pd.read_csv(out).to_dict("records") if out.exists() else []
    has = {(one["robot"], one["seed"]) for one in found}
    for number in range(arguments.first, arguments.first + arguments.seeds):
        for name in CASES:
            if (name, number) not in has:
                found.append(row(name, number))
                pd.DataFrame(found).to_csv(out, index=False)
                print(found[-1], flush=True)


if __name__ == "__main__":
    main()
