"""Objectives of a controller, its horizon, and the interface of all controllers."""

from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import HopdataError, require
from hopdata.rigid import wrapped
from hopdata.steering.frame_changes import HOPPER
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
        if axes.input_names == HOPPER.input_names:
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


# What every controller takes and returns.

#: Largest coordinate of a pose; anything larger is a measurement error.
#: Unit: m or rad. Origin: chosen.
FARTHEST = 1e4


class PlanningError(HopdataError):
    """No plan can be made from this state; the robot is then not steered."""


@dataclass(frozen=True)
class Plan:
    """Inputs that a controller plans; only the first are executed.

    Parameters
    ----------
    inputs : (H, U) array
        Inputs of the next strides; (H,) will do for one input.
    poses : (H + 1, 3) array
        The present pose, and the predicted poses; m, m, rad.
    objective : float
        Value of the minimised objective with these inputs.
    """

    inputs: FloatArray
    poses: FloatArray
    objective: float

    def __post_init__(self) -> None:
        if self.inputs.ndim == 1:
            object.__setattr__(self, "inputs", self.inputs[:, None])

    @property
    def swings_rad(self) -> FloatArray:
        """Swings of the hopper's next hops, (H,), rad: the first input."""
        return self.inputs[:, 0]

    @property
    def swing_rad(self) -> float:
        """Swing of the hopper's next hop, rad."""
        return float(self.inputs[0, 0])


class Controller(Protocol):
    """Chooses the next inputs from the state at a stance."""

    def plan(
        self,
        pose: ArrayLike,
        state: ArrayLike,
        previous_inputs: ArrayLike | None = None,
        /,
    ) -> Plan:
        """Plan from a pose (3,) and the states of the robot (S,).

        `previous_inputs` (U,) are those of the previous stride as they were measured,
        if known. For one state and one input, numbers will do: for the hopper the boom
        angle and the swing, rad.

        Raises
        ------
        PlanningError
            If a number is missing or not finite.
        """
        ...


def checked_state(
    pose: ArrayLike, state: ArrayLike, axes: StrideAxes
) -> tuple[FloatArray, FloatArray]:
    """Return pose (3,) and states (S,) as new arrays, angles in [0, 2 pi).

    Raises
    ------
    PlanningError
        If the pose is not three finite numbers of plausible size, or the states are not
        as many finite numbers as the robot has states.
    """
    here = checked_pose(pose)
    names = [one.name.replace("_", " ") for one in axes.states]
    given = state
    if len(names) == 1 and np.shape(state) == ():
        given = np.array([state])
    if not is_finite(given, (len(names),)):
        wanted = f"a finite {names[0]}" if len(names) == 1 else f"finite {names}"
        raise PlanningError(f"plan: expected {wanted}, found {state!r}")
    return here, axes.wrapped(np.array(given, dtype=float))


def checked_pose(pose: ArrayLike) -> FloatArray:
    """Return the pose (3,) as a new array.

    Raises
    ------
    PlanningError
        If it is not three finite numbers of plausible size.
    """
    if not is_finite(pose, (3,)):
        raise PlanningError(
            f"plan: expected a pose of three finite numbers, found {pose!r}"
        )
    here = np.array(pose, dtype=float)
    if np.abs(here).max() > FARTHEST:
        raise PlanningError(
            f"plan: expected a pose within {FARTHEST:.0f} m, found {pose!r}"
        )
    return here
