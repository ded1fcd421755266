"""Drop-outs: frames in which a marker is hidden from the cameras."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.synthesis.options import GapOptions

BoolArray = NDArray[np.bool_]


def draw_gaps(
    options: GapOptions,
    *,
    frames: int,
    markers: int,
    rate_hz: float,
    rng: np.random.Generator,
) -> BoolArray:
    """Draw which markers are hidden in which frames, (N, M).

    Drop-outs of each marker begin at random (Poisson) and last a geometrically distributed number
    of frames, at least one; those that overlap merge.
    """
    hidden = np.zeros((frames, markers), dtype=bool)
    expected = options.rate_per_min / 60.0 * frames / rate_hz
    end_probability = min(1.0, 1.0 / max(1.0, options.mean_s * rate_hz))
    for marker in range(markers):
        count = rng.poisson(expected)
        starts = rng.integers(0, max(frames, 1), count)
        lengths = rng.geometric(end_probability, count)
        for start, length in zip(starts, lengths, strict=True):
            hidden[start : start + length, marker] = True
    return hidden
