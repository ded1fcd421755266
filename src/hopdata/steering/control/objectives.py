"""Objectives of a controller, and its horizon."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import require
from hopdata.rigid import wrapped
from hopdata.steering.frame_changes import is_hopper
from hopdata.steering.goals import SWING_LIMIT_RAD
from hopdata.steering.strides import StrideAxes


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
    """How many strides a controller looks ahead, and how far the boom may swing in one.

    Parameters
    ----------
    hops : int
        Number of strides ahead; three in the dissertation (Sec. 3.4.3).
    swing_limit_rad : float
        Largest swing of the hopper's boom, rad. Inputs of other robots have the limits
        that their axes tell.
    """

    hops: int = 3
    swing_limit_rad: float = SWING_LIMIT_RAD

    def __post_init__(self) -> None:
        require(self.hops in range(1, 17), "hops", "1 to 16", self.hops)
        limit = self.swing_limit_rad
        sound = is_finite(limit) and 0 < limit <= np.pi
        require(sound, "swing_limit_rad", "more than 0, at most pi", limit)

    def limits(self, axes: StrideAxes) -> tuple[FloatArray, FloatArray]:
        """Return the least and the largest inputs of a stride, (U,) each."""
        if is_hopper(axes):
            limit = np.array([self.swing_limit_rad])
            return -limit, limit
        return axes.lower, axes.upper


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
