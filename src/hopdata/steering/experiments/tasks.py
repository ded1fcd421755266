"""The experiments: what is asked, from where, and when it counts as done (dissertation, 3.5)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.errors import chosen
from hopdata.steering.control.objectives import Objective, ToHeading, ToPoint
from hopdata.steering.plant.obstacle import Board
from hopdata.steering.se2 import wrapped

FloatArray = NDArray[np.float64]

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


def errors_of(manoeuvre: str, start: ArrayLike, poses: ArrayLike) -> FloatArray:
    """Distance from the origin, m, or size of the heading's error, rad, at poses (..., 3)."""
    poses = np.asarray(poses, dtype=float)
    if to_origin(manoeuvre):
        return np.asarray(np.hypot(poses[..., 0], poses[..., 1]))
    return np.abs(wrapped(poses[..., 2] - np.asarray(start)[2] - np.pi))


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
