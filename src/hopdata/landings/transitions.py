"""Candidate touchdowns: the body sinks through the pre section and then the post section."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


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
    hysteresis: float = 0.02,
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
    hysteresis : float
        Part of the distance between the sections by which the body must sink below the pre section
        before a descent counts, so that noise about the section makes no descents of its own.

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
    sunk = pre_height_m - hysteresis * (pre_height_m - post_height_m)
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
