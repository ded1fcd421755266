"""How far each position is from what the frames before it, and those after it, let expect.

A contact bends a track, so one of the two sides still predicts every frame. A spike is foreseen by
neither side; a step is a miss of both sides in one and the same direction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# A miss is gross above the marker's own 99.9 % quantile, the more so the heavier its tail (quantile
# over 99 % quantile): noise has a light one, hard impacts a heavy one. All in units of quantiles.
OF_MEDIAN, OF_99, OF_999, TAIL_POWER = 5.0, 10.0, 3.0, 4
LEAST_M = 0.005


@dataclass(frozen=True)
class Surprises:
    """Misses of the one-sided predictions, m.

    Parameters
    ----------
    spike : (N, M) array
        Miss that both sides agree on; 0 where they do not, NaN where a side is not seen.
    step : (N, M) array
        Miss that the step from the frame before makes, seen from both sides; 0, NaN likewise.
    limit : (M,) array
        Above this a miss is gross for the marker.
    """

    spike: FloatArray
    step: FloatArray
    limit: FloatArray


def surprises(positions: FloatArray) -> Surprises:
    """Compare each frame of (N, M, 3) positions, m, with parabolas through three frames beside."""
    from_left, from_right = np.full_like(positions, np.nan), np.full_like(positions, np.nan)
    if len(positions) > 3:
        a, b, c, d = (positions[i : len(positions) - 3 + i] for i in range(4))
        third = d - 3 * c + 3 * b - a
        from_left[3:], from_right[:-3] = third, -third
    spike = _agreed(from_left, from_right)
    step = np.full_like(spike, np.nan)
    step[1:] = _agreed(from_left[1:], -from_right[:-1])
    return Surprises(spike, step, _limits(spike))


def _agreed(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the smaller of two vectors' lengths, 0 where they point apart; (..., 3) to (...)."""
    length = np.minimum(np.linalg.norm(one, axis=-1), np.linalg.norm(other, axis=-1))
    along = np.einsum("...i,...i->...", one, other)
    return np.where(along > 0, length, 0.0 * length)


def _limits(spike: FloatArray) -> FloatArray:
    """Limit of each marker, (M,); infinite for one that is never seen on both sides."""
    limits = np.full(spike.shape[1], np.inf)
    for m, values in enumerate(spike.T):
        values = values[np.isfinite(values)]
        if len(values):
            middle = np.median(values[values > 0]) if np.any(values > 0) else 0.0
            q99, q999 = np.quantile(values, [0.99, 0.999])
            tail = min(OF_999, (q999 / max(q99, 1e-12)) ** TAIL_POWER)
            limits[m] = max(LEAST_M, OF_MEDIAN * middle, min(OF_99 * q99, tail * q999))
    return limits
