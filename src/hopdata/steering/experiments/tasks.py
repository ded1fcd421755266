"""The experiments: tasks, starts and controllers (dissertation, Sec. 3.5)."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import chosen
from hopdata.rigid import wrapped
from hopdata.steering import START, child
from hopdata.steering.control import objectives
from hopdata.steering.control.adaptive import AdaptivePlanner
from hopdata.steering.control.interface import Controller, Plan
from hopdata.steering.control.planner import Planner, planner
from hopdata.steering.control.printed import PrintedController
from hopdata.steering.control.waypoints import Progress, WayPointFollower, WayPoints
from hopdata.steering.frame_changes import hopper_axes
from hopdata.steering.models.process import FrameChangeProcess
from hopdata.steering.models.stride_table import StrideTable

ORIGIN, HALF_TURN, WAYPOINTS = "origin", "turn", "waypoints"

# Manoeuvre of each experiment, and whether there is a board in the way.
EXPERIMENTS: Mapping[str, tuple[str, bool]] = {
    "origin": (ORIGIN, False),
    "turn": (HALF_TURN, False),
    "origin_board": (ORIGIN, True),
    "turn_board": (HALF_TURN, True),
    "waypoints": (WAYPOINTS, False),
}


@dataclass(frozen=True, kw_only=True)
class Task:
    """Success criterion of a run.

    Parameters
    ----------
    manoeuvre : {"origin", "turn", "waypoints"}
        Go to the origin, turn by 180 degrees, or visit points in order.
    near : float
        Tolerance for arrival: distance from the point, m, or heading error, rad.
    hops : int
        Largest number of hops. The run ends with the arrival, since a hopper that moves
        forward in each hop cannot stay.
    points_m : tuple of (x, y)
        Points to visit, world frame, m; none for the other manoeuvres.
    """

    manoeuvre: str
    near: float
    hops: int
    points_m: tuple[tuple[float, float], ...] = ()

    @property
    def way_points(self) -> WayPoints:
        """The points with the tolerance for arrival."""
        return WayPoints(points_m=self.points_m, arrival_m=self.near)


@dataclass(frozen=True)
class RunOutcome:
    """RunOutcome of a run: success, number of hops to arrival (-1 if never), reason."""

    success: bool
    hops: int
    reason: str


ARRIVED = "arrived"
LATE = "not in time"
FELL = "fell"
UNTOUCHED = "arrived, but never touched the board"


def task_of(experiments: Mapping[str, Any], manoeuvre: str) -> Task:
    """Return the task of a manoeuvre by the block ``steering.experiments``."""
    near = experiments["arrived_m"]
    hops = experiments["hops"]
    points: tuple[tuple[float, float], ...] = ()
    if manoeuvre == HALF_TURN:
        near = experiments["turned_rad"]
        hops = experiments["turn_hops"]
    if manoeuvre == WAYPOINTS:
        points = tuple((x, y) for x, y in experiments["waypoints_m"])
        hops = hops * len(points)
    return Task(manoeuvre=manoeuvre, near=near, hops=hops, points_m=points)


def progress_of(task: Task, start: ArrayLike) -> Callable[[ArrayLike], float]:
    """Return a function that gives the error of each stance of a run, m or rad.

    It takes the poses (3,) of the stances one after another. For way-points, the error
    is the way that is left.
    """
    if task.manoeuvre == WAYPOINTS:
        return Progress(task.way_points)
    goal = goal_of(task.manoeuvre, start)
    return lambda pose: float(objectives.goal_errors(goal, pose))


def goal_of(manoeuvre: str, start: ArrayLike) -> objectives.Objective:
    """Return the controller's objective.

    It is the origin, or the heading opposite to the initial one.
    """
    if manoeuvre == ORIGIN:
        return objectives.ToPoint(point_m=(0.0, 0.0))
    heading = float(np.asarray(start)[2])
    return objectives.ToHeading(heading_rad=float(wrapped(heading + np.pi)))


def judged(
    task: Task, errors: ArrayLike, *, fell: bool = False, touched: bool = True
) -> RunOutcome:
    """Judge a run.

    Parameters
    ----------
    task : Task
    errors : (K + 1,) array
        Errors at the stances, starting with the first landing: the k-th is k hops
        later.
    fell : bool
        Whether the run ended in a fall.
    touched : bool
        Whether the board, if any, was touched: a run that it did not impede does not
        count.
    """
    in_time = np.asarray(errors, dtype=float)[: task.hops + 1]
    arrivals = np.flatnonzero(in_time <= task.near)
    if not len(arrivals):
        return RunOutcome(success=False, hops=-1, reason=FELL if fell else LATE)
    reason = ARRIVED if touched else UNTOUCHED
    return RunOutcome(success=touched, hops=int(arrivals[0]), reason=reason)


def decided(task: Task, errors: Sequence[float]) -> bool:
    """Return whether further hops cannot change the outcome."""
    return errors[-1] <= task.near or len(errors) > task.hops


# Random starts: the pose at release, and the random streams of each run.


@dataclass(frozen=True)
class Start:
    """One start: its number, its pose (3,) m, m, rad, and the seed of all that follows.

    Runs of different controllers from one start have the same kicks and the same noise.
    """

    number: int
    pose: FloatArray
    seed: np.random.SeedSequence

    def streams(self) -> list[np.random.Generator]:
        """Return generators of kicks, noise, gaps, random swings and lost frames.

        They are new, and the same, at every call.
        """
        return [np.random.default_rng(one) for one in child(self.seed).spawn(5)]


def draw_starts(
    experiment: str, number: int, *, distance_m: float, seed: np.random.SeedSequence
) -> list[Start]:
    """Draw the starts of an experiment, with random headings.

    Parameters
    ----------
    experiment : str
        A name from `EXPERIMENTS`. Runs to the origin start at `distance_m` in a random
        direction, turns and way-points at the origin.
    number : int
        Number of starts; the first ones do not depend on it.
    distance_m : float
    seed : SeedSequence
        Seed of the excitation that the model was learned from.
    """
    manoeuvre, _ = chosen("experiment", experiment, EXPERIMENTS)
    index = list(EXPERIMENTS).index(experiment)
    starts = []
    for k in range(number):
        stream = child(seed, START, index, k)
        bearing, heading = np.random.default_rng(stream).uniform(-np.pi, np.pi, 2)
        pose = np.array([0.0, 0.0, heading])
        if manoeuvre == ORIGIN:
            pose[:2] = distance_m * np.array([np.cos(bearing), np.sin(bearing)])
        starts.append(Start(k + 1, pose, stream))
    return starts


# The controllers.

Policy: TypeAlias = Callable[[Start], Controller]

PRINTED = "printed"
PLANNER = "planner"
ADAPTIVE = "adaptive"
RANDOM = "random"
NONE = "none"
CONTROLLERS = (PRINTED, PLANNER, ADAPTIVE, RANDOM, NONE)
LEARNED = (PRINTED, PLANNER, ADAPTIVE)  # those that use the learned model
# The planner that knows the true map: the reference for the number of hops
CEILING = "ceiling"


#: Whose run is the example, where it takes part; else that of the next.
SHOWN_FIRST = (PLANNER, ADAPTIVE, PRINTED, RANDOM, NONE)


def taking_part(asked: Sequence[str], *, later_observation: bool) -> list[str]:
    """Return who runs: the controllers asked for, and the one that knows the true map.

    An observation after the first changes only what is learned, so with it only
    controllers that use the learned model run, perhaps none.
    """
    if later_observation:
        return [name for name in asked if name in LEARNED]
    return [*asked, CEILING]


def shown_of(controllers: Collection[str]) -> str | None:
    """Return the controller whose run is the example; None if none of them runs."""
    return next((name for name in SHOWN_FIRST if name in controllers), None)


def beside_of(controllers: Collection[str]) -> str | None:
    """Return the controller whose run from the same start is shown beside the example.

    It is the printed one, beside one that is not the dissertation's; else None.
    """
    is_ours = shown_of(controllers) in (PLANNER, ADAPTIVE)
    if is_ours and PRINTED in controllers:
        return PRINTED
    return None


@dataclass(frozen=True)
class Unheeding:
    """Swings at random up to a limit (none if it is 0), whatever is seen."""

    limit_rad: float
    rng: np.random.Generator

    def plan(
        self, pose: ArrayLike, _state: ArrayLike, _inputs: ArrayLike | None = None, /
    ) -> Plan:
        """Return the swing; where it leads is unknown."""
        swing = self.rng.uniform(-self.limit_rad, self.limit_rad, 1)
        poses = np.array([pose, [np.nan] * 3], dtype=float)
        return Plan(swing, poses, np.nan)


def policies(
    names: Sequence[str],
    options: Mapping[str, Any],
    task: Task,
    *,
    model: FrameChangeProcess,
    truth: FloatArray,
    swing_limit_rad: float,
) -> dict[str, Policy]:
    """Return functions from a start to a controller, by name.

    Slow computations are done here.

    Parameters
    ----------
    names : sequence of str
        Names from `CONTROLLERS`, and `CEILING`.
    options : mapping
        The configuration's ``steering.control``.
    task : Task
        What is to be done, for its goal.
    model : FrameChangeProcess
        The learned model.
    truth : (A, S, 3) array
        True frame change for the ceiling, averaged over the previous swing.
    swing_limit_rad : float
    """
    horizon = objectives.Horizon(
        hops=options["horizon"], swing_limit_rad=swing_limit_rad
    )
    axes = hopper_axes(swing_limit_rad)
    learned = model.within(axes.lower, axes.upper)

    def goal(start: ArrayLike) -> objectives.Objective:
        if task.manoeuvre == WAYPOINTS:
            return task.way_points.legs()[0]
        return goal_of(task.manoeuvre, start)

    def going(controller: PrintedController | Any) -> Controller:
        """Return the controller, or one that leads it from point to point."""
        if task.manoeuvre == WAYPOINTS:
            return WayPointFollower(controller, task.way_points)
        known: Controller = controller
        return known

    def steered(controller: PrintedController | Any) -> Policy:
        return lambda start: going(controller.towards(goal(start.pose)))

    def planning(known: StrideTable) -> Planner:
        shorter = replace(horizon, hops=options["planner_horizon"])
        return planner(known, goal(np.zeros(3)), horizon=shorter)

    def adaptive() -> Policy:
        known = planning(learned)

        def policy(start: Start) -> Controller:
            towards_goal = known.towards(goal(start.pose))
            return going(AdaptivePlanner(towards_goal, model.noise_sd))

        return policy

    def unheeding(limit_rad: float) -> Policy:
        return lambda start: Unheeding(limit_rad, start.streams()[3])

    makers: Mapping[str, Callable[[], Policy]] = {
        PRINTED: lambda: steered(PrintedController(model=learned, horizon=horizon)),
        PLANNER: lambda: steered(planning(learned)),
        ADAPTIVE: adaptive,
        RANDOM: lambda: unheeding(swing_limit_rad),
        NONE: lambda: unheeding(0.0),
        CEILING: lambda: steered(planning(StrideTable.evenly_spaced(axes, truth))),
    }
    return {name: chosen("controller", name, makers)() for name in names}
