"""Order of a method from errors at many step sizes: a line through the straight part, and its end.

A line gives the mean slope over its steps. The order is the slope in the limit of short steps,
where the next term of the error's expansion has died away: that term is fitted as well, over steps
of which several fit into the shortest smooth piece of the trajectory.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.hybrid.solution import FloatArray

LEAST_ERROR, MOST_ERROR = 1e-12, 1e-3
DEVIATION = 0.1  # decades: by so much may an error stand off the line
FEWEST = 4
STEPS_PER_PIECE = 4  # from which on a method is near its limit


@dataclass(frozen=True)
class OrderFit:
    """A line through the logarithms: error = factor step^order, over the steps that are `used`.

    Parameters
    ----------
    order, factor : float
        NaN where fewer than four steps are straight.
    used : (N,) array of bool
        Which steps the line was fitted to.
    standard_error : float
        Of the order, from the scatter about the line.
    """

    order: float
    factor: float
    used: NDArray[np.bool_]
    standard_error: float

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
        (slope, shift), (slope_error, _), residual = _regression(np.stack([x, np.ones(count)]), y)
        if np.abs(residual).max() <= deviation:
            used = np.zeros(len(step), dtype=bool)
            used[chosen] = True
            return OrderFit(float(slope), float(10.0**shift), used, float(slope_error))
    return OrderFit(np.nan, np.nan, np.zeros(len(step), dtype=bool), np.nan)


@dataclass(frozen=True)
class LimitFit:
    """The order in the limit of short steps: error = factor step^order exp(bend step).

    Parameters
    ----------
    order, standard_error, bend : float
        NaN where there are fewer than five steps, one more than the parameters and two.
    n_steps : int
        How many steps it was fitted to.
    """

    order: float
    standard_error: float
    bend: float
    n_steps: int


def fit_limit(
    step: FloatArray, error: FloatArray, shortest_piece: float, *, least: float = LEAST_ERROR
) -> LimitFit:
    """Fit order and next term over all steps that are short and whose errors are no rounding.

    Parameters
    ----------
    step, error : (N,) array
        Step sizes in any order, and the error at each.
    shortest_piece : float
        Shortest time between two events, or an event and an end of the trajectory.
    least : float
        Errors from here on count.
    """
    used = (step <= shortest_piece / STEPS_PER_PIECE) & (error >= least)
    count = int(used.sum())
    if count < FEWEST + 1:
        return LimitFit(np.nan, np.nan, np.nan, count)
    rows = np.stack([np.log(step[used]), step[used], np.ones(count)])
    (order, bend, _), errors, _ = _regression(rows, np.log(error[used]))
    return LimitFit(float(order), float(errors[0]), float(bend), count)


def _regression(rows: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return least-squares coefficients of the rows, their standard errors, and the residual."""
    coefficients = np.asarray(np.linalg.lstsq(rows.T, y, rcond=None)[0], dtype=np.float64)
    residual: FloatArray = y - coefficients @ rows
    variance = residual @ residual / max(len(y) - len(rows), 1)
    errors: FloatArray = np.sqrt(np.diag(np.linalg.inv(rows @ rows.T)) * variance)
    return coefficients, errors, residual
