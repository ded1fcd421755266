"""What every controller takes and gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.errors import HopdataError

FloatArray = NDArray[np.float64]


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
    status : {"solved", "stopped early"}
        Whether the solver says that it has finished.
    reason : str
        The solver's own words, if any.
    """

    swings_rad: FloatArray
    poses: FloatArray
    objective: float
    status: str = "solved"
    reason: str = ""

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
