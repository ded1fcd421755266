"""Controller and experiments (Secs. 3.4.3 and 3.5, Figs. 3.5, 3.6, 3.8 and 3.9).

Each seed is a steering study three times: all of it as printed, the printed controller
with hopdata's observation and model, and hopdata's planner. Starts and disturbances are
the same. There are fewer starts than in a study of its own, for the sake of time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.arrays import FloatArray, one_blas_thread, pd
from hopdata.dissertation.rows import Agreement, Made, Row, over_seeds
from hopdata.dissertation.steered import Learned, learned, rms
from hopdata.rigid import wrapped
from hopdata.steering import FLOOR, child
from hopdata.steering.control.interface import Controller
from hopdata.steering.control.objectives import Horizon, ToHeading, ToPoint, goal_errors
from hopdata.steering.control.prediction import predicted_poses
from hopdata.steering.control.printed import PrintedController
from hopdata.steering.control.waypoints import Progress, WayPointFollower, WayPoints
from hopdata.steering.experiments import tasks
from hopdata.steering.experiments.run import (
    MEASURED,
    PREDICTED,
    Run,
    Sight,
    WatchedHopper,
    run_task,
)
from hopdata.steering.experiments.study import Setting, example_of, simulated, typical
from hopdata.steering.models.interface import StrideModel
from hopdata.steering.robot import robot_and_camera
from hopdata.steering.trial import POSE
from hopdata.synthesis.camera import draw_floor

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Who steers: all as printed; the printed controller with hopdata's model; the planner.
ALL_PRINTED = "printed"
OWN_MODEL = "printed controller"
PLANNER = "planner"
#: Starts of each experiment and seed; a study has 30.
#: Unit: 1. Origin: chosen.
STARTS = {"origin": 6, "turn": 3, "origin_board": 3, "turn_board": 3}
#: Starts from which the printed controller looks farther ahead.
#: Unit: 1. Origin: chosen.
FAR_STARTS = 2
#: How far it looks ahead there, in place of 3.
#: Unit: hops. Origin: chosen.
FAR_HOPS = 10
#: Way-points: a square, from its first corner on.
#: Unit: m. Origin: chosen.
SQUARE_M = ((0.8, 0.0), (0.8, 0.8), (0.0, 0.8), (0.0, 0.0))
#: These points, and the distance at which one is reached.
#: Unit: m. Origin: chosen.
WAY_POINTS = WayPoints(points_m=SQUARE_M, arrival_m=0.11)
#: Most hops for each way-point.
#: Unit: hops. Origin: chosen.
HOPS_A_POINT = 30
#: States from which single plans are compared.
#: Unit: 1. Origin: chosen.
PLANS = 10
#: States from which single plans are timed.
#: Unit: 1. Origin: chosen.
TIMED = 8
#: Swings that the search over all sequences tries in each hop.
#: Unit: 1. Origin: chosen.
TRIED = 15
#: Times that it tries, each time nearer to the best so far.
#: Unit: 1. Origin: chosen.
REFINED = 3
#: A search misses if it ends this far above the best, of the sum of three distances.
MISSED_M = 1e-3
ASKED_MS = 100.0
#: A start faces the goal, or away from it, within this of the line to it.
FACING_RAD = np.deg2rad(60)

# When print and result are said to agree.
#: A manoeuvre is done with success if this share of the runs succeeds.
DONE = 0.9


@one_blas_thread()
def make(seeds: Sequence[int]) -> Made:
    """Measure the items of this part."""
    studies = over_seeds(_study, seeds)
    made = [run for study in studies for run in study.all_runs()]
    runs = pd.DataFrame([row for row, _ in made])
    far = pd.concat([_farther(study) for study in studies], ignore_index=True)
    shown = {name: _shown(studies, name) for name in STARTS}
    ways = [_way_points(study) for study in studies]
    examples = pd.concat([one for _, one in shown.values()], ignore_index=True)
    rows = [
        _optima(studies),
        _times(studies),
        _objectives(studies, seeds),
        way_points_row(ways),
        *(figure_row(number, *shown[name]) for name, number in FIGURES.items()),
        _drawn_alone(examples),
        success_row(runs, far),
    ]
    columns = ["seed", "who", "experiment", "run", "success", "hops", "bearing_rad"]
    tables = {
        "runs": runs[columns],
        "farther": far,
        "examples": examples,
        "way_points": ways[0][1],
    }
    return Made(rows, tables)


def draw(tables: Mapping[str, pd.DataFrame]) -> dict[str, Figure]:
    """Draw the runs of chapter III, way-points, and success."""
    from hopdata.dissertation.figures.steering_runs import success_figure
    from hopdata.steering.figures.runs import steering_run_figure

    examples = tables["examples"]
    numbers = {"origin": 5, "turn": 6, "origin_board": 8, "turn_board": 9}
    figures = {}
    for name, number in numbers.items():
        figure = steering_run_figure(examples, experiment=name)
        figures[f"fig3_{number}_{name}"] = figure
    figures["way_points"] = steering_run_figure(tables["way_points"])
    figures["success"] = success_figure(tables["runs"], tables["farther"])
    return figures


# Item of each figure.
FIGURES = {"origin": 72, "turn": 73, "origin_board": 75, "turn_board": 76}


@dataclass(frozen=True)
class _Study:
    """A seed: what was learned, as printed and by hopdata, and who steers with it."""

    number: int
    printed: Learned
    ours: Learned

    def setting(self, experiment: str, who: str) -> Setting:
        """Return an experiment as this controller sees it."""
        one = self.ours
        if who == ALL_PRINTED:
            one = self.printed
        steering = one.config["steering"]
        robot, camera = robot_and_camera(
            steering["robot"], one.config["motion_capture"]
        )
        rng = np.random.default_rng(child(one.seed, FLOOR))
        floor = draw_floor(camera.floor, rng)
        sight = Sight(camera, one.observed.geometry, floor)
        return Setting(experiment, steering["experiments"], robot, sight)

    @cached_property
    def policies(self) -> dict[str, dict[str, tasks.Policy]]:
        """Who steers, by manoeuvre and name."""
        found = {}
        for manoeuvre in (tasks.ORIGIN, tasks.HALF_TURN):
            task = tasks.task_of(self.options, manoeuvre)
            found[manoeuvre] = {
                ALL_PRINTED: self._policy(tasks.PRINTED, task, self.printed),
                OWN_MODEL: self._policy(tasks.PRINTED, task, self.ours),
                PLANNER: self._policy(tasks.PLANNER, task, self.ours),
            }
        return found

    @property
    def options(self) -> Mapping[str, Any]:
        """The experiments' options, which both studies share."""
        options: Mapping[str, Any] = self.ours.config["steering"]["experiments"]
        return options

    def _policy(
        self, name: str, task: tasks.Task, one: Learned, **control: Any
    ) -> tasks.Policy:
        made = tasks.policies(
            [name],
            one.config["steering"]["control"] | control,
            task,
            model=one.process,
            truth=np.zeros((0, 0, 3)),  # nobody who knows the true map takes part
            swing_limit_rad=one.swing_limit_rad,
        )
        return made[name]

    def farther_policy(self, hops: int) -> tasks.Policy:
        """Return the printed controller with another horizon, on the printed model."""
        task = tasks.task_of(self.options, tasks.ORIGIN)
        return self._policy(tasks.PRINTED, task, self.printed, horizon=hops)

    def starts(self, experiment: str, number: int) -> list[tasks.Start]:
        """Return the first starts of an experiment."""
        return tasks.draw_starts(
            experiment,
            number,
            distance_m=self.options["distance_m"],
            seed=self.ours.seed,
        )

    @cached_property
    def runs(self) -> dict[tuple[str, str], list[tuple[tasks.Start, Run]]]:
        """All runs, by experiment and who steers."""
        found = {}
        for experiment, number in STARTS.items():
            manoeuvre, _ = tasks.EXPERIMENTS[experiment]
            for who, policy in self.policies[manoeuvre].items():
                if who == OWN_MODEL and experiment != "origin":
                    continue
                setting = self.setting(experiment, who)
                starts = self.starts(experiment, number)
                found[experiment, who] = [
                    (start, setting.run(policy, start)) for start in starts
                ]
        return found

    def all_runs(self) -> list[tuple[dict[str, Any], Run]]:
        """Return a row for each run, and the run."""
        rows = []
        for (experiment, who), made in self.runs.items():
            for start, run in made:
                row = {
                    "seed": self.number,
                    "who": who,
                    "experiment": experiment,
                    "run": start.number,
                    "success": run.outcome.success,
                    "hops": run.outcome.hops,
                    "bearing_rad": bearing_of(start.pose),
                }
                rows.append((row, run))
        return rows


def _study(seed: int) -> _Study:
    printed = learned(seed, printed=True)
    ours = learned(seed, printed=False)
    return _Study(seed, printed, ours)


def bearing_of(pose: FloatArray) -> float:
    """Return how far a pose is turned away from the origin, rad; 0 at the origin."""
    if not pose[:2].any():
        return 0.0
    way = np.arctan2(-pose[1], -pose[0])
    return float(np.abs(wrapped(way - pose[2])))


# Item 67: how often a search does not find the best sequence.


def _optima(studies: Sequence[_Study]) -> Row:
    values: dict[str, list[float]] = {"single": [], "four": []}
    for study in studies:
        process = study.printed.process
        horizon = Horizon(hops=3, swing_limit_rad=study.printed.swing_limit_rad)
        model = process.within(*horizon.limits(process.axes))
        controller = PrintedController(model=model, horizon=horizon)
        missed = []
        for pose, boom in _states(study, PLANS):
            single = controller.descended(pose, boom, 0.0).fun
            four = controller.plan(pose, boom).objective
            best = min(_best_of_all(controller, pose, boom), four, single)
            missed.append((single - best > MISSED_M, four - best > MISSED_M))
        shares = 100 * np.mean(missed, axis=0)
        values["single"].append(float(shares[0]))
        values["four"].append(float(shares[1]))
    return Row(67, Agreement.BUILT, values, "starts")


def _states(study: _Study, number: int) -> list[tuple[FloatArray, float]]:
    """Return random poses within a metre of the origin, and boom angles."""
    stream = child(study.ours.seed, 67)
    rng = np.random.default_rng(stream)
    places = rng.uniform(-1.0, 1.0, (number, 2))
    angles = rng.uniform(-np.pi, np.pi, (number, 2))
    poses = np.column_stack([places, angles[:, 0]])
    return list(zip(poses, angles[:, 1].tolist(), strict=True))


def _best_of_all(
    controller: PrintedController, pose: FloatArray, boom_rad: float
) -> float:
    """Return the least objective over all sequences of a grid, refined about it."""
    limit = controller.horizon.swing_limit_rad
    hops = controller.horizon.hops
    middle = np.zeros(hops)
    half = limit
    least = np.inf
    for _ in range(REFINED):
        around = np.linspace(-half, half, TRIED)
        swings = [np.clip(centre + around, -limit, limit) for centre in middle]
        mesh = np.meshgrid(*swings, indexing="ij")
        tried = np.stack(mesh, axis=-1).reshape(-1, hops)
        poses = predicted_poses(controller.model, pose, boom_rad, tried)
        values = goal_errors(controller.objective, poses[1:]).sum(axis=0)
        middle = tried[values.argmin()]
        least = min(least, float(values.min()))
        # Next, between the neighbours of the best: a step of the grid to either side.
        half = 2 * half / (TRIED - 1)
    return least


# Item 68: how long a plan takes.


def _times(studies: Sequence[_Study]) -> Row:
    names = ("printed", "printed_most", "quick", "planner")
    values: dict[str, list[float]] = {name: [] for name in names}
    for study in studies:
        limit = study.printed.swing_limit_rad
        slow = study.printed.process
        horizon = Horizon(hops=3, swing_limit_rad=limit)
        table = slow.within(*horizon.limits(slow.axes))
        quick = PrintedController(model=table, horizon=horizon)
        start = study.starts("origin", 1)[0]
        planner = study.policies[tasks.ORIGIN][PLANNER](start)
        states = _states(study, TIMED)
        _as_printed(slow, *states[0], limit)  # what is loaded at first does not count
        printed = [
            _milliseconds(partial(_as_printed, slow, pose, boom, limit))
            for pose, boom in states
        ]
        values["printed"].append(float(np.median(printed)))
        values["printed_most"].append(max(printed))
        for name, controller in (("quick", quick), ("planner", planner)):
            took = [
                _milliseconds(partial(controller.plan, pose, boom))
                for pose, boom in states
            ]
            values[name].append(float(np.median(took)))
    agreement = Agreement.DIFFERS
    if np.median(values["printed"]) < ASKED_MS:
        agreement = Agreement.AGREES
    return Row(68, agreement, values, "machine")


def _milliseconds(plan: Callable[[], Any]) -> float:
    """Return the processor time of a call, ms; other work of the machine is no part."""
    begun = time.process_time()
    plan()
    return 1e3 * (time.process_time() - begun)


def _as_printed(
    model: StrideModel, pose: FloatArray, boom_rad: float, limit_rad: float
) -> Any:
    """Plan by SciPy's L-BFGS-B with its own differences, from no swing."""
    from scipy.optimize import minimize

    def objective(swings: FloatArray) -> float:
        poses = predicted_poses(model, pose, boom_rad, swings)
        return float(goal_errors(ToPoint(), poses[1:]).sum())

    bounds = [(-limit_rad, limit_rad)] * 3
    return minimize(objective, np.zeros(3), method="L-BFGS-B", bounds=bounds)


# Item 69: the objectives.


def _objectives(studies: Sequence[_Study], seeds: Sequence[int]) -> Row:
    """Compare with the formulas, and the planner's foresight with what it takes."""
    rng = np.random.default_rng(np.random.SeedSequence(seeds[0]))
    poses = rng.uniform(-4, 4, (1000, 3))
    asked = rng.uniform(-np.pi, np.pi)
    apart = asked - poses[:, 2]
    angle = np.abs(np.arctan2(np.sin(apart), np.cos(apart)))
    own_angle = goal_errors(ToHeading(heading_rad=asked), poses)
    by_angle = np.abs(own_angle - angle).max()
    distance = np.sqrt((poses[:, :2] ** 2).sum(axis=1))
    own_distance = goal_errors(ToPoint(), poses)
    by_distance = np.abs(own_distance - distance).max()
    foreseen = []
    needed = []
    for study in studies:
        for start, run in study.runs["origin", PLANNER]:
            planner = study.policies[tasks.ORIGIN][PLANNER](start)
            foreseen.append(_first_plan(planner, run))
            needed.append(len(run.stances) - 1)
    values = {
        "difference": float(max(by_angle, by_distance)),
        "foreseen": float(np.median(foreseen)),
        "needed": float(np.median(needed)),
    }
    return Row(69, Agreement.BUILT, values)


def _first_plan(controller: Controller, run: Run) -> float:
    """Return the objective of the plan at the first stance of a run."""
    first = run.stances.dropna(subset=MEASURED).iloc[0]
    pose = first[MEASURED].to_numpy(dtype=float)
    return controller.plan(pose, float(first["boom_angle_rad"])).objective


# Item 70: way-points.


def _way_points(study: _Study) -> tuple[dict[str, float], pd.DataFrame]:
    """Return how many points each visits, on the robot and in the model, and curves."""
    start = study.starts("waypoints", 1)[0]
    visited: dict[str, float] = {}
    curves = []
    for who in (ALL_PRINTED, PLANNER):
        steering = study.policies[tasks.ORIGIN][who]

        def policy(one: tasks.Start, known: tasks.Policy = steering) -> Controller:
            return WayPointFollower(known(one), WAY_POINTS)

        options = dict(study.options)
        options["waypoints_m"] = SQUARE_M
        options["arrived_m"] = WAY_POINTS.arrival_m
        options["hops"] = HOPS_A_POINT
        setting = replace(study.setting("waypoints", who), options=options)
        task = setting.task
        hopper = WatchedHopper(setting.robot, setting.sight, task, start)
        run = run_task(hopper, policy(start))
        alone = simulated(policy(start), task, start.pose, run)
        visited[who] = _number_visited(run.stances[POSE])
        visited[f"{who}_alone"] = _number_visited(alone[POSE])
        visited[f"{who}_hops"] = len(run.stances) - 1
        curves.append(example_of(setting, who, policy, start, run))
    return visited, pd.concat(curves, ignore_index=True)


def _number_visited(poses: pd.DataFrame) -> int:
    """Return how many way-points a run visits in their order."""
    progress = Progress(WAY_POINTS)
    for pose in poses.to_numpy(dtype=float):
        progress(pose)
    return progress.visited


def way_points_row(ways: Sequence[tuple[dict[str, float], pd.DataFrame]]) -> Row:
    """Judge item 70: whether the printed controller follows them in its model."""
    values: dict[str, Any] = {
        "points": len(SQUARE_M),
        "most": HOPS_A_POINT * len(SQUARE_M),
    }
    for name in ways[0][0]:
        values[name] = [visited[name] for visited, _ in ways]
    agreement = Agreement.DIFFERS
    if np.median(values["printed_alone"]) >= len(SQUARE_M) / 2:
        agreement = Agreement.PARTLY
    if np.median(values["printed_alone"]) == len(SQUARE_M):
        agreement = Agreement.AGREES
    return Row(70, agreement, values, "square")


# Items 72, 73, 75 and 76: the runs of the figures.


def _shown(
    studies: Sequence[_Study], experiment: str
) -> tuple[dict[str, Any], pd.DataFrame]:
    """Return what the typical runs show, over the seeds, and the curves of one seed.

    Of each seed it is the printed controller's run with the median number of hops, if
    one succeeded, and the planner's from the same start. The curves are those of the
    first seed in which one did.
    """
    values: dict[str, Any] = {}
    curves: list[pd.DataFrame] = []
    for study in studies:
        chosen = typical(study.runs[experiment, ALL_PRINTED])
        if chosen is None:
            continue
        start, printed = chosen
        of_planner = study.runs[experiment, PLANNER]
        ours = {other.number: run for other, run in of_planner}[start.number]
        own_curves = []
        for who, run in ((ALL_PRINTED, printed), (PLANNER, ours)):
            setting = study.setting(experiment, who)
            policy = study.policies[setting.manoeuvre][who]
            own_curves.append(example_of(setting, who, policy, start, run))
            found = _closeness(run, own_curves[-1])
            found["done"] = int(run.outcome.success)
            found["hops"] = len(run.stances) - 1
            for name, value in found.items():
                values.setdefault(f"{who}_{name}", []).append(value)
        if printed.outcome.success and not curves:
            curves = own_curves
        last = own_curves
    return values, pd.concat(curves or last, ignore_index=True)


def _closeness(run: Run, curves: pd.DataFrame) -> dict[str, float]:
    """Return how far response and pure simulation are from the run, rms, mm."""
    made = run.stances
    response = made[PREDICTED].to_numpy() - made[MEASURED].to_numpy()
    pure = curves[curves["curve"] == "pure"]
    measured = curves[curves["curve"] == "measured"]
    both = min(len(pure), len(measured))
    places = ["x_m", "y_m"]
    apart = pure[places].to_numpy()[:both] - measured[places].to_numpy()[:both]
    return {
        "response": 1e3 * rms(np.linalg.norm(response[:, :2], axis=1)),
        "pure": 1e3 * rms(np.linalg.norm(apart, axis=1)),
    }


def figure_row(number: int, values: Mapping[str, Any], _curves: pd.DataFrame) -> Row:
    """Tell whether the run is done, and the response closer than pure simulation."""
    done = np.mean(values["printed_done"]) >= DONE
    is_close = np.median(values["printed_response"]) < np.median(values["printed_pure"])
    agreement = Agreement.PARTLY
    if done and is_close:
        agreement = Agreement.AGREES
    if not (done or is_close):
        agreement = Agreement.DIFFERS
    counts = {
        "seeds": len(values["printed_done"]),
        "printed_number": sum(values["printed_done"]),
        "planner_number": sum(values["planner_done"]),
    }
    return Row(number, agreement, {**values, **counts}, "chosen")


def _drawn_alone(examples: pd.DataFrame) -> Row:
    """Item 77: draw the figures of the printed controller alone."""
    from hopdata.steering.figures.runs import steering_run_figure

    alone = examples[examples["controller"] == tasks.PRINTED]
    drawn = 0
    for experiment in FIGURES:
        figure = steering_run_figure(alone, experiment=experiment)
        # The arena, x, y and heading.
        drawn += int(len(figure.axes) == len(POSE) + 1)
    agreement = Agreement.DIFFERS
    if drawn == len(FIGURES):
        agreement = Agreement.BUILT
    return Row(77, agreement, {"drawn": drawn, "asked": len(FIGURES)})


# Item 78: success, and why the printed controller fails.


def _farther(study: _Study) -> pd.DataFrame:
    """Return runs of the printed controller to the origin, by its horizon."""
    rows = []
    setting = study.setting("origin", ALL_PRINTED)
    policy = study.farther_policy(FAR_HOPS)
    near = study.runs["origin", ALL_PRINTED][:FAR_STARTS]
    for start, run in near:
        again = setting.run(policy, start)
        for hops, one in ((3, run), (FAR_HOPS, again)):
            row = (study.number, hops, start.number, one.outcome.success)
            rows.append(row)
    return pd.DataFrame(rows, columns=["seed", "horizon", "run", "success"])


def success_row(runs: pd.DataFrame, far: pd.DataFrame) -> Row:
    """Count successes by experiment, who steers, heading of the start and horizon."""
    values: dict[str, Any] = {}
    shares = {}
    for (experiment, who), group in runs.groupby(["experiment", "who"]):
        by_seed = group.groupby("seed")["success"].sum()
        name = f"{str(who).replace(' ', '_')}_{experiment}"
        values[name] = [int(number) for number in by_seed]
        shares[name] = float(group["success"].mean())
    for experiment, number in STARTS.items():
        values[f"of_{experiment}"] = number
    origin = runs[runs["experiment"] == "origin"]
    for who, short in ((ALL_PRINTED, "printed"), (OWN_MODEL, "own")):
        own = origin[origin["who"] == who]
        facing = own[own["bearing_rad"] < FACING_RAD]
        away = own[own["bearing_rad"] > np.pi - FACING_RAD]
        for name, group in (("facing", facing), ("away", away)):
            values[f"{short}_{name}"] = int(group["success"].sum())
            values[f"of_{name}"] = len(group)
    for hops, name in ((3, "near"), (FAR_HOPS, "far")):
        values[name] = int(far.loc[far["horizon"] == hops, "success"].sum())
    values["of_far"] = len(far) // 2
    values["far_hops"] = FAR_HOPS
    turns = runs[(runs["experiment"] == "turn") & runs["success"]]
    values["turn_hops"] = 0
    if len(turns):
        values["turn_hops"] = int(turns["hops"].median())
    done = [shares[f"printed_{experiment}"] >= DONE for experiment in STARTS]
    agreement = Agreement.DIFFERS
    if any(done):
        agreement = Agreement.PARTLY
    if all(done):
        agreement = Agreement.AGREES
    return Row(78, agreement, values, "horizon")
