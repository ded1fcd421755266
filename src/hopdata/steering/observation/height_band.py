"""Heights that tell stances from flights."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError

FloatArray = NDArray[np.float64]

LOW, HIGH = 2.0, 90.0  # percentiles of the heights: near the lowest points, near the apexes
BELOW, ABOVE = 0.35, 0.45  # of the travel between them


def height_band(height_m: FloatArray) -> tuple[float, float]:
    """Return a height that stances fall below and one that flights rise above, m.

    They stand at 35 and 45 % of the travel between low and high heights, (N,), m, NaN where
    unknown. Percentiles hardly mind how long the hopper is carried about or stands.

    Raises
    ------
    AnalysisError
        If no height is known.
    """
    known = height_m[np.isfinite(height_m)]
    if not known.size:
        raise AnalysisError("heights: expected some that are known, found none")
    low, high = np.percentile(known, [LOW, HIGH])
    return float(low + BELOW * (high - low)), float(low + ABOVE * (high - low))
