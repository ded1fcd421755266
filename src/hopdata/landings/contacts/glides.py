"""Feet that are timed while they still glide above the floor, and sought again.

A heel that swings forward in a walk stops falling some centimetres up, glides, and
comes down a tenth of a second later. The kink of its height is where the glide begins.
A foot that has landed yields within some hundredths of a second, and then stands.
A heel whose foot comes flat later may touch below the height at which it then stands.
So low the toe of a jump tilts too, but the floor stopped it: a leg is slower.
Everything here is of an animal of 1 m.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.landings.contacts import approach, descents

#: Time in which soles and legs have yielded after a contact.
#: Unit: s. Origin: chosen: runners' shoes take 0.02 to 0.03.
YIELDED_S = 0.04

#: Time after a contact by which a foot that glides has come down.
#: Unit: s. Origin: chosen.
DOWN_S = 0.25

#: Height by which a foot sinks after it has yielded, from which on it has glided, and
#: its first kink is no contact.
#: Unit: m. Origin: measured: 240 of 241 contacts of three runners sink by at most
#: 0.003 (one, timed 20 mm above the floor, by 0.0052), and 927 of the simulated hopper
#: by 0.0022; heels of a walk that were timed 0.11 s before their force plates sink by
#: 0.006 and 0.009. At 1.5 times this the first is missed.
GLIDED_M = 0.005

#: Height by which it sinks, from which on it may have glided: it has if it is then
#: seen to come down.
#: Unit: m. Origin: chosen: as most of those contacts sink less.
SINKS_M = 0.003

#: The same height where no kink was found.
#: Unit: m. Origin: chosen.
SLOWLY_SINKS_M = 0.0015

#: Least sinking that noise does not make, in standard deviations of a height.
#: Unit: standard deviations. Origin: chosen: with 6, noise of 0.6 mm takes 1 in 2,400
#: feet that creep by 20 mm/s for gliding.
SINKS_SIGMAS = 10.0

#: How much lower than it is a foot seems by its lowest frames, in standard deviations
#: of a height: added to `GLIDED_M`.
#: Unit: standard deviations. Origin: convention: three sigmas.
LOWEST_SIGMAS = 3.0

#: Speed at which a foot that has glided comes down, at least. A foot that stands sinks
#: more slowly.
#: Unit: m/s. Origin: measured: feet of three runners that sink by more than 0.003 after
#: their contacts do so at up to 0.07, made-up heels that glide at 0.14 and more.
COMES_DOWN_M_S = 0.1

#: Error of the later kink, from its residuals, up to which it is one. Noise makes kinks
#: in a foot that creeps.
#: Unit: s. Origin: chosen: made-up heels that glide have 0.002 to 0.0085, noise in feet
#: that stand 0.006 to 0.02.
CLEAR_S = 0.01

#: Ratio of the residuals about the contacts to the noise, from which on a foot rolls,
#: and sinks by some millimetres after a sound contact.
#: Unit: 1. Origin: measured: three runners have 6.1 to 9.8, made-up heels that glide
#: have 1.1 to 3.0.
ROLLS = 4.0

#: Residuals about an even sinking, up to which a foot creeps and does not glide.
#: Unit: standard deviations of a height. Origin: derived: a step by `SINKS_SIGMAS` in
#: the middle of the frames leaves 2.5 beside the noise, an even sinking 1.
EVENLY_SIGMAS = 1.75

#: Share of the sinking that an even one explains, at least: otherwise the foot came
#: down where it was hidden.
#: Unit: 1. Origin: chosen.
EVENLY_SHARE = 0.5

#: Fewest frames that tell an even sinking from another, and most that may be hidden.
#: Unit: frames. Origin: chosen.
LEAST_FRAMES = 6

#: Rise from which on a foot has left; as deep below the floor no foot is.
#: Unit: m. Origin: derived: twice `GLIDED_M`.
LEAVES_M = 2 * GLIDED_M

#: Sinking of a foot that glides, at least, in heights by which it rises meanwhile: one
#: that bounces rises farther, and was on the floor between two frames.
#: Unit: 1. Origin: chosen.
BOUNCE_SHARE = 2.0

#: Time before a contact in which a leg slows the foot.
#: Unit: s. Origin: chosen.
SLOWS_S = 0.15

#: Largest deceleration of a foot, up to which a leg slowed it, and not the floor.
#: Unit: m/s^2. Origin: chosen: heels of three recorded walks that slow above the floor
#: have 13 to 18; of 1,645 fits of three runners none passes for a leg's, 7 would at 30.
LEG_M_S2 = 20.0

#: The same, up to which it is not sure which of them it was.
#: Unit: m/s^2. Origin: chosen.
LEG_OR_FLOOR_M_S2 = 30.0

#: Mean deceleration over `approach.SOFTEST_S` about a contact, from which on no leg
#: slowed the foot.
#: Unit: m/s^2. Origin: chosen: made-up heels that glide have up to 60, toes of
#: simulated jumps 150 and more.
HARD_M_S2 = 100.0

#: Time in which a floor stops a foot, its speed over its largest deceleration, at most,
#: in times of the softest contact.
#: Unit: 1. Origin: chosen: a speed that decays within such a time seems to last 1.4 to
#: 1.7 of them longer than the frames are apart.
FLOOR_TIMES = 2.5

#: Error of a deceleration from the noise of heights; it says how far apart the frames
#: are that it is taken from.
#: Unit: m/s^2. Origin: chosen: a tenth of `LEG_M_S2`, as the largest counts.
DECELERATION_ERROR_M_S2 = 2.0

#: Error of a contact that is sought again, for which no other says how soft it is: it
#: may be late by up to the time of the softest contact.
#: Unit: s. Origin: derived: the rms of an even distribution from 0 to
#: `approach.SOFTEST_S`.
UNKNOWN_SOFTNESS_S = approach.SOFTEST_S / 3**0.5


def glides(
    time: FloatArray,
    heights: FloatArray,
    instant: FloatArray,
    foot_of: Sequence[int],
    *,
    least_m: FloatArray | float = GLIDED_M,
    noise_m: float = 0.0,
    leg_m_s2: float = LEG_M_S2,
) -> BoolArray:
    """Mark the contacts (L, p) after which a foot sinks by more than it yields.

    Of a foot with several markers those are marked that sink themselves, or, if none of
    them does, the one that touched first.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    heights : (N, p) array
        Heights of the feet's markers above the levelled floor, m; NaN where unseen.
    instant : (L, p) array
        Contacts of the markers, s; NaN where none can be trusted.
    foot_of : sequence of int
        Number of the foot that each marker belongs to.
    least_m : (L, p) array or float
        Height by which a foot must sink to have glided, m.
    noise_m : float
        Standard deviation of a height, m: see `sinks`.
    leg_m_s2 : float
        Deceleration up to which a leg may have slowed a foot, m/s^2: see `sinks`.
    """
    least_m = np.broadcast_to(least_m, instant.shape)
    sinks_m = np.zeros(instant.shape)
    for marker in range(instant.shape[1]):
        sinks_m[:, marker] = sinks(
            time,
            heights[:, marker],
            instant[:, marker],
            noise_m=noise_m,
            leg_m_s2=leg_m_s2,
        )
    marked = sinks_m > least_m
    for foot in sorted(set(foot_of)):
        own = np.flatnonzero(np.equal(foot_of, foot))
        if len(own) == 1:
            continue
        known = np.where(np.isfinite(instant[:, own]), instant[:, own], np.inf)
        first = known.argmin(axis=1)
        first_s = known.min(axis=1)
        first_s[np.isinf(first_s)] = np.nan
        foot_least_m = np.take_along_axis(least_m[:, own], first[:, None], axis=1)
        # As a foot rolls, one marker rises while the next comes down.
        lowest_m = _lowest(heights[:, own])
        foot_sinks_m = sinks(
            time,
            lowest_m,
            first_s,
            bounce_share=0.0,
            noise_m=noise_m,
            leg_m_s2=leg_m_s2,
        )
        foot_sinks = foot_sinks_m > foot_least_m[:, 0]
        marked[:, own] &= foot_sinks[:, None]
        none_sinks = foot_sinks & ~marked[:, own].any(axis=1)
        marked[none_sinks, own[first[none_sinks]]] = True
    return marked


def doubts(first: FloatArray, later: FloatArray) -> FloatArray:
    """Return errors (L, n) of contacts of feet that may have glided on, s.

    The contact may be anywhere from the first kink (L, n), s, to the later one, or,
    where that is NaN, to the end of the search: the error is the rms of an even
    distribution about its begin.
    """
    until = np.where(np.isfinite(later), later, first + DOWN_S)
    return np.asarray((until - first) / 3**0.5)


def _lowest(heights: FloatArray) -> FloatArray:
    """Return the height (N,) of the lowest of a foot's markers (N, p), m."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # frames without any
        return np.asarray(np.nanmin(heights, axis=1))


def sinks(
    time: FloatArray,
    height: FloatArray,
    instant: FloatArray,
    *,
    bounce_share: float = BOUNCE_SHARE,
    noise_m: float = 0.0,
    leg_m_s2: float = LEG_M_S2,
) -> FloatArray:
    """Return by how much a foot (N,) sinks after it has yielded, (L,), m.

    It is how far it comes below where it has been by then, to the floor. 0 where it is
    not seen, or not timed, of a foot that rises half as far in between: it bounces, and
    of one that sinks evenly to within the noise, `noise_m` (m): it stands, and creeps.
    Below the floor it counts only where a leg may have slowed the foot, by less than
    `leg_m_s2` (m/s^2): see `is_slowed_by_leg`.
    """
    sinks_m = np.zeros(len(instant))
    timed = np.flatnonzero(np.isfinite(instant))
    contact_s = instant[timed]
    begin = np.searchsorted(time, contact_s)
    yielded = np.searchsorted(time, contact_s + YIELDED_S)
    end = np.searchsorted(time, contact_s + DOWN_S)
    seen_m = np.append(np.where(np.isnan(height), np.inf, height), np.inf)
    before_m = _least_between(seen_m, begin, yielded)
    after_m = _least_between(seen_m, yielded, end)
    # Few sink at all, and only these are looked at frame by frame.
    is_lower = np.isfinite(before_m) & (after_m < before_m)
    for row in np.flatnonzero(is_lower).tolist():
        frames_m = seen_m[begin[row] : end[row]]
        frames_m = frames_m[: stays_until(frames_m)]
        after_m = frames_m[int(yielded[row] - begin[row]) :]
        if not len(after_m):
            continue
        sunk_m = before_m[row] - after_m.min()
        # Below the floor a marker only tilts, as a toe's when the heel comes down; the
        # heel of a foot that comes flat later touches there.
        to_floor_m = min(sunk_m, before_m[row] + LOWEST_SIGMAS * noise_m)
        if _creeps(after_m, to_floor_m, noise_m):
            to_floor_m = 0.0
        if to_floor_m < sunk_m and not is_slowed_by_leg(
            time, height, contact_s[row], noise_m, most_m_s2=leg_m_s2
        ):
            sunk_m = to_floor_m
        if sunk_m > bounce_share * rises(frames_m):
            sinks_m[timed[row]] = sunk_m
    return sinks_m


def is_slowed_by_leg(
    time: FloatArray,
    height: FloatArray,
    contact_s: float,
    noise_m: float,
    *,
    most_m_s2: float = LEG_M_S2,
) -> bool:
    """Tell whether a leg may have slowed a foot (N,) at a contact, and not the floor.

    A floor takes a foot's speed within `approach.SOFTEST_S`, a leg takes it within a
    tenth of a second, and by less than `most_m_s2`. Speeds are differences over so many
    frames that noise of `noise_m` (m) does not make such a deceleration. Where frames
    are hidden about the contact it is not known, and taken for the floor.
    """
    begin, least, contact, end = np.searchsorted(
        time,
        [
            contact_s - SLOWS_S,
            contact_s - YIELDED_S,
            contact_s,
            contact_s + YIELDED_S,
        ],
    )
    if contact - begin < 2:
        return False
    frame_s = float(np.median(np.diff(time[begin:contact])))
    apart_s = (6**0.5 * noise_m / DECELERATION_ERROR_M_S2) ** 0.5
    apart = max(1, round(apart_s / frame_s))
    frames_m = height[begin : end + apart]
    hidden = np.flatnonzero(np.isnan(frames_m))
    first = int(hidden[-1]) + 1 if len(hidden) else 0
    frames_m = frames_m[first:]
    if begin + first > least or len(frames_m) <= 2 * apart:
        return False
    speed_m_s = (frames_m[:-apart] - frames_m[apart:]) / (apart * frame_s)
    slowing_m_s2 = (speed_m_s[:-apart] - speed_m_s[apart:]) / (apart * frame_s)
    fastest = int(np.argmax(speed_m_s))
    most_slowing_m_s2 = slowing_m_s2[max(fastest - apart, 0) :].max(initial=0.0)
    longest_on_floor_s = apart * frame_s + FLOOR_TIMES * approach.SOFTEST_S
    lasts_long = speed_m_s[fastest] > longest_on_floor_s * most_slowing_m_s2
    return bool(lasts_long and 0 < most_slowing_m_s2 < most_m_s2)


def is_stopped_hard(time: FloatArray, height: FloatArray, contact_s: float) -> bool:
    """Tell whether a foot (N,) lost its speed at a contact faster than by any leg.

    Its mean speeds before and after are compared, both over `approach.SOFTEST_S`.
    """
    seen = np.isfinite(height)
    about_s = contact_s + approach.SOFTEST_S * np.array([-1.0, 0.0, 1.0])
    if seen.sum() < LEAST_FRAMES:
        return False
    before_m, at_m, after_m = np.interp(about_s, time[seen], height[seen])
    slows_m = (before_m - at_m) - (at_m - after_m)
    return bool(slows_m > HARD_M_S2 * approach.SOFTEST_S**2)


def _least_between(values: FloatArray, begin: IntArray, end: IntArray) -> FloatArray:
    """Return the least of the values from each begin until before each end, (L,)."""
    least = np.full(len(begin), np.inf)
    some = np.flatnonzero(begin < end)
    if len(some):
        edges = np.stack([begin[some], end[some]], axis=1).ravel()
        least[some] = np.minimum.reduceat(values, edges)[::2]
    return least


def _leaves(time: FloatArray, height: FloatArray, contact_s: float) -> float:
    """Return when a foot (N,) leaves the floor again, or the search ends, s."""
    begin, end = np.searchsorted(time, [contact_s, contact_s + DOWN_S])
    frames_m = np.where(np.isnan(height[begin:end]), np.inf, height[begin:end])
    stays = stays_until(frames_m)
    if stays == len(frames_m):
        return contact_s + DOWN_S
    return float(time[begin + stays - 1])


def rises(heights: FloatArray) -> float:
    """Return how far a foot rises before it is lowest, m; `heights` (n,) are frames."""
    until_lowest = heights[: int(np.argmin(heights)) + 1]
    seen = until_lowest[np.isfinite(until_lowest)]
    return float((seen - np.minimum.accumulate(seen)).max())


def _creeps(heights: FloatArray, sunk_m: float, noise_m: float) -> bool:
    """Tell whether a foot sinks evenly by `sunk_m`, m, to within the noise, m.

    `heights` (n,), m, are those after it has yielded. One that glides is level at
    first, comes down, and is level again.
    """
    frames = np.flatnonzero(np.isfinite(heights))
    # Two short clusters of frames lie on a line, whatever is between them.
    if len(frames) < LEAST_FRAMES or np.diff(frames).max() > LEAST_FRAMES:
        return False
    line = np.polyfit(frames, heights[frames], 1)
    falls_m = -line[0] * (frames[-1] - frames[0])
    if falls_m < EVENLY_SHARE * sunk_m:
        return False
    residual_m = heights[frames] - np.polyval(line, frames)
    rms_m = np.sqrt((residual_m**2).sum() / (len(frames) - 2))
    return bool(rms_m < EVENLY_SIGMAS * noise_m)


def stays_until(heights: FloatArray) -> int:
    """Return the frame of these (n,), m, in which a foot has left the floor again."""
    is_seen = np.isfinite(heights)
    lowest_m = np.minimum.accumulate(heights)
    has_left = is_seen & (heights > lowest_m + LEAVES_M)
    has_left |= heights < -LEAVES_M
    if not has_left.any():
        return len(heights)
    return int(np.argmax(has_left))


def last_descents(
    time: FloatArray,
    heights: FloatArray,
    instant: FloatArray,
    gliding: BoolArray,
    *,
    noise_m: float,
) -> tuple[FloatArray, FloatArray]:
    """Find roughly when feet that glide come down to where they rest.

    The search begins once the foot would have yielded, and goes as for any contact: the
    foot is too high to touch until it is near the height at which it comes to rest.

    Parameters
    ----------
    time, heights, instant
        See `glides`.
    gliding : (L, p) bool array
        Contacts that are sought again.
    noise_m : float
        Standard deviation of a height, m.

    Returns
    -------
    near, earliest : (L, p) array
        Rough instants, and those until which the foot is too high to touch, s; NaN
        where the foot does not come down, or need not.
    """
    near = np.full(instant.shape, np.nan)
    earliest = np.full(instant.shape, np.nan)
    for marker in np.flatnonzero(gliding.any(axis=0)).tolist():
        rows = np.flatnonzero(gliding[:, marker])
        contact_s = instant[rows, marker]
        until_s = [_leaves(time, heights[:, marker], one) for one in contact_s.tolist()]
        no_gap = np.zeros(len(rows))
        spans = descents.Transitions(
            contact_s + YIELDED_S, np.array(until_s), no_gap, no_gap
        )
        near_s, earliest_s, status = approach.approaches(
            time,
            heights[:, [marker]],
            spans,
            noise_m=noise_m,
            # A foot that sinks by `SLOWLY_SINKS_M` has not stood all along.
            down_height_m=SLOWLY_SINKS_M / approach.SETTLES,
            lead_s=0.0,
            trail_s=0.0,
        )
        comes_down = status[:, 0] == descents.LANDED
        near[rows[comes_down], marker] = near_s[comes_down, 0]
        earliest[rows[comes_down], marker] = earliest_s[comes_down, 0]
    return near, earliest
