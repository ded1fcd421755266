"""Spikes: one to three frames in which a marker is elsewhere; and jumps to another place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import BoolArray, FloatArray, IntArray

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


def surprises(positions: FloatArray) -> Surprises:
    """Compare (N, M, 3) positions, m, with parabolas through three frames on either side."""
    n_frames, n_markers = positions.shape[:2]
    limit = np.full(n_markers, np.inf)
    spikes: list[Excursion] = []
    steps: list[Excursion] = []
    for m in range(n_markers):
        third = np.diff(positions[:, m], 3, axis=0)  # [k]: frame k + 3 less the three before
        if len(third) > 3:
            found, limit[m] = _spikes(third, m)
            spikes += found
            steps += _steps(third, m, limit[m])
    return Surprises(_separate(spikes, (n_frames, n_markers)), _in_order(steps), limit, n_frames)


def _spikes(third: FloatArray, m: int) -> tuple[list[Excursion], float]:
    """Excursions of one marker by its third differences (N - 3, 3), and its limit for one frame.

    An excursion is no larger than the miss of its first frame by the left side, so only frames
    with a gross one are looked at. The limits are those of at most `MOST_FRAMES` frames.
    """
    n_frames = len(third) + 3
    usual = np.arange(3, n_frames - 3, -(-n_frames // MOST_FRAMES))
    around = _around(third, usual)
    limits = {
        length: _limit(_excursions(around[:, usual <= n_frames - length - 3], length))
        for length in range(LONGEST_SPIKE, 0, -1)
    }
    gross = np.flatnonzero(_length(third) >= min(limits.values())) + 3
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
    frames = 3 + np.flatnonzero(_length(third[:-2]) >= limit)
    sizes = _agreed(third[frames - 3], third[frames - 1])
    gross = sizes > limit
    return [
        Excursion(m, frame, frame + 1, size)
        for frame, size in zip(frames[gross].tolist(), sizes[gross].tolist(), strict=True)
    ]


def _length(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))


def _agreed(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the smaller of two vectors' lengths, 0 where they point apart; (..., 3) to (...)."""
    length = np.minimum(_length(one), _length(other))
    along = np.einsum("...i,...i->...", one, other)
    return np.where(along > 0, length, 0.0 * length)


def _limit(off: FloatArray) -> float:
    """Limit of a marker, m, by how far it usually is off (K,); infinite if it is never seen."""
    values = off[np.isfinite(off)]
    if not len(values):
        return np.inf
    middle = np.median(values[values > 0]) if np.any(values > 0) else 0.0
    q99, q999 = np.quantile(values, [0.99, 0.999])
    tail = min(OF_999, (q999 / max(q99, 1e-12)) ** TAIL_POWER)
    return float(max(LEAST_M, OF_MEDIAN * middle, min(OF_99 * q99, tail * q999)))


@dataclass(frozen=True)
class Spike:
    """A marker that is elsewhere for up to three frames, or (a jump) from a frame on.

    Parameters
    ----------
    marker : str
        Its name.
    start, stop : int
        First frame and the frame after the last, from 0.
    size : float
        How far off it is at least, m.
    """

    marker: str
    start: int
    stop: int
    size: float


def find_spikes(
    missed: Surprises, markers: tuple[str, ...], *, explained: NDArray[np.bool_]
) -> tuple[Spike, ...]:
    """List the spikes.

    Parameters
    ----------
    missed : Surprises
        Misses of the one-sided predictions.
    markers : tuple of str
        The M names.
    explained : (N, M) bool array
        Frames that a swap explains.
    """
    return tuple(
        Spike(markers[e.marker], e.start, e.stop, e.size)
        for e in missed.spikes
        if not explained[e.start : e.stop, e.marker].any()
    )


def find_jumps(
    missed: Surprises, markers: tuple[str, ...], *, explained: NDArray[np.bool_]
) -> tuple[Spike, ...]:
    """List the jumps that are neither spikes nor explained by a swap; see `find_spikes`."""
    near_spike = missed.is_spike
    for _ in range(LONGEST_SPIKE):
        near_spike[1:] |= near_spike[:-1].copy()
        near_spike[:-1] |= near_spike[1:].copy()
    return tuple(
        Spike(markers[e.marker], e.start, e.stop, e.size)
        for e in missed.steps
        if not (explained[e.start, e.marker] or near_spike[e.start, e.marker])
    )
