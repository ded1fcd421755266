"""Where to look for a contact: the last descent of each foot to its lowest level."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.gravity import GRAVITY_M_S2
from hopdata.landings.transitions import Transitions

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LANDED, ALREADY_DOWN, NOT_LANDED, MISSING, POOR_FIT = range(5)
NEAR_FLOOR = 0.15  # of the descent: where a foot counts as nearly down
ON_ITS_WAY = 0.4  # of the descent: from here on its mean speed is taken
LEAST_FRAMES = 5
GAP = 1.5  # frames: what is longer hides something
LEAST_NOISE_M = 5e-5  # no cameras do better; what has no noise is not exactly like the model


def height_noise(heights: FloatArray) -> float:
    """Estimate the standard deviation of the noise of heights (N, n), m.

    From third differences: those of a smooth motion all but vanish, those of white noise have
    variance 20 sigma^2; the median is not moved by the few frames about the contacts. Where only
    every k-th frame is seen they are taken over k frames. Never less than `LEAST_NOISE_M`.
    """
    seen = np.flatnonzero(~np.isnan(heights).all(axis=1))
    step = int(np.median(np.diff(seen))) if len(seen) > 1 else 1
    if len(heights) <= 3 * step:
        return float("nan")
    z0, z1, z2, z3 = (heights[k * step : len(heights) - (3 - k) * step] for k in range(4))
    third = z3 - 3 * z2 + 3 * z1 - z0
    third = np.abs(third[~np.isnan(third)])
    if third.size == 0:
        return float("nan")
    return max(float(np.median(third) / 0.6744897501960817 / np.sqrt(20.0)), LEAST_NOISE_M)


def approaches(
    time: FloatArray,
    heights: FloatArray,
    transitions: Transitions,
    *,
    noise_m: float,
    down_height_m: float,
    lead_s: float,
    trail_s: float,
) -> tuple[FloatArray, IntArray]:
    """Find roughly when each foot came down in each complete transition.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    heights : (N, n) array
        Heights of the feet, m; NaN where unseen.
    transitions : Transitions
        L descents of the body.
    noise_m : float
        Standard deviation of a height, m.
    down_height_m : float
        A foot that never sinks below this height has not landed, m.
    lead_s, trail_s : float
        The search begins so long before the pre section and ends so long after the post section, s.

    Returns
    -------
    near : (L, n) array
        Rough instants, s; NaN where the foot did not come down from above.
    status : (L, n) int array
        `LANDED`, `ALREADY_DOWN`, `NOT_LANDED` or, where gaps may hide which of them, `MISSING`.
    """
    shape = (len(transitions), heights.shape[1])
    near, status = np.full(shape, np.nan), np.full(shape, NOT_LANDED, dtype=np.int64)
    rows = np.flatnonzero(transitions.complete)
    if len(rows):
        start = np.searchsorted(time, transitions.t_pre[rows] - lead_s)
        stop = np.searchsorted(time, transitions.t_post[rows] + trail_s)
        frames = start[:, None] + np.arange(int(np.max(stop - start, initial=1)))
        inside = frames < stop[:, None]
        frames = np.minimum(frames, len(time) - 1)
        for foot in range(shape[1]):
            z = np.where(inside, heights[frames, foot], np.nan)
            ends = transitions.t_pre[rows], transitions.t_post[rows]
            longest = GAP * _frame(time, heights[:, foot])
            near[rows, foot], status[rows, foot] = _descents(
                time[frames], z, ends, longest, noise_m, down_height_m
            )
    return near, status


def _frame(time: FloatArray, heights: FloatArray) -> float:
    """Return the time between the frames in which a foot is seen, s: not each one need be meant."""
    seen = time[~np.isnan(heights)]
    return float(np.median(np.diff(seen))) if len(seen) > 1 else float("nan")


def _descents(
    t: FloatArray,
    z: FloatArray,
    ends: tuple[FloatArray, FloatArray],
    longest: float,
    noise_m: float,
    down_height_m: float,
) -> tuple[FloatArray, IntArray]:
    """Rough instants (R,) at which a foot came down within each window (R, W), and its status.

    What is not seen cannot tell against a foot: that it was down before the pre section or not down
    by the post section (`ends`, each (R,)) is said only if no gap can hide the contrary. Frames
    that are farther apart than `longest` are a gap.
    """
    count = (~np.isnan(z)).sum(axis=1)
    order = np.argsort(np.isnan(z), axis=1, kind="stable")  # the frames that are seen come first
    t, z = np.take_along_axis(t, order, axis=1), np.take_along_axis(z, order, axis=1)
    rows, place = np.arange(len(z)), np.arange(z.shape[1])
    low_first = np.where(np.isnan(z), np.inf, z)
    bottom = np.argmin(low_first, axis=1)
    low = low_first[rows, bottom]
    depth = np.where(np.isnan(z), -np.inf, z).max(axis=1, initial=-np.inf) - low
    falling = place < bottom[:, None]
    nearly = np.maximum(5 * noise_m, NEAR_FLOOR * depth)
    last = _last(falling & (z > (low + nearly)[:, None]))
    with np.errstate(invalid="ignore"):  # where nothing is seen, depth is not finite
        on_its_way = z > (low + ON_ITS_WAY * depth)[:, None]
    first = _last((place <= last[:, None]) & on_its_way)
    first = np.where(first < 0, last, first)
    status = np.where(last < 0, np.where(t[:, 0] > ends[0], MISSING, ALREADY_DOWN), LANDED)
    hidden = _may_hide_landing(t, z, ends, longest, down_height_m)
    status = np.where(low > down_height_m, np.where(hidden, MISSING, NOT_LANDED), status)
    status = np.where(count < LEAST_FRAMES, MISSING, status)
    after = np.minimum(last + 1, z.shape[1] - 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        fall = (z[rows, first] - z[rows, after]) / (t[rows, after] - t[rows, first])
        near = t[rows, after] + (z[rows, after] - low) / fall
        gap = t[rows, after] - t[rows, last]
        before = np.maximum(np.minimum(first, last - 1), 0)
        fall = (z[rows, before] - z[rows, last]) / (t[rows, last] - t[rows, before])
        early = t[rows, last] + np.minimum((z[rows, last] - low) / fall, gap)
    in_gap = gap > longest  # its far end says nothing
    in_gap &= (last > 0) & (fall > 0)
    near = np.where(in_gap, early, near)
    return np.where(status == LANDED, near, np.nan), status


def _may_hide_landing(
    t: FloatArray,
    z: FloatArray,
    ends: tuple[FloatArray, FloatArray],
    longest: float,
    down_height_m: float,
) -> NDArray[np.bool_]:
    """Tell whether a foot may have been down within a gap of its row (R, W): seen frames first.

    It begins the gap at the fastest fall that was seen, and falls freely from there on; within a
    gap that ends before the post section it must come back as well.
    """
    gap, rise = np.diff(t, axis=1), np.diff(z, axis=1)  # NaN where one is not seen
    fall = np.where((gap <= longest) & (rise < 0), -rise / gap, 0.0).max(axis=1, initial=0.0)
    lower = np.fmin(z[:, :-1], z[:, 1:]) + 0.0 * rise
    within = lower - _drop(fall[:, None], 0.5 * gap) <= down_height_m
    seen = np.maximum((~np.isnan(z)).sum(axis=1) - 1, 0)
    rows = np.arange(len(z))
    final, rest = z[rows, seen], ends[1] - t[rows, seen]
    first, lead = z[:, 0], t[:, 0] - ends[0]
    return np.asarray(
        (within & (gap > longest)).any(axis=1)
        | ((final - _drop(fall, rest) <= down_height_m) & (rest > longest))
        | ((first - _drop(fall, lead) <= down_height_m) & (lead > longest))
    )


def _drop(speed: FloatArray, duration: FloatArray) -> FloatArray:
    """Return how far what falls at this speed, m/s, and ever faster, comes within the duration."""
    return duration * (speed + 0.5 * GRAVITY_M_S2 * duration)


def _last(marked: NDArray[np.bool_]) -> IntArray:
    """Place of the last mark in each row (R, W), -1 where there is none."""
    last = marked.shape[1] - 1 - np.argmax(marked[:, ::-1], axis=1)
    return np.where(marked.any(axis=1), last, -1)
