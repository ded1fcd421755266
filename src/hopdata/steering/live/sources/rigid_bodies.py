"""Rigid bodies of Vicon, OptiTrack and other systems, by the library `motioncapture`.

It gives bodies, with place and attitude, and no markers. A body stands for three
points: its origin and those 0.1 m along its x and its y, as ``hopper.o``, ``hopper.x``
and ``hopper.y``. The geometry of a robot must have been recorded with the same points.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import did_you_mean
from hopdata.steering.live import packets
from hopdata.steering.live.sources.threaded import Sample, ThreadedStream
from hopdata.steering.observation.bodies import ARM_M, POINTS

# Systems that the library knows.
SYSTEMS = (
    "vicon",
    "optitrack",
    "optitrack_closed_source",
    "qualisys",
    "nokov",
    "vrpn",
    "motionanalysis",
    "fzmotion",
    "mock",
)


class RigidBodyStream(ThreadedStream):
    """Reads rigid bodies; `host` is SYSTEM:ADDRESS, such as vicon:10.0.0.2.

    The library gives neither numbers nor times of frames: a frame is as old as its
    arrival, and those that are missing are not counted. It must be set up in metres,
    with z up. A body that it does not give in a frame is hidden.

    Raises
    ------
    SettingsError
        If the system is unknown, or a label is not BODY.POINT.
    """

    library = "motioncapture"
    extra = "motioncapture"

    def __init__(self, labels: Sequence[str], **options: Any) -> None:
        super().__init__(labels, **options)
        self._system, _, self._address = self.host.partition(":")
        if self._system not in SYSTEMS:
            near = did_you_mean(self._system, SYSTEMS)
            wanted = f"SYSTEM:ADDRESS with one of the systems {', '.join(SYSTEMS)}"
            raise packets.SettingsError.at("--host", wanted, f"{self.host!r}{near}")
        self._points = [_point_of(label) for label in labels]

    def _samples(self, ended: threading.Event) -> Iterator[Sample]:
        try:
            bodies = self._client.connect(self._system, {"hostname": self._address})
        except (RuntimeError, ValueError) as error:
            where = f"{self._system} at {self._address}"
            raise packets.ConnectionLostError(f"{where}: {error}") from error
        unseen = {name for name, _ in self._points}
        begun_s = time.monotonic()
        number = 0
        while not ended.is_set():
            bodies.waitForNextFrame()
            arrival_s = time.monotonic()
            found = bodies.rigidBodies
            unseen -= set(found)
            if unseen and arrival_s - begun_s > self.patience.answer_s:
                raise _never_seen(sorted(unseen)[0], sorted(found))
            yield Sample(number, arrival_s, arrival_s, self._placed(found))
            number += 1

    def _placed(self, found: Any) -> FloatArray:
        """Return the points (M, 3) of the bodies in a frame, m."""
        markers = np.full((len(self._points), 3), np.nan)
        for k, (name, point) in enumerate(self._points):
            body = found.get(name)
            if body is not None:
                markers[k] = np.asarray(body.position, dtype=float) + arm(body, point)
        return markers


def arm(body: Any, point: str) -> FloatArray:
    """Return where a point of a body is from its origin, world axes, (3,), m."""
    if point == "o":
        return np.zeros(3)
    q = body.rotation
    if point == "x":
        axis = [
            1.0 - 2.0 * (q.y**2 + q.z**2),
            2.0 * (q.x * q.y + q.w * q.z),
            2.0 * (q.x * q.z - q.w * q.y),
        ]
    else:
        axis = [
            2.0 * (q.x * q.y - q.w * q.z),
            1.0 - 2.0 * (q.x**2 + q.z**2),
            2.0 * (q.y * q.z + q.w * q.x),
        ]
    return ARM_M * np.array(axis)


def _point_of(label: str) -> tuple[str, str]:
    """Return the body and the point that a label names."""
    body, _, point = label.rpartition(".")
    if not body or point not in POINTS:
        wanted = f"BODY.POINT with one of the points {', '.join(POINTS)}"
        raise packets.LabelError.at("marker of a rigid body", wanted, f"{label!r}")
    return body, point


def _never_seen(name: str, found: Sequence[str]) -> packets.LabelError:
    given = ", ".join(found) or "none"
    near = did_you_mean(name, found)
    return packets.LabelError(
        f"rigid body {name!r} is not among those of the system ({given}){near}"
    )
