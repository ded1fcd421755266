"""A robot of any axes as a rigid body: its pose, and the states that it shows."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.steering.observation.apexes import ApexDetector
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.stances import WINDOW_FRAMES, WINDOW_S
from hopdata.steering.observation.tracking import HopperTracker, Observation

#: Distance of the points that stand for a rigid body from its origin.
#: Unit: m. Origin: chosen.
ARM_M = 0.1
POINTS = ("o", "x", "y")


class Shown(Protocol):
    """Measures the states of a robot (S,), frame by frame."""

    def feed(self, time_s: float, seen: Observation) -> tuple[float, ...]:
        """Return the states that a frame shows, with those before it; NaN if none.

        States that an input sets are left NaN: they are known from what was sent.
        """
        ...


class NothingShown:
    """For a robot of S states each of which is set by an input, or of none."""

    def __init__(self, n_states: int = 0) -> None:
        self._states = (math.nan,) * n_states

    def feed(self, time_s: float, seen: Observation) -> tuple[float, ...]:  # noqa: ARG002
        """Return no state."""
        return self._states


class SpeedShown:
    """For a robot whose one state is its forward speed: a line through a few frames."""

    def __init__(self, rate_hz: float) -> None:
        self._window_s = max(WINDOW_S, WINDOW_FRAMES / rate_hz)
        self._places: deque[tuple[float, float, float]] = deque()

    def feed(self, time_s: float, seen: Observation) -> tuple[float, ...]:
        """Return the speed along the heading, m/s."""
        if not seen.known:
            return (math.nan,)
        x, y, heading = seen.pose.tolist()
        places = self._places
        if places and time_s < places[-1][0]:
            places.clear()
        places.append((time_s, x, y))
        while places[0][0] < time_s - self._window_s:
            places.popleft()
        if len(places) < 3:
            return (math.nan,)
        times, *path = np.array(places).T
        speed_x, speed_y = (np.polyfit(times - time_s, one, 1)[0] for one in path)
        return (float(speed_x * math.cos(heading) + speed_y * math.sin(heading)),)


@dataclass(frozen=True)
class BodyObservation(Observation):
    """An observation of a frame with the states that it shows."""

    shown: tuple[float, ...] = ()

    @property
    def state(self) -> tuple[float, ...]:
        """States of the robot that the frame shows; NaN for the others."""
        return self.shown


class BodyTracker(HopperTracker):
    """Tracks a rigid body frame by frame, and the states that it shows.

    Parameters
    ----------
    geometry : HopperGeometry
        Of a body without a boom.
    markers : sequence of str
        Names of the stream's markers, in order.
    shown : Shown
    """

    def __init__(
        self, geometry: HopperGeometry, markers: Sequence[str], shown: Shown
    ) -> None:
        super().__init__(geometry, markers)
        self._shown = shown

    def feed(self, time_s: float, markers: FloatArray) -> BodyObservation:
        """Take the next frame; see `HopperTracker.feed`."""
        seen = super().feed(time_s, markers)
        shown = self._shown.feed(time_s, seen)
        return BodyObservation(**vars(seen), shown=shown)


def body_of(
    names: Sequence[str], body_m: FloatArray, *, noise_m: float
) -> HopperGeometry:
    """Return the geometry of a body by its markers (B, 3), m, in its own axes.

    Its origin is moved to their mean. It says nothing of the heights of a hop, which an
    `ApexDetector` does not need.
    """
    points = np.asarray(body_m, dtype=float)
    return HopperGeometry(
        body_names=tuple(names),
        body_m=points - points.mean(axis=0),
        noise_m=noise_m,
        stance_below_m=0.0,
        flight_above_m=0.0,
    )


def rigid_body(name: str, *, noise_m: float) -> HopperGeometry:
    """Return the geometry of a body that a camera system gives as a whole.

    It stands for its origin and the points 0.1 m along its x and its y, as the source
    "motioncapture" names them. Its place is the mean of the three.

    Parameters
    ----------
    name : str
        Name of the body in the camera system.
    noise_m : float
        Standard deviation of the noise on a coordinate of a point, m.
    """
    names = [f"{name}.{point}" for point in POINTS]
    points_m = ARM_M * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    return body_of(names, points_m, noise_m=noise_m)


def apex_observers(
    geometry: HopperGeometry, rate_hz: float, new_shown: Callable[[], Shown]
) -> Callable[[], tuple[BodyTracker, ApexDetector]]:
    """Return a maker of tracker and detector, of strides that begin in flight.

    Parameters
    ----------
    geometry : HopperGeometry
        Such as of `body_of`.
    rate_hz : float
    new_shown : callable
        Returns what measures the robot's states.
    """
    return lambda: (
        BodyTracker(geometry, geometry.body_names, new_shown()),
        ApexDetector(geometry, rate_hz=rate_hz),
    )
