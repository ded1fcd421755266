"""Frames of a foot that no camera saw where they stand: gaps filled, names exchanged.

A fit takes each frame for a measurement of its own. Frames that a spline or a straight
line put into a gap are none: with them contacts were 3.5 times as far off as stated.
Nor are frames of another foot's marker: 8 times. Nor are spikes, single frames far off
those beside them, which also bend the law that other feet share. All are left out, so
that the contact is timed from what was seen, or not at all.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.landings.contacts.noise import height_noise

#: Fourth difference of a coordinate, as a share of its usual one, below which a frame
#: and the two on either side lie on one cubic. In noise a frame has three such
#: coordinates by chance once in two million.
#: Unit: 1. Origin: chosen.
ON_A_CUBIC = 0.01

#: Share of the frames on a cubic above which the whole track is smooth, as one without
#: noise or after a filter: then nothing tells filled frames from others.
#: Unit: 1. Origin: chosen.
SMOOTH_SHARE = 0.2

#: Least usual fourth difference from which on frames are told apart, for an animal of
#: 1 m: that of the least noise of cameras.
#: Unit: m. Origin: derived: 2e-5 m (`processing.NO_CAMERA_M`) times the root of 70.
LEAST_ROUGHNESS_M = 1.7e-4

#: Miss of a marker's place, by its last two frames, from which on it may have another
#: one's, for an animal of 1 m.
#: Unit: m. Origin: chosen.
FAR_OFF_M = 0.04

#: Largest ratio of the misses with names exchanged to those with the names given.
#: Unit: 1. Origin: chosen: as `recordings.quality.swaps.BETTER`.
BETTER = 0.2

#: Longest gap over which a marker's place is predicted, for an animal of 1 m.
#: Unit: s. Origin: measured. Feet of six public walkers and runners with made-up gaps
#: are never taken for exchanged up to 0.2 s, and some are at 0.3 s, half a stride.
LONGEST_GAP_S = 0.2

#: Distance of a frame from what the frames beside it allow, from which on it is a
#: spike, in standard deviations of a coordinate.
#: Unit: standard deviations. Origin: derived: white noise passes 5 in 3 of 100,000
#: frames, 6 in 8 of 10 million.
SPIKE_SIGMAS = 6.0

#: The same distance in steps from one frame to the next beside it, to which it is
#: added: what a foot does within a frame of its contact grows with its speed.
#: Unit: 1. Origin: chosen.
SPIKE_STEPS = 0.25

#: No smaller distance is a spike, for an animal of 1 m: a foot shakes at its impact.
#: Unit: m. Origin: measured: feet of two public runners shake by up to 4 mm from frame
#: to frame at 150 Hz; as `recordings.quality.surprises.LEAST_M`.
LEAST_SPIKE_M = 0.005

#: Share of the frames that are spikes above which they are the noise of the track.
#: Unit: 1. Origin: chosen.
MOST_SPIKES = 0.05

# Frames that are extrapolated at a time, which bounds the memory.
BLOCK = 10_000


def doubted(tracks: FloatArray, *, rate_hz: float, scale: float = 1.0) -> BoolArray:
    """Mark the frames (N, n) of markers (N, n, 3), m, that no camera saw there.

    They are filled, exchanged, or spikes.
    """
    kinds = kinds_of_doubt(tracks, rate_hz=rate_hz, scale=scale)
    return np.logical_or.reduce(kinds)


def kinds_of_doubt(
    tracks: FloatArray, *, rate_hz: float, scale: float = 1.0
) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Mark the frames (N, n) that are filled, those that are exchanged, and spikes."""
    of_markers = np.moveaxis(tracks, 1, 0)
    is_filled = np.stack([filled(one, scale=scale) for one in of_markers], axis=1)
    is_exchanged = exchanged(tracks, rate_hz=rate_hz, scale=scale)
    not_seen = is_filled | is_exchanged
    is_spike = np.zeros_like(is_filled)
    for marker, track in enumerate(of_markers):
        seen = _without(track, not_seen[:, marker])
        is_spike[:, marker] = spikes(seen, scale=scale)
    return is_filled, is_exchanged, is_spike


def _without(track: FloatArray, not_seen: BoolArray) -> FloatArray:
    """Return a track (N, 3) with NaN in the frames that are marked."""
    if not not_seen.any():
        return track  # no copy: long recordings fill the memory
    return np.where(not_seen[:, None], np.nan, track)


def spikes(track: FloatArray, *, scale: float = 1.0) -> BoolArray:
    """Mark the single frames of a marker (N, 3), m, that are far off all others, (N,).

    The two frames before it, the two behind it, and the two on either side each say
    where a frame should be. A bend of the path, as at a contact, lies between what they
    say; a spike lies far beyond all of it. Two spikes within two frames hide each
    other.
    """
    marked = np.zeros(len(track), dtype=bool)
    if len(track) < 5:
        return marked
    for coordinate in track.T:
        marked[2:-2] |= _far_beyond(coordinate, scale=scale)
    if marked.sum() > MOST_SPIKES * np.isfinite(track[:, 0]).sum():
        return np.zeros(len(track), dtype=bool)
    return marked


def _far_beyond(coordinate: FloatArray, *, scale: float) -> BoolArray:
    """Mark the frames of a coordinate (N,) far beyond what those beside say, (N - 4,).

    None is marked where one of the five is not seen.
    """
    two_before = coordinate[:-4]
    before = coordinate[1:-3]
    here = coordinate[2:-2]
    after = coordinate[3:-1]
    two_after = coordinate[4:]
    from_before = 2 * before - two_before
    from_behind = 2 * after - two_after
    said = np.stack([from_before, from_behind, (before + after) / 2])
    beyond_m = np.maximum(said.min(axis=0) - here, here - said.max(axis=0))
    step_m = np.maximum(np.abs(before - two_before), np.abs(two_after - after))
    noise_m = height_noise(coordinate[:, None], scale=scale)
    usual_m = SPIKE_SIGMAS * noise_m + SPIKE_STEPS * step_m
    return np.asarray(beyond_m > np.maximum(usual_m, LEAST_SPIKE_M * scale))


def filled(track: FloatArray, *, scale: float = 1.0) -> BoolArray:
    """Mark the frames of a marker (N, 3), m, that interpolate between others, (N,)."""
    marked = np.zeros(len(track), dtype=bool)
    # One coordinate at a time, since long recordings fill the memory.
    rough = [np.abs(np.diff(coordinate, 4)) for coordinate in track.T]
    known = np.logical_and.reduce([np.isfinite(one) for one in rough])
    if not known.any():
        return marked
    usual = [np.median(one[known]) for one in rough]
    if not min(usual) > LEAST_ROUGHNESS_M * scale:
        return marked
    on_cubic = known
    for one, usual_of_one in zip(rough, usual, strict=True):
        with np.errstate(invalid="ignore"):
            on_cubic = on_cubic & (one < ON_A_CUBIC * usual_of_one)
    if on_cubic.sum() > SMOOTH_SHARE * known.sum():
        return marked
    # Each difference is that of five frames. The first and the last frame of a run of
    # them were seen: the curve goes through them.
    for shift in (1, 2, 3):
        marked[shift : shift + len(on_cubic)] |= on_cubic
    return marked


def exchanged(tracks: FloatArray, *, rate_hz: float, scale: float = 1.0) -> BoolArray:
    """Mark the frames (N, n) in which markers (N, n, 3), m, have another one's name.

    Names may be exchanged from one frame to the next or while a marker is not seen. An
    exchange that is never undone may as well be the undoing of one before: the shorter
    part of the recording is marked.
    """
    marked = np.zeros(tracks.shape[:2], dtype=bool)
    if len(tracks) < 3:
        return marked
    far_m = FAR_OFF_M * scale
    longest = max(1, round(LONGEST_GAP_S * scale**0.5 * rate_hz))
    suspects = _several_far_off(tracks, far_m)
    place = tracks[suspects]
    expected = _extrapolated(tracks, suspects)
    for one, other in combinations(range(tracks.shape[1]), 2):
        pair = [one, other]
        is_exchange = _fits_crossed(place[:, pair], expected[:, pair], far_m)
        at_once = _single(suspects[is_exchange])
        in_gaps = _exchanges_in_gaps(tracks[:, pair], far_m=far_m, longest=longest)
        exchanges = sorted([*at_once, *in_gaps])
        for begin, end in _stretches(exchanges, len(tracks)):
            marked[begin:end, pair] = True
    return marked


def _fits_crossed(place: FloatArray, expected: FloatArray, far_m: float) -> BoolArray:
    """Mark the frames (K,) in which each of two markers is where the other should be.

    Parameters
    ----------
    place, expected : (K, 2, 3) array
        Where the markers are, and where they should be, m.
    far_m : float
        Miss from which on a marker may have another one's place, m.
    """
    own_miss = np.linalg.norm(place - expected, axis=2)
    crossed_miss = np.linalg.norm(place - expected[:, ::-1], axis=2)
    both_far = (own_miss > far_m).all(axis=1)
    fits_better = crossed_miss.sum(axis=1) < BETTER * own_miss.sum(axis=1)
    return np.asarray(both_far & fits_better)


def _several_far_off(tracks: FloatArray, far_m: float) -> IntArray:
    """Return the frames in which several markers are far from where they should be."""
    found = []
    for begin in range(2, len(tracks), BLOCK):
        frames = np.arange(begin, min(begin + BLOCK, len(tracks)))
        miss = np.linalg.norm(tracks[frames] - _extrapolated(tracks, frames), axis=2)
        with np.errstate(invalid="ignore"):
            is_far = miss > far_m
        found.append(frames[is_far.sum(axis=1) > 1])
    return np.concatenate(found)


def _extrapolated(tracks: FloatArray, frames: IntArray) -> FloatArray:
    """Return where the markers (N, n, 3) should be by their last two frames, m."""
    return np.asarray(2 * tracks[frames - 1] - tracks[frames - 2])


# An exchange: the last frame with one order of the names, and the first with the other.
# Between them, if there are frames, is a gap.
Exchange = tuple[int, int]


def _single(frames: IntArray) -> list[Exchange]:
    """Return the exchanges from one frame to the next.

    A step to another's place also spoils the prediction of the next frame.
    """
    first = frames[np.diff(frames, prepend=-2) > 1].tolist()
    return [(frame - 1, frame) for frame in first]


def _exchanges_in_gaps(
    pair: FloatArray, *, far_m: float, longest: int
) -> list[Exchange]:
    """Return the gaps of two markers (N, 2, 3) behind which their names are exchanged.

    Parameters
    ----------
    pair : (N, 2, 3) array
        NaN where a marker was not seen.
    far_m : float
        Miss from which on a marker may have another one's place, m.
    longest : int
        Longest gap, frames.
    """
    both_seen = np.flatnonzero(np.isfinite(pair).all(axis=(1, 2)))
    gaps = np.diff(both_seen) - 1
    is_short = (gaps > 0) & (gaps <= longest)
    last = both_seen[:-1][is_short]
    first = both_seen[1:][is_short]
    if not len(last):
        return []
    own = _misses_over_gaps(pair, pair, last, first)
    crossed = _misses_over_gaps(pair, pair[:, ::-1], last, first)
    is_far = (own > far_m).all(axis=1)
    is_better = crossed.sum(axis=1) < BETTER * own.sum(axis=1)
    found = is_far & is_better
    return list(zip(last[found].tolist(), first[found].tolist(), strict=True))


def _misses_over_gaps(
    before: FloatArray, after: FloatArray, last: IntArray, first: IntArray
) -> FloatArray:
    """Return how badly tracks before gaps continue in those behind them, (K, 2), m.

    A marker may rest in the gap, or move on as before it, as behind it, or as in
    between; the best of these counts.

    Parameters
    ----------
    before, after : (N, 2, 3) array
        Tracks that end in the frames `last` (K,), and that go on in `first` (K,).
    """
    steps = (first - last)[:, None, None]
    moved = after[first] - before[last]
    ahead = np.minimum(first + 1, len(after) - 1)
    as_before = steps * (before[last] - before[np.maximum(last - 1, 0)])
    as_behind = steps * (after[ahead] - after[first])
    between = 0.5 * (as_before + as_behind)
    ways = (np.zeros_like(moved), as_before, as_behind, between)
    misses = [np.linalg.norm(moved - way, axis=2) for way in ways]
    return np.asarray(np.fmin.reduce(misses))


def _stretches(exchanges: list[Exchange], frames: int) -> list[tuple[int, int]]:
    """Return the stretches of exchanged names, with the gaps at their ends, frames."""
    if len(exchanges) % 2 == 0:
        return _pairs(exchanges)
    # The last one is never undone.
    *undone, (last_before, first_after) = exchanges
    if not undone and last_before < frames / 2:
        return [(0, first_after)]
    return [*_pairs(undone), (last_before + 1, frames)]


def _pairs(exchanges: list[Exchange]) -> list[tuple[int, int]]:
    """Return the frames from the begin of each exchange to the end of the next."""
    stretches = []
    for one, other in zip(exchanges[::2], exchanges[1::2], strict=True):
        stretches.append((one[0] + 1, other[1]))
    return stretches
