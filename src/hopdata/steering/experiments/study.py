"""The experiments: all controllers from all starts, and typical runs as examples."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from itertools import chain
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import one_blas_thread, pd
from hopdata.rigid import composed, inverse
from hopdata.steering import FLOOR, child
from hopdata.steering.control.objectives import Controller, goal_errors
from hopdata.steering.experiments import run as watched
from hopdata.steering.experiments import tasks
from hopdata.steering.experiments.run import MEASURED, PREDICTED, Run
from hopdata.steering.models.process import FrameChangeProcess
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.robot import Board, SteeredHopper, robot_and_camera
from hopdata.steering.trial import POSE, TrueFrameChanges
from hopdata.synthesis.camera import draw_floor

# A run in which the model replaces the hopper, as if the model were exact.


def simulated(
    controller: Controller, task: tasks.Task, start: ArrayLike, run: Run
) -> pd.DataFrame:
    """Simulate controller and model alone, from the first measured stance of a run.

    Parameters
    ----------
    controller : Controller
        Its own predictions are taken as the outcome.
    task : Task
        Ends the simulation when decided.
    start : (3,) array
        Pose at the release, which defines the goal.
    run : Run
        Provides the first stance, and the mean duration of a hop.

    Returns
    -------
    DataFrame
        ``curve`` ("pure"), ``stance, time_s, x_m, y_m, heading_rad``.
    """
    goal, seen = (
        tasks.goal_of(task.manoeuvre, start),
        run.stances.dropna(subset=MEASURED),
    )
    pose, boom, hop_s = (
        np.array(start, dtype=float),
        np.pi,
        run.stances["time_s"].diff().mean(),
    )
    if len(seen):
        pose, boom = seen[MEASURED].to_numpy()[0], float(seen["boom_angle_rad"].iloc[0])
    poses, errors, swing = [pose], [float(goal_errors(goal, pose))], None
    while not tasks.decided(task, errors):
        plan = controller.plan(pose, boom, swing)
        pose, swing = plan.poses[1], plan.swing_rad
        boom += swing
        poses.append(pose)
        errors.append(float(goal_errors(goal, pose)))
    stances = np.arange(len(poses))
    table = pd.DataFrame(np.array(poses), columns=POSE)
    return table.assign(curve="pure", stance=stances, time_s=stances * hop_s)


FILM_HZ = 10.0

Shown: TypeAlias = tuple[tasks.Start, Run]

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Setting:
    """An experiment, its options (``steering.experiments``), the robot, and how it is seen."""

    experiment: str
    options: Mapping[str, Any]
    robot: SteeredHopper
    sight: watched.Sight

    @property
    def manoeuvre(self) -> str:
        """The manoeuvre: going to the origin, or turning."""
        return tasks.EXPERIMENTS[self.experiment][0]

    @property
    def task(self) -> tasks.Task:
        """Success criterion of a run."""
        return tasks.task_of(self.options, self.manoeuvre)

    def board(self, start: tasks.Start) -> Board | None:
        """Return the board in the way of a run, if there is one."""
        manoeuvre, impeded = tasks.EXPERIMENTS[self.experiment]
        if not impeded:
            return None
        ahead_m = self.options[
            "board_ahead_m" if manoeuvre == tasks.ORIGIN else "turn_ahead_m"
        ]
        return board_for(
            manoeuvre, start.pose, drag_n=self.options["drag_n"], ahead_m=ahead_m
        )

    def run(self, policy: tasks.Policy, start: tasks.Start) -> Run:
        """Run a controller from a start."""
        board = self.board(start)
        hopper = watched.WatchedHopper(self.robot, self.sight, self.task, start, board)
        return watched.run_task(hopper, policy(start))


@one_blas_thread()
def experiments_of(
    names: Sequence[str],
    controllers: Sequence[str],
    steering: Mapping[str, Any],
    motion_capture: Mapping[str, Any],
    *,
    model: FrameChangeProcess,
    truth: TrueFrameChanges,
    geometry: HopperGeometry,
    seed: np.random.SeedSequence,
) -> dict[str, pd.DataFrame]:
    """Run experiments on the simulated robot.

    Parameters
    ----------
    names : sequence of str
        Names from `EXPERIMENTS`.
    controllers : sequence of str
        Names from `CONTROLLERS`, and `CEILING`; if there are none, the tables have no
        rows.
    steering, motion_capture : mapping
        These blocks of the configuration.
    model : FrameChangeProcess
        The learned model.
    truth : TrueFrameChanges
        For the policy that knows the true map.
    geometry : HopperGeometry
        Calibrated geometry of the hopper.
    seed : SeedSequence
        Seed of the excitation that the model was learned from.

    Returns
    -------
    runs : DataFrame
        One row per run: ``experiment, controller, run, success, hops`` (-1 if it never
        arrived), ``reason, stances, blind, touched`` (number of stances that touched
        the board), ``last_error`` (m or rad).
    stances : DataFrame
        One row per stance: the run, ``stance, time_s``, the true pose, the measured
        pose (columns ``measured_...``), ``boom_angle_rad, swing_rad``, the pose
        predicted at the previous stance (``predicted_...``), ``board_m`` and
        ``touched``.
    example : DataFrame
        Three curves of one run, of the controller that `tasks.shown_of` chooses:
        ``curve`` is "measured", "response" (predicted from each measured stance) or
        "pure" (controller and model alone; NaN where the controller predicts nothing);
        ``controller, run, success`` of the run; ``stance, time_s`` and the pose, for
        turns in the frame of the start; ``near`` (tolerance of the goal, m or rad); and
        of the board ``board_x, board_y`` (direction), ``board_first_m`` and ``board_m``
        (initial and current place). Of an experiment in which no stance was seen in any
        run of that controller, there are no rows.
    film : DataFrame
        Markers of that run at `FILM_HZ`: ``experiment, time_s`` (0 at the first
        stance), ``marker, x_m, y_m, z_m``.
    """
    robot, camera = robot_and_camera(steering["robot"], motion_capture)
    options = steering["experiments"]
    floor = draw_floor(camera.floor, np.random.default_rng(child(seed, FLOOR)))
    sight = watched.Sight(camera, geometry, floor)
    parts, known = [], dict[str, Mapping[str, tasks.Policy]]()
    for name in names:
        setting = Setting(name, options, robot, sight)
        starts = tasks.draw_starts(
            name, options["starts"], distance_m=options["distance_m"], seed=seed
        )
        if setting.manoeuvre not in known:
            known[setting.manoeuvre] = tasks.policies(
                controllers, steering["control"], setting.manoeuvre, model=model,
                truth=truth.average(), swing_limit_rad=robot.swing_limit_rad,
            )  # fmt: skip
        parts.append(_tables(setting, known[setting.manoeuvre], starts))
    return {
        name: _joined([*chain.from_iterable(pieces)], columns)
        for (name, columns), *pieces in zip(TABLES.items(), *parts, strict=True)
    }


# Tables of the experiments and their columns, which a table without rows has too.
OF_RUN = ("experiment", "controller", "run")
OF_OUTCOME = tuple(field.name for field in fields(tasks.Outcome))
TABLES: Mapping[str, tuple[str, ...]] = {
    "runs": (*OF_RUN, *OF_OUTCOME, "stances", "blind", "touched", "last_error"),
    "stances": (*OF_RUN, "stance", *watched.COLUMNS),
    "example": (
        *("curve", "stance", "time_s", *POSE, "board_m", *OF_RUN, "success", "near"),
        *("board_x", "board_y", "board_first_m"),
    ),
    "film": ("time_s", "marker", "x_m", "y_m", "z_m", "experiment"),
}


def _joined(pieces: Sequence[pd.DataFrame], columns: Sequence[str]) -> pd.DataFrame:
    """Return the pieces as one table with these columns, also if there are none."""
    if not pieces:
        return pd.DataFrame(columns=list(columns))
    return pd.concat(pieces, ignore_index=True)[list(columns)]


FEW = 10  # number of starts for comparing horizons


def horizons_of(
    steering: Mapping[str, Any], motion_capture: Mapping[str, Any], **learned: Any
) -> pd.DataFrame:
    """Run the printed controller to the origin with several horizons, all else being equal.

    For the other parameters see `experiments_of`.

    Returns
    -------
    DataFrame
        ``horizon, runs, succeeded`` and ``hops``, the median over the successful runs.
    """
    few = dict(
        steering["experiments"], starts=min(FEW, steering["experiments"]["starts"])
    )
    rows = []
    for hops in steering["experiments"]["horizons"]:
        asked = {
            **steering,
            "control": dict(steering["control"], horizon=hops),
            "experiments": few,
        }
        made = experiments_of(
            [tasks.ORIGIN], [tasks.PRINTED], asked, motion_capture, **learned
        )
        runs = made["runs"]
        good = runs[runs["success"]]
        rows.append((hops, len(runs), len(good), good["hops"].median()))
    return pd.DataFrame(rows, columns=["horizon", "runs", "succeeded", "hops"])


def _tables(
    setting: Setting,
    policies: Mapping[str, tasks.Policy],
    starts: Sequence[tasks.Start],
) -> tuple[list[pd.DataFrame], ...]:
    """Return the four tables of an experiment, each as a list of pieces."""
    runs, stances, example, film = [], [], [], []
    shown = tasks.shown_of(policies)
    for name, policy in policies.items():
        made = [setting.run(policy, start) for start in starts]
        good = sum(run.outcome.success for run in made)
        logger.info("%s, %s: %d of %d", setting.experiment, name, good, len(made))
        for start, run in zip(starts, made, strict=True):
            key = {
                "experiment": setting.experiment,
                "controller": name,
                "run": start.number,
            }
            touched = int(run.stances["touched"].sum())
            summary = {
                "stances": len(run.stances),
                "blind": run.blind,
                "touched": touched,
            }
            row = key | asdict(run.outcome) | summary | {"last_error": run.last_error}
            runs.append(pd.DataFrame([row]))
            stances.append(
                pd.DataFrame({**key, "stance": run.stances.index, **run.stances})
            )
        if name == shown:
            chosen = typical(list(zip(starts, made, strict=True)))
            if chosen is not None:
                example.append(_example(setting, name, policy, *chosen))
                film.append(_film(setting, chosen[1]))
    return runs, stances, example, film


def typical(runs: list[Shown]) -> Shown | None:
    """Return the successful run with the median number of hops.

    If none succeeded, it is the first in which a stance was seen; None if there is none
    either.
    """
    good = sorted(
        (one for one in runs if one[1].outcome.success), key=lambda s: s[1].outcome.hops
    )
    if good:
        return good[(len(good) - 1) // 2]
    seen = (one for one in runs if one[1].stances[MEASURED].notna().all(axis=1).any())
    return next(seen, None)


def _example(
    setting: Setting,
    controller: str,
    policy: tasks.Policy,
    start: tasks.Start,
    run: Run,
) -> pd.DataFrame:
    """Return the three curves of a run; turns are in the frame of their start."""
    task, board = setting.task, setting.board(start)
    alone = simulated(policy(start), task, start.pose, run)
    table = pd.concat([_curves(run), alone], ignore_index=True)
    into = (np.nan, np.nan) if board is None else board.direction
    if (
        setting.manoeuvre == tasks.TURN
    ):  # from the origin; the board is across the heading
        table[POSE] = composed(inverse(start.pose), table[POSE].to_numpy())
        into = into if board is None else (1.0, 0.0)
    return table.assign(
        experiment=setting.experiment, controller=controller, run=start.number,
        success=run.outcome.success, near=task.near, board_x=into[0], board_y=into[1],
        board_first_m=np.nan if board is None else board.place_m,
    )  # fmt: skip


def _film(setting: Setting, run: Run) -> pd.DataFrame:
    """Return a subset of the frames of a run."""
    first_s = run.stances["time_s"].iloc[0]
    kept = run.frames[:: max(1, round(setting.sight.camera.rate_hz / FILM_HZ))]
    places = np.array([markers for _, markers in kept])
    names = [f"body{i + 1}" for i in range(places.shape[1] - 1)] + ["boom"]
    table = pd.DataFrame(places.reshape(-1, 3), columns=["x_m", "y_m", "z_m"])
    table.insert(0, "marker", np.tile(names, len(kept)))
    table.insert(
        0, "time_s", np.repeat([time for time, _ in kept], len(names)) - first_s
    )
    return table.assign(experiment=setting.experiment)


def _curves(run: Run) -> pd.DataFrame:
    """Return the measured curve, and the one the model predicted from each stance."""
    made = run.stances
    curves = []
    for name, columns in (("measured", MEASURED), ("response", PREDICTED)):
        curve = pd.DataFrame({"curve": name, "stance": made.index})
        curve["time_s"] = made["time_s"] - made["time_s"].iloc[0]
        curve[POSE] = made[columns]
        curves.append(
            curve.assign(board_m=made["board_m"] if name == "measured" else np.nan)
        )
    return pd.concat(curves)


def board_for(
    manoeuvre: str, start: ArrayLike, *, drag_n: float, ahead_m: float
) -> Board:
    """Return the board in the way: across the line to the origin, or across the initial heading.

    It is as wide as the floor. A hopper that reaches the origin has therefore pushed
    it, and so has one that turned round, if the board is no farther than a turn takes
    the hopper forward.

    Parameters
    ----------
    manoeuvre : str
    start : (3,) array
        Pose at the release, m, m, rad.
    drag_n : float
        Friction of the board on the floor, N.
    ahead_m : float
        Distance the hopper travels before it meets the board, m.
    """
    pose = np.asarray(start, dtype=float)
    way = np.array([np.cos(pose[2]), np.sin(pose[2])])
    if manoeuvre == tasks.ORIGIN:
        way = -pose[:2] / np.hypot(pose[0], pose[1])
    place = float(pose[:2] @ way) + ahead_m + Board.reach_m
    return Board(direction=(float(way[0]), float(way[1])), place_m=place, drag_n=drag_n)
