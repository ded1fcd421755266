"""How far positions are from what the frames before them, and those after them, let expect.

A contact bends a track, so one of the two sides still predicts every frame. A spike is foreseen by
neither side; a step is a miss of both sides in one and the same direction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

LONGEST_SPIKE = 3  # frames
# A miss is gross above the marker's own 99.9 % quantile, the more so the heavier its tail (quantile
# over 99 % quantile): noise has a light one, hard impacts a heavy one. All in units of quantiles.
OF_MEDIAN, OF_99, OF_999, TAIL_POWER = 5.0, 10.0, 3.0, 4
LEAST_M = 0.005


@dataclass(frozen=True)
class Surprises:
    """Gross misses of the one-sided predictions.

    Parameters
    ----------
    spike : (N, M) array
        How far each marker is off in the frames of its spikes, m; 0 elsewhere.
    step : (N, M) array
        Miss that the step from the frame before makes, seen from both sides, m; 0 where the sides
        do not agree, NaN where one is not seen.
    limit : (M,) array
        Above this a step is gross for the marker, m.
    """

    spike: FloatArray
    step: FloatArray
    limit: FloatArray

    @property
    def is_step(self) -> BoolArray:
        """Where a marker makes a gross step from the frame before, (N, M)."""
        return np.asarray(np.nan_to_num(self.step) > self.limit)

    @property
    def is_spike(self) -> BoolArray:
        """Where a marker is in a spike, (N, M)."""
        return np.asarray(self.spike > 0)


def surprises(positions: FloatArray) -> Surprises:
    """Compare (N, M, 3) positions, m, with parabolas through three frames on either side."""
    spike = np.zeros(positions.shape[:2])
    limit = np.full(positions.shape[1], np.inf)
    for length in range(1, LONGEST_SPIKE + 1):
        off = _excursions(positions, length)
        gross_at = _limits(off)
        limit = gross_at if length == 1 else limit
        sizes = np.where(np.nan_to_num(off) > gross_at, off, 0.0)
        for k in range(length):
            spike[k : k + len(sizes)] = np.maximum(spike[k : k + len(sizes)], sizes)
    return Surprises(spike, _steps(positions), limit)


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
    length = np.minimum(np.linalg.norm(one, axis=-1), np.linalg.norm(other, axis=-1))
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
