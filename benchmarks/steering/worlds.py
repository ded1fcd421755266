"""How often each controller arrives, over seeds and over worlds that differ from plain.

    python benchmarks/steering/worlds.py --out worlds.csv [--seeds 20] [--first 1]
        [--starts 10] [--worlds ...] [--controllers ...] [--cores 2]

A world is the simulated hopper with one thing changed: friction, stiffness, the mass on
the boom, the preload of one leg, or how it is seen. In each world, of each seed, each
controller steers to the origin from the same starts, one metre away with any heading,
within 50 hops. `learned anew` knows 100 hops of an excitation in that world, and `as it
was` 100 hops of the plain world; the random swings and the resting boom know nothing.
The planner that knows the last step has learned anew from 100 hops with their last step.
Seeds are those of a steering study with its default `seed`: starts, kicks and noise of
the plain world are those of the study's first starts.

There is one row per seed, world, model and controller: `arrived` of `starts`, the
median `hops` of the runs that arrived, and how many of the others `fell` or were
`late`; `late_commands` counts commands that came after the flight they were for had
begun. `note` says why there is no model. `worlds_models.csv`, beside it, has one row
per model, before its first run: its scores on the hops that were not learned from, and
of the plain model the scores on hops of the changed world.

A finished row is kept: the same command goes on where it was interrupted. The rows are
in the same order, with the same numbers, whatever the number of cores.
"""

from __future__ import annotations

import argparse
import multiprocessing as mp
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cache, lru_cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from hopdata.arrays import one_blas_thread
from hopdata.dissertation.steered import config_of
from hopdata.errors import HopdataError
from hopdata.jobs import write_table
from hopdata.recording import Recording
from hopdata.steering import (
    CORRECTED,
    EXCITATION,
    FLOOR,
    PRINTED,
    TRIAL,
    child,
)
from hopdata.steering.control.forecast import forecast, warning
from hopdata.steering.control.last_step import LastStepPlanner
from hopdata.steering.control.objectives import Horizon
from hopdata.steering.control.planner import planner
from hopdata.steering.excitation import (
    ControlGrid,
    eulerian_excitation,
    random_excitation,
)
from hopdata.steering.experiments import tasks
from hopdata.steering.experiments.run import Run, Sight
from hopdata.steering.experiments.study import Setting
from hopdata.steering.live.clocked import Transport
from hopdata.steering.models.last_step import SettledModel, with_last_step
from hopdata.steering.models.learning import learned_and_rest, prediction_score
from hopdata.steering.models.process import FrameChangeProcess
from hopdata.steering.models.training import process_of, trained_process
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.observe import observe_recordings
from hopdata.steering.robot import SteeredHopper, robot_and_camera
from hopdata.steering.strides import Strides
from hopdata.steering.trial import record_trial
from hopdata.synthesis.camera import MotionCapture, draw_floor

LAST_STEP = "planner, last step"
CONTROLLERS = (tasks.PLANNER, LAST_STEP, tasks.PRINTED, tasks.RANDOM, tasks.NONE)
LEARNED = (*tasks.LEARNED, LAST_STEP)
PLAIN = "plain"
ANEW = "learned anew"
AS_IT_WAS = "as it was"
UNLEARNED = "none"
#: Random stream of the frames of an excitation that are lost.
LOST_FRAMES = 20


@dataclass(frozen=True, kw_only=True)
class World:
    """What is different from the plain world.

    Parameters
    ----------
    hopper : mapping
        Parameters of the hopper, with factors of the plain ones under `times`.
    times : mapping
    preloaded : int, optional
        Leg with 10 % more preload, from 0.
    noise_m : float, optional
        Deviation of each coordinate of each marker, m.
    transport : Transport
        Delay of the frames on their way to the loop, and the share that never arrives;
        an excitation is recorded, so that it only loses frames.
    observation : {"corrected", "printed"}
        How the excitation is drawn and observed.
    """

    hopper: Mapping[str, float]
    times: Mapping[str, float]
    preloaded: int | None = None
    noise_m: float | None = None
    transport: Transport = field(default_factory=Transport)
    observation: str = CORRECTED

    @property
    def changes_robot(self) -> bool:
        """Whether the robot differs, not only what is seen of it."""
        return bool(self.hopper) or bool(self.times) or self.preloaded is not None

    @property
    def changes_excitation(self) -> bool:
        """Whether what is learned differs from what is learned in the plain world."""
        is_seen_otherwise = self.noise_m is not None or self.transport.lost_share > 0
        is_printed = self.observation == PRINTED
        return self.changes_robot or is_seen_otherwise or is_printed

    def robot(self, plain: SteeredHopper) -> SteeredHopper:
        """Return the robot of this world."""
        scaled = {
            name: k * getattr(plain.hopper, name) for name, k in self.times.items()
        }
        hopper = replace(plain.hopper, **self.hopper, **scaled)
        shares = list(plain.preload_shares)
        if self.preloaded is not None:
            shares[self.preloaded] *= 1.1
        return replace(plain, hopper=hopper, preload_shares=tuple(shares))

    def camera(self, plain: MotionCapture) -> MotionCapture:
        """Return the cameras of this world."""
        if self.noise_m is None:
            return plain
        return replace(plain, noise_m=self.noise_m)


def world(
    hopper: Mapping[str, float] | None = None,
    times: Mapping[str, float] | None = None,
    **others: Any,
) -> World:
    return World(hopper=hopper or {}, times=times or {}, **others)


WORLDS: Mapping[str, World] = {
    PLAIN: world(),
    "friction 0.2": world({"friction": 0.2}),
    "friction 0.35": world({"friction": 0.35}),
    "friction 0.6": world({"friction": 0.6}),
    "stiffness -20 %": world(times={"stiffness_n_m": 0.8}),
    "stiffness +20 %": world(times={"stiffness_n_m": 1.2}),
    "boom 0.05 kg": world({"counterweight_mass_kg": 0.05}),
    "boom 0.2 kg": world({"counterweight_mass_kg": 0.2}),
    "preload of leg 1 +10 %": world(preloaded=0),
    "preload of leg 2 +10 %": world(preloaded=1),
    "preload of leg 3 +10 %": world(preloaded=2),
    "noise 2 mm": world(noise_m=0.002),
    "20 % of frames lost": world(transport=Transport(lost_share=0.2)),
    "delay 50 ms": world(transport=Transport(delay_s=0.05)),
    "delay 150 ms": world(transport=Transport(delay_s=0.15)),
    "printed observation": world(observation=PRINTED),
}

# A model learned from an excitation.


@dataclass(frozen=True)
class Learned:
    """A model, the geometry to see with, and the hops that were not learned from.

    `changes` are all hops, in the order in which they were made.
    """

    geometry: HopperGeometry
    process: FrameChangeProcess
    rest: Strides
    changes: Strides


@cache
def config() -> dict[str, Any]:
    """Return the default configuration of a steering study."""
    return config_of(printed=False)


def settings() -> tuple[dict[str, Any], SteeredHopper, MotionCapture]:
    """Return the block `steering`, and robot and cameras of the plain world."""
    whole = config()
    steering = whole["steering"]
    robot, camera = robot_and_camera(steering["robot"], whole["motion_capture"])
    return steering, robot, camera


def seed_of(number: int) -> np.random.SeedSequence:
    """Return the seed of an excitation of the default study."""
    return np.random.SeedSequence(config()["seed"], spawn_key=(number,))


@cache
def learned(number: int, name: str) -> Learned | str:
    """Return what is learned in a world as by a study, or why nothing is."""
    steering, plain, plain_camera = settings()
    of_world = WORLDS[name]
    robot = of_world.robot(plain)
    camera = of_world.camera(plain_camera)
    seed = seed_of(number)
    grid = ControlGrid(**steering["excitation"])
    drawn = (
        random_excitation if of_world.observation == PRINTED else eulerian_excitation
    )
    swings = drawn(grid, np.random.default_rng(child(seed, EXCITATION)))
    chance = child(seed, TRIAL).generate_state(4).tolist()
    try:
        recording = record_trial(robot, swings, seed=chance, camera=camera).recording
        seen = with_lost_frames(recording, of_world.transport.lost_share, seed)
        observed = observe_recordings(
            [seen],
            swing_limit_rad=robot.swing_limit_rad,
            observation=of_world.observation,
        )
        options = steering["model"]
        train, rest = learned_and_rest(observed.changes, options, seed=seed)
        process = trained_process(train, process_of(options))
    except HopdataError as error:
        return str(error)
    return Learned(observed.geometry, process, rest, observed.changes)


def with_lost_frames(
    recording: Recording, share: float, seed: np.random.SeedSequence
) -> Recording:
    """Return a recording in which a share of the frames holds no marker."""
    if not share:
        return recording
    rng = np.random.default_rng(child(seed, LOST_FRAMES))
    positions = recording.positions.copy()
    positions[rng.random(len(positions)) < share] = np.nan
    return replace(recording, positions=positions)


# The cells of the table.


@dataclass(frozen=True)
class Cell:
    """One row of the table."""

    seed: int
    world: str
    model: str
    controller: str


def cells(
    seeds: Sequence[int], worlds: Sequence[str], controllers: Sequence[str]
) -> Iterator[Cell]:
    """Yield the cells, those of the planner first.

    What is the same by construction is made once: nothing but the plain model is
    learned in the plain world, and controllers that do not look need no other eyes.
    """
    for controller, seed, name in product(controllers, seeds, worlds):
        is_seen_otherwise = not WORLDS[name].changes_robot and name != PLAIN
        if controller not in LEARNED:
            if not is_seen_otherwise:
                yield Cell(seed, name, UNLEARNED, controller)
            continue
        of_world = WORLDS[name]
        if name == PLAIN or of_world.changes_excitation:
            yield Cell(seed, name, ANEW, controller)
        is_old = name != PLAIN and of_world.observation == CORRECTED
        if is_old and controller != LAST_STEP:
            yield Cell(seed, name, AS_IT_WAS, controller)


@lru_cache(maxsize=8)
def policy_of(controller: str, number: int, name: str) -> tasks.Policy:
    """Return a controller with what was learned in a world, ready to steer."""
    steering, plain, _ = settings()
    found = learned(number, name)
    options = steering["experiments"]
    if controller == LAST_STEP:
        return last_step_policy(found, number)
    made = tasks.policies(
        [controller],
        steering["control"],
        tasks.task_of(options, tasks.ORIGIN),
        model=found.process,
        truth=np.zeros((0, 0, 3)),
        swing_limit_rad=plain.swing_limit_rad,
    )
    return made[controller]


def last_step_policy(found: Learned, number: int) -> tasks.Policy:
    """Return the planner that knows the last step, learned from as many hops."""
    steering, plain, _ = settings()
    options = steering["model"]
    hops = with_last_step(found.changes)
    train, _ = learned_and_rest(hops, options, seed=seed_of(number))
    process = trained_process(train, process_of(options))
    horizon = Horizon(
        hops=steering["control"]["planner_horizon"],
        swing_limit_rad=plain.swing_limit_rad,
    )
    known = planner(SettledModel(process), horizon=horizon)
    return lambda _start: LastStepPlanner(known, process)


@one_blas_thread()
def measured(cell: Cell, starts: int) -> dict[str, Any]:
    """Return the row of a cell: its controller has run from all starts."""
    steering, plain, plain_camera = settings()
    of_world = WORLDS[cell.world]
    row: dict[str, Any] = {**asdict(cell), "starts": starts}
    # The eyes are those of the model, also if there is no model to steer by.
    taught = cell.world if cell.model == ANEW else PLAIN
    found = learned(cell.seed, taught)
    if isinstance(found, str):
        none = {"arrived": 0, "hops": np.nan, "fell": 0, "late": 0, "late_commands": 0}
        return {**row, **none, "note": found}
    seed = seed_of(cell.seed)
    options = steering["experiments"]
    camera = of_world.camera(plain_camera)
    floor = draw_floor(camera.floor, np.random.default_rng(child(seed, FLOOR)))
    setting = Setting(
        tasks.ORIGIN,
        options,
        of_world.robot(plain),
        Sight(camera, found.geometry, floor, of_world.transport),
    )
    policy = policy_of(cell.controller, cell.seed, taught)
    drawn = tasks.draw_starts(
        tasks.ORIGIN, starts, distance_m=options["distance_m"], seed=seed
    )
    runs = [setting.run(policy, start) for start in drawn]
    return {**row, **outcomes(runs), "note": ""}


def outcomes(runs: Sequence[Run]) -> dict[str, Any]:
    """Count the outcomes of runs."""
    hops = [run.outcome.hops for run in runs if run.outcome.success]
    reasons = [run.outcome.reason for run in runs]
    return {
        "arrived": len(hops),
        "hops": float(np.median(hops)) if hops else np.nan,
        "fell": reasons.count(tasks.FELL),
        "late": reasons.count(tasks.LATE),
        "late_commands": sum(run.late_commands for run in runs),
    }


COLUMNS = (
    *(field.name for field in fields(Cell)),
    "starts",
    "arrived",
    "hops",
    "fell",
    "late",
    "late_commands",
    "note",
)


def finished(out: Path) -> dict[Cell, dict[str, Any]]:
    """Return the rows of an earlier call, by cell."""
    if not out.exists():
        return {}
    table = pd.read_csv(out, keep_default_na=False, na_values={"hops": [""]})
    rows = table.to_dict("records")
    names = [field.name for field in fields(Cell)]
    return {Cell(**{name: row[name] for name in names}): row for row in rows}


def made(out: Path, asked: Sequence[Cell], starts: int, cores: int) -> None:
    """Make the rows that are asked for and not finished, and write each at once."""
    rows = finished(out)
    wrong = {row["starts"] for row in rows.values()} - {starts}
    if wrong:
        raise SystemExit(f"{out}: expected rows of {starts} starts, found {wrong}")
    missing = [cell for cell in asked if cell not in rows]
    with ProcessPoolExecutor(cores, mp_context=mp.get_context("spawn")) as pool:
        running = {pool.submit(measured, cell, starts): cell for cell in missing}
        for done in as_completed(running):
            row = done.result()
            rows[running[done]] = row
            print(*row.values(), sep=", ", flush=True)
            write_rows(out, rows)


def write_rows(out: Path, rows: Mapping[Cell, Mapping[str, Any]]) -> None:
    """Write all rows in the order of the whole table."""
    seeds = sorted({cell.seed for cell in rows})
    ordered = [rows[c] for c in cells(seeds, list(WORLDS), CONTROLLERS) if c in rows]
    write_table(out, pd.DataFrame(ordered, columns=list(COLUMNS)))


# What is foretold of each model.


@one_blas_thread()
def foretold(number: int, name: str, taught: str) -> dict[str, Any]:
    """Return the scores of a model on hops of a world that it has not learned from."""
    row: dict[str, Any] = {
        "seed": number,
        "world": name,
        "model": AS_IT_WAS if taught != name else ANEW,
    }
    of_world = learned(number, name)
    of_model = learned(number, taught)
    if isinstance(of_world, str) or isinstance(of_model, str):
        return {**row, "note": str(of_world)}
    scores = prediction_score(of_model.process, of_world.rest)
    for score in scores.itertuples():
        row[f"r2_{score.component}"] = score.r2
    expected = forecast(of_model.process, of_world.rest, state=[np.pi])
    row |= expected.columns()
    said = warning(scores.assign(**expected.columns()))
    return {**row, "named": said is not None, "note": ""}


def foretell(out: Path, rows: Sequence[Cell]) -> None:
    """Write what is foretold of the models in these rows, as far as it is not there."""
    seen = dict.fromkeys(
        (cell.seed, cell.world, PLAIN if cell.model == AS_IT_WAS else cell.world)
        for cell in rows
        if cell.model != UNLEARNED and has_own_hops(cell.world)
    )
    table = pd.read_csv(out) if out.exists() else pd.DataFrame()
    found = table.to_dict("records")
    known = {(row["seed"], row["world"], row["model"]) for row in found}
    for number, name, taught in seen:
        model = AS_IT_WAS if taught != name else ANEW
        if (number, name, model) not in known:
            found.append(foretold(number, name, taught))
            write_table(out, pd.DataFrame(found))


def has_own_hops(name: str) -> bool:
    """Whether an excitation of a world differs from that of the plain one."""
    return name == PLAIN or WORLDS[name].changes_excitation


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--starts", type=int, default=10)
    parser.add_argument("--worlds", nargs="+", choices=WORLDS, default=list(WORLDS))
    parser.add_argument(
        "--controllers", nargs="+", choices=CONTROLLERS, default=list(CONTROLLERS)
    )
    parser.add_argument("--cores", type=int, default=1)
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    asked = list(cells(seeds, arguments.worlds, arguments.controllers))
    out: Path = arguments.out
    made(out, asked, arguments.starts, arguments.cores)
    foretell(out.with_name(f"{out.stem}_models.csv"), list(finished(out)))


if __name__ == "__main__":
    main()
