"""The experiments: what is asked, from where, and when it counts as done (dissertation, 3.5)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import chosen, require_choice
from hopdata.rigid import wrapped
from hopdata.steering.control.objectives import Controller, Horizon, Objective, ToHeading, ToPoint
from hopdata.steering.control.planner import planner
from hopdata.steering.control.printed import PrintedController
from hopdata.steering.excitation import FLOOR, START
from hopdata.steering.models.tabulated import FrameChangeMap, TabulatedMap
from hopdata.steering.robot import Board
from hopdata.steering.trial import TrueFrameChanges

ORIGIN, TURN = "origin", "turn"
FREE, BOARD = "free", "board"
FACING, ANY = HEADINGS = ("facing", "any")

# Name of each experiment: its manoeuvre and its way, and the figure of the dissertation.
EXPERIMENTS: Mapping[str, tuple[str, str]] = {
    "origin": (ORIGIN, FREE),
    "turn": (TURN, FREE),
    "origin_board": (ORIGIN, BOARD),
    "turn_board": (TURN, BOARD),
}


MANOEUVRES = {ORIGIN: True, TURN: False}  # whether it leads to the origin


def to_origin(manoeuvre: str) -> bool:
    """Tell whether a manoeuvre, one of `MANOEUVRES`, leads to the origin; the other turns."""
    return chosen("manoeuvre", manoeuvre, MANOEUVRES)


@dataclass(frozen=True, kw_only=True)
class Task:
    """What a run must do to succeed.

    Parameters
    ----------
    manoeuvre : {"origin", "turn"}
        Come to the origin, or turn by 180 degrees.
    near : float
        Distance from the origin, m, or error of the heading, rad, at which it has arrived.
    hops : int
        Hops in which it must.
    stay : float
        Distance within which it must stay after that, m.
    stay_hops : int
        For how many hops.
    """

    manoeuvre: str
    near: float
    hops: int
    stay: float = np.inf
    stay_hops: int = 0

    @property
    def most_hops(self) -> int:
        """Hops after which a run ends, whatever it does."""
        return self.hops + self.stay_hops


@dataclass(frozen=True)
class Outcome:
    """How a run ended: whether well, after how many hops it arrived (-1: never), and why."""

    success: bool
    hops: int
    reason: str


ARRIVED = "arrived"
LEFT = "arrived, but left again"
LATE = "not in time"
FELL = "fell"


def tasks_of(experiments: Mapping[str, Any]) -> dict[tuple[str, str], Task]:
    """Return the tasks by manoeuvre and start, from the config's ``steering.experiments``.

    The printed controller starts facing the origin, and need not stay.
    """
    origin = Task(
        manoeuvre=ORIGIN,
        near=experiments["arrived_m"],
        hops=experiments["hops"],
        stay=experiments["stay_m"],
        stay_hops=experiments["stay_hops"],
    )
    facing = Task(
        manoeuvre=ORIGIN, near=experiments["printed_arrived_m"], hops=experiments["printed_hops"]
    )
    turn = Task(manoeuvre=TURN, near=experiments["turned_rad"], hops=experiments["turn_hops"])
    return {(ORIGIN, ANY): origin, (ORIGIN, FACING): facing, (TURN, ANY): turn}


def goal_of(manoeuvre: str, start: ArrayLike) -> Objective:
    """Return what a controller is told: the origin, or the heading opposite to the first."""
    if to_origin(manoeuvre):
        return ToPoint(point_m=(0.0, 0.0))
    return ToHeading(heading_rad=float(wrapped(float(np.asarray(start)[2]) + np.pi)))


def board_for(
    manoeuvre: str, start: ArrayLike, *, drag_n: float, ahead_m: float, reach_m: float = 0.38
) -> Board:
    """Return the board in the way: across the line to the origin, or across the first heading.

    Parameters
    ----------
    manoeuvre : str
    start : (3,) array
        Pose at the release, m, m, rad.
    drag_n : float
        Friction of the board on the floor, N.
    ahead_m : float
        How far the hopper comes before it meets it, m.
    reach_m : float
        How far ahead of its centre the hopper touches it, m.
    """
    pose = np.asarray(start, dtype=float)
    way = np.array([np.cos(pose[2]), np.sin(pose[2])])
    if to_origin(manoeuvre):
        way = -pose[:2] / np.hypot(pose[0], pose[1])
    place = float(pose[:2] @ way) + ahead_m + reach_m
    return Board(
        direction=(float(way[0]), float(way[1])), place_m=place, reach_m=reach_m, drag_n=drag_n
    )


def judged(task: Task, errors: ArrayLike, *, fell: bool = False) -> Outcome:
    """Judge a run.

    Parameters
    ----------
    task : Task
    errors : (K + 1,) array
        Errors at its stances, that at the first landing first: the k-th is k hops later.
    fell : bool
        Whether the run ended in a fall.
    """
    left = np.asarray(errors, dtype=float)
    near = np.flatnonzero(left[: task.hops + 1] <= task.near)
    if not len(near):
        return Outcome(False, -1, FELL if fell else LATE)
    arrived = int(near[0])
    after = left[arrived + 1 : arrived + 1 + task.stay_hops]
    if np.any(after > task.stay):
        return Outcome(False, arrived, LEFT)
    if len(after) < task.stay_hops:
        return Outcome(False, arrived, FELL)
    return Outcome(True, arrived, ARRIVED)


def decided(task: Task, errors: ArrayLike) -> bool:
    """Whether more hops cannot change how the run is judged."""
    left = np.asarray(errors, dtype=float)
    near = np.flatnonzero(left[: task.hops + 1] <= task.near)
    if not len(near):
        return len(left) > task.hops
    return len(left) > near[0] + task.stay_hops


# Who steers: the printed controller, the one that is recommended, and one that knows the truth.

Policy: TypeAlias = Callable[[Objective], Controller]

PRINTED, PLANNER, CEILING = "printed", "planner", "ceiling"


def policies(
    options: Mapping[str, Any],
    manoeuvre: str,
    *,
    models: Sequence[FrameChangeMap],
    truth: TrueFrameChanges,
    swing_limit_rad: float,
) -> dict[tuple[str, str], list[Policy]]:
    """Return what makes a controller for a goal, by start and name of the controller.

    There is one for each model, with which the starts take turns.

    Parameters
    ----------
    options : mapping
        The config's ``steering.control``.
    manoeuvre : {"origin", "turn"}
    models : sequence of FrameChangeMap
        What was learned, from one set of hops each.
    truth : TrueFrameChanges
        What the ceiling knows: the true frame change, averaged over the swing before.
    swing_limit_rad : float
    """
    horizon = Horizon(hops=options["horizon"], swing_limit_rad=swing_limit_rad)
    true_map = TabulatedMap(truth.average(), swing_limit_rad)

    printed = [_printed(model, horizon) for model in models]
    starts = {(FACING, PRINTED): printed} if to_origin(manoeuvre) else {}
    return starts | {
        (ANY, PRINTED): printed,
        (ANY, PLANNER): [_recommended(options, manoeuvre, model, horizon) for model in models],
        (ANY, CEILING): [_recommended(options, manoeuvre, true_map, horizon)],
    }


def _printed(model: FrameChangeMap, horizon: Horizon) -> Policy:
    return PrintedController(model=model, horizon=horizon).towards


def _recommended(
    options: Mapping[str, Any], manoeuvre: str, model: FrameChangeMap, horizon: Horizon
) -> Policy:
    """Return what makes the recommended controller; what takes long is computed here, once."""
    return planner(
        model,
        ToPoint() if to_origin(manoeuvre) else ToHeading(),
        horizon=replace(horizon, hops=options["planner_horizon"]),
    ).towards


# Random starts: poses at which the operator lets the hopper go, and the chance of each run.


@dataclass(frozen=True)
class Start:
    """One start: its number, its pose (3,) m, m, rad, and the seed of all chance after it.

    Runs of different controllers from one start meet the same kicks and the same noise.
    """

    number: int
    pose: FloatArray
    seed: np.random.SeedSequence

    def streams(self) -> tuple[np.random.Generator, np.random.Generator, np.random.Generator]:
        """Return generators of kicks, noise and gaps, new ones at every call."""
        fresh = np.random.SeedSequence(self.seed.entropy, spawn_key=self.seed.spawn_key)
        kicks, noise, gaps = (np.random.default_rng(one) for one in fresh.spawn(3))
        return kicks, noise, gaps


def draw_starts(
    experiment: str, heading: str, number: int, *, distance_m: float, seed: int
) -> list[Start]:
    """Draw the starts of an experiment.

    Parameters
    ----------
    experiment : str
        A name of `EXPERIMENTS`. To the origin they lie at `distance_m` in any direction, turns
        begin at the origin.
    heading : {"facing", "any"}
        Whether the hopper faces the origin at first.
    number : int
        How many; the first ones are the same whatever the number.
    distance_m : float
    seed : int
        The study's.
    """
    require_choice("heading", heading, HEADINGS)
    manoeuvre, _ = chosen("experiment", experiment, EXPERIMENTS)
    place = list(EXPERIMENTS).index(experiment)
    starts = []
    for k in range(number):
        stream = np.random.SeedSequence(seed, spawn_key=(START, place, k))
        bearing, turn = np.random.default_rng(stream).uniform(-np.pi, np.pi, 2)
        x, y = distance_m * np.array([np.cos(bearing), np.sin(bearing)])
        if not to_origin(manoeuvre):
            pose = np.array([0.0, 0.0, turn])
        elif heading == FACING:
            pose = np.array([x, y, np.arctan2(-y, -x)])
        else:
            pose = np.array([x, y, turn])
        starts.append(Start(k, pose, stream))
    return starts


def floor_stream(seed: int) -> np.random.Generator:
    """Return the stream from which the floor of all experiments is drawn."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(FLOOR,)))
