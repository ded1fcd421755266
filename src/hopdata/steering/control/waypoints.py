"""Points that are visited one after another: the route, and who steers along it.

The dissertation lets its controller follow way-points in simulation, each as the point
whose distance is minimised (Sec. 3.4.3).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import require
from hopdata.steering.control.interface import Plan, checked_pose
from hopdata.steering.control.objectives import ToPoint, goal_errors


@dataclass(frozen=True, kw_only=True)
class WayPoints:
    """Points of the floor to visit in order.

    Parameters
    ----------
    points_m : tuple of (x, y)
        Points in the world frame, m; at least one.
    arrival_m : float
        Distance at which a point counts as visited, m.

    Raises
    ------
    ConfigError
        If there are no points, one is not two finite numbers, or neighbours are so
        close that one stance visits both.
    """

    points_m: tuple[tuple[float, float], ...]
    arrival_m: float = 0.15

    def __post_init__(self) -> None:
        n_points = len(self.points_m)
        require(n_points > 0, "points_m", "at least one point", n_points)
        legs = self.legs()  # which checks each point
        lengths = self.lengths_m()
        shortest = float(lengths.min(initial=np.inf))
        wanted = f"neighbours more than {2 * self.arrival_m:g} m apart"
        is_apart = shortest > 2 * self.arrival_m
        require(is_apart or len(legs) == 1, "points_m", wanted, f"{shortest:g} m")

    def legs(self) -> tuple[ToPoint, ...]:
        """Objectives of the single points, in order."""
        return tuple(ToPoint(point_m=point) for point in self.points_m)

    def lengths_m(self) -> FloatArray:
        """Distances between neighbouring points, (n - 1,), m."""
        return np.linalg.norm(np.diff(np.array(self.points_m), axis=0), axis=1)

    def visited(self, before: int, pose: ArrayLike) -> int:
        """Return how many points are visited, at this pose (3,) after `before`."""
        n_visited = before
        legs = self.legs()
        while n_visited < len(legs):
            if not goal_errors(legs[n_visited], pose) <= self.arrival_m:
                break
            n_visited += 1
        return n_visited


class Progress:
    """How far is left to go along way-points, stance by stance.

    Parameters
    ----------
    way_points : WayPoints
    """

    def __init__(self, way_points: WayPoints) -> None:
        self._way_points = way_points
        self.visited = 0

    def __call__(self, pose: ArrayLike) -> float:
        """Return the way that is left after a stance at this pose (3,), m.

        It is the distance to the next point, and from there along the others. It is
        within the arrival distance only when all points are visited.
        """
        self.visited = self._way_points.visited(self.visited, pose)
        legs = self._way_points.legs()
        leg = min(self.visited, len(legs) - 1)
        to_next_m = float(goal_errors(legs[leg], pose))
        return to_next_m + float(self._way_points.lengths_m()[leg:].sum())


class WayPointFollower:
    """Steers to the first way-point that has not been visited, and stays at the last.

    It remembers the visited points, so each run needs a follower of its own.

    Parameters
    ----------
    controller : PrintedController, Planner or AdaptivePlanner
        Anything that plans, and that has `towards` for a point.
    way_points : WayPoints
    """

    def __init__(self, controller: Any, way_points: WayPoints) -> None:
        self._way_points = way_points
        self._legs = way_points.legs()
        self._controller = controller.towards(self._legs[0])
        self.visited = 0

    def plan(
        self,
        pose: ArrayLike,
        state: ArrayLike,
        previous_inputs: ArrayLike | None = None,
        /,
    ) -> Plan:
        """Plan towards the current way-point; one within reach counts as visited."""
        here = checked_pose(pose)
        before = self.visited
        self.visited = self._way_points.visited(before, here)
        leg = min(self.visited, len(self._legs) - 1)
        if self.visited > before:
            self._controller = self._controller.towards(self._legs[leg])
        plan: Plan = self._controller.plan(here, state, previous_inputs)
        return plan
