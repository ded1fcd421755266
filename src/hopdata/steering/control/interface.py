"""What every controller takes and returns."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import HopdataError
from hopdata.steering.control.objectives import is_finite
from hopdata.steering.strides import StrideAxes

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

        `previous_inputs` (U,) are those of the previous stride as they were measured.
        They are None if they are not known, or if no plan was asked for at the stance
        before this one. For one state and one input, numbers will do: for the hopper
        the boom angle and the swing, rad.

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
