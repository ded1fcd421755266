"""Frames in which a foot is at rest: hardly moving up or down, and low."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.landings.modes import ground_mode
from hopdata.recordings.recording import Recording

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_LEAST_FRAMES = 20
_PAUSE_S = 0.1


@dataclass(frozen=True)
class RestPoints:
    """Feet at rest.

    Parameters
    ----------
    points : (P, 3) array
        Marker positions, m, z up.
    foot : (P,) array of int
        Which foot each belongs to, 0-based in the order of the recording.
    time : (P,) array
        When, s.
    start_m : (n,) array
        The ground mode of each foot's resting heights, m; NaN for a foot that never rests.
    """

    points: FloatArray
    foot: IntArray
    time: FloatArray
    start_m: FloatArray

    @property
    def above_mode(self) -> FloatArray:
        """Height of each point above its foot's ground mode, (P,), m."""
        return self.points[:, 2] - self.start_m[self.foot]

    @property
    def n_steps(self) -> int:
        """Number of times that a foot came to rest (a pause of 0.1 s ends a rest)."""
        apart = (np.diff(self.foot) != 0) | (np.diff(self.time) > _PAUSE_S)
        return int(apart.sum()) + (len(self.foot) > 0)

    def take(self, keep: NDArray[np.bool_] | slice) -> RestPoints:
        """Return the points that `keep` selects."""
        return RestPoints(self.points[keep], self.foot[keep], self.time[keep], self.start_m)


def rest_points(
    recording: Recording, *, speed_m_s: float = 0.05, window_s: float = 0.04
) -> RestPoints:
    """Collect the feet at rest.

    Only the vertical speed is asked for, since on a treadmill a foot on the ground travels.

    Parameters
    ----------
    recording : Recording
        With at least one foot.
    speed_m_s : float
        Largest vertical speed of a foot at rest, m/s.
    window_s : float
        Span of the central difference, s; at least one frame to either side. A frame counts
        only if the marker is seen there and at both ends of the span.

    Returns
    -------
    RestPoints
        All frames that are slow; those high up are left to the caller, who has the floor.
    """
    lag = max(1, round(0.5 * window_s * recording.rate_hz))
    n_feet = recording.feet.shape[1]
    frames, start = [], np.full(n_feet, np.nan)
    for foot in range(n_feet):
        height = recording.feet[:, foot, 2]
        slow = np.abs(vertical_speed(recording.time, height, lag=lag)) < speed_m_s
        frames.append(np.flatnonzero(slow & np.isfinite(recording.feet[:, foot]).all(axis=1)))
        if len(frames[foot]) >= _LEAST_FRAMES:
            start[foot] = ground_mode(height[frames[foot]]).height_m
    foot_of = np.repeat(np.arange(n_feet), [len(f) for f in frames])
    frame_of = np.concatenate([np.empty(0, dtype=np.int64), *frames])
    rest = RestPoints(recording.feet[frame_of, foot_of], foot_of, recording.time[frame_of], start)
    return rest.take(np.isfinite(rest.above_mode))


def thinned(rest: RestPoints, max_points: int) -> RestPoints:
    """Keep the points of every k-th instant, so that about `max_points` are left.

    Whole instants, so that the choice does not depend on the order of the feet.
    """
    step = max(1, -(-len(rest.foot) // max_points))
    _, instant = np.unique(rest.time, return_inverse=True)
    return rest.take(instant % step == 0)


def vertical_speed(time: FloatArray, height: FloatArray, *, lag: int) -> FloatArray:
    """Central difference over `lag` frames to either side, (N,), m/s; NaN where it has a gap."""
    speed = np.full(len(time), np.nan)
    if len(time) > 2 * lag:
        span = time[2 * lag :] - time[: -2 * lag]
        speed[lag:-lag] = (height[2 * lag :] - height[: -2 * lag]) / span
    speed[np.isnan(height)] = np.nan
    return speed
