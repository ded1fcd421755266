"""What the control loop asks of those it works with."""

from __future__ import annotations

from typing import Protocol

from hopdata.steering.live.packets import FloatArray


class Seen(Protocol):
    """What one frame tells; NaN where it is not known."""

    @property
    def pose(self) -> FloatArray:
        """(3,): x and y of the mean body marker, m, and heading, rad."""

    @property
    def height_m(self) -> float:
        """Height of the mean body marker."""

    @property
    def boom_angle_rad(self) -> float:
        """Angle of the boom in the body frame."""


class Tracker(Protocol):
    """Tells pose, height and boom angle, frame by frame."""

    def feed(self, time_s: float, markers: FloatArray) -> Seen:
        """Take the next frame: camera time, s, and markers (M, 3), m, NaN where unseen."""


class ToldStance(Protocol):
    """A stance that has been recognised."""

    @property
    def time_s(self) -> float:
        """Its instant, camera time, s."""


class Detector(Protocol):
    """Tells stances from heights."""

    def feed(self, time_s: float, height_m: float) -> ToldStance | None:
        """Take the next height, NaN if not known; return the stance that it establishes."""


class Planned(Protocol):
    """A plan for the next hops."""

    @property
    def swing_rad(self) -> float:
        """Swing of the next flight, rad."""


class Controller(Protocol):
    """Plans the swing of the next flight; those of `hopdata.steering.control` do."""

    def plan(
        self, pose: FloatArray, boom_angle_rad: float, previous_swing_rad: float | None, /
    ) -> Planned:
        """Plan from a stance with this pose (3,), m and rad, this boom angle and last swing."""
