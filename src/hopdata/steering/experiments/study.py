"""The experiments: all controllers from all starts, and typical runs as examples."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import one_blas_thread, pd
from hopdata.rigid import composed, inverse
from hopdata.steering import FLOOR, child
from hopdata.steering.control.interface import Controller
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
    error_at = tasks.progress_of(task, start)
    pose = np.array(start, dtype=float)
    boom = np.pi
    seen = run.stances.dropna(subset=MEASURED)
    if len(seen):
        pose = seen[MEASURED].to_numpy()[0]
        boom = float(seen["boom_angle_rad"].iloc[0])
    poses = [pose]
    errors = [error_at(pose)]
    swing = None
    while not tasks.decided(task, errors):
        plan = controller.plan(pose, boom, swing)
        pose = plan.poses[1]
        swing = plan.swing_rad
        boom += swing
        poses.append(pose)
        errors.append(error_at(pose))
    stances = np.arange(len(poses))
    hop_s = run.stances["time_s"].diff().mean()
    table = pd.DataFrame(np.array(poses), columns=POSE)
    return table.assign(curve="pure", stance=stances, time_s=stances * hop_s)


#: Frame rate of the film.
#: Unit: Hz. Origin: chosen.
FILM_HZ = 10.0

# A run and where it starts.
Shown: TypeAlias = tuple[tasks.Start, Run]

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Setting:
    """An experiment, its options, the robot, and how it is seen.

    The options are the block ``steering.experiments``.
    """

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
        key = "turn_ahead_m"
        if manoeuvre == tasks.ORIGIN:
            key = "board_ahead_m"
        return board_for(
            manoeuvre,
            start.pose,
            drag_n=self.options["drag_n"],
            ahead_m=self.options[key],
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
        Three curves of one run, of the controller that `tasks.shown_of` chooses, and
        after them those of the run from the same start of the controller that
        `tasks.beside_of` chooses, if it does: ``curve`` is
        "measured", "response" (predicted from each measured stance), "pure" (controller
        and model alone; NaN where the controller predicts nothing) or "point" (the
        way-points);
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
    pieces: dict[str, list[pd.DataFrame]] = {name: [] for name in TABLES}
    # Preparing a policy takes seconds; it serves all experiments of a manoeuvre.
    prepared: dict[str, Mapping[str, tasks.Policy]] = {}
    for name in names:
        setting = Setting(name, options, robot, sight)
        manoeuvre = setting.manoeuvre
        starts = tasks.draw_starts(
            name, options["starts"], distance_m=options["distance_m"], seed=seed
        )
        if manoeuvre not in prepared:
            prepared[manoeuvre] = tasks.policies(
                controllers,
                steering["control"],
                setting.task,
                model=model,
                truth=truth.average(),
                swing_limit_rad=robot.swing_limit_rad,
            )
        for table, made in _tables(setting, prepared[manoeuvre], starts).items():
            pieces[table] += made
    return {name: _joined(pieces[name], columns) for name, columns in TABLES.items()}


# Tables of the experiments and their columns, which a table without rows has too.
OF_RUN = ("experiment", "controller", "run")
OF_OUTCOME = tuple(field.name for field in fields(tasks.RunOutcome))
TABLES: Mapping[str, tuple[str, ...]] = {
    "runs": (
        *OF_RUN,
        *OF_OUTCOME,
        "stances",
        "blind",
        "late_commands",
        "rests",
        "touched",
        "last_error",
    ),
    "stances": (*OF_RUN, "stance", *watched.COLUMNS),
    "example": (
        "curve",
        "stance",
        "time_s",
        *POSE,
        "board_m",
        *OF_RUN,
        "success",
        "near",
        "board_x",
        "board_y",
        "board_first_m",
    ),
    "film": ("time_s", "marker", "x_m", "y_m", "z_m", "experiment"),
}


def _joined(pieces: Sequence[pd.DataFrame], columns: Sequence[str]) -> pd.DataFrame:
    """Return the pieces as one table with these columns, also if there are none."""
    if not pieces:
        return pd.DataFrame(columns=list(columns))
    return pd.concat(pieces, ignore_index=True)[list(columns)]


#: Most starts for comparing horizons.
#: Unit: 1. Origin: chosen.
FEW = 10


def horizons_of(
    steering: Mapping[str, Any], motion_capture: Mapping[str, Any], **learned: Any
) -> pd.DataFrame:
    """Run the printed controller to the origin with several horizons.

    All else is equal. For the other parameters see `experiments_of`.

    Returns
    -------
    DataFrame
        ``horizon, runs, succeeded`` and ``hops``, the median over the successful runs.
    """
    experiments = dict(steering["experiments"])
    experiments["starts"] = min(FEW, experiments["starts"])
    rows = []
    for hops in experiments["horizons"]:
        asked = dict(steering)
        asked["control"] = {**steering["control"], "horizon": hops}
        asked["experiments"] = experiments
        tables = experiments_of(
            [tasks.ORIGIN], [tasks.PRINTED], asked, motion_capture, **learned
        )
        runs = tables["runs"]
        good = runs[runs["success"]]
        rows.append((hops, len(runs), len(good), good["hops"].median()))
    return pd.DataFrame(rows, columns=["horizon", "runs", "succeeded", "hops"])


def _tables(
    setting: Setting,
    policies: Mapping[str, tasks.Policy],
    starts: Sequence[tasks.Start],
) -> dict[str, list[pd.DataFrame]]:
    """Return the four tables of an experiment, each as a list of pieces."""
    pieces: dict[str, list[pd.DataFrame]] = {name: [] for name in TABLES}
    shown = tasks.shown_of(policies)
    chosen: Shown | None = None
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
            pieces["runs"].append(_outcome_row(key, run))
            columns = {**key, "stance": run.stances.index + 1, **run.stances}
            pieces["stances"].append(pd.DataFrame(columns))
        if name == shown:
            # Of all other controllers, no run is kept.
            chosen = typical(list(zip(starts, made, strict=True)))
    if shown is None or chosen is None:
        return pieces
    start, run = chosen
    pieces["example"].append(example_of(setting, shown, policies[shown], start, run))
    pieces["film"].append(_film(setting, run))
    beside = tasks.beside_of(policies)
    if beside is not None:
        # Made once more, since all runs with all of their frames would be much to keep.
        again = setting.run(policies[beside], start)
        if was_seen(again):
            example = example_of(setting, beside, policies[beside], start, again)
            pieces["example"].append(example)
    return pieces


def _outcome_row(key: Mapping[str, Any], run: Run) -> pd.DataFrame:
    """Return the row of a run in the table of runs."""
    row = {
        **key,
        **asdict(run.outcome),
        "stances": len(run.stances),
        "blind": run.blind,
        "late_commands": run.late_commands,
        "rests": run.rests,
        "touched": int(run.stances["touched"].sum()),
        "last_error": run.last_error,
    }
    return pd.DataFrame([row])


def typical(runs: list[Shown]) -> Shown | None:
    """Return the successful run with the median number of hops.

    If none succeeded, it is the first in which a stance was seen; None if there is none
    either.
    """
    good = [(start, run) for start, run in runs if run.outcome.success]
    if good:
        good.sort(key=lambda shown: shown[1].outcome.hops)
        return good[(len(good) - 1) // 2]
    for start, run in runs:
        if was_seen(run):
            return start, run
    return None


def was_seen(run: Run) -> bool:
    """Tell whether the pose of any stance of a run was measured."""
    return bool(run.stances[MEASURED].notna().all(axis=1).any())


def example_of(
    setting: Setting,
    controller: str,
    policy: tasks.Policy,
    start: tasks.Start,
    run: Run,
) -> pd.DataFrame:
    """Return the three curves of a run, and its way-points.

    Turns are in the frame of their start. See `experiments_of`.
    """
    task = setting.task
    board = setting.board(start)
    alone = simulated(policy(start), task, start.pose, run)
    points = pd.DataFrame(task.points_m, columns=["x_m", "y_m"])
    points = points.assign(curve="point", stance=points.index)
    pieces = [_curves(run), alone]
    if len(points):
        pieces.append(points)
    table = pd.concat(pieces, ignore_index=True)
    is_turn = setting.manoeuvre == tasks.HALF_TURN
    if is_turn:
        table[POSE] = composed(inverse(start.pose), table[POSE].to_numpy())
    if board is None:
        direction = (np.nan, np.nan)
        board_first_m = np.nan
    elif is_turn:
        # It is across the initial heading, the x axis of the frame of the start.
        direction = (1.0, 0.0)
        board_first_m = board.place_m
    else:
        direction = board.direction
        board_first_m = board.place_m
    return table.assign(
        experiment=setting.experiment,
        controller=controller,
        run=start.number,
        success=run.outcome.success,
        near=task.near,
        board_x=direction[0],
        board_y=direction[1],
        board_first_m=board_first_m,
    )


def _film(setting: Setting, run: Run) -> pd.DataFrame:
    """Return a subset of the frames of a run."""
    first_s = run.stances["time_s"].iloc[0]
    every = max(1, round(setting.sight.camera.rate_hz / FILM_HZ))
    kept = run.frames[::every]
    times = [time for time, _ in kept]
    positions = np.array([markers for _, markers in kept])
    # The last marker is that of the boom.
    n_body = positions.shape[1] - 1
    names = [f"body{i + 1}" for i in range(n_body)] + ["boom"]
    table = pd.DataFrame(positions.reshape(-1, 3), columns=["x_m", "y_m", "z_m"])
    table.insert(0, "marker", np.tile(names, len(kept)))
    table.insert(0, "time_s", np.repeat(times, len(names)) - first_s)
    return table.assign(experiment=setting.experiment)


def _curves(run: Run) -> pd.DataFrame:
    """Return the measured curve, and the one the model predicted from each stance."""
    made = run.stances
    curves = []
    for name, columns in (("measured", MEASURED), ("response", PREDICTED)):
        curve = pd.DataFrame({"curve": name, "stance": made.index + 1})
        curve["time_s"] = made["time_s"] - made["time_s"].iloc[0]
        curve[POSE] = made[columns]
        curve["board_m"] = np.nan
        if name == "measured":
            curve["board_m"] = made["board_m"]
        curves.append(curve)
    return pd.concat(curves)


def board_for(
    manoeuvre: str, start: ArrayLike, *, drag_n: float, ahead_m: float
) -> Board:
    """Return the board in the way of a manoeuvre.

    It stands across the line to the origin, or across the initial heading. It is as
    wide as the floor. A hopper that reaches the origin has therefore pushed it, and so
    has one that turned round, if the board is no farther than a turn takes the hopper
    forward.

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
    if manoeuvre == tasks.ORIGIN:
        way = -pose[:2] / np.hypot(pose[0], pose[1])
    else:
        way = np.array([np.cos(pose[2]), np.sin(pose[2])])
    return Board(
        direction=(float(way[0]), float(way[1])),
        place_m=float(pose[:2] @ way) + ahead_m + Board.reach_m,
        drag_n=drag_n,
    )
