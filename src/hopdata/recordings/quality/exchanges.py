"""Frames at which markers go on from one another's places instead of their own."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.recordings.quality.gaps import seen
from hopdata.recordings.quality.one_sided import Surprises

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

BETTER = 0.2  # the exchanged places must fit better than the own ones by this factor
BLOCK = 10_000  # frames looked at together
LONGEST_GAP_S = 0.5  # after a longer one nobody can tell where a marker should be


@dataclass(frozen=True)
class Exchange:
    """Markers that go on from one another's places.

    Parameters
    ----------
    cycle : tuple of int
        Indices; each goes on from the place of the next, the last from that of the first.
    frame : int
        First frame of the exchanged names, from 0.
    """

    cycle: tuple[int, ...]
    frame: int


def exchanges(positions: FloatArray, missed: Surprises, *, rate_hz: float) -> list[Exchange]:
    """Test every frame at which a marker jumps or comes back from a gap.

    Parameters
    ----------
    positions : (N, M, 3) array
        NaN where a marker was not seen.
    missed : Surprises
        Of the same positions.
    rate_hz : float
        Frame rate, Hz.
    """
    is_seen, is_spike = seen(positions), missed.is_spike
    moved = missed.is_step
    moved[1:] |= is_seen[1:] & ~is_seen[:-1]
    moved[1:] |= is_spike[1:] != is_spike[:-1]
    moved |= _steps_beside_gaps(positions, is_seen, missed.limit)
    moved &= is_seen
    longest = max(1, round(LONGEST_GAP_S * rate_hz))
    frames = np.flatnonzero(np.count_nonzero(moved, axis=1) > 1)
    last = _last_seen(is_seen, frames)
    found: list[Exchange] = []
    for begin in range(0, len(frames), BLOCK):
        at, ends = frames[begin : begin + BLOCK], last[begin : begin + BLOCK]
        taking = moved[at] & (ends >= 0) & (at[:, None] - ends <= longest)
        way = positions[at] - positions[ends, np.arange(ends.shape[1])]
        far = taking & (np.linalg.norm(way, axis=2) > missed.limit)
        for k in np.flatnonzero(np.count_nonzero(far, axis=1) > 1):  # else all are at home
            for cycle in _cycles_at(int(at[k]), positions, taking[k], ends[k], missed.limit):
                found.append(Exchange(cycle, int(at[k])))
    return found


def _steps_beside_gaps(positions: FloatArray, is_seen: BoolArray, limit: FloatArray) -> BoolArray:
    """Find steps (N, M) where the three frames that a parabola needs are not seen on one side."""
    whole = is_seen.copy()
    for shift in range(1, 4):
        whole[shift:] &= is_seen[:-shift]
        whole[:-shift] &= is_seen[shift:]
    whole[:3] = whole[-3:] = False
    steps = np.zeros_like(is_seen)
    for m, track in enumerate(np.moveaxis(positions, 1, 0)):
        beside = np.flatnonzero(~whole[2:, m] & is_seen[2:, m])
        bend = np.diff([track[beside + k] for k in range(3)], 2, axis=0)[0]
        steps[2 + beside, m] = np.linalg.norm(bend, axis=1) > 2 * limit[m]
    return steps


def _last_seen(is_seen: BoolArray, frames: IntArray) -> IntArray:
    """Frame at which each marker was last seen before each of the frames (K,), (K, M); -1: never.

    The first frame has none before it.
    """
    last = np.full((len(frames), is_seen.shape[1]), -1, dtype=np.int64)
    later = frames > 0
    for m in range(is_seen.shape[1]):
        number = np.where(is_seen[:, m], np.arange(len(is_seen)), -1)
        last[later, m] = np.maximum.accumulate(number)[frames[later] - 1]
    return last


def _cycles_at(
    frame: int,
    positions: FloatArray,
    is_taking: BoolArray,
    last: IntArray,
    limit: FloatArray,
) -> Iterator[tuple[int, ...]]:
    """Yield the circles of markers that fit one another's tracks at a frame.

    Those that may take a track over (M,) were last seen in the frames `last` (M,).
    """
    from scipy.optimize import linear_sum_assignment

    taking = np.flatnonzero(is_taking)
    cost = _misses(frame, positions, taking, last)
    rows, columns = linear_sum_assignment(cost)
    own = np.diag(cost)
    goes_to = dict(zip(taking[rows].tolist(), taking[columns].tolist(), strict=True))
    miss = dict(zip(taking.tolist(), cost[rows, columns].tolist(), strict=True))
    at_home = dict(zip(taking.tolist(), own.tolist(), strict=True))
    for cycle in _cycles(goes_to):
        gross = all(at_home[m] > limit[m] for m in cycle)
        if gross and sum(miss[m] for m in cycle) < BETTER * sum(at_home[m] for m in cycle):
            yield cycle


def _misses(frame: int, positions: FloatArray, taking: IntArray, last: IntArray) -> FloatArray:
    """How far each marker (row) is from where each track (column) should be, (K, K).

    A track goes on as it did, or as the marker that takes it over goes on, or with all others
    that were seen at both ends of a gap: whatever fits best, in the same way for all pairs.
    """
    here = positions[frame, taking]
    ends = last[taking]
    place = positions[ends, taking]
    steps = (frame - ends)[:, None]
    before = np.where(ends[:, None] > 0, place - positions[ends - 1, taking], np.nan) * steps
    after = np.full_like(place, np.nan)
    if frame + 1 < len(positions):
        after = positions[frame + 1, taking] - here
    still = np.zeros_like(place)
    moves = {end: _common_move(positions, end, frame, taking) for end in set(ends.tolist())}
    common = np.stack([moves[end] for end in ends.tolist()])
    guesses = [
        place[None] + still[None],
        place[None] + before[None],
        place[None] + after[:, None] * steps[None],
        place[None] + common[None],
    ]
    misses = [np.linalg.norm(here[:, None] - guess, axis=2) for guess in guesses]
    result: FloatArray = np.nanmin(misses, axis=0)
    return result


def _common_move(positions: FloatArray, start: int, stop: int, without: IntArray) -> FloatArray:
    """Median displacement of all other markers between two frames, (3,); 0 if none was seen."""
    move = positions[stop] - positions[start]
    move[without] = np.nan
    move = move[np.isfinite(move).all(axis=1)]
    return np.median(move, axis=0) if len(move) else np.zeros(3)


def _cycles(goes_to: dict[int, int]) -> Iterator[tuple[int, ...]]:
    """Yield the circles of a permutation that are longer than one."""
    left = set(goes_to)
    while left:
        first = min(left)
        cycle = [first]
        while (following := goes_to[cycle[-1]]) != first:
            cycle.append(following)
        left -= set(cycle)
        if len(cycle) > 1:
            yield tuple(cycle)
