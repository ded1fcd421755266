"""Spikes: one to three frames in which a marker is elsewhere; and jumps to another place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import BoolArray, FloatArray

# How far positions are from what the frames before them, and those after them, let expect.
#
# A contact bends a track, so one of the two sides still predicts every frame. A spike is foreseen
# by
# neither side; a step is a miss of both sides in one and the same direction.

LONGEST_SPIKE = 3  # frames
# A miss is gross above the marker's own 99.9 % quantile, the more so the heavier its tail (quantile
# over 99 % quantile): noise has a light one, hard impacts a heavy one. All in units of quantiles.
OF_MEDIAN, OF_99, OF_999, TAIL_POWER = 5.0, 10.0, 3.0, 4
LEAST_M = 0.005
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
    step : (N, M) array
        Miss that the step from the frame before makes, seen from both sides, m; 0 where the sides
        do not agree, NaN where one is not seen.
    limit : (M,) array
        Above this a step is gross for the marker, m.
    """

    spikes: tuple[Excursion, ...]
    step: FloatArray
    limit: FloatArray

    @property
    def is_step(self) -> BoolArray:
        """Where a marker makes a gross step from the frame before, (N, M)."""
        return np.asarray(np.nan_to_num(self.step) > self.limit)

    @property
    def is_spike(self) -> BoolArray:
        """Where a marker is in a spike, (N, M)."""
        mask = np.zeros(self.step.shape, dtype=bool)
        for spike in self.spikes:
            mask[spike.start : spike.stop, spike.marker] = True
        return mask


def surprises(positions: FloatArray) -> Surprises:
    """Compare (N, M, 3) positions, m, with parabolas through three frames on either side."""
    limit = np.full(positions.shape[1], np.inf)
    found: list[Excursion] = []
    covered = np.zeros(positions.shape[:2])  # sizes of longer excursions
    for length in range(LONGEST_SPIKE, 0, -1):
        off = _excursions(positions, length)
        limit = _limits(off)
        for start, m in np.argwhere(np.nan_to_num(off) > limit).tolist():
            size, stop = float(off[start, m]), start + length
            if covered[start:stop, m].min() < OF_SHORTER * size:
                found.append(Excursion(m, start, stop, size))
        for e in found:
            column = covered[e.start : e.stop, e.marker]
            np.maximum(column, e.size, out=column)
    return Surprises(_separate(found, positions.shape), _steps(positions), limit)


def _separate(found: list[Excursion], shape: tuple[int, ...]) -> tuple[Excursion, ...]:
    """Keep the largest, and those whose three frames on either side are free of larger ones."""
    taken = np.zeros(shape[:2], dtype=bool)
    kept = []
    for spike in sorted(found, key=lambda e: (-e.size, e.marker, e.start)):
        if not taken[max(0, spike.start - 3) : spike.stop + 3, spike.marker].any():
            taken[spike.start : spike.stop, spike.marker] = True
            kept.append(spike)
    return tuple(sorted(kept, key=lambda e: (e.start, e.marker)))


def _excursions(positions: FloatArray, length: int) -> FloatArray:
    """How far `length` frames in a row are off, by both sides; (K, M), least of the frames.

    Row k is that of the frames from k on; NaN for the first three, which have no left side.
    """
    n = len(positions) - length - 6
    if n < 0:
        return np.full((0, positions.shape[1]), np.nan)
    off = np.full((n + 4, positions.shape[1]), np.nan)
    before = [positions[2 - i : 2 - i + n + 1] for i in range(3)]
    after = [positions[3 + length + i : 3 + length + i + n + 1] for i in range(3)]
    least = np.full((n + 1, positions.shape[1]), np.inf)
    for k in range(length):
        here = positions[3 + k : 3 + k + n + 1]
        from_left = here - _ahead(before, k + 1)
        from_right = here - _ahead(after, length - k)
        least = np.minimum(least, _agreed(from_left, from_right))
    off[3:] = least
    return off


def _ahead(frames: list[FloatArray], distance: int) -> FloatArray:
    """Parabola through three frames, the nearest first, taken so many frames further."""
    d = float(distance)
    nearest, middle, farthest = frames
    return (d + 1) * (d + 2) / 2 * nearest - d * (d + 2) * middle + d * (d + 1) / 2 * farthest


def _steps(positions: FloatArray) -> FloatArray:
    """Step into each frame, as both sides see it, (N, M)."""
    step = np.full(positions.shape[:2], np.nan)
    if len(positions) > 3:
        a, b, c, d = (positions[i : len(positions) - 3 + i] for i in range(4))
        third = d - 3 * c + 3 * b - a  # miss of d by the left, and less that of a by the right
        step[3:-2] = _agreed(third[:-2], third[2:])
    return step


def _agreed(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the smaller of two vectors' lengths, 0 where they point apart; (..., 3) to (...)."""
    squares = [np.einsum("...i,...i->...", vector, vector) for vector in (one, other)]
    length: FloatArray = np.sqrt(np.minimum(*squares))
    along = np.einsum("...i,...i->...", one, other)
    return np.where(along > 0, length, 0.0 * length)


def _limits(off: FloatArray) -> FloatArray:
    """Limit of each marker, (M,), m; infinite for one that is never seen on both sides."""
    limits = np.full(off.shape[1], np.inf)
    for m, values in enumerate(off.T):
        values = values[np.isfinite(values)]
        if len(values):
            middle = np.median(values[values > 0]) if np.any(values > 0) else 0.0
            q99, q999 = np.quantile(values, [0.99, 0.999])
            tail = min(OF_999, (q999 / max(q99, 1e-12)) ** TAIL_POWER)
            limits[m] = max(LEAST_M, OF_MEDIAN * middle, min(OF_99 * q99, tail * q999))
    return limits


@dataclass(frozen=True)
class Spike:
    """A marker that is elsewhere for up to three frames.

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


@dataclass(frozen=True)
class Jump:
    """A marker that moves to another place between two frames, and no other takes its own.

    Parameters
    ----------
    marker : str
        Its name.
    frame : int
        First frame at the new place, from 0.
    size : float
        Length of the jump, m.
    """

    marker: str
    frame: int
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
) -> tuple[Jump, ...]:
    """List the jumps that are neither spikes nor explained by a swap; see `find_spikes`."""
    near_spike = missed.is_spike
    for _ in range(LONGEST_SPIKE):
        near_spike[1:] |= near_spike[:-1].copy()
        near_spike[:-1] |= near_spike[1:].copy()
    gross = missed.is_step & ~explained & ~near_spike
    return tuple(
        Jump(markers[m], int(frame), float(missed.step[frame, m]))
        for frame, m in np.argwhere(gross)
    )
