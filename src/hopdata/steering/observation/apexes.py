"""Recognition of apexes: the stances of a robot whose stride begins in flight."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.stances import (
    GRAVITY_M_S2,
    LEAST_STEP_FRAMES,
    RECOGNISED_HOLE_S,
    RESTART_S,
    SIGMAS,
    WINDOW_FRAMES,
    WINDOW_S,
    DetectedStance,
)

#: Frames of free flight that are needed to know a speed.
#: Unit: 1. Origin: derived: two numbers are fitted, and two frames are left to judge.
LEAST_FRAMES = 4
#: Least time between two apexes.
#: Unit: s. Origin: chosen: a flight from this apex to the floor and up again takes
#: longer.
LEAST_STRIDE_S = 0.15


class ApexDetector:
    """Reports each apex once, as soon as a robot in free flight clearly descends.

    The heights of the last frames must be those of free fall, but for their noise. The
    apex is where the speed of that fall was zero, also in a gap of the frames. Used
    like a `StanceDetector`.

    Parameters
    ----------
    geometry : HopperGeometry
        Of it, the noise of a coordinate.
    rate_hz : float
        Frame rate of the stream.
    """

    def __init__(self, geometry: HopperGeometry, *, rate_hz: float = 100.0) -> None:
        self.noise_m = float(geometry.noise_m) / math.sqrt(len(geometry.body_m))
        self.window_s = max(WINDOW_S, (WINDOW_FRAMES + 1) / rate_hz)
        self.least_step_s = LEAST_STEP_FRAMES / rate_hz
        self._frames: deque[tuple[float, float]] = deque()
        self._last_apex_s = -math.inf

    def feed(self, time_s: float, height_m: float) -> DetectedStance | None:
        """Take the next frame; return the apex it reveals, if any.

        Parameters
        ----------
        time_s : float
            Time of the frame, s.
        height_m : float
            Height of the mean body marker, m; NaN if unknown.
        """
        frames = self._frames
        if frames and time_s < frames[-1][0] - RESTART_S:
            frames.clear()
            self._last_apex_s = -math.inf
        if not math.isfinite(height_m):
            return None
        if frames and time_s - frames[-1][0] <= self.least_step_s:
            return None
        frames.append((time_s, height_m))
        while frames[0][0] < time_s - self.window_s:
            frames.popleft()
        fall = self._free_fall(time_s)
        if fall is None:
            return None
        here_m, speed, error = fall
        apex_s = time_s + speed / GRAVITY_M_S2
        is_new = apex_s - self._last_apex_s > LEAST_STRIDE_S
        is_recent = time_s - apex_s < RECOGNISED_HOLE_S
        if not (speed < -SIGMAS * error and is_new and is_recent):
            return None
        self._last_apex_s = apex_s
        return DetectedStance(
            time_s=apex_s,
            height_m=here_m + speed**2 / (2 * GRAVITY_M_S2),
            bridged=bool(apex_s < frames[0][0]),
            recognised_s=time_s,
        )

    def _free_fall(self, time_s: float) -> tuple[float, float, float] | None:
        """Return height, speed and its error at a time; None unless it is free fall."""
        if len(self._frames) < LEAST_FRAMES:
            return None
        times, heights = np.array(self._frames).T
        since = times - time_s
        level = heights + 0.5 * GRAVITY_M_S2 * since**2
        speed, here_m = np.polyfit(since, level, 1)
        residual_m = level - here_m - speed * since
        if np.abs(residual_m).max() > SIGMAS * self.noise_m:
            return None
        error = self.noise_m / math.sqrt(float(np.sum((since - since.mean()) ** 2)))
        return float(here_m), float(speed), error
