"""What a controller is to reach, and how far it looks ahead."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import ConfigError, HopdataError
from hopdata.rigid import wrapped


@dataclass(frozen=True, kw_only=True)
class ToPoint:
    """Come near a point (x, y) of the floor, world frame, m (dissertation, Sec. 3.4.3)."""

    point_m: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if not _is_finite(self.point_m, shape=(2,)):
            raise ConfigError(f"point_m: expected two finite numbers, found {self.point_m}")


@dataclass(frozen=True, kw_only=True)
class ToHeading:
    """Turn to a heading of the world frame, rad; the error is wrapped (Sec. 3.4.3, footnote 8)."""

    heading_rad: float = 0.0

    def __post_init__(self) -> None:
        if not _is_finite(self.heading_rad):
            raise ConfigError(f"heading_rad: expected a finite number, found {self.heading_rad}")


Objective: TypeAlias = ToPoint | ToHeading


@dataclass(frozen=True, kw_only=True)
class Horizon:
    """How far a controller looks ahead, and how far the boom may swing in a hop.

    Parameters
    ----------
    hops : int
        Hops ahead; three in the dissertation (Sec. 3.4.3).
    swing_limit_rad : float
        Largest swing of a hop, rad.
    """

    hops: int = 3
    swing_limit_rad: float = 3 * np.pi / 8

    def __post_init__(self) -> None:
        if self.hops not in range(1, 17):
            raise ConfigError(f"hops: expected 1 to 16, found {self.hops}")
        if not (_is_finite(self.swing_limit_rad) and 0 < self.swing_limit_rad <= np.pi):
            raise ConfigError(
                f"swing_limit_rad: expected more than 0, at most pi, found {self.swing_limit_rad}"
            )


def errors_left(objective: Objective, poses: ArrayLike) -> FloatArray:
    """Distance from the point, m, or size of the heading error, rad, at poses (..., 3)."""
    poses = np.asarray(poses, dtype=float)
    if isinstance(objective, ToPoint):
        away = poses[..., :2] - np.array(objective.point_m)
        return np.asarray(np.hypot(away[..., 0], away[..., 1]))
    return np.abs(wrapped(objective.heading_rad - poses[..., 2]))


def objective_value(objective: Objective, poses: ArrayLike) -> FloatArray:
    """Sum of what is left at the stances (H, ..., 3) that come after the present one, (...)."""
    return np.asarray(errors_left(objective, poses).sum(axis=0))


def _is_finite(value: object, shape: tuple[int, ...] = ()) -> bool:
    """Whether a value is so many numbers, and all are finite."""
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return False
    return numbers.shape == shape and bool(np.isfinite(numbers).all())


# What every controller takes and gives.

#: Largest coordinate of a pose, m or rad: what lies beyond is a mistake of the measurement.
FARTHEST = 1e4


class PlanningError(HopdataError):
    """No plan can be made from this state; a loop that meets it holds the boom still."""


@dataclass(frozen=True)
class Plan:
    """Swings that a controller means to make, of which the first is executed.

    Parameters
    ----------
    swings_rad : (H,) array
        Swings of the next hops, rad.
    poses : (H + 1, 3) array
        The present pose, and those that the model predicts; m, m, rad.
    objective : float
        What was minimised, at these swings.
    """

    swings_rad: FloatArray
    poses: FloatArray
    objective: float

    @property
    def swing_rad(self) -> float:
        """Swing of the next hop, rad."""
        return float(self.swings_rad[0])


class Controller(Protocol):
    """Chooses the next swing from what is known at a stance."""

    def plan(
        self, pose: ArrayLike, boom_angle_rad: float, previous_swing_rad: float | None = None, /
    ) -> Plan:
        """Plan from a pose (3,) and a boom angle.

        `previous_swing_rad`, of the hop before, is used by models with a history, if known.

        Raises
        ------
        PlanningError
            If a number is missing or not finite.
        """
        ...


def checked_state(pose: ArrayLike, boom_angle_rad: float) -> tuple[FloatArray, float]:
    """Return the pose as an array of its own and the boom angle in [0, 2 pi).

    Raises
    ------
    PlanningError
        Unless there are three finite coordinates, not absurdly large, and a finite angle.
    """
    try:
        state = np.array(pose, dtype=float)
        boom = float(boom_angle_rad)
    except (TypeError, ValueError) as error:
        raise PlanningError(
            f"plan: expected a pose of three numbers and a boom angle, "
            f"found {pose!r} and {boom_angle_rad!r}"
        ) from error
    if state.shape != (3,) or not np.all(np.isfinite(state)):
        raise PlanningError(f"plan: expected a pose of three finite numbers, found {pose!r}")
    if np.abs(state).max() > FARTHEST:
        raise PlanningError(f"plan: expected a pose within {FARTHEST:.0f} m, found {pose!r}")
    if not np.isfinite(boom):
        raise PlanningError(f"plan: expected a finite boom angle, found {boom_angle_rad!r}")
    return state, boom % (2 * np.pi)
