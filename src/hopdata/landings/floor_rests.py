"""Feet at rest: frames in which they hardly move up or down.

Only the vertical speed counts, because on a treadmill a foot on the ground travels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.landings.sections.modes import ground_mode
from hopdata.recording import Recording

# Lengths and times are those of an animal of 1 m; others are multiplied by
# `Recording.scale`, or its square root.

#: Largest vertical speed of a foot at rest.
#: Unit: m/s. Origin: chosen.
REST_SPEED_M_S = 0.05

#: Span of the central difference that gives this speed.
#: Unit: s. Origin: chosen.
REST_WINDOW_S = 0.04

#: Largest distance of a resting foot from the floor.
#: Unit: m. Origin: chosen.
REST_BAND_M = 0.02

#: Fewest frames at rest that a foot needs.
#: Unit: frames. Origin: chosen.
LEAST_FRAMES = 20

#: Frames up to which a recording holds a jump or two, so that feet may rest less still.
#: Unit: frames. Origin: chosen.
SHORT_FRAMES = 1000

#: Factors on the largest speed that are tried in such a recording.
#: Unit: 1. Origin: chosen.
LESS_STILL = (1.0, 2.0, 4.0)

#: Time not at rest that ends a rest; a rest weighs no more than this.
#: Unit: s. Origin: chosen.
PAUSE_S = 0.1

#: Points of a long rest that count, in those of the usual rest of the recording: one
#: place that is stood on for a fifth of the time would bend the floor elsewhere.
#: Unit: 1. Origin: chosen.
LONG_RESTS = 10

#: Range of the heights of a foot at rest on one floor, however uneven.
#: Unit: m. Origin: chosen.
LEVEL_M = 0.06

#: Share of the weight of the heaviest level that the lowest one must have.
#: Unit: 1. Origin: chosen.
HEAVY_SHARE = 0.5

#: Time after a rest in which a foot that sinks far fell: it was held, or stood on
#: something.
#: Unit: s. Origin: chosen.
LET_GO_S = 0.15

#: How far a foot sinks then.
#: Unit: m. Origin: chosen.
LET_GO_M = 0.02


@dataclass(frozen=True)
class RestPoints:
    """Feet at rest.

    Parameters
    ----------
    points : (P, 3) array
        Marker positions, m, z up.
    foot : (P,) array of int8
        Number of the foot, from 0 in the order of the recording.
    time : (P,) array
        Time of each point, s.
    start_m : (n,) array
        Ground mode of each foot's resting heights, m; NaN for a foot that never rests.
    let_go : (P,) bool array
        Whether the foot fell when its rest ended: it was held, or stood on something.
    scale : float
        Scale of the recording.
    """

    points: FloatArray
    foot: NDArray[np.int8]
    time: FloatArray
    start_m: FloatArray
    let_go: BoolArray
    scale: float = 1.0

    @property
    def above_mode(self) -> FloatArray:
        """Height of each point above its foot's ground mode, (P,), m."""
        return self.points[:, 2] - self.start_m[self.foot]

    @property
    def n_steps(self) -> int:
        """Number of times that a foot came to rest (a pause of 0.1 s ends a rest)."""
        if not len(self.foot):
            return 0
        pause_s = PAUSE_S * np.sqrt(self.scale)
        begins = (np.diff(self.foot) != 0) | (np.diff(self.time) > pause_s)
        return 1 + int(begins.sum())

    def take(self, keep: NDArray[Any] | slice) -> Self:
        """Return the points that `keep` selects."""
        per_point = ("points", "foot", "time", "let_go")
        return replace(self, **{name: getattr(self, name)[keep] for name in per_point})


def rest_points(
    recording: Recording,
    *,
    speed_m_s: float | None = None,
    window_s: float | None = None,
) -> RestPoints:
    """Collect the frames in which feet are at rest.

    Parameters
    ----------
    recording : Recording
        With at least one foot.
    speed_m_s : float, optional
        Largest vertical speed of a foot at rest, m/s.
    window_s : float, optional
        Span of the central difference, s; at least one frame to either side. A frame
        counts only if the marker is seen there and at both ends of the span.

    Returns
    -------
    RestPoints
        All slow frames, including high ones, which the caller removes because it knows
        the floor. If these are too few in a recording of a jump or two, the speed limit
        is up to four times higher.
    """
    if not speed_m_s:
        speed_m_s = REST_SPEED_M_S * recording.time_scale
    if not window_s:
        window_s = REST_WINDOW_S * recording.time_scale
    lag = max(1, round(0.5 * window_s * recording.rate_hz))
    n_feet = recording.feet.shape[1]
    frames = []
    let_go = []
    start_m = np.full(n_feet, np.nan)
    for foot in range(n_feet):
        height = recording.feet[:, foot, 2]
        speed = np.abs(vertical_speed(recording.time, height, lag=lag))
        is_seen = np.isfinite(recording.feet[:, foot]).all(axis=1)
        slow = _slow_frames(np.where(is_seen, speed, np.nan), speed_m_s)
        if len(slow):
            start_m[foot] = _ground_of(
                recording.time[slow], height[slow], recording.scale
            )
        frames.append(slow)
        let_go.append(_let_go(recording, height, slow))
    foot_of = np.repeat(np.arange(n_feet, dtype=np.int8), [len(f) for f in frames])
    frame_of = np.concatenate([np.empty(0, dtype=np.int64), *frames])
    return RestPoints(
        points=recording.feet[frame_of, foot_of],
        foot=foot_of,
        time=recording.time[frame_of],
        start_m=start_m,
        let_go=np.concatenate([np.empty(0, dtype=bool), *let_go]),
        scale=recording.scale,
    )


def _slow_frames(speed: FloatArray, limit_m_s: float) -> IntArray:
    """Return the frames in which a foot is slow; none if they are too few."""
    factors: tuple[float, ...] = LESS_STILL
    if len(speed) > SHORT_FRAMES:
        factors = (1.0,)
    for factor in factors:
        slow = np.flatnonzero(speed < factor * limit_m_s)
        if len(slow) >= LEAST_FRAMES:
            return slow
    return np.empty(0, dtype=np.int64)


def _let_go(recording: Recording, height: FloatArray, slow: IntArray) -> BoolArray:
    """Mark the slow frames (K,) that belong to a rest after which the foot falls."""
    waits = np.diff(recording.time[slow], append=np.inf)
    is_last = waits > PAUSE_S * recording.time_scale
    last_frames = slow[is_last]
    ahead = np.arange(1 + round(LET_GO_S * recording.time_scale * recording.rate_hz))
    after = height[np.minimum(last_frames[:, None] + ahead, len(height) - 1)]
    lowest = np.fmin.reduce(after, axis=1)
    fell = lowest < height[last_frames] - LET_GO_M * recording.scale
    length = np.diff(np.flatnonzero(is_last), prepend=-1)
    return np.asarray(np.repeat(fell, length))


def _ground_of(time: FloatArray, heights: FloatArray, scale: float) -> float:
    """Return the height on which a foot rests, m.

    Of a box and the ground it is the one used more often. Each rest counts by its
    duration, but by 0.1 s at most, because an animal stands for long before it jumps.
    The lowest level with at least half the weight of the heaviest is taken.
    """
    mode = ground_mode(heights, scale=scale).height_m
    pause_s = PAUSE_S * np.sqrt(scale)
    level_m = LEVEL_M * scale
    rest = np.cumsum(np.diff(time, prepend=time[0]) > pause_s)
    duration_s = np.bincount(rest) * np.diff(time).min()
    weight = 1 / np.maximum(duration_s, pause_s)
    levels = np.sort(heights)
    weights = weight[rest[np.argsort(heights)]]
    sums = np.cumsum(np.append(0, weights))
    within_level = np.searchsorted(levels, levels + level_m, side="right")
    share = sums[within_level] - sums[:-1]
    lowest = levels[np.argmax(share >= HEAVY_SHARE * share.max())]
    if lowest + level_m >= mode:
        return mode
    on_it = levels[(levels >= lowest) & (levels <= lowest + level_m)]
    return float(np.median(on_it))


def thinned(rest: RestPoints, max_points: int) -> RestPoints:
    """Keep the points of every k-th instant, so that about `max_points` remain."""
    return rest.take(few_of(rest.time, max_points))


def without_long_rests(rest: RestPoints) -> RestPoints:
    """Keep `LONG_RESTS` times the usual number of points of a rest, evenly spaced.

    Nothing changes where no rest is that long, as in hopping and running.
    """
    if not len(rest.foot):
        return rest
    pause_s = PAUSE_S * np.sqrt(rest.scale)
    begins = np.concatenate(
        [[True], (np.diff(rest.foot) != 0) | (np.diff(rest.time) > pause_s)]
    )
    first = np.flatnonzero(begins)
    length = np.diff(first, append=len(begins))
    most = LONG_RESTS * int(np.median(length))
    number = np.cumsum(begins) - 1
    place = np.arange(len(begins)) - first[number]
    # One point of each span of a long rest; each point of a short one.
    span = place * np.minimum(most, length)[number] // length[number]
    is_new = np.diff(span, prepend=-1) != 0
    return rest.take(begins | is_new)


def few_of(time: FloatArray, max_points: int) -> BoolArray:
    """Mark the points (P,) of every k-th instant, about `max_points` of them.

    Instants are kept whole, so the choice does not depend on the order of the feet.
    """
    if not len(time):
        return np.zeros(0, dtype=bool)
    step = max(1, -(-len(time) // max_points))
    kept = np.unique(time)[::step]
    place = np.searchsorted(kept[1:], time, side="right")
    return np.asarray(kept[place] == time)


def vertical_speed(time: FloatArray, height: FloatArray, *, lag: int) -> FloatArray:
    """Return the central difference over `lag` frames to either side, (N,), m/s.

    NaN in gaps.
    """
    speed = np.full(len(time), np.nan)
    if len(time) > 2 * lag:
        span = time[2 * lag :] - time[: -2 * lag]
        speed[lag:-lag] = (height[2 * lag :] - height[: -2 * lag]) / span
    speed[np.isnan(height)] = np.nan
    return speed
