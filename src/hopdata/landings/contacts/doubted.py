"""Frames of a foot that no camera saw where they stand: filled gaps, exchanged names.

A fit takes each frame for a measurement of its own. Frames that a spline or a straight
line put into a gap are none: with them contacts were 3.5 times as far off as stated.
Nor are frames of another foot's marker: 8 times. Both are left out, so that the contact
is timed from what was seen, or not at all.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray

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

# Frames that are extrapolated at a time, which bounds the memory.
BLOCK = 10_000


def doubted(tracks: FloatArray, *, scale: float = 1.0) -> BoolArray:
    """Mark the frames (N, n) of markers (N, n, 3), m, that are filled or exchanged."""
    found = np.stack(
        [filled(track, scale=scale) for track in np.moveaxis(tracks, 1, 0)], axis=1
    )
    return np.asarray(found | exchanged(tracks, scale=scale))


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


def exchanged(tracks: FloatArray, *, scale: float = 1.0) -> BoolArray:
    """Mark the frames (N, n) in which markers (N, n, 3), m, have another one's name.

    An exchange that is never undone may as well be the undoing of one before: the
    shorter part of the recording is marked.
    """
    marked = np.zeros(tracks.shape[:2], dtype=bool)
    if len(tracks) < 3:
        return marked
    frames = _several_far_off(tracks, FAR_OFF_M * scale)
    place = tracks[frames]
    expected = _extrapolated(tracks, frames)
    miss = np.linalg.norm(place - expected, axis=2)
    is_far = miss > FAR_OFF_M * scale
    for one, other in combinations(range(tracks.shape[1]), 2):
        both = is_far[:, one] & is_far[:, other]
        crossed = np.linalg.norm(place[both, one] - expected[both, other], axis=1)
        crossed += np.linalg.norm(place[both, other] - expected[both, one], axis=1)
        better = crossed < BETTER * (miss[both, one] + miss[both, other])
        for begin, end in _stretches(frames[both][better], len(tracks)):
            marked[begin:end, [one, other]] = True
    return marked


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


def _stretches(exchanges: IntArray, frames: int) -> list[tuple[int, int]]:
    """Return the stretches of exchanged names between the exchanges, frames."""
    # A step to another's place and the next frame, whose prediction it spoils.
    single = exchanges[np.diff(exchanges, prepend=-2) > 1].tolist()
    if len(single) % 2:
        last = single.pop()
        if last < frames / 2 and not single:
            return [(0, last)]
        return [*_pairs(single), (last, frames)]
    return _pairs(single)


def _pairs(exchanges: list[int]) -> list[tuple[int, int]]:
    return list(zip(exchanges[::2], exchanges[1::2], strict=True))
