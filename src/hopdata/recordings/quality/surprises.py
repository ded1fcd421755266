"""Where positions deviate grossly from predictions by the frames on either side.

A contact bends a track, but one of the two sides still predicts every frame. Neither
side predicts a spike. At a step, both sides miss in the same direction.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.recordings.quality.displaced import displaced
from hopdata.recordings.quality.rests import lowest
from hopdata.recordings.quality.rigid import norms
from hopdata.recordings.quality.stretches import near

#: Most frames in a row of a spike.
#: Unit: frames. Origin: chosen.
LONGEST_SPIKE = 3

#: A miss is gross above this multiple of the marker's median miss.
#: Unit: 1. Origin: chosen.
OF_MEDIAN = 5.0

#: A miss is gross in any case above this multiple of the 99 % quantile of the misses.
#: Unit: 1. Origin: chosen.
OF_99 = 10.0

#: Largest multiple of the 99.9 % quantile of the misses above which a miss is gross.
#: Unit: 1. Origin: chosen.
OF_999 = 3.0

#: The multiple is this power of the ratio of the 99.9 % to the 99 % quantile: noise has
#: a light tail, and hard impacts have a heavy one.
#: Unit: 1. Origin: chosen.
TAIL_POWER = 4

#: Ratio of the 90 % quantile of the misses of white noise to their median, both of
#: misses above zero.
#: Unit: 1. Origin: measured: 1.58 to 1.62 for excursions of one to three frames. Spikes
#: in 2 % of the frames hardly change it, while they are themselves the 99 % quantile.
NOISE_90 = 1.6

#: No smaller miss is gross, for an animal of 1 m.
#: Unit: m. Origin: chosen.
LEAST_M = 0.005

#: Evenly spaced frames from which the limits of a longer recording are taken.
#: Unit: frames. Origin: chosen.
MOST_FRAMES = 200_000

#: Share of the size of a shorter excursion from which on a longer one, which holds it,
#: outranks it.
#: Unit: 1. Origin: chosen. The middle of three displaced frames seems displaced twice
#: as far by itself.
OF_SHORTER = 0.4

# Miss of a parabola one to three frames ahead, in third differences.
AHEAD = (1.0, 3.0, 6.0)

#: Frames on one side through which a parabola predicts those on the other.
#: Unit: frames. Origin: derived: a parabola has three coefficients.
SIDE = 3

#: Least 99 % quantile of the misses by which the 99.9 % quantile is divided.
#: Unit: m. Origin: rounding: avoids a division by zero, where a marker stands still.
TINY_M = 1e-12


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

    @property
    def length(self) -> int:
        """Number of frames."""
        return self.stop - self.start


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
        for one in excursions:
            mask[one.start : one.stop, one.marker] = True
        return mask


def surprises(positions: FloatArray, *, scale: float = 1.0) -> Surprises:
    """Compare (N, M, 3) positions, m, with parabolas through three frames on each side.

    No miss below `LEAST_M` times the scale (`hopdata.scale.scale_of`) is gross.
    """
    n_frames, n_markers = positions.shape[:2]
    limit = np.full(n_markers, np.inf)
    spikes: list[Excursion] = []
    steps: list[Excursion] = []
    for m in range(n_markers):
        # Of frame k + 3 relative to the three before it.
        third = np.diff(positions[:, m], SIDE, axis=0)
        if len(third) > SIDE:
            limits = _limits_by_length(third, LEAST_M * scale)
            limit[m] = limits[1].sure
            spikes += _spikes(positions[:, m], third, m, limits)
            steps += _steps(third, m, limit[m])
    return Surprises(_in_order(spikes), _in_order(steps), limit, n_frames)


@dataclass(frozen=True)
class _Limits:
    """Least sizes of excursions of one length, m.

    Above `sure` it is a spike in any case, and from `clear` on if it is displaced from
    a smooth curve.
    """

    clear: float
    sure: float


def _spikes(
    track: FloatArray, third: FloatArray, m: int, limits: dict[int, _Limits]
) -> list[Excursion]:
    """Return the spikes of one marker.

    Excursions close to one another may be caused by the same displaced frames.

    Parameters
    ----------
    track : (N, 3) array
        Positions, m.
    third : (N - 3, 3) array
        Their third differences.
    m : int
        The marker.
    limits : dict
        Limits of each length of an excursion, the longest first.
    """
    clear = {length: limit.clear for length, limit in limits.items()}
    spikes: list[Excursion] = []
    for cluster in _clusters(_excursions_above(third, m, clear)):
        first = min(one.start for one in cluster) - SIDE
        last = max(one.stop for one in cluster) - 1 + SIDE
        runs = _runs(displaced(track, first, last, clear), m)
        if runs and all(run.length <= LONGEST_SPIKE for run in runs):
            spikes += runs
        else:  # no smooth curve tells the frames apart: only those that are sure count
            sure = [one for one in cluster if one.size > limits[one.length].sure]
            spikes += _separate(sure)
    return spikes


def _clusters(found: list[Excursion]) -> list[list[Excursion]]:
    """Divide the excursions of one marker into those that share frames beside them."""
    clusters: list[list[Excursion]] = []
    last_frame = -np.inf
    for one in _in_order(found):
        shares_none = one.start - last_frame > 2 * SIDE
        if shares_none:
            clusters.append([])
        clusters[-1].append(one)
        last_frame = max(last_frame, one.stop - 1)
    return clusters


def _runs(off: dict[int, float], m: int) -> list[Excursion]:
    """Return displaced frames and their sizes as excursions of frames in a row."""
    if not off:
        return []
    frames = np.array(list(off))
    sizes = np.array(list(off.values()))
    # Numbers of the frames at which a run begins, and of those after its last.
    begins = np.flatnonzero(np.diff(frames, prepend=-2) > 1)
    ends = np.append(begins[1:], len(frames))
    runs = []
    for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
        start = int(frames[begin])
        stop = start + end - begin
        size = float(sizes[begin:end].min())
        runs.append(Excursion(m, start, stop, size))
    return runs


def _excursions_above(
    third: FloatArray, m: int, limits: dict[int, float]
) -> list[Excursion]:
    """Return excursions of one marker above the limits, from its third differences.

    An excursion is no larger than the miss of its first frame as predicted from before,
    so only frames with a gross miss are examined.

    Parameters
    ----------
    third : (N - 3, 3) array
        Third differences of the marker's positions.
    m : int
        The marker.
    limits : dict
        Least size, m, of excursions of each length, the longest first.
    """
    n_frames = len(third) + SIDE
    gross = np.flatnonzero(norms(third) >= min(limits.values())) + SIDE
    around = _around(third, gross)
    # Of each frame, the largest of the longer excursions that hold it.
    size_of_longer = np.zeros(n_frames)
    found: list[Excursion] = []
    for length, limit in limits.items():
        has_both_sides = gross <= n_frames - length - SIDE
        sizes = _excursions(around[:, has_both_sides], length)
        for k in np.flatnonzero(sizes > limit).tolist():
            start = int(gross[k])
            stop = start + length
            size = float(sizes[k])
            outranked = size_of_longer[start:stop].min() >= OF_SHORTER * size
            if not outranked:
                found.append(Excursion(m, start, stop, size))
        for one in found:
            covered = size_of_longer[one.start : one.stop]
            np.maximum(covered, one.size, out=covered)
    return found


def _limits_by_length(third: FloatArray, least_m: float) -> dict[int, _Limits]:
    """Return the limits, m, of excursions of each length, the longest first.

    The limits come from at most `MOST_FRAMES` frames.
    """
    n_frames = len(third) + SIDE
    every = math.ceil(n_frames / MOST_FRAMES)
    usual = np.arange(SIDE, n_frames - SIDE, every)
    around = _around(third, usual)
    limits = {}
    for length in range(LONGEST_SPIKE, 0, -1):
        has_both_sides = usual <= n_frames - length - SIDE
        sizes = _excursions(around[:, has_both_sides], length)
        limits[length] = _limits(sizes, least_m)
    return limits


def _around(third: FloatArray, frames: IntArray) -> FloatArray:
    """Return the third differences that judge three frames from each of (K,) on.

    Shape (6, K, 3): as seen from the left, then from the right.
    """
    places = frames + np.arange(-LONGEST_SPIKE, LONGEST_SPIKE)[:, None]
    return third[np.minimum(places, len(third) - 1)]


def _excursions(around: FloatArray, length: int) -> FloatArray:
    """Return the displacement of `length` frames in a row by both sides.

    (6, K, 3) to (K,). This is the smallest of the frames' displacements. A parabola
    through three frames misses the next one by a third difference, and later ones by
    sums of these with the weights 1, 3, 6.
    """
    before = around[:length]
    after = around[LONGEST_SPIKE : LONGEST_SPIKE + length]
    least = np.full(around.shape[1], np.inf)
    for k in range(length):
        from_left = _miss_ahead(before[k::-1])
        from_right = -_miss_ahead(after[k:])
        least = np.minimum(least, _agreed(from_left, from_right))
    return least


def _miss_ahead(third: FloatArray) -> FloatArray:
    """Return by how much a parabola misses a frame, (K, 3).

    From the third differences (n, K, 3) between it and the frame, the nearest to the
    frame first; n is 1 to 3.
    """
    terms = [weight * one for weight, one in zip(AHEAD, third, strict=False)]
    return np.asarray(sum(terms))


def _agreed(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the smaller length of two vectors, or 0 if they point apart.

    (..., 3) to (...); NaN stays NaN.
    """
    length = np.minimum(norms(one), norms(other))
    alike = np.einsum("...i,...i->...", one, other) > 0
    return np.where(alike, length, 0.0 * length)


def _limits(sizes: FloatArray, least_m: float) -> _Limits:
    """Return a marker's limits, m, from its usual misses (K,).

    They are infinite if the marker is never seen. Many spikes are themselves the 99.9 %
    quantile, or even the 99 % quantile, but hardly change the 90 % quantile.
    """
    known = sizes[np.isfinite(sizes)]
    if not len(known):
        return _Limits(np.inf, np.inf)
    q50 = 0.0
    q90 = 0.0
    above_zero = known[known > 0]
    if len(above_zero):
        q50, q90 = np.quantile(above_zero, [0.5, 0.9])
    q99, q999 = np.quantile(known, [0.99, 0.999])
    # Hard impacts make a heavy tail, above which a spike must be; noise has a light
    # one.
    heaviness = q999 / max(q99, TINY_M)
    tail = min(OF_999, heaviness**TAIL_POWER)
    of_tail = min(OF_99 * q99, tail * q999)
    # Likewise the shoulder, which spikes themselves do not raise.
    over_noise = q90 / (NOISE_90 * max(q50, TINY_M))
    shoulder = max(1.0, over_noise) ** TAIL_POWER
    of_noise = OF_MEDIAN * q50
    sure = float(max(least_m, of_noise, of_tail))
    clear = float(max(least_m, of_noise * shoulder))
    return _Limits(min(clear, sure), sure)


def _steps(third: FloatArray, m: int, limit: float) -> list[Excursion]:
    """Return gross steps of one marker on which both sides agree."""
    frames = SIDE + np.flatnonzero(norms(third[:-2]) >= limit)
    sizes = _agreed(third[frames - 3], third[frames - 1])
    gross = sizes > limit
    steps = []
    for frame, size in zip(frames[gross].tolist(), sizes[gross].tolist(), strict=True):
        steps.append(Excursion(m, frame, frame + 1, size))
    return steps


def _separate(found: list[Excursion]) -> list[Excursion]:
    """Keep the largest of one marker, and those without a larger one within three."""
    kept: list[Excursion] = []
    for spike in sorted(found, key=lambda e: (-e.size, e.start)):
        if all(_apart(spike, other) for other in kept):
            kept.append(spike)
    return kept


def _apart(one: Excursion, other: Excursion) -> bool:
    """Return whether there are three frames or more between two excursions."""
    return one.start - SIDE >= other.stop or one.stop + SIDE <= other.start


def _in_order(excursions: Iterable[Excursion]) -> tuple[Excursion, ...]:
    return tuple(sorted(excursions, key=lambda e: (e.start, e.marker)))


def find_spikes(
    missed: Surprises, *, explained: BoolArray, heights: FloatArray
) -> tuple[Excursion, ...]:
    """List spikes: displacements of up to three frames that are not short landings.

    Parameters
    ----------
    missed : Surprises
        Gross misses.
    explained : (N, M) bool array
        Frames that a swap explains.
    heights : (N, M) array
        Heights, m.
    """
    if not missed.spikes:
        return ()
    low_m = lowest(heights)
    spikes = []
    for spike in missed.spikes:
        m = spike.marker
        if explained[spike.start : spike.stop, m].any():
            continue
        if not _touches(spike, heights[:, m], float(low_m[m])):
            spikes.append(spike)
    return tuple(spikes)


def _touches(spike: Excursion, heights: FloatArray, low_m: float) -> bool:
    """Tell whether a marker (N,) is lowest during a spike and higher around it.

    That is a short stance.
    """
    during = heights[spike.start : spike.stop]
    before = max(spike.start - 2, 0)
    after = min(spike.stop + 1, len(heights) - 1)
    around = heights[[before, after]]
    some_m = 0.5 * spike.size
    is_lowest = (np.abs(during - low_m) < some_m).all()
    is_higher_around = around.min() > during.max() + some_m
    return bool(is_lowest and is_higher_around)


def find_jumps(missed: Surprises, *, explained: BoolArray) -> tuple[Excursion, ...]:
    """List jumps to another place that no spike and no swap explains."""
    accounted = explained | near(missed.is_spike, LONGEST_SPIKE)
    return tuple(e for e in missed.steps if not accounted[e.start, e.marker])
