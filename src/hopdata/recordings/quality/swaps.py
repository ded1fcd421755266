"""Find markers that exchange names, by their tracks and by their distances."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.recordings.quality.exchanged_distances import exchanged_stretches
from hopdata.recordings.quality.rigid import Cluster, PairDistances
from hopdata.recordings.quality.stretches import near, seen
from hopdata.recordings.quality.surprises import Surprises

#: Largest ratio of the misfit of exchanged places to that of own places.
#: Unit: 1. Origin: chosen.
BETTER = 0.2

#: Longest gap after which a marker's place can be predicted, for an animal of 1 m.
#: Unit: s. Origin: chosen.
LONGEST_GAP_S = 0.5

#: Bend beside a gap from which on it is a step, as a multiple of the marker's limit.
#: Unit: 1. Origin: chosen.
BEND_BESIDE_GAP = 2

#: Frames by which the two tests may differ on the time of one exchange.
#: Unit: frames. Origin: chosen.
NEAR = 3

# Frames processed together.
BLOCK = 10_000

# The tests that find swaps.
CONTINUITY = "continuity"
DISTANCES = "pair distances"


@dataclass(frozen=True)
class Swap:
    """Markers that seem to exchange names for a while.

    Parameters
    ----------
    markers : tuple of str
        Two names, or more if they are exchanged in a cycle.
    start : int
        First frame with the exchanged names, from 0.
    stop : int or None
        The frame after the last. None if the names are never restored; either part of
        the recording may then be the correct one.
    found_by : tuple of str
        The tests that found it: `CONTINUITY`, `DISTANCES`.
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
        Misses of the same positions.
    pairs, clusters
        Distances and rigid clusters of the same positions.
    rate_hz : float
        Frame rate, Hz.
    """
    by_track = _paired(exchanges(positions, missed, rate_hz=rate_hz), markers)
    breaks = missed.is_step | missed.is_spike | ~seen(positions)
    by_distance = []
    for a, b, start, stop in exchanged_stretches(
        positions, pairs, clusters, breaks=breaks
    ):
        until = stop if stop < len(positions) else None
        by_distance.append(Swap((markers[a], markers[b]), start, until, (DISTANCES,)))
    swaps = _merged(by_track, by_distance, _longest_gap(rate_hz))
    return tuple(sorted(swaps, key=lambda swap: (swap.start, swap.markers)))


def _longest_gap(rate_hz: float) -> int:
    """Return the longest gap after which a place can be predicted, frames."""
    return max(1, round(LONGEST_GAP_S * rate_hz))


# By tracks: frames at which markers continue from one another's places instead of
# their own.


def exchanges(
    positions: FloatArray, missed: Surprises, *, rate_hz: float
) -> Iterator[tuple[tuple[int, ...], int]]:
    """Test every frame at which a marker jumps or returns from a gap.

    Yields marker indices and the first frame of the exchanged names, from 0. Each
    marker continues from the place of the next, and the last from that of the first.

    Parameters
    ----------
    positions : (N, M, 3) array
        NaN where a marker was not seen.
    missed : Surprises
        Misses of the same positions.
    rate_hz : float
        Frame rate, Hz.
    """
    is_seen = seen(positions)
    moved = _moved(positions, is_seen, missed)
    longest = _longest_gap(rate_hz)
    frames = np.flatnonzero(np.count_nonzero(moved, axis=1) > 1)
    last = _last_seen(is_seen, frames)
    for begin in range(0, len(frames), BLOCK):
        at = frames[begin : begin + BLOCK]
        ends = last[begin : begin + BLOCK]
        taking = moved[at] & (ends >= 0) & (at[:, None] - ends <= longest)
        way = positions[at] - positions[ends, np.arange(ends.shape[1])]
        far = taking & (np.linalg.norm(way, axis=2) > missed.limit)
        out_of_place = np.count_nonzero(far, axis=1) > 1
        for k in np.flatnonzero(out_of_place):
            frame = int(at[k])
            for cycle in _cycles_at(frame, positions, taking[k], ends[k], missed.limit):
                yield cycle, frame


def _moved(positions: FloatArray, is_seen: BoolArray, missed: Surprises) -> BoolArray:
    """Mark frames in which a seen marker jumps or returns from a gap, (N, M)."""
    is_spike = missed.is_spike
    moved = missed.is_step
    moved[1:] |= is_seen[1:] & ~is_seen[:-1]
    moved[1:] |= is_spike[1:] != is_spike[:-1]
    moved |= _steps_beside_gaps(positions, is_seen, missed.limit)
    moved &= is_seen
    return moved


def _steps_beside_gaps(
    positions: FloatArray, is_seen: BoolArray, limit: FloatArray
) -> BoolArray:
    """Find steps (N, M) where one side lacks the three frames that a parabola needs."""
    whole = ~near(~is_seen, 3)
    whole[:3] = False
    whole[-3:] = False
    steps = np.zeros_like(is_seen)
    for m, track in enumerate(np.moveaxis(positions, 1, 0)):
        first = np.flatnonzero(~whole[2:, m] & is_seen[2:, m])
        three = [track[first + k] for k in range(3)]
        bend = np.diff(three, 2, axis=0)[0]
        is_gross = np.linalg.norm(bend, axis=1) > BEND_BESIDE_GAP * limit[m]
        steps[2 + first, m] = is_gross
    return steps


def _last_seen(is_seen: BoolArray, frames: IntArray) -> IntArray:
    """Return each marker's last seen frame before each of the frames (K,), (K, M).

    It is -1 if there is none; nothing precedes the first frame.
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
    """Yield cycles of markers that fit one another's tracks at a frame.

    Candidates to take over a track (M,) were last seen in the frames `last` (M,).
    """
    from scipy.optimize import linear_sum_assignment

    taking = np.flatnonzero(is_taking)
    cost = _misses(frame, positions, taking, last)
    rows, goes_to = linear_sum_assignment(cost)
    exchanged = cost[rows, goes_to]
    at_home = np.diag(cost)
    for cycle in _cycles(goes_to.tolist()):
        are_gross = (at_home[cycle] > limit[taking[cycle]]).all()
        if are_gross and exchanged[cycle].sum() < BETTER * at_home[cycle].sum():
            yield tuple(taking[cycle].tolist())


def _misses(
    frame: int, positions: FloatArray, taking: IntArray, last: IntArray
) -> FloatArray:
    """Return how far each marker (row) is from where each track (column) leads, (K, K).

    A track may continue on its own, like the marker that takes it over, or with all
    others that are seen at both ends of a gap. The best fit is used, in the same way
    for all pairs.
    """
    here = positions[frame, taking]
    ends = last[taking]
    place = positions[ends, taking]
    steps = (frame - ends)[:, None]
    last_step = place - positions[ends - 1, taking]
    before = np.where(ends[:, None] > 0, last_step, np.nan) * steps
    after = np.full_like(place, np.nan)
    if frame + 1 < len(positions):
        after = positions[frame + 1, taking] - here
    moves = {
        end: _common_move(positions, end, frame, taking) for end in set(ends.tolist())
    }
    common = np.stack([moves[end] for end in ends.tolist()])
    ways: list[Any] = [
        0.0,  # at rest
        before[None],
        after[:, None] * steps[None],
        common[None],
    ]
    misses = []
    for way in ways:
        misses.append(np.linalg.norm(here[:, None] - (place[None] + way), axis=2))
    return np.asarray(np.nanmin(misses, axis=0))


def _common_move(
    positions: FloatArray, start: int, stop: int, without: IntArray
) -> FloatArray:
    """Return the median displacement of other markers between two frames, (3,).

    It is 0 if there are none.
    """
    move = positions[stop] - positions[start]
    move[without] = np.nan
    move = move[np.isfinite(move).all(axis=1)]
    if not len(move):
        return np.zeros(3)
    return np.asarray(np.median(move, axis=0))


def _cycles(goes_to: list[int]) -> Iterator[list[int]]:
    """Yield the cycles of a permutation that are longer than one."""
    left = set(range(len(goes_to)))
    while left:
        first = min(left)
        cycle = [first]
        following = goes_to[first]
        while following != first:
            cycle.append(following)
            following = goes_to[following]
        left -= set(cycle)
        if len(cycle) > 1:
            yield cycle


def _paired(
    found: Iterable[tuple[tuple[int, ...], int]], markers: tuple[str, ...]
) -> list[Swap]:
    """Pair each exchange with the next one of the same markers, which undoes it."""
    swaps: list[Swap] = []
    waiting: dict[frozenset[int], int] = {}
    for cycle, frame in found:
        key = frozenset(cycle)
        if key in waiting:
            at = waiting.pop(key)
            swaps[at] = replace(swaps[at], stop=frame)
        else:
            waiting[key] = len(swaps)
            names = tuple(markers[m] for m in cycle)
            swaps.append(Swap(names, frame, None, (CONTINUITY,)))
    return swaps


# Swaps that both tests find.


def _merged(by_track: list[Swap], by_distance: list[Swap], longest: int) -> list[Swap]:
    """Merge the swaps found by both tests if markers agree and spans overlap.

    An exchange that nothing undoes may itself undo one that only the distances show,
    and that ends in the gap before it, of at most `longest` frames.
    """
    merged = list(by_track)
    for late in by_distance:
        for i, swap in enumerate(merged):
            is_same = set(swap.markers) == set(late.markers)
            if is_same and _undoes(swap, late, longest):
                found_by = late.found_by + swap.found_by
                merged[i] = replace(late, stop=swap.start, found_by=found_by)
                break
            if is_same and _overlap(swap, late):
                found_by = tuple(dict.fromkeys(swap.found_by + late.found_by))
                stop = swap.stop if swap.stop is not None else late.stop
                merged[i] = replace(swap, stop=stop, found_by=found_by)
                break
            is_part_of_cycle = set(late.markers) < set(swap.markers)
            if is_part_of_cycle and _overlap(swap, late):
                break
        else:
            merged.append(late)
    return merged


def _undoes(swap: Swap, earlier: Swap, longest: int) -> bool:
    """Tell whether an exchange that nothing undoes ends an earlier one."""
    if swap.stop is not None or earlier.stop is None:
        return False
    return earlier.start < swap.start <= earlier.stop + longest


def _overlap(one: Swap, other: Swap) -> bool:
    return one.start < _end(other) + NEAR and other.start < _end(one) + NEAR


def _end(swap: Swap) -> float:
    if swap.stop is None:
        return np.inf
    return swap.stop
