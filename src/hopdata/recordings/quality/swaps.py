"""Markers whose names were exchanged: found by where each goes on, and by pair distances."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.recordings.quality.rigid import Cluster, PairDistances, exchanged_stretches
from hopdata.recordings.quality.spikes import Surprises
from hopdata.recordings.quality.stretches import seen

# Frames at which markers go on from one another's places instead of their own.

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
    _, columns = linear_sum_assignment(cost)
    told = (taking[columns], np.take_along_axis(cost, columns[:, None], 1)[:, 0], np.diag(cost))
    goes_to, miss, at_home = (
        dict(zip(taking.tolist(), of_each.tolist(), strict=True)) for of_each in told
    )
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
    moves = {end: _common_move(positions, end, frame, taking) for end in set(ends.tolist())}
    common = np.stack([moves[end] for end in ends.tolist()])
    ways: list[Any] = [0.0, before[None], after[:, None] * steps[None], common[None]]
    misses = [np.linalg.norm(here[:, None] - (place[None] + way), axis=2) for way in ways]
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


CONTINUITY, DISTANCES = "continuity", "pair distances"
NEAR = 3  # frames by which the two tests may differ in when


@dataclass(frozen=True)
class Swap:
    """Markers that seem to have exchanged their names for a while.

    Parameters
    ----------
    markers : tuple of str
        Two names, or more if they went round in a circle.
    start : int
        First frame with the exchanged names, from 0.
    stop : int or None
        The frame after the last; None if the names never came back, so that either part of the
        recording may be the right one.
    found_by : tuple of str
        The tests that saw it: ``"continuity"``, ``"pair distances"``.
    """

    markers: tuple[str, ...]
    start: int
    stop: int | None
    found_by: tuple[str, ...]


def find_swaps(
    positions: FloatArray,
    markers: tuple[str, ...],
    *,
    missed: Surprises,
    pairs: PairDistances,
    clusters: tuple[Cluster, ...],
    rate_hz: float,
) -> tuple[Swap, ...]:
    """Find exchanged markers by both tests.

    Parameters
    ----------
    positions : (N, M, 3) array
        NaN where a marker was not seen.
    markers : tuple of str
        The M names.
    missed : Surprises
        Of the same positions.
    pairs, clusters
        Distances and rigid clusters of the same positions.
    rate_hz : float
        Frame rate, Hz.
    """
    by_track = _paired(exchanges(positions, missed, rate_hz=rate_hz), markers)
    breaks = missed.is_step | missed.is_spike | ~seen(positions)
    by_distance = [
        Swap((markers[a], markers[b]), start, stop if stop < len(positions) else None, (DISTANCES,))
        for a, b, start, stop in exchanged_stretches(positions, pairs, clusters, breaks=breaks)
    ]
    swaps = _merged(by_track, by_distance, max(1, round(LONGEST_GAP_S * rate_hz)))
    return tuple(sorted(swaps, key=lambda s: (s.start, s.markers)))


def explained_frames(swaps: Iterable[Swap], markers: tuple[str, ...], n_frames: int) -> BoolArray:
    """Mask (N, M) of the frames beside the ends of a swap, whose jumps it explains."""
    mask = np.zeros((n_frames, len(markers)), dtype=bool)
    for swap in swaps:
        stop = n_frames if swap.stop is None else swap.stop
        for name in swap.markers:
            column = mask[:, markers.index(name)]
            for frame in {swap.start, stop}:
                column[max(0, frame - NEAR) : frame + NEAR] = True
            if stop - swap.start <= NEAR:
                column[swap.start : stop] = True
    return mask


def _paired(found: Iterable[Exchange], markers: tuple[str, ...]) -> list[Swap]:
    """Join an exchange and the next one of the same markers, which undoes it."""
    swaps: list[Swap] = []
    waiting: dict[frozenset[int], int] = {}
    for exchange in found:
        key = frozenset(exchange.cycle)
        if key in waiting:
            at = waiting.pop(key)
            swaps[at] = replace(swaps[at], stop=exchange.frame)
        else:
            waiting[key] = len(swaps)
            names = tuple(markers[m] for m in exchange.cycle)
            swaps.append(Swap(names, exchange.frame, None, (CONTINUITY,)))
    return swaps


def _merged(by_track: list[Swap], by_distance: list[Swap], longest: int) -> list[Swap]:
    """Say of each swap who found it; both where they agree on the markers and overlap.

    An exchange that nothing undoes may itself undo one that only the distances show, and that ends
    in the gap (of `longest` frames at most) before it.
    """
    merged = list(by_track)
    for late in by_distance:
        for i, swap in enumerate(merged):
            same = set(swap.markers) == set(late.markers)
            if same and _undoes(swap, late, longest):
                both = late.found_by + swap.found_by
                merged[i] = replace(late, stop=swap.start, found_by=both)
                break
            if same and _overlap(swap, late):
                both = tuple(dict.fromkeys(swap.found_by + late.found_by))
                stop = swap.stop if swap.stop is not None else late.stop
                merged[i] = replace(swap, stop=stop, found_by=both)
                break
            if set(late.markers) < set(swap.markers) and _overlap(swap, late):
                break  # a part of a longer circle
        else:
            merged.append(late)
    return merged


def _undoes(swap: Swap, late: Swap, longest: int) -> bool:
    if swap.stop is not None or late.stop is None:
        return False
    return late.start < swap.start <= late.stop + longest


def _overlap(one: Swap, other: Swap) -> bool:
    ends = [np.inf if swap.stop is None else swap.stop for swap in (one, other)]
    return one.start < ends[1] + NEAR and other.start < ends[0] + NEAR
