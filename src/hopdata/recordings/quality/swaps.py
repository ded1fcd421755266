"""Find markers that spike, jump to another place or exchange names."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.recordings.quality.rigid import (
    Cluster,
    PairDistances,
    exchanged_stretches,
    norms,
)
from hopdata.recordings.quality.stretches import lowest, near, seen

# # Deviations of positions from predictions by the frames before and by those after.
#
# A contact bends a track, but one of the two sides still predicts every frame. Neither
# side predicts a spike. At a step, both sides miss in the same direction.

LONGEST_SPIKE = 3  # frames
# A miss is gross above the marker's own 99.9 % quantile. The limit is higher for a
# heavier tail (99.9 % over 99 % quantile), since noise has a light tail and hard
# impacts a heavy one. All in units of quantiles.
OF_MEDIAN, OF_99, OF_999, TAIL_POWER = 5.0, 10.0, 3.0, 4
LEAST_M = 0.005
MOST_FRAMES = 200_000  # evenly spaced frames used for limits in a longer recording
AHEAD = (
    1.0,
    3.0,
    6.0,
)  # miss of a parabola one to three frames ahead, in third differences
# The middle of three displaced frames seems displaced twice as far by itself. A longer
# excursion therefore outranks a shorter one within it from this share of its size on.
OF_SHORTER = 0.4


@dataclass(frozen=True)
class Excursion:
    """Consecutive frames in which a marker is displaced.

    Parameters
    ----------
    marker : int
        Index of the marker.
    start, stop : int
        First frame and the frame after the last.
    size : float
        Least displacement, m.
    """

    marker: int
    start: int
    stop: int
    size: float


@dataclass(frozen=True)
class Surprises:
    """Gross misses of the one-sided predictions.

    Parameters
    ----------
    spikes : tuple of Excursion
        Spikes that no larger one nearby explains.
    steps : tuple of Excursion
        Gross steps from the frame before, on which both sides agree; `stop` is the
        frame after.
    limit : (M,) array
        Least size of a gross step of each marker, m.
    n_frames : int
        Number of frames of the recording.
    """

    spikes: tuple[Excursion, ...]
    steps: tuple[Excursion, ...]
    limit: FloatArray
    n_frames: int

    @property
    def is_step(self) -> BoolArray:
        """Mask gross steps of markers from the frame before, (N, M)."""
        return self._mask(self.steps)

    @property
    def is_spike(self) -> BoolArray:
        """Mask frames in which a marker is in a spike, (N, M)."""
        return self._mask(self.spikes)

    def _mask(self, excursions: tuple[Excursion, ...]) -> BoolArray:
        mask = np.zeros((self.n_frames, len(self.limit)), dtype=bool)
        for e in excursions:
            mask[e.start : e.stop, e.marker] = True
        return mask


def surprises(positions: FloatArray, *, scale: float = 1.0) -> Surprises:
    """Compare (N, M, 3) positions, m, with parabolas through three frames on either side.

    No miss below `LEAST_M` times the scale (`hopdata.recording.scale_of`) is gross.
    """
    n_frames, n_markers = positions.shape[:2]
    limit = np.full(n_markers, np.inf)
    spikes: list[Excursion] = []
    steps: list[Excursion] = []
    for m in range(n_markers):
        third = np.diff(
            positions[:, m], 3, axis=0
        )  # [k]: frame k + 3 relative to the three before
        if len(third) > 3:
            found, limit[m] = _spikes(third, m, LEAST_M * scale)
            spikes += found
            steps += _steps(third, m, limit[m])
    return Surprises(
        _separate(spikes, (n_frames, n_markers)), _in_order(steps), limit, n_frames
    )


def _spikes(third: FloatArray, m: int, least_m: float) -> tuple[list[Excursion], float]:
    """Return excursions of one marker from third differences (N - 3, 3), and its one-frame limit.

    An excursion is no larger than the miss of its first frame as predicted from before,
    so only frames with a gross miss are examined. The limits come from at most
    `MOST_FRAMES` frames.
    """
    n_frames = len(third) + 3
    usual = np.arange(3, n_frames - 3, -(-n_frames // MOST_FRAMES))
    around = _around(third, usual)
    limits = {
        length: _limit(
            _excursions(around[:, usual <= n_frames - length - 3], length), least_m
        )
        for length in range(LONGEST_SPIKE, 0, -1)
    }
    gross = np.flatnonzero(norms(third) >= min(limits.values())) + 3
    around = _around(third, gross)
    covered = np.zeros(n_frames)  # sizes of longer excursions
    found: list[Excursion] = []
    for length, limit in limits.items():
        sizes = _excursions(around[:, gross <= n_frames - length - 3], length)
        for k in np.flatnonzero(sizes > limit).tolist():
            start, size = int(gross[k]), float(sizes[k])
            if covered[start : start + length].min() < OF_SHORTER * size:
                found.append(Excursion(m, start, start + length, size))
        for e in found:
            np.maximum(covered[e.start : e.stop], e.size, out=covered[e.start : e.stop])
    return found, limits[1]


def _around(third: FloatArray, frames: IntArray) -> FloatArray:
    """Return the third differences that judge up to three frames from each frame (K,) on.

    Shape (6, K, 3): as seen from the left, then from the right.
    """
    places = frames + np.arange(-LONGEST_SPIKE, LONGEST_SPIKE)[:, None]
    return third[np.minimum(places, len(third) - 1)]


def _in_order(excursions: list[Excursion]) -> tuple[Excursion, ...]:
    return tuple(sorted(excursions, key=lambda e: (e.start, e.marker)))


def _separate(found: list[Excursion], shape: tuple[int, ...]) -> tuple[Excursion, ...]:
    """Keep the largest, and those without a larger one within three frames on either side."""
    taken = np.zeros(shape[:2], dtype=bool)
    kept = []
    for spike in sorted(found, key=lambda e: (-e.size, e.marker, e.start)):
        if not taken[max(0, spike.start - 3) : spike.stop + 3, spike.marker].any():
            taken[spike.start : spike.stop, spike.marker] = True
            kept.append(spike)
    return _in_order(kept)


def _excursions(around: FloatArray, length: int) -> FloatArray:
    """Return the displacement of `length` frames in a row by both sides; (6, K, 3) to (K,).

    This is the smallest of the frames' displacements. A parabola through three frames
    misses the next one by a third difference, and later ones by sums of these with the
    weights 1, 3, 6.
    """
    before, after = around[:length], around[LONGEST_SPIKE : LONGEST_SPIKE + length]
    least = np.full(around.shape[1], np.inf)
    for k in range(length):
        from_left = sum(w * t for w, t in zip(AHEAD, before[k::-1], strict=False))
        from_right = sum(-w * t for w, t in zip(AHEAD, after[k:], strict=False))
        least = np.minimum(
            least, _agreed(np.asarray(from_left), np.asarray(from_right))
        )
    return least


def _steps(third: FloatArray, m: int, limit: float) -> list[Excursion]:
    """Return gross steps of one marker on which both sides agree."""
    frames = 3 + np.flatnonzero(norms(third[:-2]) >= limit)
    sizes = _agreed(third[frames - 3], third[frames - 1])
    gross = sizes > limit
    found = zip(frames[gross].tolist(), sizes[gross].tolist(), strict=True)
    return [Excursion(m, frame, frame + 1, size) for frame, size in found]


def _agreed(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the smaller length of two vectors, or 0 if they point apart; (..., 3) to (...)."""
    length = np.minimum(norms(one), norms(other))
    return np.where(np.einsum("...i,...i->...", one, other) > 0, length, 0.0 * length)


def _limit(off: FloatArray, least_m: float) -> float:
    """Return a marker's limit, m, from its usual misses (K,); infinite if it is never seen."""
    values = off[np.isfinite(off)]
    if not len(values):
        return np.inf
    middle = np.median(values[values > 0]) if np.any(values > 0) else 0.0
    q99, q999 = np.quantile(values, [0.99, 0.999])
    tail = min(OF_999, (q999 / max(q99, 1e-12)) ** TAIL_POWER)
    return float(max(least_m, OF_MEDIAN * middle, min(OF_99 * q99, tail * q999)))


def find_spikes(
    missed: Surprises, *, explained: BoolArray, heights: FloatArray
) -> tuple[Excursion, ...]:
    """List spikes: displacements of up to three frames that are not short landings.

    Frames (N, M) explained by a swap are left out; `heights` (N, M) are in m.
    """
    low = lowest(heights) if missed.spikes else np.zeros(0)
    return tuple(
        e
        for e in missed.spikes
        if not explained[e.start : e.stop, e.marker].any()
        and not _touches(e, heights[:, e.marker], float(low[e.marker]))
    )


def _touches(spike: Excursion, heights: FloatArray, low_m: float) -> bool:
    """Tell whether a marker (N,) is lowest during a spike and higher around it: a short stance."""
    there, some = heights[spike.start : spike.stop], 0.5 * spike.size
    around = heights[[max(spike.start - 2, 0), min(spike.stop + 1, len(heights) - 1)]]
    return bool(
        (np.abs(there - low_m) < some).all() and around.min() > there.max() + some
    )


def find_jumps(missed: Surprises, *, explained: BoolArray) -> tuple[Excursion, ...]:
    """List jumps to another place that no spike and no swap explains."""
    told = explained | near(missed.is_spike, LONGEST_SPIKE)
    return tuple(e for e in missed.steps if not told[e.start, e.marker])


# Frames at which markers continue from one another's places instead of their own.

BETTER = 0.2  # largest ratio of the misfit of exchanged places to that of own places
BLOCK = 10_000  # frames processed together
LONGEST_GAP_S = 0.5  # s; after a longer gap a marker's place cannot be predicted


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
    is_seen, is_spike = seen(positions), missed.is_spike
    moved = missed.is_step
    moved[1:] |= is_seen[1:] & ~is_seen[:-1]
    moved[1:] |= is_spike[1:] != is_spike[:-1]
    moved |= _steps_beside_gaps(positions, is_seen, missed.limit)
    moved &= is_seen
    longest = max(1, round(LONGEST_GAP_S * rate_hz))
    frames = np.flatnonzero(np.count_nonzero(moved, axis=1) > 1)
    last = _last_seen(is_seen, frames)
    for begin in range(0, len(frames), BLOCK):
        at, ends = frames[begin : begin + BLOCK], last[begin : begin + BLOCK]
        taking = moved[at] & (ends >= 0) & (at[:, None] - ends <= longest)
        way = positions[at] - positions[ends, np.arange(ends.shape[1])]
        far = taking & (np.linalg.norm(way, axis=2) > missed.limit)
        for k in np.flatnonzero(
            np.count_nonzero(far, axis=1) > 1
        ):  # else all are in place
            for cycle in _cycles_at(
                int(at[k]), positions, taking[k], ends[k], missed.limit
            ):
                yield cycle, int(at[k])


def _steps_beside_gaps(
    positions: FloatArray, is_seen: BoolArray, limit: FloatArray
) -> BoolArray:
    """Find steps (N, M) where one side lacks the three frames that a parabola needs."""
    whole = ~near(~is_seen, 3)
    whole[:3] = whole[-3:] = False
    steps = np.zeros_like(is_seen)
    for m, track in enumerate(np.moveaxis(positions, 1, 0)):
        beside = np.flatnonzero(~whole[2:, m] & is_seen[2:, m])
        bend = np.diff([track[beside + k] for k in range(3)], 2, axis=0)[0]
        steps[2 + beside, m] = np.linalg.norm(bend, axis=1) > 2 * limit[m]
    return steps


def _last_seen(is_seen: BoolArray, frames: IntArray) -> IntArray:
    """Return each marker's last seen frame before each of the frames (K,), (K, M); -1: never.

    Nothing precedes the first frame.
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
    miss, at_home = cost[rows, goes_to], np.diag(cost)
    for cycle in _cycles(goes_to.tolist()):
        gross = (at_home[cycle] > limit[taking[cycle]]).all()
        if gross and miss[cycle].sum() < BETTER * at_home[cycle].sum():
            yield tuple(taking[cycle].tolist())


def _misses(
    frame: int, positions: FloatArray, taking: IntArray, last: IntArray
) -> FloatArray:
    """Return the distance of each marker (row) from the prediction of each track (column), (K, K).

    A track may continue on its own, like the marker that takes it over, or with all
    others that are seen at both ends of a gap. The best fit is used, in the same way
    for all pairs.
    """
    here = positions[frame, taking]
    ends = last[taking]
    place = positions[ends, taking]
    steps = (frame - ends)[:, None]
    before = (
        np.where(ends[:, None] > 0, place - positions[ends - 1, taking], np.nan) * steps
    )
    after = np.full_like(place, np.nan)
    if frame + 1 < len(positions):
        after = positions[frame + 1, taking] - here
    moves = {
        end: _common_move(positions, end, frame, taking) for end in set(ends.tolist())
    }
    common = np.stack([moves[end] for end in ends.tolist()])
    ways: list[Any] = [0.0, before[None], after[:, None] * steps[None], common[None]]
    misses = [
        np.linalg.norm(here[:, None] - (place[None] + way), axis=2) for way in ways
    ]
    return np.asarray(np.nanmin(misses, axis=0))


def _common_move(
    positions: FloatArray, start: int, stop: int, without: IntArray
) -> FloatArray:
    """Return the median displacement of other markers between two frames, (3,); 0 if none."""
    move = positions[stop] - positions[start]
    move[without] = np.nan
    move = move[np.isfinite(move).all(axis=1)]
    return np.median(move, axis=0) if len(move) else np.zeros(3)


def _cycles(goes_to: list[int]) -> Iterator[list[int]]:
    """Yield the cycles of a permutation that are longer than one."""
    left = set(range(len(goes_to)))
    while left:
        first = min(left)
        cycle = [first]
        while (following := goes_to[cycle[-1]]) != first:
            cycle.append(following)
        left -= set(cycle)
        if len(cycle) > 1:
            yield cycle


CONTINUITY, DISTANCES = "continuity", "pair distances"
NEAR = 3  # frames by which the two tests may differ on the time


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
        The tests that found it: ``"continuity"``, ``"pair distances"``.
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
    by_distance = [
        Swap(
            (markers[a], markers[b]),
            start,
            stop if stop < len(positions) else None,
            (DISTANCES,),
        )
        for a, b, start, stop in exchanged_stretches(
            positions, pairs, clusters, breaks=breaks
        )
    ]
    swaps = _merged(by_track, by_distance, max(1, round(LONGEST_GAP_S * rate_hz)))
    return tuple(sorted(swaps, key=lambda s: (s.start, s.markers)))


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


def _merged(by_track: list[Swap], by_distance: list[Swap], longest: int) -> list[Swap]:
    """Merge the swaps found by both tests if markers agree and spans overlap; record the tests.

    An exchange that nothing undoes may itself undo one that only the distances show,
    and that ends in the gap before it, of at most `longest` frames.
    """
    merged = list(by_track)
    for late in by_distance:
        for i, swap in enumerate(merged):
            same = set(swap.markers) == set(late.markers)
            follows = (
                late.stop is not None and late.start < swap.start <= late.stop + longest
            )
            if same and follows and swap.stop is None:
                both = late.found_by + swap.found_by
                merged[i] = replace(late, stop=swap.start, found_by=both)
                break
            if same and _overlap(swap, late):
                both = tuple(dict.fromkeys(swap.found_by + late.found_by))
                stop = swap.stop if swap.stop is not None else late.stop
                merged[i] = replace(swap, stop=stop, found_by=both)
                break
            if set(late.markers) < set(swap.markers) and _overlap(swap, late):
                break  # part of a longer cycle
        else:
            merged.append(late)
    return merged


def _overlap(one: Swap, other: Swap) -> bool:
    ends = [np.inf if swap.stop is None else swap.stop for swap in (one, other)]
    return one.start < ends[1] + NEAR and other.start < ends[0] + NEAR
