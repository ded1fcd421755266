"""What a controller is to reach, and how far it looks ahead."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.errors import ConfigError, require_choice
from hopdata.steering.se2 import wrapped

FloatArray = NDArray[np.float64]

PENALTIES = ("absolute", "square")
STANCES = ("all", "last")


@dataclass(frozen=True, kw_only=True)
class ToPoint:
    """Come near a point of the floor (dissertation, Sec. 3.4.3).

    Parameters
    ----------
    point_m : (x, y)
        The point in the world frame, m.
    penalty : {"absolute", "square"}
        Distance from the point, or its square.
    stances : {"all", "last"}
        Whether the penalties of all stances within the horizon are added up, or that of the last
        one counts.
    """

    point_m: tuple[float, float] = (0.0, 0.0)
    penalty: str = "absolute"
    stances: str = "all"

    def __post_init__(self) -> None:
        if not _is_finite(self.point_m, shape=(2,)):
            raise ConfigError(f"point_m: expected two finite numbers, found {self.point_m}")
        _check_choices(self.penalty, self.stances)


@dataclass(frozen=True, kw_only=True)
class ToHeading:
    """Turn to a heading of the world frame, rad; the error is wrapped (Sec. 3.4.3, footnote 8).

    `penalty` and `stances` as for a point: the size of the error or its square, of all stances or
    of the last.
    """

    heading_rad: float = 0.0
    penalty: str = "absolute"
    stances: str = "all"

    def __post_init__(self) -> None:
        if not _is_finite(self.heading_rad):
            raise ConfigError(f"heading_rad: expected a finite number, found {self.heading_rad}")
        _check_choices(self.penalty, self.stances)


Objective: TypeAlias = ToPoint | ToHeading


@dataclass(frozen=True, kw_only=True)
class WayPoints:
    """Visit points of the floor one after the other, and stay at the last.

    Parameters
    ----------
    points_m : tuple of (x, y)
        Points in the world frame, m.
    arrival_m : float
        Distance at which a point counts as visited, m.
    penalty, stances : str
        As for a single point.
    """

    points_m: tuple[tuple[float, float], ...]
    arrival_m: float = 0.15
    penalty: str = "absolute"
    stances: str = "all"

    def __post_init__(self) -> None:
        if not np.iterable(self.points_m):
            raise ConfigError(f"points_m: expected points (x, y), found {self.points_m}")
        if not len(self.points_m):
            raise ConfigError("points_m: expected one point at least, found none")
        if not (_is_finite(self.arrival_m) and self.arrival_m > 0):
            raise ConfigError(f"arrival_m: expected more than 0, found {self.arrival_m}")
        self.legs()

    def legs(self) -> tuple[ToPoint, ...]:
        """Return the objectives of the single points, in order."""
        return tuple(
            ToPoint(point_m=point, penalty=self.penalty, stances=self.stances)
            for point in self.points_m
        )


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
        if self.hops not in range(1, 7):
            raise ConfigError(f"hops: expected 1 to 6, found {self.hops}")
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


def objective_value(objective: Objective, poses: ArrayLike) -> float:
    """Value of an objective over the stances (H, 3) that come after the present one."""
    left = errors_left(objective, poses)
    penalties = left**2 if objective.penalty == "square" else left
    return float(penalties[-1] if objective.stances == "last" else penalties.sum())


def _is_finite(value: object, shape: tuple[int, ...] = ()) -> bool:
    """Whether a value is so many numbers, and all are finite."""
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return False
    return numbers.shape == shape and bool(np.isfinite(numbers).all())


def _check_choices(penalty: str, stances: str) -> None:
    require_choice("penalty", penalty, PENALTIES)
    require_choice("stances", stances, STANCES)
