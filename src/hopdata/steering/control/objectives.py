"""Objectives of a controller, its horizon, and the interface of all controllers."""

from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import HopdataError, require
from hopdata.rigid import wrapped


@dataclass(frozen=True, kw_only=True)
class ToPoint:
    """Reach a point (x, y) on the floor, world frame, m (dissertation, Sec. 3.4.3)."""

    point_m: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        is_point = is_finite(self.point_m, (2,))
        require(is_point, "point_m", "two finite numbers", self.point_m)


@dataclass(frozen=True, kw_only=True)
class ToHeading:
    """Turn to a heading in the world frame, rad (Sec. 3.4.3).

    The error is wrapped (footnote 8).
    """

    heading_rad: float = 0.0

    def __post_init__(self) -> None:
        heading = self.heading_rad
        require(is_finite(heading), "heading_rad", "a finite number", heading)


Objective: TypeAlias = ToPoint | ToHeading


@dataclass(frozen=True, kw_only=True)
class Horizon:
    """How many hops a controller looks ahead, and how far the boom may swing in a hop.

    Parameters
    ----------
    hops : int
        Number of hops ahead; three in the dissertation (Sec. 3.4.3).
    swing_limit_rad : float
        Largest swing of a hop, rad.
    """

    hops: int = 3
    swing_limit_rad: float = 3 * np.pi / 8

    def __post_init__(self) -> None:
        require(self.hops in range(1, 17), "hops", "1 to 16", self.hops)
        limit = self.swing_limit_rad
        sound = is_finite(limit) and 0 < limit <= np.pi
        require(sound, "swing_limit_rad", "more than 0, at most pi", limit)


def goal_errors(objective: Objective, poses: ArrayLike) -> FloatArray:
    """Return the errors of poses (..., 3): the distance to the point, m.

    With a heading as objective, the absolute heading error, rad.
    """
    poses = np.asarray(poses, dtype=float)
    if isinstance(objective, ToPoint):
        offset = poses[..., :2] - np.array(objective.point_m)
        return np.asarray(np.hypot(offset[..., 0], offset[..., 1]))
    return np.abs(wrapped(objective.heading_rad - poses[..., 2]))


def is_finite(value: object, shape: tuple[int, ...] = ()) -> bool:
    """Return whether a value consists of finite numbers in this shape."""
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return False
    return numbers.shape == shape and bool(np.isfinite(numbers).all())


# What every controller takes and returns.

#: Largest coordinate of a pose; anything larger is a measurement error.
#: Unit: m or rad. Origin: chosen.
FARTHEST = 1e4


class PlanningError(HopdataError):
    """No plan can be made from this state; the loop then holds the boom still."""


@dataclass(frozen=True)
class Plan:
    """Swings that a controller plans; only the first is executed.

    Parameters
    ----------
    swings_rad : (H,) array
        Swings of the next hops, rad.
    poses : (H + 1, 3) array
        The present pose, and the predicted poses; m, m, rad.
    objective : float
        Value of the minimised objective at these swings.
    """

    swings_rad: FloatArray
    poses: FloatArray
    objective: float

    @property
    def swing_rad(self) -> float:
        """Swing of the next hop, rad."""
        return float(self.swings_rad[0])


class Controller(Protocol):
    """Chooses the next swing from the state at a stance."""

    def plan(
        self,
        pose: ArrayLike,
        boom_angle_rad: float,
        previous_swing_rad: float | None = None,
        /,
    ) -> Plan:
        """Plan from a pose (3,) and a boom angle.

        `previous_swing_rad` is the measured swing of the previous hop, if known.

        Raises
        ------
        PlanningError
            If a number is missing or not finite.
        """
        ...


def checked_state(pose: ArrayLike, boom_angle_rad: float) -> tuple[FloatArray, float]:
    """Return the pose as a new array, and the boom angle in [0, 2 pi).

    Raises
    ------
    PlanningError
        If the pose is not three finite numbers of plausible size, or the angle is not
        finite.
    """
    if not is_finite(pose, (3,)):
        raise PlanningError(
            f"plan: expected a pose of three finite numbers, found {pose!r}"
        )
    if not is_finite(boom_angle_rad):
        raise PlanningError(
            f"plan: expected a finite boom angle, found {boom_angle_rad!r}"
        )
    state = np.array(pose, dtype=float)
    if np.abs(state).max() > FARTHEST:
        raise PlanningError(
            f"plan: expected a pose within {FARTHEST:.0f} m, found {pose!r}"
        )
    return state, float(boom_angle_rad) % (2 * np.pi)
