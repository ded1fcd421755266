"""One trial in closed loop: stance, pose, plan, swing, next stance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import BoolArray, FloatArray
from hopdata.steering.control.objectives import Controller, Plan, PlanningError
from hopdata.steering.robot import Board, Stance, SteeredHopper, released, steer_past

#: Makes of a stance what is measured of it: the pose (3,) and the boom angle, rad.
Observe = Callable[[Stance, np.random.Generator], tuple[FloatArray, float]]


@dataclass(frozen=True, kw_only=True)
class PoseNoise:
    """Measurement noise of a stance.

    Parameters
    ----------
    position_m, heading_rad, boom_rad : float
        Standard deviations; by default those of three body markers seen with 0.6 mm of noise.
    """

    position_m: float = 0.6e-3
    heading_rad: float = 2.2e-3
    boom_rad: float = 5e-3

    def __call__(self, stance: Stance, rng: np.random.Generator) -> tuple[FloatArray, float]:
        """Return the measured pose (3,) and boom angle."""
        spread = np.array([self.position_m, self.position_m, self.heading_rad])
        pose = stance.pose + spread * rng.standard_normal(3)
        return pose, stance.boom_angle_rad + self.boom_rad * rng.standard_normal()


def exactly(stance: Stance, rng: np.random.Generator) -> tuple[FloatArray, float]:
    """Return the pose and the boom angle as they are."""
    del rng
    return stance.pose.copy(), stance.boom_angle_rad


@dataclass(frozen=True)
class ClosedLoopTrial:
    """A trial of H planned hops, fewer if the hopper fell.

    Parameters
    ----------
    time_s : (H + 1,) array
        Time of the stances, s; the first is that before the first plan.
    poses : (H + 1, 3) array
        True poses at the stances; m, m, rad, headings not wrapped.
    measured_poses : (H + 1, 3) array
        Poses that were planned from; the last is not.
    boom_angles_rad : (H + 1,) array
        True boom angles at the stances, not wrapped.
    swings_rad : (H,) array
        Swings between the stances.
    plans : tuple of Plan
        The plans, None where there could be none and the boom was held.
    board_m : (H + 1,) array
        Place of the board at the stances, m; NaN without a board.
    fell : bool
        Whether the hopper fell in the hop after the last stance.
    """

    time_s: FloatArray
    poses: FloatArray
    measured_poses: FloatArray
    boom_angles_rad: FloatArray
    swings_rad: FloatArray
    plans: tuple[Plan | None, ...]
    board_m: FloatArray
    fell: bool

    @property
    def pushed(self) -> BoolArray:
        """Whether each hop moved the board, (H,)."""
        return np.diff(self.board_m) > 0

    @property
    def held(self) -> int:
        """Number of hops without a plan, in which the boom was held."""
        return sum(plan is None for plan in self.plans)


def closed_loop(
    robot: SteeredHopper,
    controller: Controller,
    start: ArrayLike,
    *,
    hops: int,
    seed: int | Sequence[int],
    boom_angle_rad: float = np.pi,
    board: Board | None = None,
    observe: Observe = exactly,
) -> ClosedLoopTrial:
    """Let the hopper go, and steer it from its first stance on.

    Parameters
    ----------
    robot : SteeredHopper
    controller : Controller
        Asked once a stance. If it can make no plan (`PlanningError`) the boom is held.
    start : (3,) array
        Pose at which the hopper is released; m, m, rad.
    hops : int
        Hops that are planned.
    seed : int or sequence of int
        Seed of the kicks and of the measurement, which have streams of their own.
    boom_angle_rad : float
        Boom angle at the release.
    board : Board, optional
        What stands in the way.
    observe : callable
        What is measured of a stance; `PoseNoise`, say.
    """
    kicks, noise = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
    apex = released(robot, start, boom_angle_rad)
    hop, board = steer_past(robot, apex, 0.0, board, rng=kicks)
    stances, measured, boards = [hop.stance], [], [board]
    swings: list[float] = []
    plans: list[Plan | None] = []
    while True:
        pose, boom = observe(hop.stance, noise)
        measured.append(pose)
        if len(plans) == hops or hop.stance.fell:
            break
        plan = _plan(controller, pose, boom, swings[-1] if swings else 0.0)
        swing = 0.0 if plan is None else plan.swing_rad
        hop, board = steer_past(robot, hop.end, swing, board, rng=kicks)
        if hop.stance.fell:
            break
        plans.append(plan)
        swings.append(hop.swing_rad)
        stances.append(hop.stance)
        boards.append(board)
    return ClosedLoopTrial(
        time_s=np.array([stance.time_s for stance in stances]),
        poses=np.array([stance.pose for stance in stances]),
        measured_poses=np.array(measured),
        boom_angles_rad=np.array([stance.boom_angle_rad for stance in stances]),
        swings_rad=np.array(swings),
        plans=tuple(plans),
        board_m=np.array([np.nan if one is None else one.place_m for one in boards]),
        fell=hop.stance.fell,
    )


def _plan(
    controller: Controller, pose: FloatArray, boom_angle_rad: float, previous_swing_rad: float
) -> Plan | None:
    try:
        return controller.plan(pose, boom_angle_rad, previous_swing_rad)
    except PlanningError:
        return None
