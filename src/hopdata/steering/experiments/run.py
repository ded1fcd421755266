"""One run: a controller steers the hopper that motion capture sees, from a start to the end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.steering.control.plan import Controller, PlanningError
from hopdata.steering.experiments.starts import Start
from hopdata.steering.experiments.tasks import Outcome, Task, decided, errors_of, judged
from hopdata.steering.experiments.watched import Sight, WatchedHopper, WatchedStance
from hopdata.steering.plant.obstacle import Board
from hopdata.steering.plant.robot import SteeredHopper

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Run:
    """What happened at the K + 1 stances of a run, that of the first landing first.

    Parameters
    ----------
    time_s : (K + 1,) array
        Time of each stance since the release, s.
    pose, measured : (K + 1, 3) arrays
        As it truly was, and as it was seen; m, m, rad. NaN where it was not seen.
    boom_angle_rad : (K + 1,) array
        As seen; taken from the swing that was commanded where it was not.
    swing_rad : (K + 1,) array
        Swing that was commanded for the hop after each stance.
    predicted : (K + 1, 3) array
        Pose that the controller's model foretold from the stance before; NaN for the first.
    board_m : (K + 1,) array
        Where the board was along its direction; NaN without one.
    blind : int
        Stances at which nothing was planned, since no pose was known: the boom held still.
    outcome : Outcome
        Judged by the true poses.
    """

    time_s: FloatArray
    pose: FloatArray
    measured: FloatArray
    boom_angle_rad: FloatArray
    swing_rad: FloatArray
    predicted: FloatArray
    board_m: FloatArray
    blind: int
    outcome: Outcome


@dataclass
class _Decision:
    swing_rad: float
    predicted: FloatArray
    boom_angle_rad: float
    blind: bool


def run_task(
    robot: SteeredHopper,
    sight: Sight,
    controller: Controller,
    task: Task,
    start: Start,
    *,
    board: Board | None = None,
    frames: list[tuple[float, FloatArray]] | None = None,
) -> Run:
    """Let a controller steer from a start until the run is decided or the hopper falls.

    Parameters
    ----------
    robot : SteeredHopper
    sight : Sight
        How it is seen.
    controller : Controller
        Knows its goal; is told what was seen, never what is true.
    task : Task
        What counts as success.
    start : Start
    board : Board, optional
        What stands in the way.
    frames : list, optional
        Takes time, s, and markers (M, 3), m, of each frame as the cameras saw it.
    """
    kicks, noise, gaps = start.streams()
    hopper = WatchedHopper(
        robot, sight, start.pose, most_hops=task.most_hops + 2, kicks=kicks, noise=noise,
        gaps=gaps, board=board, frames=frames,
    )  # fmt: skip
    stances: list[WatchedStance] = []
    decisions: list[_Decision] = []
    errors: list[float] = []
    last = _Decision(0.0, np.full(3, np.nan), robot.hopper.boom_angle_rad, False)
    while True:
        stance = hopper.hop(last.swing_rad)
        if stance.fell:
            break
        last = _decide(controller, stance, last, first=not stances)
        stances.append(stance)
        decisions.append(last)
        errors.append(float(errors_of(task.manoeuvre, start.pose, stance.hop.stance.pose)))
        if decided(task, errors):
            break
    return _collected(stances, decisions, judged(task, errors, fell=stance.fell))


def _decide(
    controller: Controller, stance: WatchedStance, before: _Decision, *, first: bool
) -> _Decision:
    """Plan from what was seen; hold the boom still where that is too little."""
    boom = before.boom_angle_rad + before.swing_rad
    nothing = np.full(3, np.nan)
    if stance.seen is None:
        return _Decision(0.0, nothing, boom, True)
    if np.isfinite(stance.seen.boom_angle_rad):
        boom = stance.seen.boom_angle_rad
    try:
        plan = controller.plan(stance.seen.pose, boom, None if first else before.swing_rad)
    except PlanningError:
        return _Decision(0.0, nothing, boom, True)
    return _Decision(plan.swing_rad, plan.poses[1], boom, False)


def _collected(stances: list[WatchedStance], decisions: list[_Decision], outcome: Outcome) -> Run:
    unseen = np.full(3, np.nan)
    measured = [unseen if s.seen is None else s.seen.pose for s in stances]
    foretold = [unseen, *(d.predicted for d in decisions[:-1])][: len(stances)]
    return Run(
        time_s=np.array([s.hop.stance.time_s for s in stances]),
        pose=np.array([s.hop.stance.pose for s in stances]).reshape(-1, 3),
        measured=np.array(measured).reshape(-1, 3),
        boom_angle_rad=np.array([d.boom_angle_rad for d in decisions]),
        swing_rad=np.array([d.swing_rad for d in decisions]),
        predicted=np.array(foretold).reshape(-1, 3),
        board_m=np.array([np.nan if s.board is None else s.board.place_m for s in stances]),
        blind=sum(d.blind for d in decisions),
        outcome=outcome,
    )
