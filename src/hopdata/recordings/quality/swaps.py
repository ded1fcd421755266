"""Markers that are elsewhere for some frames, jump to another place, or exchange their names."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.recordings.quality.rigid import Cluster, PairDistances, exchanged_stretches, norms
from hopdata.recordings.quality.stretches import lowest, near, seen

# How far positions are from what the frames before them, and those after them, let expect.
#
# A contact bends a track, so one of the two sides still predicts every frame. A spike is foreseen
# by neither side; a step is a miss of both sides in one and the same direction.

LONGEST_SPIKE = 3  # frames
# A miss is gross above the marker's own 99.9 % quantile, the more so the heavier its tail (quantile
# over 99 % quantile): noise has a light one, hard impacts a heavy one. All in units of quantiles.
OF_MEDIAN, OF_99, OF_999, TAIL_POWER = 5.0, 10.0, 3.0, 4
LEAST_M = 0.005
MOST_FRAMES = 200_000  # of a longer recording, evenly spaced, what is usual is measured
AHEAD = (1.0, 3.0, 6.0)  # a parabola's miss one to three frames ahead, in third differences
# The middle of three frames that are off seems twice as far off by itself, so a longer excursion
# goes before a shorter one within it from this share of its size on.
OF_SHORTER = 0.4


@dataclass(frozen=True)
class Excursion:
    """Frames in which a marker is elsewhere.

    Parameters
    ----------
    marker : int
        Its index.
    start, stop : int
        First frame and the frame after the last.
    size : float
        How far it is off at least, m.
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
        Those that no larger one beside them explains.
    steps : tuple of Excursion
        Gross steps from the frame before, as both sides see them; `stop` is the frame after.
    limit : (M,) array
        Above this a step is gross for the marker, m.
    n_frames : int
        Frames of the recording.
    """

    spikes: tuple[Excursion, ...]
    steps: tuple[Excursion, ...]
    limit: FloatArray
    n_frames: int

    @property
    def is_step(self) -> BoolArray:
        """Where a marker makes a gross step from the frame before, (N, M)."""
        return self._mask(self.steps)

    @property
    def is_spike(self) -> BoolArray:
        """Where a marker is in a spike, (N, M)."""
        return self._mask(self.spikes)

    def _mask(self, excursions: tuple[Excursion, ...]) -> BoolArray:
        mask = np.zeros((self.n_frames, len(self.limit)), dtype=bool)
        for e in excursions:
            mask[e.start : e.stop, e.marker] = True
        return mask


def surprises(positions: FloatArray, *, scale: float = 1.0) -> Surprises:
    """Compare (N, M, 3) positions, m, with parabolas through three frames on either side.

    No miss is gross below `LEAST_M` times the scale (`hopdata.recording.scale_of`).
    """
    n_frames, n_markers = positions.shape[:2]
    limit = np.full(n_markers, np.inf)
    spikes: list[Excursion] = []
    steps: list[Excursion] = []
    for m in range(n_markers):
        third = np.diff(positions[:, m], 3, axis=0)  # [k]: frame k + 3 less the three before
        if len(third) > 3:
            found, limit[m] = _spikes(third, m, LEAST_M * scale)
            spikes += found
            steps += _steps(third, m, limit[m])
    return Surprises(_separate(spikes, (n_frames, n_markers)), _in_order(steps), limit, n_frames)


def _spikes(third: FloatArray, m: int, least_m: float) -> tuple[list[Excursion], float]:
    """Excursions of one marker by its third differences (N - 3, 3), and its limit for one frame.

    An excursion is no larger than the miss of its first frame by the left side, so only frames
    with a gross one are looked at. The limits are those of at most `MOST_FRAMES` frames.
    """
    n_frames = len(third) + 3
    usual = np.arange(3, n_frames - 3, -(-n_frames // MOST_FRAMES))
    around = _around(third, usual)
    limits = {
        length: _limit(_excursions(around[:, usual <= n_frames - length - 3], length), least_m)
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
    """Third differences that judge up to three frames from each of the given ones (K,) on.

    (6, K, 3): as seen from the left, then from the right.
    """
    places = frames + np.arange(-LONGEST_SPIKE, LONGEST_SPIKE)[:, None]
    return third[np.minimum(places, len(third) - 1)]


def _in_order(excursions: list[Excursion]) -> tuple[Excursion, ...]:
    return tuple(sorted(excursions, key=lambda e: (e.start, e.marker)))


def _separate(found: list[Excursion], shape: tuple[int, ...]) -> tuple[Excursion, ...]:
    """Keep the largest, and those whose three frames on either side are free of larger ones."""
    taken = np.zeros(shape[:2], dtype=bool)
    kept = []
    for spike in sorted(found, key=lambda e: (-e.size, e.marker, e.start)):
        if not taken[max(0, spike.start - 3) : spike.stop + 3, spike.marker].any():
            taken[spike.start : spike.stop, spike.marker] = True
            kept.append(spike)
    return _in_order(kept)


def _excursions(around: FloatArray, length: int) -> FloatArray:
    """How far `length` frames in a row are off, by both sides; (6, K, 3) to (K,).

    The least of the frames. A parabola through three frames misses the one after them by a third
    difference, and later ones by sums of these with the weights 1, 3, 6.
    """
    before, after = around[:length], around[LONGEST_SPIKE : LONGEST_SPIKE + length]
    least = np.full(around.shape[1], np.inf)
    for k in range(length):
        from_left = sum(w * t for w, t in zip(AHEAD, before[k::-1], strict=False))
        from_right = sum(-w * t for w, t in zip(AHEAD, after[k:], strict=False))
        least = np.minimum(least, _agreed(np.asarray(from_left), np.asarray(from_right)))
    return least


def _steps(third: FloatArray, m: int, limit: float) -> list[Excursion]:
    """Gross steps of one marker, as both sides see them."""
    frames = 3 + np.flatnonzero(norms(third[:-2]) >= limit)
    sizes = _agreed(third[frames - 3], third[frames - 1])
    gross = sizes > limit
    found = zip(frames[gross].tolist(), sizes[gross].tolist(), strict=True)
    return [Excursion(m, frame, frame + 1, size) for frame, size in found]


def _agreed(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the smaller of two vectors' lengths, 0 where they point apart; (..., 3) to (...)."""
    length = np.minimum(norms(one), norms(other))
    return np.where(np.einsum("...i,...i->...", one, other) > 0, length, 0.0 * length)


def _limit(off: FloatArray, least_m: float) -> float:
    """Limit of a marker, m, by how far it usually is off (K,); infinite if it is never seen."""
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
    """List the spikes: markers that are elsewhere for up to three frames, and do not just land.

    Frames (N, M) that a swap explains are left out; `heights` (N, M) are in m.
    """
    low = lowest(heights) if missed.spikes else np.zeros(0)
    return tuple(
        e
        for e in missed.spikes
        if not explained[e.start : e.stop, e.marker].any()
        and not _touches(e, heights[:, e.marker], float(low[e.marker]))
    )


def _touches(spike: Excursion, heights: FloatArray, low_m: float) -> bool:
    """Tell whether a marker (N,) is at its lowest, and higher before and after: a short stance."""
    there, some = heights[spike.start : spike.stop], 0.5 * spike.size
    around = heights[[max(spike.start - 2, 0), min(spike.stop + 1, len(heights) - 1)]]
    return bool((np.abs(there - low_m) < some).all() and around.min() > there.max() + some)


def find_jumps(missed: Surprises, *, explained: BoolArray) -> tuple[Excursion, ...]:
    """List the jumps, to another place from a frame on, that no spike and no swap explains."""
    told = explained | near(missed.is_spike, LONGEST_SPIKE)
    return tuple(e for e in missed.steps if not told[e.start, e.marker])


# Frames at which markers go on from one another's places instead of their own.

BETTER = 0.2  # the exchanged places must fit better than the own ones by this factor
BLOCK = 10_000  # frames looked at together
LONGEST_GAP_S = 0.5  # after a longer one nobody can tell where a marker should be


def exchanges(
    positions: FloatArray, missed: Surprises, *, rate_hz: float
) -> Iterator[tuple[tuple[int, ...], int]]:
    """Test every frame at which a marker jumps or comes back from a gap.

    Yields the indices of markers of which each goes on from the place of the next, the last from
    that of the first, and the first frame of the exchanged names, from 0.

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
    for begin in range(0, len(frames), BLOCK):
        at, ends = frames[begin : begin + BLOCK], last[begin : begin + BLOCK]
        taking = moved[at] & (ends >= 0) & (at[:, None] - ends <= longest)
        way = positions[at] - positions[ends, np.arange(ends.shape[1])]
        far = taking & (np.linalg.norm(way, axis=2) > missed.limit)
        for k in np.flatnonzero(np.count_nonzero(far, axis=1) > 1):  # else all are at home
            for cycle in _cycles_at(int(at[k]), positions, taking[k], ends[k], missed.limit):
                yield cycle, int(at[k])


def _steps_beside_gaps(positions: FloatArray, is_seen: BoolArray, limit: FloatArray) -> BoolArray:
    """Find steps (N, M) where the three frames that a parabola needs are not seen on one side."""
    whole = ~near(~is_seen, 3)
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
    frame: int, positions: FloatArray, is_taking: BoolArray, last: IntArray, limit: FloatArray
) -> Iterator[tuple[int, ...]]:
    """Yield the circles of markers that fit one another's tracks at a frame.

    Those that may take a track over (M,) were last seen in the frames `last` (M,).
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
    return np.asarray(np.nanmin(misses, axis=0))


def _common_move(positions: FloatArray, start: int, stop: int, without: IntArray) -> FloatArray:
    """Median displacement of all other markers between two frames, (3,); 0 if none was seen."""
    move = positions[stop] - positions[start]
    move[without] = np.nan
    move = move[np.isfinite(move).all(axis=1)]
    return np.median(move, axis=0) if len(move) else np.zeros(3)


def _cycles(goes_to: list[int]) -> Iterator[list[int]]:
    """Yield the circles of a permutation that are longer than one."""
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


def _paired(found: Iterable[tuple[tuple[int, ...], int]], markers: tuple[str, ...]) -> list[Swap]:
    """Join an exchange and the next one of the same markers, which undoes it."""
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
    """Say of each swap who found it; both where they agree on the markers and overlap.

    An exchange that nothing undoes may itself undo one that only the distances show, and that ends
    in the gap (of `longest` frames at most) before it.
    """
    merged = list(by_track)
    for late in by_distance:
        for i, swap in enumerate(merged):
            same = set(swap.markers) == set(late.markers)
            follows = late.stop is not None and late.start < swap.start <= late.stop + longest
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
                break  # a part of a longer circle
        else:
            merged.append(late)
    return merged


def _overlap(one: Swap, other: Swap) -> bool:
    ends = [np.inf if swap.stop is None else swap.stop for swap in (one, other)]
    return one.start < ends[1] + NEAR and other.start < ends[0] + NEAR
