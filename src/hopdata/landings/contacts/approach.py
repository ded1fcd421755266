"""Where to look for a contact: in the first descent of each foot to the floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hopdata.arrays import GRAVITY_M_S2, BoolArray, FloatArray, IntArray
from hopdata.landings.contacts.descents import (
    ALREADY_DOWN,
    LANDED,
    MISSING,
    NOT_LANDED,
    Transitions,
)

LANDINGS = 2000  # landings processed together, to bound memory

#: Height, as a share of the foot's descent, below which it is nearly down.
#: Unit: 1. Origin: chosen.
NEAR_FLOOR = 0.15

#: Least height below which a foot is nearly down, in standard deviations of a height.
#: Unit: standard deviations. Origin: chosen.
NEAR_FLOOR_SIGMAS = 5.0

#: Share of that height below which a foot has come down.
#: Unit: 1. Origin: chosen.
HALF_DOWN = 0.5

#: Height, as a share of the descent, below which the mean speed of the fall is taken.
#: Unit: 1. Origin: chosen.
ON_ITS_WAY = 0.4

#: A foot that sinks by less than this share of the down height stood all along: it
#: only settles.
#: Unit: 1. Origin: measured: seven of the 29 landings found in a series of jumps were
#: none.
SETTLES = 0.5

#: Fewest frames of a foot in which a contact is sought.
#: Unit: frames. Origin: chosen.
LEAST_FRAMES = 5

#: A foot stands at the height of the lowest of its frames but this many.
#: Unit: frames. Origin: chosen.
RESTING_FRAME = 3

#: Height above where it stands at which a foot may touch: skin gives.
#: Unit: m. Origin: measured: on three runs (docs/contacts_method.md, "The earliest
#: contact").
SKIN_M = 0.004

#: Time constant of the softest contact: a foot may touch higher by the way of its
#: fastest fall in this time. From 9 to 13 ms the orders are the same; at 7 ms true
#: kinks are lost.
#: Unit: s. Origin: measured: on three runs (docs/contacts_method.md, "The earliest
#: contact").
SOFTEST_S = 0.01

#: Time between two frames, in usual ones, above which something may be hidden.
#: Unit: frames. Origin: chosen.
GAP = 1.5


def approaches(
    time: FloatArray,
    heights: FloatArray,
    transitions: Transitions,
    *,
    noise_m: float,
    down_height_m: float,
    lead_s: float,
    trail_s: float,
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Find the rough instant at which each foot came down in each complete transition.

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
        Height to which a foot must sink to have landed, m.
    lead_s, trail_s : float
        Time before the pre section at which the search begins, and time after the post
        section at which it ends, s.

    Returns
    -------
    near : (L, n) array
        Rough instants, s; NaN where the foot did not come down from above.
    earliest : (L, n) array
        Last instant at which the foot was too high to touch, s: higher above its
        resting height than skin and a soft contact let it sink.
    status : (L, n) int array
        `LANDED`, `ALREADY_DOWN`, `NOT_LANDED`, or `MISSING` where gaps may hide which
        one holds.
    """
    n_feet = heights.shape[1]
    shape = (len(transitions), n_feet)
    near = np.full(shape, np.nan)
    earliest = np.full(shape, np.nan)
    status = np.full(shape, NOT_LANDED, dtype=np.int64)
    longest_gap_s = [GAP * _usual_frame_s(time, one) for one in heights.T]
    complete = np.flatnonzero(transitions.complete)
    for rows in np.split(complete, range(LANDINGS, len(complete), LANDINGS)):
        if len(rows) == 0:
            continue
        t_pre = transitions.t_pre[rows]
        t_post = transitions.t_post[rows]
        start = np.searchsorted(time, t_pre - lead_s)
        stop = np.searchsorted(time, t_post + trail_s)
        frames = start[:, None] + np.arange(int(np.max(stop - start, initial=1)))
        inside = frames < stop[:, None]
        frames = np.minimum(frames, len(time) - 1)
        for foot in range(n_feet):
            z = np.where(inside, heights[frames, foot], np.nan)
            windows = _Windows.of(time[frames], z, t_pre, t_post, longest_gap_s[foot])
            found = _first_descents(windows, noise_m, down_height_m)
            near[rows, foot], earliest[rows, foot], status[rows, foot] = found
    return near, earliest, status


def _usual_frame_s(time: FloatArray, heights: FloatArray) -> float:
    """Return the usual time between frames that show a foot, s.

    A foot may be seen in every k-th frame.
    """
    seen = time[~np.isnan(heights)]
    if len(seen) < 2:
        return float("nan")
    return float(np.median(np.diff(seen)))


@dataclass(frozen=True)
class _Windows:
    """Frames of one foot in R landings.

    Parameters
    ----------
    t, z : (R, W) array
        Times, s, and heights, m. Frames that show the foot come first; in the others z
        is NaN.
    count : (R,) int array
        Number of frames that show the foot.
    t_pre, t_post : (R,) array
        When the body crosses the sections, s.
    longest_gap_s : float
        Frames farther apart than this are a gap, s.
    """

    t: FloatArray
    z: FloatArray
    count: IntArray
    t_pre: FloatArray
    t_post: FloatArray
    longest_gap_s: float

    @classmethod
    def of(
        cls,
        t: FloatArray,
        z: FloatArray,
        t_pre: FloatArray,
        t_post: FloatArray,
        longest_gap_s: float,
    ) -> _Windows:
        """Put the frames (R, W) that show the foot first."""
        unseen = np.isnan(z)
        order = np.argsort(unseen, axis=1, kind="stable")
        return cls(
            t=np.take_along_axis(t, order, axis=1),
            z=np.take_along_axis(z, order, axis=1),
            count=(~unseen).sum(axis=1),
            t_pre=t_pre,
            t_post=t_post,
            longest_gap_s=longest_gap_s,
        )

    @property
    def rows(self) -> IntArray:
        """Numbers of the landings, (R,)."""
        return np.arange(len(self.z))

    @property
    def places(self) -> IntArray:
        """Places of the frames, (W,)."""
        return np.arange(self.z.shape[1])

    @property
    def last_place(self) -> int:
        """Place of the last frame."""
        return self.z.shape[1] - 1


def _first_descents(
    windows: _Windows, noise_m: float, down_height_m: float
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return what `approaches` does, each (R,), for one foot.

    Missing frames never count against a foot: it is `ALREADY_DOWN` before the pre
    section or `NOT_LANDED` by the post section only if no gap can hide the contrary.
    """
    t = windows.t
    z = windows.z
    place = windows.places
    stands_lowest = np.where(np.isnan(z), np.inf, z)
    lowest = stands_lowest.min(axis=1)
    highest = np.where(np.isnan(z), -np.inf, z).max(axis=1, initial=-np.inf)
    depth = highest - lowest
    nearly = np.maximum(NEAR_FLOOR_SIGMAS * noise_m, NEAR_FLOOR * depth)
    above = z > (lowest + nearly)[:, None]
    # Only the first of two landings in a descent of the body counts.
    has_left = _has_left(z, above, lowest + HALF_DOWN * nearly)
    stands_lowest = np.where(has_left, np.inf, stands_lowest)
    bottom = np.argmin(stands_lowest, axis=1)
    low = stands_lowest[windows.rows, bottom]
    falling = place < bottom[:, None]
    last_above = _last(falling & above)

    # What became of the foot: the later of these lines that holds.
    stood = (last_above < 0) | (depth <= SETTLES * down_height_m)
    unseen_before = t[:, 0] > windows.t_pre
    status = np.where(stood, np.where(unseen_before, MISSING, ALREADY_DOWN), LANDED)
    may_hide = _may_hide_landing(windows, down_height_m)
    stays_up = low > down_height_m
    status = np.where(stays_up, np.where(may_hide, MISSING, NOT_LANDED), status)
    status = np.where(windows.count < LEAST_FRAMES, MISSING, status)

    with np.errstate(invalid="ignore"):  # depth is infinite if no frame shows the foot
        on_its_way = z > (low + ON_ITS_WAY * depth)[:, None]
    first = _last((place <= last_above[:, None]) & on_its_way)
    first = np.where(first < 0, last_above, first)
    is_half_down = z <= (low + HALF_DOWN * nearly)[:, None]
    half_down = np.argmax((place > last_above[:, None]) & is_half_down, axis=1)
    near = _rough_instants(windows, first, last_above, half_down, low)
    landed = status == LANDED
    resting_place = min(RESTING_FRAME, windows.last_place)
    rest = np.sort(stands_lowest, axis=1)[:, resting_place]
    earliest = np.where(landed, _last_too_high(windows, falling, rest), np.nan)
    return np.where(landed, np.maximum(near, earliest), np.nan), earliest, status


def _rough_instants(
    windows: _Windows,
    first: IntArray,
    last: IntArray,
    half_down: IntArray,
    low: FloatArray,
) -> FloatArray:
    """Return when a foot would be as low as it gets, (R,), s, if it fell on as before.

    Parameters
    ----------
    first, last : (R,) int array
        Places of the frames between which the speed of the fall is taken; in `last` the
        foot is for the last time above the floor.
    half_down : (R,) int array
        Place of the frame in which the foot has come down.
    low : (R,) array
        Height that it reaches, m.
    """
    t = windows.t
    z = windows.z
    rows = windows.rows
    after = np.minimum(last + 1, windows.last_place)
    t_last = t[rows, last]
    t_after = t[rows, after]
    gap = t_after - t_last
    before = np.maximum(np.minimum(first, last - 1), 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        # From the frame after the last one above the floor, at the speed until then.
        fall = (z[rows, first] - z[rows, after]) / (t_after - t[rows, first])
        near = t_after + (z[rows, after] - low) / fall
        # A fall does not slow down.
        near = np.minimum(near, 2 * t[rows, half_down] - t_last)
        # From the last frame above the floor, at the speed before it.
        fall = (z[rows, before] - z[rows, last]) / (t_last - t[rows, before])
        near_before_gap = t_last + np.minimum((z[rows, last] - low) / fall, gap)
    # The frame after a gap shows only that the foot is down.
    in_gap = (gap > windows.longest_gap_s) & (last > 0) & (fall > 0)
    return np.where(in_gap, near_before_gap, near)


def _has_left(z: FloatArray, above: BoolArray, stands_m: FloatArray) -> BoolArray:
    """Mark the frames (R, W) after a foot that stood has left the floor again.

    A foot may land twice in one descent: the body may keep sinking while it pushes off
    again.
    """
    has_been_above = np.logical_or.accumulate(above, axis=1)
    stands = has_been_above & (z <= stands_m[:, None])
    has_stood = np.cumsum(stands, axis=1) > RESTING_FRAME
    return np.logical_or.accumulate(above & has_stood, axis=1)


def _last_too_high(
    windows: _Windows, falling: BoolArray, rest: FloatArray
) -> FloatArray:
    """Return the instants (R,), s, until which a foot is too high to touch.

    -inf where it never is. `falling` (R, W) are the frames before it is lowest, and
    `rest` (R,) is the height at which it stands, m.
    """
    t = windows.t
    z = windows.z
    rows = windows.rows
    step = np.diff(t, axis=1)
    rise = np.diff(z, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        is_fall = (step <= windows.longest_gap_s) & falling[:, 1:]
        fall_m_s = np.where(is_fall, -rise / step, 0.0)
        fastest_m_s = np.nan_to_num(fall_m_s).max(axis=1, initial=0.0)
        limit = rest + SKIN_M + SOFTEST_S * fastest_m_s
        place = _last(falling & (z > limit[:, None]))
        after = np.minimum(place + 1, windows.last_place)
        ahead = t[rows, after] - t[rows, place]
        share = (z[rows, place] - limit) / (z[rows, place] - z[rows, after])
        into_step = np.where(ahead <= windows.longest_gap_s, share * ahead, 0.0)
        at = t[rows, place] + into_step
    return np.where(place < 0, -np.inf, at)


def _may_hide_landing(windows: _Windows, down_height_m: float) -> BoolArray:
    """Mark the rows (R,) in which a gap may hide that the foot was down.

    The foot is assumed to enter a gap at the fastest fall that was seen, and then to
    fall freely. If it is seen again after the gap, it must also have had time to come
    back up.
    """
    t = windows.t
    z = windows.z
    rows = windows.rows
    longest = windows.longest_gap_s
    gap = np.diff(t, axis=1)
    rise = np.diff(z, axis=1)  # NaN where a frame is not seen
    is_fall = (gap <= longest) & (rise < 0)
    fastest = np.where(is_fall, -rise / gap, 0.0).max(axis=1, initial=0.0)

    lower = np.fmin(z[:, :-1], z[:, 1:]) + 0.0 * rise
    could_land = lower - _drop(fastest[:, None], 0.5 * gap) <= down_height_m
    hides_within = (could_land & (gap > longest)).any(axis=1)

    last_seen = np.maximum((~np.isnan(z)).sum(axis=1) - 1, 0)
    rest_s = windows.t_post - t[rows, last_seen]
    could_land = z[rows, last_seen] - _drop(fastest, rest_s) <= down_height_m
    hides_after = could_land & (rest_s > longest)

    lead_s = t[:, 0] - windows.t_pre
    could_land = z[:, 0] - _drop(fastest, lead_s) <= down_height_m
    hides_before = could_land & (lead_s > longest)
    return np.asarray(hides_within | hides_after | hides_before)


def _drop(speed: FloatArray, duration: FloatArray) -> FloatArray:
    """Return the drop, m, in free fall for a time, s, from a downward speed, m/s."""
    return duration * (speed + 0.5 * GRAVITY_M_S2 * duration)


def _last(marked: BoolArray) -> IntArray:
    """Return the place of the last mark in each row (R, W), -1 where there is none."""
    last = marked.shape[1] - 1 - np.argmax(marked[:, ::-1], axis=1)
    return np.where(marked.any(axis=1), last, -1)
