"""Along way-points: one point after the other, with any controller that steers to points."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from hopdata.steering.control.objectives import ToPoint, WayPoints, errors_left
from hopdata.steering.control.plan import Controller, Plan, checked_state


class Steerable(Protocol):
    """A controller that can be given another point."""

    def towards(self, objective: ToPoint, /) -> Controller:
        """Return the same controller with another objective."""
        ...


class WayPointFollower:
    """Steers to the first of the way-points that has not been visited, and stays at the last.

    It remembers which have been visited, so each run needs one of its own.

    Parameters
    ----------
    controller : Steerable
        Such as a `GlobalisedController`.
    way_points : WayPoints
    """

    def __init__(self, controller: Steerable, way_points: WayPoints) -> None:
        self._legs = way_points.legs()
        self._controllers = [controller.towards(leg) for leg in self._legs]
        self._arrival_m = way_points.arrival_m
        self.visited = 0

    def plan(
        self, pose: ArrayLike, boom_angle_rad: float, previous_swing_rad: float | None = None, /
    ) -> Plan:
        """Plan towards the present way-point; one that is within reach counts as visited."""
        here, boom = checked_state(pose, boom_angle_rad)
        while self.visited < len(self._legs) and self._arrived(here):
            self.visited += 1
        leg = min(self.visited, len(self._legs) - 1)
        return self._controllers[leg].plan(here, boom, previous_swing_rad)

    def _arrived(self, pose: ArrayLike) -> bool:
        return bool(np.all(errors_left(self._legs[self.visited], pose) <= self._arrival_m))
