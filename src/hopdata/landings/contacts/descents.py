"""Where to look for a contact: the last descent of each foot to its lowest level."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import GRAVITY_M_S2, BoolArray, FloatArray, IntArray
from hopdata.errors import AnalysisError

# Candidate touchdowns: the body sinks through the pre section and then the post section.


# Part of the distance between the sections by which the body must sink below the pre section before
# a descent counts, so that noise about the section makes no descents of its own.
HYSTERESIS = 0.02


@dataclass(frozen=True)
class Transitions:
    """Descents through the pre section, in order of time (L of them).

    Parameters
    ----------
    t_pre, t_post : (L,) array
        Instants of the descending crossings, s; `t_post` is NaN where the body rose again first.
    gap_pre, gap_post : (L,) array
        Time between the two frames that bracket each crossing, s; where there is none, the longest
        time without a frame in which it may be hidden.
    """

    t_pre: FloatArray
    t_post: FloatArray
    gap_pre: FloatArray
    gap_post: FloatArray

    def __len__(self) -> int:
        return len(self.t_pre)

    @property
    def complete(self) -> BoolArray:
        """Whether the post section was reached, (L,)."""
        return ~np.isnan(self.t_post)


def find_transitions(
    time: FloatArray,
    height: FloatArray,
    *,
    pre_height_m: float,
    post_height_m: float,
) -> Transitions:
    """Find every descent of the body through the pre section.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    height : (N,) array
        Mean height of the body markers, m; NaN where unseen.
    pre_height_m, post_height_m : float
        The sections, m; the pre section is the upper one.

    Returns
    -------
    Transitions
        One entry for each descent, also for those that turn back before the post section; none if
        the body never sinks through the pre section.

    Raises
    ------
    AnalysisError
        If the post section is not below the pre section.
    """
    if not post_height_m < pre_height_m:
        raise AnalysisError(
            f"sections: expected the post section below the pre section, found post "
            f"{post_height_m:.4g} m and pre {pre_height_m:.4g} m"
        )
    seen = np.flatnonzero(~np.isnan(height))
    t, h = time[seen], height[seen]
    sunk = pre_height_m - HYSTERESIS * (pre_height_m - post_height_m)
    falls, rises = schmitt_edges(h, high=pre_height_m, low=sunk)
    if len(falls) == 0:
        return Transitions(*np.empty((4, 0)))
    before_pre = last_at_or_before(np.flatnonzero(h >= pre_height_m), falls)
    end = np.append(rises, len(h))[np.searchsorted(rises, falls)]
    after_post = _first_at_or_after(np.flatnonzero(h <= post_height_m), falls, len(h))
    reached = after_post < end
    last = np.where(reached, after_post, 1) - 1
    t_pre, gap_pre = _crossing(t, h, before_pre, pre_height_m)
    t_post, gap_post = _crossing(t, h, last, post_height_m)
    gap_post = np.where(reached, gap_post, _longest_step(t, before_pre, end))
    return Transitions(t_pre, np.where(reached, t_post, np.nan), gap_pre, gap_post)


def find_low_flights(
    time: FloatArray, height: FloatArray, *, pre_height_m: float, post_height_m: float
) -> Transitions:
    """Find descents to the post section from tops that are below the pre section.

    A hop may be too low for the section that all others pass. It has no crossing of it, but it is a
    landing all the same. From half way between the sections on a rise counts as a hop.

    Parameters
    ----------
    time, height, pre_height_m, post_height_m
        As for `find_transitions`.

    Returns
    -------
    Transitions
        `t_pre` is the instant of the top.
    """
    seen = np.flatnonzero(~np.isnan(height))
    t, h = time[seen], height[seen]
    middle = 0.5 * (pre_height_m + post_height_m)
    falls, rises = schmitt_edges(h, high=middle, low=post_height_m)
    falls = falls[falls > rises[0]] if len(rises) else falls[:0]  # of the first the top is unseen
    if len(falls) == 0:
        return Transitions(*np.empty((4, 0)))
    starts = last_at_or_before(rises, falls)
    tops = np.array([a + int(np.argmax(h[a:b])) for a, b in zip(starts, falls, strict=True)])
    low = h[tops] < pre_height_m
    t_post, gap_post = _crossing(t, h, falls[low] - 1, post_height_m)
    gap_pre = _longest_step(t, starts[low] - 1, tops[low] + 1)
    return Transitions(t[tops[low]], t_post, gap_pre, gap_post)


def together(*parts: Transitions) -> tuple[Transitions, IntArray]:
    """All parts in order of time, and of which part each entry is."""
    fields = ("t_pre", "t_post", "gap_pre", "gap_post")
    joined = [np.concatenate([getattr(part, f) for part in parts]) for f in fields]
    order = np.argsort(joined[0], kind="stable")
    kind = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return Transitions(*(values[order] for values in joined)), kind[order]


def schmitt_edges(h: FloatArray, *, high: float, low: float) -> tuple[IntArray, IntArray]:
    """Find where a Schmitt trigger on `h` goes down (h <= low) and where up (h >= high)."""
    level = np.where(h >= high, 1, np.where(h <= low, -1, 0))
    decided = np.flatnonzero(level)
    signs = level[decided]
    turns = np.flatnonzero(np.diff(signs)) + 1
    at, now = decided[turns], signs[turns]
    return at[now < 0], at[now > 0]


def last_at_or_before(candidates: IntArray, at: IntArray) -> IntArray:
    """Last of some frames at or before each of others; there must be one."""
    return candidates[np.searchsorted(candidates, at, side="right") - 1]


def _first_at_or_after(candidates: IntArray, at: IntArray, missing: int) -> IntArray:
    return np.append(candidates, missing)[np.searchsorted(candidates, at)]


def _longest_step(t: FloatArray, first: IntArray, last: IntArray) -> FloatArray:
    """Longest time from frame to frame, s, between each two frames; `last` may be past the end."""
    steps = np.diff(t)
    return np.array([steps[a:b].max(initial=0.0) for a, b in zip(first, last, strict=True)])


def _crossing(
    t: FloatArray, h: FloatArray, index: IntArray, level: float
) -> tuple[FloatArray, FloatArray]:
    """Instant at which the chord from frame `index` to the next meets `level`, and its length."""
    width = t[index + 1] - t[index]
    drop = h[index] - h[index + 1]
    return t[index] + width * (h[index] - level) / np.where(drop == 0, 1.0, drop), width


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
