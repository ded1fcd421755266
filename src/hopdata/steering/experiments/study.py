"""One experiment: all controllers from all starts, and a typical run to look at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import pd
from hopdata.blas import one_blas_thread
from hopdata.errors import chosen
from hopdata.rigid import composed, inverse
from hopdata.steering.control.objectives import Controller, errors_left
from hopdata.steering.experiments import tasks
from hopdata.steering.experiments.run import MEASURED, PREDICTED, Frames, Run, Sight, run_task
from hopdata.steering.models.tabulated import FrameChangeMap
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.robot import Board, SteeredHopper, camera_of, robot_of
from hopdata.steering.trial import POSE, TrueFrameChanges
from hopdata.synthesis.camera import draw_floor

# A run in which the model stands in for the hopper: what would happen were it right.


def simulated(controller: Controller, task: tasks.Task, start: ArrayLike, run: Run) -> pd.DataFrame:
    """Let controller and model go on alone from the first measured stance of a run.

    Parameters
    ----------
    controller : Controller
        Its own predictions are taken for what happens.
    task : Task
        Ends it, when it is decided.
    start : (3,) array
        Pose at the release, for the goal.
    run : Run
        Gives the first stance, and the time that a hop takes (its mean).

    Returns
    -------
    DataFrame
        ``curve`` ("pure"), ``stance, time_s, x_m, y_m, heading_rad``.
    """
    goal, seen = tasks.goal_of(task.manoeuvre, start), run.stances.dropna(subset=MEASURED)
    pose, boom, hop_s = np.array(start, dtype=float), np.pi, run.stances["time_s"].diff().mean()
    if len(seen):
        pose, boom = seen[MEASURED].to_numpy()[0], float(seen["boom_angle_rad"].iloc[0])
    poses, errors, swing = [pose], [float(errors_left(goal, pose))], None
    while not tasks.decided(task, errors):
        plan = controller.plan(pose, boom, swing)
        pose, swing = plan.poses[1], plan.swing_rad
        boom += swing
        poses.append(pose)
        errors.append(float(errors_left(goal, pose)))
    stances = np.arange(len(poses))
    table = pd.DataFrame(np.array(poses), columns=POSE)
    return table.assign(curve="pure", stance=stances, time_s=stances * hop_s)


SHOWN = tasks.PLANNER  # whose run of median hops is the example
FILM_HZ = 10.0

Shown: TypeAlias = tuple[tasks.Policy, tasks.Start, Run]


@dataclass(frozen=True)
class ExperimentTables:
    """Runs and stances of an experiment, and one typical run with what the model says of it.

    Parameters
    ----------
    runs : DataFrame
        One row a run: ``experiment, start, controller, run, model`` (number of the learned
        model), ``success, hops`` (-1 if it never arrived), ``reason, stances, blind``.
    stances : DataFrame
        One row a stance: the run, ``stance, time_s``, the true pose, the measured pose (columns
        ``measured_...``), ``boom_angle_rad, swing_rad``, the pose foretold from the stance before
        (``predicted_...``) and ``board_m``.
    film : DataFrame
        The markers of that run at `FILM_HZ`: ``time_s`` (0 at the first stance), ``marker, x_m,
        y_m, z_m``.
    example : DataFrame
        Three curves of one run: ``curve`` is "measured", "response" (foretold from each measured
        stance) or "pure" (controller and model alone); ``stance, time_s`` and the pose, a turn's in
        the frame of its start; ``near`` (when the goal counts as reached, m or rad) and of the
        board ``board_x, board_y`` (direction), ``board_first_m`` and ``board_m`` (where it was).
    """

    runs: pd.DataFrame
    stances: pd.DataFrame
    example: pd.DataFrame
    film: pd.DataFrame


@dataclass(frozen=True)
class Setting:
    """An experiment, the block ``steering.experiments``, the robot, and how it is seen."""

    experiment: str
    options: Mapping[str, Any]
    robot: SteeredHopper
    sight: Sight

    @property
    def manoeuvre(self) -> str:
        """What is asked: to come to the origin, or to turn."""
        return chosen("experiment", self.experiment, tasks.EXPERIMENTS)[0]

    def task(self, heading: str = tasks.ANY) -> tasks.Task:
        """Return what a run from this kind of start must do."""
        return tasks.tasks_of(self.options)[self.manoeuvre, heading]

    def board(self, start: tasks.Start) -> Board | None:
        """Return the board in the way of a run, if there is one."""
        if tasks.EXPERIMENTS[self.experiment][1] != tasks.BOARD:
            return None
        drag_n, ahead_m = self.options["drag_n"], self.options["board_ahead_m"]
        return tasks.board_for(self.manoeuvre, start.pose, drag_n=drag_n, ahead_m=ahead_m)

    def controller(self, policy: tasks.Policy, start: tasks.Start) -> Controller:
        """Return the controller of a run."""
        return policy(tasks.goal_of(self.manoeuvre, start.pose))

    def run(
        self, policy: tasks.Policy, start: tasks.Start, heading: str, frames: Frames | None = None
    ) -> Run:
        """Let a controller steer from a start; `frames` takes what the cameras see."""
        controller, task = self.controller(policy, start), self.task(heading)
        board = self.board(start)
        return run_task(self.robot, self.sight, controller, task, start, board=board, frames=frames)


@one_blas_thread()
def experiment_of(
    experiment: str,
    steering: Mapping[str, Any],
    motion_capture: Mapping[str, Any],
    *,
    models: Sequence[FrameChangeMap],
    truth: TrueFrameChanges,
    geometry: HopperGeometry,
    seed: int,
) -> ExperimentTables:
    """Run an experiment on the simulated robot.

    Parameters
    ----------
    experiment : str
        A name of `EXPERIMENTS`.
    steering, motion_capture : mapping
        These blocks of the configuration.
    models : sequence of FrameChangeMap
        What was learned, from one set of hops each; the starts take turns with them.
    truth : TrueFrameChanges
        For the policy that knows it.
    geometry : HopperGeometry
        From the calibration.
    seed : int
        The study's.
    """
    camera, options = camera_of(motion_capture), steering["experiments"]
    robot = robot_of(steering["robot"], camera)
    sight = Sight(camera, geometry, draw_floor(camera.floor, tasks.floor_stream(seed)))
    setting = Setting(experiment, options, robot, sight)
    policies = tasks.policies(
        steering["control"],
        setting.manoeuvre,
        models=models,
        truth=truth,
        swing_limit_rad=robot.swing_limit_rad,
    )
    runs, stances, shown = [], [], []
    for (heading, name), makers in policies.items():
        for start in tasks.draw_starts(
            experiment, heading, options["starts"], distance_m=options["distance_m"], seed=seed
        ):
            model = start.number % len(makers)
            run = setting.run(makers[model], start, heading)
            key = {
                "experiment": experiment, "start": heading, "controller": name, "run": start.number
            }  # fmt: skip
            summary = {"stances": len(run.stances), "blind": run.blind}
            runs.append(key | {"model": model + 1} | vars(run.outcome) | summary)
            stances.append(pd.DataFrame({**key, "stance": run.stances.index, **run.stances}))
            if (heading, name) == (tasks.ANY, SHOWN):
                shown.append((makers[model], start, run))
    policy, start, run = typical(shown)
    return ExperimentTables(
        pd.DataFrame(runs),
        pd.concat(stances, ignore_index=True),
        _example(setting, policy, start, run),
        _film(setting, policy, start, run.stances["time_s"].iloc[0]),
    )


def typical(runs: list[Shown]) -> Shown:
    """Return the run of median hops among those that succeeded; the first if none did."""
    good = sorted((one for one in runs if one[2].outcome.success), key=lambda s: s[2].outcome.hops)
    return good[(len(good) - 1) // 2] if good else runs[0]


def _example(setting: Setting, policy: tasks.Policy, start: tasks.Start, run: Run) -> pd.DataFrame:
    """Return the three curves of a run; a turn is given in the frame of its start."""
    task, board = setting.task(), setting.board(start)
    alone = simulated(setting.controller(policy, start), task, start.pose, run)
    table = pd.concat([_curves(run), alone], ignore_index=True)
    into = (np.nan, np.nan) if board is None else board.direction
    if setting.manoeuvre == tasks.TURN:  # from the origin; the board stands across its heading
        table[POSE] = composed(inverse(start.pose), table[POSE].to_numpy())
        into = into if board is None else (1.0, 0.0)
    return table.assign(
        experiment=setting.experiment,
        run=start.number,
        near=task.near,
        board_first_m=np.nan if board is None else board.place_m,
        board_x=into[0],
        board_y=into[1],
        controller=SHOWN,
    )


def _film(
    setting: Setting, policy: tasks.Policy, start: tasks.Start, first_s: float
) -> pd.DataFrame:
    """Make a run again, which the same chance makes the same, and keep some of its frames."""
    frames: Frames = []
    setting.run(policy, start, tasks.ANY, frames)
    kept = frames[:: max(1, round(setting.sight.camera.rate_hz / FILM_HZ))]
    places = np.array([markers for _, markers in kept])
    names = [f"body{i + 1}" for i in range(places.shape[1] - 1)] + ["boom"]
    table = pd.DataFrame(places.reshape(-1, 3), columns=["x_m", "y_m", "z_m"])
    table.insert(0, "marker", np.tile(names, len(kept)))
    table.insert(0, "time_s", np.repeat([time for time, _ in kept], len(names)) - first_s)
    return table


def _curves(run: Run) -> pd.DataFrame:
    """Return what was measured, and beside it what the model foretold from each stance."""
    made = run.stances
    curves = []
    for name, columns in (("measured", MEASURED), ("response", PREDICTED)):
        curve = pd.DataFrame({"curve": name, "stance": made.index})
        curve["time_s"] = made["time_s"] - made["time_s"].iloc[0]
        curve[POSE] = made[columns]
        curves.append(curve.assign(board_m=made["board_m"] if name == "measured" else np.nan))
    return pd.concat(curves)
