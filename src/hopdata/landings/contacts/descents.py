"""Descents of the body, each a possible landing, and where they cross the sections.

A descent goes from an apex to the nadir after it. Landings of a hidden body are found
from the feet alone, so that a table misses none.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.errors import AnalysisError

# What became of a foot in a descent.
LANDED = 0
ALREADY_DOWN = 1  # before the pre section
NOT_LANDED = 2  # by the post section
MISSING = 3  # gaps may hide whether and when it landed
POOR_FIT = 4
RISES = 5  # where it should touch
THIN = 6  # too few frames to time it, though none is missing
GLIDES = 7  # timed while it is still above the floor

BLOCK = 50_000  # frames processed at a time, to bound memory

#: Smallest swing of a descent, as a share of the body's range from its 2 % to its 98 %
#: quantile. Neither noise nor a shudder moves the body as far.
#: Unit: 1. Origin: chosen.
SMALLEST_SWING = 0.3

#: Smallest swing of a descent in which every foot comes down from its own apex, as a
#: share of the same range. The feet then tell a landing from a shudder. It is 0.18 and
#: more where a person on hands and feet falls anew after having hardly sunk.
#: Unit: 1. Origin: chosen.
SHALLOW_SWING = 0.1

#: Quantiles of the body's height between which its range is taken, so that a few odd
#: frames do not widen it.
#: Unit: 1. Origin: chosen.
RANGE_QUANTILES = (0.02, 0.98)

#: Range of the body's heights over its median descent, above which this range is not
#: that of landings: a body that lies on the floor at the end widens it. It is 1.0 to
#: 1.7 for runners, a walk, the bundled hopper and simulated jumps, and 2.2 to 2.8 for
#: such jumps with a fall at the end.
#: Unit: 1. Origin: chosen.
MOST_RANGE = 2.0

#: How long before the pre section a foot may touch; the flight is continued to the
#: section.
#: Unit: s. Origin: chosen: docs/contacts_study.md, One meaning of "down".
CONTINUED_S = 0.01

#: Gap of the body above which a turning point may be hidden.
#: Unit: s. Origin: chosen.
HIDDEN_S = 0.1

#: Time without any frame above which the recording paused or was joined.
#: Unit: s. Origin: chosen.
PAUSED_S = 0.5

#: Height at which a foot is surely up, in heights below which it is down.
#: Unit: 1. Origin: chosen.
CLEARLY_UP = 2.0

#: Longest gap at a crossing, in frames: one frame may be missing.
#: Unit: frames. Origin: chosen.
LONGEST_GAP_FRAMES = 2.5

#: Longest gap at a crossing at high rates: a body in free fall then departs from the
#: chord by 2 mm.
#: Unit: s. Origin: chosen.
LONGEST_GAP_S = 0.04


def descents(
    body: FloatArray, time: FloatArray | None = None, *, longest: float = np.inf
) -> list[tuple[int, int]]:
    """Find the descents of the body as frames of the apex and of the nadir after it.

    A turning point counts if the body moves away from it by 30 % of its usual range, so
    neither noise nor a shudder creates one. If the body lies on the floor for a while,
    this range is far wider than its descents; then it is 30 % of their median. The
    recording may begin and end within a descent. So may each part between gaps longer
    than `longest`, in s, or in frames if `time` is not given.
    """
    parts = _parts_without_gaps(body, time, longest)
    return _descents_in(parts, body, SMALLEST_SWING * _usual_range_m(parts, body))


def shallow_descents(
    body: FloatArray, time: FloatArray, *, longest: float
) -> list[tuple[int, int]]:
    """Find descents as `descents` does, from 10 % of the usual range on.

    A shudder may be as large, so that something else must show that these are landings.
    """
    parts = _parts_without_gaps(body, time, longest)
    return _descents_in(parts, body, SHALLOW_SWING * _usual_range_m(parts, body))


def _parts_without_gaps(
    body: FloatArray, time: FloatArray | None, longest: float
) -> list[IntArray]:
    """Return the frames that show the body, in parts without a longer gap."""
    seen = np.flatnonzero(np.isfinite(body))
    if len(seen) == 0:
        return []
    if time is None:
        waits = np.diff(seen)
    else:
        waits = np.diff(time[seen])
    return np.split(seen, np.flatnonzero(waits > longest * (1 + 1e-9)) + 1)


def _usual_range_m(parts: list[IntArray], body: FloatArray) -> float:
    """Return the range of which a swing is a share, m; 0 if the body does not move."""
    if not parts:
        return 0.0
    low, high = np.quantile(body[np.concatenate(parts)], RANGE_QUANTILES)
    range_m = float(high - low)
    found = _descents_in(parts, body, SMALLEST_SWING * range_m)
    if not found:
        return range_m
    apex, nadir = np.array(found).T
    fall_m = float(np.median(body[apex] - body[nadir]))
    if range_m > MOST_RANGE * fall_m:
        return fall_m
    return range_m


def _descents_in(
    parts: list[IntArray], body: FloatArray, swing: float
) -> list[tuple[int, int]]:
    """Find the descents in all parts of a recording, see `descents`."""
    found: list[tuple[int, int]] = []
    if swing <= 0:
        return found
    for part in parts:
        found += _descents_of(part, body, swing)
    return found


def _descents_of(
    frames: IntArray, body: FloatArray, swing: float
) -> list[tuple[int, int]]:
    """Find the descents in frames without a long gap, see `descents`."""
    found: list[tuple[int, int]] = []
    apex: int | None = None
    turn = int(frames[0])  # the highest (lowest) frame since the last turning point
    falling = False
    for frame, height in _one_by_one(frames, body):
        if falling:
            goes_on = height < body[turn]
        else:
            goes_on = height > body[turn]
        if goes_on:
            turn = frame
            continue
        if abs(height - body[turn]) <= swing:
            continue
        # The body has moved away from `turn`, so that was a turning point.
        if falling:
            if apex is not None:
                found.append((apex, turn))
            apex = None
        else:
            apex = turn
        turn = frame
        falling = not falling
    if apex is not None:
        found.append((apex, turn))
    return found


def _one_by_one(frames: IntArray, heights: FloatArray) -> Iterator[tuple[int, float]]:
    """Yield frames and their heights as Python numbers, converted in blocks."""
    for first in range(0, len(frames), BLOCK):
        block = frames[first : first + BLOCK]
        yield from zip(block.tolist(), heights[block].tolist(), strict=True)


@dataclass(frozen=True)
class Transitions:
    """Crossings of the two sections in L descents, in order of time.

    Parameters
    ----------
    t_pre, t_post : (L,) array
        Instants of the crossings, s; NaN where the body rose again first. If the top of
        a descent is below the pre section, `t_pre` is the instant of the top.
    gap_pre, gap_post : (L,) array
        Time between the two frames that bracket each crossing, s. Without a crossing,
        the longest time without a frame that may hide one.
    """

    t_pre: FloatArray
    t_post: FloatArray
    gap_pre: FloatArray
    gap_post: FloatArray

    def __len__(self) -> int:
        return len(self.t_pre)

    @property
    def complete(self) -> BoolArray:
        """Whether each descent reached the post section, (L,)."""
        return ~np.isnan(self.t_post)


def find_transitions(
    time: FloatArray,
    height: FloatArray,
    *,
    pre_height_m: float,
    post_height_m: float,
    spans: FloatArray | None = None,
) -> Transitions:
    """Find where each descent of the body crosses the sections.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    height : (N,) array
        Mean height of the body markers, m; NaN where unseen.
    pre_height_m, post_height_m : float
        The sections, m; the pre section is the upper one.
    spans : (L, 2) array, optional
        Instants of apex and nadir of each descent, s; by default those of `descents`.

    Returns
    -------
    Transitions
        One entry for each descent, including those that turn back before a section.

    Raises
    ------
    AnalysisError
        If the post section is not below the pre section.
    """
    if not post_height_m < pre_height_m:
        raise AnalysisError.at(
            "sections",
            "the post section below the pre section",
            f"post {post_height_m:.4g} m and pre {pre_height_m:.4g} m",
        )
    if spans is None:
        found = descents(height)
        spans = time[np.array(found, dtype=np.int64).reshape(-1, 2)]
    seen = ~np.isnan(height)
    track = _Track(time[seen], height[seen])
    t_pre, t_post, gap_pre, gap_post = _crossings(
        track, spans, pre_height_m, post_height_m
    )
    return Transitions(t_pre, t_post, gap_pre, gap_post)


class _Track:
    """Times, s, and heights, m, of the frames that show the body.

    Step k ends in frame k; those before the first and after the last frame are endless.
    """

    def __init__(self, time: FloatArray, height: FloatArray) -> None:
        self.time = time
        self.height = height
        self.steps = np.diff(time, prepend=-np.inf, append=np.inf)

    def crossing(self, index: IntArray, level_m: float) -> FloatArray:
        """Return when the chords from these frames to the next meet a level, s."""
        fall_m = self.height[index] - self.height[index + 1]
        share = (self.height[index] - level_m) / fall_m
        return np.asarray(
            self.time[index] + share * (self.time[index + 1] - self.time[index])
        )


def _crossings(
    track: _Track, spans: FloatArray, pre_m: float, post_m: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return both crossings within each span (L, 2), and the gaps about them, s."""
    steps = track.steps
    last = len(track.time) - 1
    start = np.searchsorted(track.time, spans[:, 0])
    stop = np.searchsorted(track.time, spans[:, 1], side="right")
    below = _first_from(np.flatnonzero(track.height <= post_m), start, stop)
    is_below = below < stop
    # The last frame above the pre section before the body is below the other.
    top = _last_before(np.flatnonzero(track.height >= pre_m), start, below)
    is_above = top >= start

    t_pre = spans[:, 0].copy()
    gap_pre = np.empty(len(spans))
    # A gap may hide a higher top.
    first_step = np.minimum(start, last + 1)
    second_step = np.minimum(start + 1, last + 1)
    gap_pre[:] = np.maximum(steps[first_step], steps[second_step])
    gap_pre[is_above] = steps[top[is_above] + 1]
    t_pre[is_above] = np.nan
    crosses = is_above & (top + 1 < stop)
    t_pre[crosses] = track.crossing(top[crosses], pre_m)

    t_post = np.full(len(spans), np.nan)
    gap_post = np.empty(len(spans))
    ends = is_below & (below > start)
    t_post[ends] = track.crossing(below[ends] - 1, post_m)
    gap_post[ends] = steps[below[ends]]
    top = np.where(is_above, top, start)
    for row in np.flatnonzero(~ends):
        within = steps[top[row] + 1 : min(stop[row] + 1, last + 1)]
        gap_post[row] = within.max(initial=0.0)
    return t_pre, t_post, gap_pre, gap_post


def _first_from(frames: IntArray, start: IntArray, stop: IntArray) -> IntArray:
    """Return the first of these frames from each start on; the stop if none is left."""
    place = np.searchsorted(frames, start)
    found = np.append(frames, np.iinfo(frames.dtype).max)[place]
    return np.minimum(found, stop)


def _last_before(frames: IntArray, start: IntArray, stop: IntArray) -> IntArray:
    """Return the last of these frames before each stop; less than start if none."""
    place = np.searchsorted(frames, stop)
    found = np.insert(frames, 0, -1)[place]
    return np.where(found < start, -1, found)


def find_hidden_landings(
    time: FloatArray,
    feet: FloatArray,
    body: FloatArray,
    spans: FloatArray,
    *,
    down_height_m: float,
) -> FloatArray:
    """Find landings that have no descent of their own because the body is hidden.

    The body's height reveals at most one of several landings in a gap: it is above the
    sections before the gap and below them after it.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    feet : (N, F) array
        Heights of the feet above the floor, m; NaN where unseen.
    body : (N,) array
        Mean height of the body markers, m; NaN where unseen.
    spans : (D, 2) array
        Instants of apex and nadir of the descents that were seen, s.
    down_height_m : float
        Height below which a foot is down, m; at twice this height it is up.

    Returns
    -------
    (H, 2) array
        Instants, s, of the last frame with all seen feet up and of the first with all
        down.
    """
    # Without a foot in view both are false.
    all_up = np.fmin.reduce(feet, axis=1) >= CLEARLY_UP * down_height_m
    all_down = np.fmax.reduce(feet, axis=1) <= down_height_m
    state = all_up.astype(np.int8) - all_down
    decided = np.flatnonzero(state)
    falls = np.flatnonzero(np.diff(state[decided]) < 0)
    found = time[np.column_stack([decided[falls], decided[falls + 1]])]
    body_gap = longest_gaps(time[~np.isnan(body)], found)
    is_hidden = body_gap > longest_gap_s(time)
    # In a pause the animal may have been moved.
    paused = longest_gaps(time, found) > PAUSED_S
    reach = _to_seen_frames(time[~np.isnan(body)], spans)
    return found[is_hidden & ~paused & ~_have_a_descent(found, spans, reach)]


def longest_gap_s(time: FloatArray, time_scale: float = 1.0) -> float:
    """Return the longest gap at which a crossing still counts as seen, s.

    `time_scale` is that of the recording (`hopdata.recording.Recording.time_scale`).
    """
    frame_s = float(np.median(np.diff(time)))
    return max(LONGEST_GAP_FRAMES * frame_s, LONGEST_GAP_S * time_scale)


def longest_gaps(seen: FloatArray, spans: FloatArray) -> FloatArray:
    """Return the longest gap, s, that overlaps each span (L, 2).

    `seen` (N,) are the instants of frames, s; beyond either end the gap is infinite.
    """
    edges = np.concatenate([[-np.inf], seen, [np.inf]])
    gaps = np.diff(edges)
    begin = np.searchsorted(edges, spans[:, 0], side="right") - 1
    end = np.searchsorted(edges, spans[:, 1], side="left")
    longest = [gaps[a:b].max(initial=0.0) for a, b in zip(begin, end, strict=True)]
    return np.array(longest)


def _to_seen_frames(seen: FloatArray, spans: FloatArray) -> FloatArray:
    """Return the spans (D, 2) from the seen frame before each to that after it, s.

    A descent may begin, or end, where a gap ends, or begins: its landing may lie within
    the gap. `seen` (N,) are the instants of frames, s.
    """
    before = np.searchsorted(seen, spans[:, 0]) - 1
    after = np.searchsorted(seen, spans[:, 1], side="right")
    reach = spans.copy()
    has_before = before >= 0
    has_after = after < len(seen)
    reach[has_before, 0] = seen[before[has_before]]
    reach[has_after, 1] = seen[after[has_after]]
    return reach


def _have_a_descent(
    found: FloatArray, spans: FloatArray, reach: FloatArray
) -> BoolArray:
    """Mark the landings (H, 2) that have a descent.

    Each descent (D, 2) claims the nearest landing that overlaps its reach (D, 2).
    """
    have = np.zeros(len(found), dtype=bool)
    # Both columns are in the order of time.
    first = np.searchsorted(found[:, 1], reach[:, 0])
    stop = np.searchsorted(found[:, 0], reach[:, 1], side="right")
    for (begin, end), low, high in zip(spans, first, stop, strict=True):
        unclaimed = low + np.flatnonzero(~have[low:high])
        if len(unclaimed) > 0:
            distance = np.abs(found[unclaimed].sum(axis=1) - begin - end)
            have[unclaimed[np.argmin(distance)]] = True
    return have
