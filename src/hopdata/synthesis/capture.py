"""Motion capture of marker tracks: curved floor, noise, resolution and drop-outs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.synthesis.floor import CurvedFloor

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


def observe(
    positions: FloatArray,
    *,
    floor: CurvedFloor,
    noise_m: float,
    resolution_m: float,
    hidden: BoolArray,
    rng: np.random.Generator,
) -> FloatArray:
    """Marker positions as the cameras report them.

    Parameters
    ----------
    positions : (N, M, 3) array
        True positions over a flat floor, m.
    floor : CurvedFloor
        Its height at a marker's own x and y is added to that marker's z.
    noise_m : float
        Standard deviation of the independent normal noise on each coordinate, m. A distance
        between two markers then has a standard deviation of sqrt(2) times that.
    resolution_m : float
        Positions are rounded to multiples of this, m; 0 for no rounding.
    hidden : (N, M) bool array
        Markers not seen; their coordinates become NaN.
    rng : numpy Generator

    Returns
    -------
    (N, M, 3) array, m
    """
    seen = positions.copy()
    seen[..., 2] += floor.height(positions[..., :2])
    seen += noise_m * rng.standard_normal(positions.shape)
    if resolution_m > 0:
        seen = np.round(seen / resolution_m) * resolution_m
    seen[hidden] = np.nan
    return seen
