"""Order of a method from errors at many step sizes: a line through the straight part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.hybrid.solution import FloatArray

LEAST_ERROR, MOST_ERROR = 1e-12, 1e-3
DEVIATION = 0.1  # decades: by so much may an error stand off the line
FEWEST = 4


@dataclass(frozen=True)
class OrderFit:
    """A line through the logarithms: error = factor step^order, over the steps that are `used`.

    Parameters
    ----------
    order, factor : float
        NaN where fewer than four steps are straight.
    used : (N,) array of bool
        Which steps the line was fitted to.
    """

    order: float
    factor: float
    used: NDArray[np.bool_]

    def error(self, step: FloatArray) -> FloatArray:
        """Return the line's error at steps."""
        return self.factor * step**self.order


def fit_order(
    step: FloatArray,
    error: FloatArray,
    *,
    least: float = LEAST_ERROR,
    most: float = MOST_ERROR,
    deviation: float = DEVIATION,
) -> OrderFit:
    """Fit the order of a method over the straight part of its curve, by rule and not by eye.

    The steps are those with errors between `least` (well above rounding) and `most`; of them the
    finest, and as many coarser ones in a row as leave every error within `deviation` decades of
    the line through them.

    Parameters
    ----------
    step, error : (N,) array
        Step sizes in any order, and the error at each.
    least, most : float
        Errors that may count.
    deviation : float
        Decades by which an error may stand off the line.
    """
    order = np.argsort(step)
    inside = [int(i) for i in order if least <= error[i] <= most]
    for count in range(len(inside), FEWEST - 1, -1):
        chosen = inside[:count]
        x, y = np.log10(step[chosen]), np.log10(error[chosen])
        slope, shift = np.polyfit(x, y, 1)
        if np.abs(y - shift - slope * x).max() <= deviation:
            used = np.zeros(len(step), dtype=bool)
            used[chosen] = True
            return OrderFit(float(slope), float(10.0**shift), used)
    return OrderFit(np.nan, np.nan, np.zeros(len(step), dtype=bool))
