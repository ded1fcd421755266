"""Landings while the body is hidden: seen by the feet alone, so that none is left out unlisted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.landings.transitions import Transitions, last_at_or_before, schmitt_edges

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

CLEARLY_UP = 2.0  # times the height below which a foot is down


def find_hidden_landings(
    time: FloatArray,
    feet: FloatArray,
    body_height: FloatArray,
    found: Transitions,
    *,
    down_height_m: float,
    longest_gap_s: float,
) -> Transitions:
    """Find landings that have no descent of their own, because the body is hidden meanwhile.

    Of several landings in one gap the body's height tells one at most: it is above the sections
    before the gap, and below them after it.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    feet : (N, F) array
        Heights of the feet above the floor, m; NaN where unseen.
    body_height : (N,) array
        Mean height of the body markers, m; NaN where unseen.
    found : Transitions
        The descents of the body that were seen.
    down_height_m : float
        A foot below this height is down, m; at twice the height it is up.
    longest_gap_s : float
        Shorter gaps of the body hide no landing, s.

    Returns
    -------
    Transitions
        Landings from a frame in which all feet that are seen are up, `t_pre`, to the first in which
        all are down, `t_post`. Both gaps are the longest of the body that begins or ends between.
    """
    starts, ends = _all_up_to_all_down(feet, down_height_m)
    t_pre, t_post = time[starts], time[ends]
    gap = _longest_gaps(time[~np.isnan(body_height)], t_pre, t_post)
    hidden = (gap > longest_gap_s) & ~_have_a_descent(t_pre, t_post, found)
    return Transitions(t_pre[hidden], t_post[hidden], gap[hidden], gap[hidden])


def _all_up_to_all_down(
    feet: FloatArray, down_height_m: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Last frames with all feet up, and first frames with all of them down after these."""
    seen = np.flatnonzero(~np.isnan(feet).all(axis=1))
    lowest, highest = np.nanmin(feet[seen], axis=1), np.nanmax(feet[seen], axis=1)
    up, down = lowest >= CLEARLY_UP * down_height_m, highest <= down_height_m
    ends, _ = schmitt_edges(up.astype(float) - down, high=1.0, low=-1.0)
    if len(ends) == 0:
        return ends, ends
    return seen[last_at_or_before(np.flatnonzero(up), ends)], seen[ends]


def _longest_gaps(seen: FloatArray, first: FloatArray, last: FloatArray) -> FloatArray:
    """Longest time without a frame, s, that overlaps each interval; infinite at either end."""
    edges = np.concatenate([[-np.inf], seen, [np.inf]])
    gaps = np.diff(edges)
    begin = np.searchsorted(edges, first, side="right") - 1
    end = np.searchsorted(edges, last, side="left")
    return np.array([gaps[a:b].max(initial=0.0) for a, b in zip(begin, end, strict=True)])


def _have_a_descent(t_pre: FloatArray, t_post: FloatArray, found: Transitions) -> BoolArray:
    """Tell which landings have a descent: each descent has one, the nearest that it may be of.

    Its crossings may lie anywhere in the gaps about them.
    """
    have = np.zeros(len(t_pre), dtype=bool)
    middle = 0.5 * (t_pre + t_post)
    until = np.where(found.complete, found.t_post, found.t_pre)
    gap_post = np.maximum(found.gap_pre, found.gap_post)
    for begin, end, before, after in zip(found.t_pre, until, found.gap_pre, gap_post, strict=True):
        may_be = (t_pre <= end + after) & (t_post >= begin - before) & ~have
        near = np.flatnonzero(may_be)
        if len(near) > 0:
            have[near[np.argmin(np.abs(middle[near] - 0.5 * (begin + end)))]] = True
    return have
