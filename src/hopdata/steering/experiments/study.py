"""One experiment: all controllers from all starts, and a typical run to look at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.blas import one_blas_thread
from hopdata.errors import chosen
from hopdata.rigid import composed, inverse
from hopdata.steering.control.objectives import Controller
from hopdata.steering.experiments.run import Run, Sight, run_task
from hopdata.steering.experiments.tasks import (
    ANY,
    BOARD,
    EXPERIMENTS,
    PLANNER,
    TURN,
    Policy,
    Start,
    Task,
    board_for,
    decided,
    draw_starts,
    errors_of,
    floor_stream,
    goal_of,
    policies,
    tasks_of,
)
from hopdata.steering.models.tabulated import FrameChangeMap
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.robot import Board, SteeredHopper, camera_of, robot_of
from hopdata.steering.trial import TrueFrameChanges
from hopdata.synthesis.camera import draw_floor

if TYPE_CHECKING:
    import pandas as pd

# A run in which the model stands in for the hopper: what would happen were it right.


def simulated(controller: Controller, task: Task, start: ArrayLike, run: Run) -> pd.DataFrame:
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
    import pandas as pd

    seen = np.isfinite(run.measured[:, 0])
    pose = np.array(run.measured[seen][0] if seen.any() else start, dtype=float)
    boom = float(run.boom_angle_rad[seen][0]) if seen.any() else np.pi
    hop_s = float(np.diff(run.time_s).mean()) if len(run.time_s) > 1 else np.nan
    poses, errors, swing = [pose], [float(errors_of(task.manoeuvre, start, pose))], None
    while not decided(task, errors):
        plan = controller.plan(pose, boom, swing)
        pose, swing = plan.poses[1], plan.swing_rad
        boom += swing
        poses.append(pose)
        errors.append(float(errors_of(task.manoeuvre, start, pose)))
    stances = np.arange(len(poses))
    table = pd.DataFrame(np.array(poses), columns=["x_m", "y_m", "heading_rad"])
    return table.assign(curve="pure", stance=stances, time_s=stances * hop_s)


FILM_HZ = 10.0
POSE = ("x_m", "y_m", "heading_rad")


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


def run_experiment(
    experiment: str,
    options: Mapping[str, Any],
    policies: Mapping[tuple[str, str], Sequence[Policy]],
    *,
    shown: str,
    robot: SteeredHopper,
    sight: Sight,
    seed: int,
) -> ExperimentTables:
    """Run an experiment.

    Parameters
    ----------
    experiment : str
        A name of `EXPERIMENTS`.
    options : mapping
        The config's ``steering.experiments``.
    policies : mapping
        Start ("facing", "any") and name of each controller to what makes it for a goal: one or
        more, with which the starts take turns.
    shown : str
        The controller whose run of median hops is the example.
    robot : SteeredHopper
    sight : Sight
    seed : int
        The study's.
    """
    import pandas as pd

    manoeuvre, way = EXPERIMENTS[experiment]
    runs, stances, of_shown = [], [], []
    for (heading, name), makers in policies.items():
        task = tasks_of(options)[manoeuvre, heading]
        key = {"experiment": experiment, "start": heading, "controller": name}
        for start in _starts(experiment, heading, options, seed):
            board = _board(manoeuvre, way, start, options)
            number = start.number % len(makers)
            controller = makers[number](goal_of(manoeuvre, start.pose))
            run = run_task(robot, sight, controller, task, start, board=board)
            runs.append(key | {"run": start.number, "model": number + 1} | _summary(run))
            stances.append(_stances(run).assign(**key, run=start.number))
            if (heading, name) == (ANY, shown):
                of_shown.append((start, run))
    start, run = typical(of_shown)
    policy = policies[ANY, shown][start.number % len(policies[ANY, shown])]
    example = example_of(experiment, options, policy, start, run)
    film = _film(experiment, options, policy, start, robot, sight)
    film["time_s"] -= run.time_s[0]
    key_first = ["experiment", "start", "controller", "run"]
    table = pd.concat(stances, ignore_index=True)
    columns = [*key_first, *(c for c in table.columns if c not in key_first)]
    example = example.assign(controller=shown)
    return ExperimentTables(pd.DataFrame(runs), table[columns], example, film)


def typical(runs: list[tuple[Start, Run]]) -> tuple[Start, Run]:
    """Return the run of median hops among those that succeeded; the first if none did."""
    good = sorted(
        (pair for pair in runs if pair[1].outcome.success), key=lambda p: p[1].outcome.hops
    )
    return good[(len(good) - 1) // 2] if good else runs[0]


def example_of(
    experiment: str, options: Mapping[str, Any], policy: Policy, start: Start, run: Run
) -> pd.DataFrame:
    """Return the three curves of a run; a turn is given in the frame of its start."""
    import pandas as pd

    manoeuvre, way = EXPERIMENTS[experiment]
    task = tasks_of(options)[manoeuvre, ANY]
    alone = simulated(policy(goal_of(manoeuvre, start.pose)), task, start.pose, run)
    table = pd.concat([_curves(run), alone], ignore_index=True)
    board = _board(manoeuvre, way, start, options)
    into = (np.nan, np.nan) if board is None else board.direction
    if manoeuvre == TURN:  # it begins at the origin, and the board stands across its heading
        table[list(POSE)] = composed(inverse(start.pose), table[list(POSE)].to_numpy())
        into = into if board is None else (1.0, 0.0)
    return table.assign(
        experiment=experiment,
        run=start.number,
        near=task.near,
        board_first_m=np.nan if board is None else board.place_m,
        board_x=into[0],
        board_y=into[1],
    )


def _film(
    experiment: str,
    options: Mapping[str, Any],
    policy: Policy,
    start: Start,
    robot: SteeredHopper,
    sight: Sight,
) -> pd.DataFrame:
    """Make a run again, which the same chance makes the same, and keep some of its frames."""
    import pandas as pd

    manoeuvre, way = EXPERIMENTS[experiment]
    frames: list[tuple[float, Any]] = []
    run_task(
        robot, sight, policy(goal_of(manoeuvre, start.pose)), tasks_of(options)[manoeuvre, ANY],
        start, board=_board(manoeuvre, way, start, options), frames=frames,
    )  # fmt: skip
    kept = frames[:: max(1, round(sight.camera.rate_hz / FILM_HZ))]
    places = np.array([markers for _, markers in kept])
    names = [f"body{i + 1}" for i in range(places.shape[1] - 1)] + ["boom"]
    table = pd.DataFrame(places.reshape(-1, 3), columns=["x_m", "y_m", "z_m"])
    table.insert(0, "marker", np.tile(names, len(kept)))
    table.insert(0, "time_s", np.repeat([time for time, _ in kept], len(names)))
    return table


def _starts(experiment: str, heading: str, options: Mapping[str, Any], seed: int) -> list[Start]:
    return draw_starts(
        experiment, heading, options["starts"], distance_m=options["distance_m"], seed=seed
    )


def _board(manoeuvre: str, way: str, start: Start, options: Mapping[str, Any]) -> Board | None:
    if way != BOARD:
        return None
    return board_for(
        manoeuvre, start.pose, drag_n=options["drag_n"], ahead_m=options["board_ahead_m"]
    )


def _summary(run: Run) -> dict[str, Any]:
    return {
        "success": run.outcome.success,
        "hops": run.outcome.hops,
        "reason": run.outcome.reason,
        "stances": len(run.time_s),
        "blind": run.blind,
    }


def _stances(run: Run) -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame(
        {
            "stance": np.arange(len(run.time_s)),
            "time_s": run.time_s,
            **dict(zip(POSE, run.pose.T, strict=True)),
            **{f"measured_{n}": v for n, v in zip(POSE, run.measured.T, strict=True)},
            "boom_angle_rad": run.boom_angle_rad,
            "swing_rad": run.swing_rad,
            **{f"predicted_{n}": v for n, v in zip(POSE, run.predicted.T, strict=True)},
            "board_m": run.board_m,
        }
    )


def _curves(run: Run) -> pd.DataFrame:
    import pandas as pd

    return pd.concat(
        [
            pd.DataFrame(
                {
                    "curve": name,
                    "stance": np.arange(len(run.time_s)),
                    "time_s": run.time_s - run.time_s[0],
                    **dict(zip(POSE, poses.T, strict=True)),
                    "board_m": run.board_m if name == "measured" else np.nan,
                }
            )
            for name, poses in (("measured", run.measured), ("response", run.predicted))
        ]
    )


# One experiment from the blocks of the configuration.


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
    camera = camera_of(motion_capture)
    robot = robot_of(steering["robot"], camera)
    return run_experiment(
        experiment,
        steering["experiments"],
        policies(
            steering["control"],
            chosen("experiment", experiment, EXPERIMENTS)[0],
            models=models,
            truth=truth,
            swing_limit_rad=robot.swing_limit_rad,
        ),
        shown=PLANNER,
        robot=robot,
        sight=Sight(camera, geometry, draw_floor(camera.floor, floor_stream(seed))),
        seed=seed,
    )
