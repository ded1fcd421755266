"""Positions that were not measured: repeated, on a straight line, or copied."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.recordings.quality.stretches import quantiles, runs

# Kinds of stretches, as in the tables.
FROZEN = "frozen"
FILLED = "filled"

#: Least number of repeats in a row that can be a fault.
#: Unit: frames. Origin: chosen.
LEAST_REPEATS = 3

#: Probability of any false alarm in a recording.
#: Unit: 1. Origin: chosen.
CHANCE = 1e-3

#: Least number of frames between seen ones that a straight line fills.
#: Unit: frames. Origin: chosen.
LEAST_STRAIGHT = 5

#: Least motion in a frame of such a line, and least deviation from it at its ends.
#: Unit: roundings. Origin: chosen.
CURVED = 5.0

#: Least number of consecutive frames that are a copy, and their least distance to the
#: frames that they repeat.
#: Unit: frames. Origin: chosen.
LEAST_COPIED = 5

#: Largest share of held frames; with more, holding is how the file was made.
#: Unit: 1. Origin: chosen.
MOST_HELD = 0.1

#: Share of the coordinates that move before and after a held frame.
#: Unit: 1. Origin: chosen.
ALL_MOVE = 0.9


@dataclass(frozen=True)
class Frozen:
    """A stretch in which a marker repeats one position or follows a straight line.

    Parameters
    ----------
    marker : str
        Name of the marker.
    start, stop : int
        First frame of the stretch, and the frame after its last.
    kind : str
        `FROZEN`, or `FILLED` if along a line.
    """

    marker: str
    start: int
    stop: int
    kind: str = FROZEN


def frozen_markers(
    positions: FloatArray,
    markers: tuple[str, ...],
    steps: Collection[tuple[int, int]] = (),
) -> tuple[Frozen, ...]:
    """Find exact repeats that are too long to be chance, or that end with a jump.

    In a coarsely rounded file, positions repeat by chance while a foot rests. The
    probability that one repeat follows another is therefore estimated from all other
    runs of the same marker.

    Parameters
    ----------
    positions : (N, M, 3) array
        Positions as in the file, not smoothed.
    markers : tuple of str
        The M names.
    steps : collection of (frame, marker)
        Gross steps relative to the frame before.
    """
    n_tests = max(len(positions) - 1, 1) * len(markers)
    found = []
    for m, name in enumerate(markers):
        # Step k is from frame k to frame k + 1, so steps start to stop - 1 hold the
        # position of the frames start to stop.
        is_repeat = np.all(np.diff(positions[:, m], axis=0) == 0, axis=1)
        stretches = runs(is_repeat)
        too_long = _too_long(stretches, n_tests)
        for stretch, is_too_long in zip(stretches, too_long, strict=True):
            start, stop = stretch.tolist()
            if stop - start < LEAST_REPEATS:
                continue
            jumps = (start, m) in steps or (stop + 1, m) in steps
            if is_too_long or jumps:
                found.append(Frozen(name, start, stop + 1))
    return tuple(found)


def _too_long(stretches: IntArray, n_tests: int) -> BoolArray:
    """Tell which runs of repeats, (K,), are too long in view of the other runs."""
    length = stretches[:, 1] - stretches[:, 0]
    # The run in question is not among the others, and goes on itself.
    n_others = max(len(length) - 1, 1)
    n_others_go_on = np.sum(length > 1) - 1
    chance_to_go_on = np.clip(n_others_go_on / n_others, 1e-9, 1 - 1e-9)
    # By chance a run has n repeats with the probability chance_to_go_on**(n - 1); of
    # the longest that is CHANCE / n_tests.
    longest = 1 + np.log(CHANCE / n_tests) / np.log(chance_to_go_on)
    return np.asarray((length >= LEAST_REPEATS) & (length > longest))


def straight_stretches(
    positions: FloatArray, markers: tuple[str, ...]
) -> tuple[Frozen, ...]:
    """Find gaps that were filled: a marker follows a straight line to within rounding.

    Second differences are zero in all axes within them, but not before and after.

    Parameters
    ----------
    positions : (N, M, 3) array
        Positions as in the file.
    markers : tuple of str
        The M names.
    """
    found = []
    for name, track in zip(markers, np.moveaxis(positions, 1, 0), strict=True):
        rounding = _rounding(track)
        # One axis at a time, so that ten million frames fit into memory.
        axes = track.T[..., None]
        usual_bends = [quantiles(_differences(x, 2), [0.5])[0, 0] for x in axes]
        if not max(usual_bends) > CURVED * rounding:
            continue
        along_axes = [_differences(x, 2)[:, 0] <= rounding for x in axes]
        is_straight = np.logical_and.reduce(along_axes)
        # Second difference k is of the frames k, k + 1 and k + 2, so of a filled gap
        # the first stands at the last frame that was seen, `start`.
        for start, stop in runs(is_straight).tolist():
            if stop - start < LEAST_STRAIGHT:
                continue
            step = np.abs(track[stop] - track[start]).max() / (stop - start)
            before = _bend_at(track, max(start - 1, 0))
            after = _bend_at(track, stop)
            if min(step, before, after) > CURVED * rounding:
                found.append(Frozen(name, start + 1, stop + 1, FILLED))
    return tuple(found)


def _rounding(track: FloatArray) -> float:
    """Return the largest second difference that rounding makes of a line, (N, 3)."""
    digit = np.inf
    for x in track.T[..., None]:
        steps = _differences(x, 1)
        digit = min(digit, np.min(steps, initial=np.inf, where=steps > 0))
    largest = np.nanmax(np.abs(track), initial=0)
    # A second difference x0 - 2 x1 + x2 has four times the error of a number, which is
    # half a digit, and what single precision leaves of the largest.
    of_digits = 4 * (digit / 2)
    of_single_precision = 4 * np.finfo(np.float32).eps * largest
    return float(of_digits + of_single_precision)


def _differences(track: FloatArray, order: int) -> FloatArray:
    return np.abs(np.diff(track, order, axis=0))


def _bend_at(track: FloatArray, start: int) -> float:
    """Return the largest second difference of the three frames from `start` on."""
    return float(_differences(track[start : start + 3], 2).max(initial=0))


def copied_frames(positions: FloatArray) -> IntArray:
    """Find blocks of frames of (N, M, 3) positions that are copies of earlier ones.

    Returns
    -------
    (K, 3) array
        First frame, the frame after the last, and the first frame of the original.
    """
    # To how many frames earlier each frame is equal; 0 if it is new.
    lag = _lags_to_equal_frames(_digests(positions))
    copied = []
    for start, stop in runs(lag >= LEAST_COPIED):
        is_one_block = not np.ptp(lag[start:stop])
        if stop - start >= LEAST_COPIED and is_one_block:
            copied.append((start, stop, start - lag[start]))
    copied += [(start, stop, start - 1) for start, stop in held_frames(positions)]
    return np.array(copied, dtype=np.int64).reshape(-1, 3)


def _digests(positions: FloatArray) -> FloatArray:
    """Return a number for each frame, (N,), that equal frames have in common."""
    tracks = []
    for marker in np.moveaxis(positions, 0, 2):
        tracks += list(marker)
    weights = np.random.default_rng(0).uniform(1.0, 2.0, len(tracks))
    digest = np.zeros(len(positions))
    for weight, track in zip(weights, tracks, strict=True):
        digest += weight * np.nan_to_num(track)
    return digest


def _lags_to_equal_frames(digest: FloatArray) -> IntArray:
    """Return how many frames before each one the last equal one is, (N,); 0 if none."""
    # Stable sorting leaves equal frames beside each other in the order of time.
    by_digest = np.argsort(digest, kind="stable")
    first = np.flatnonzero(np.diff(digest[by_digest]) == 0)
    earlier = by_digest[first]
    later = by_digest[first + 1]
    lag = np.zeros(len(digest), dtype=np.int64)
    lag[later] = later - earlier
    return lag


def held_frames(positions: FloatArray) -> list[tuple[int, int]]:
    """Find frames of (N, M, 3) that repeat the one before while all moves around them.

    They were not measured: a system that has lost its cameras may repeat its last
    frame. None are found where so many are held that the file was made so.

    Returns
    -------
    list of (start, stop)
        First frame that repeats, and the frame after the last.
    """
    same = np.ones(max(len(positions) - 1, 0), dtype=bool)
    for track in np.moveaxis(positions, 1, 0):
        for x in track.T:
            both_unseen = np.isnan(x[1:]) & np.isnan(x[:-1])
            same &= (x[1:] == x[:-1]) | both_unseen
    found = []
    for before, last in runs(same).tolist():
        start, stop = before + 1, last + 1
        if start > 1 and stop < len(positions) and _is_held(positions, start, stop):
            found.append((start, stop))
    if len(found) < MOST_HELD * len(positions):
        return found
    return []


def _is_held(positions: FloatArray, start: int, stop: int) -> bool:
    """Tell whether frames repeat the one before while all moves before and after."""
    if not np.isfinite(positions[start]).any():
        return False
    moves = positions[[start - 1, stop]] != positions[[start - 2, start]]
    return bool(np.mean(moves) > ALL_MOVE)
