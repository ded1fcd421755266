"""The order of a method: of one step (Definition 4.2.1), and over a whole trajectory.

The slope of a line through the logarithms of error and step is a mean over the steps to
which it was fitted, whereas an order is a limit. `fit_order` fits the line over a part
of the steps that a fixed rule chooses, and says which; `fit_limit` includes the next
term of the error's expansion, over all steps that fit several times into the shortest
smooth piece of the trajectory.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.hybrid.printed.region import Slope
from hopdata.hybrid.printed.solvers import Stepping

OneStep = Callable[[Slope, float, FloatArray, float], FloatArray]

#: Least error that an order is fitted to: well above rounding.
#: Unit: 1. Origin: chosen: ten thousand roundings of a number near 1.
LEAST_ERROR = 1e-12
#: Largest error that a line is fitted to.
#: Unit: 1. Origin: chosen.
MOST_ERROR = 1e-3
#: Largest distance of an error from the fitted line, beyond which it is not straight.
#: Unit: decade. Origin: chosen.
DEVIATION = 0.1
#: Fewest steps that a line is fitted to.
#: Unit: 1. Origin: chosen: two more than a line needs.
FEWEST = 4
#: Steps per smooth piece of a trajectory from which a method is near its limit.
#: Unit: 1. Origin: chosen.
STEPS_PER_PIECE = 4
# Tolerances so loose that they never shorten a step: all steps have one length.
LOOSE: Mapping[str, float] = {"rtol": 0.9, "atol": 1e9}


def equal_steps(
    kind: Callable[..., Any], length: float, first: float | None = None
) -> Stepping:
    """Return a classical solver of SciPy's with steps of one length, s.

    Parameters
    ----------
    kind : class
        A class with the interface of `scipy.integrate.OdeSolver`.
    length : float
        Length of a step, s.
    first : float, optional
        Length of the first step, s, to move events within their steps.
    """
    if first is None:
        first = length
    return Stepping(kind, {**LOOSE, "max_step": length, "first_step": first})


def order_of_step(
    one_step: OneStep,
    slope: Slope,
    solution: Callable[[float], FloatArray],
    steps: FloatArray,
    *,
    start: float = 0.0,
) -> float:
    """Return the order p of a one-step method as Definition 4.2.1 has it.

    The error of one step is at most K dt^(p + 1), so p is the slope of its logarithm
    over that of the step, less one.

    Parameters
    ----------
    one_step : callable
        ``one_step(slope, t, y, dt)`` returns the state (n,) after a step.
    slope : callable
        Field ``slope(t, y)``.
    solution : callable
        ``solution(t)``: the exact solution (n,).
    steps : (N,) array
        Lengths of the step, s, so short that the next term of the error is small.
    start : float
        Where the step begins, s.
    """
    errors = []
    for dt in steps.tolist():
        found = one_step(slope, start, solution(start), dt)
        exact = solution(start + dt)
        errors.append(np.abs(found - exact).max())
    slope_of_error, _ = np.polyfit(np.log(steps), np.log(errors), 1)
    return float(slope_of_error) - 1.0


@dataclass(frozen=True)
class OrderFit:
    """A line through the logarithms, over the steps `used`: error = factor step^order.

    Parameters
    ----------
    order, factor : float
        NaN where fewer than four steps are straight.
    used : (N,) array of bool
        Which steps the line was fitted to.
    standard_error : float
        Standard error of the order, from the scatter about the line.
    """

    order: float
    factor: float
    used: BoolArray
    standard_error: float

    def error(self, step: FloatArray) -> FloatArray:
        """Return the line's error at given steps."""
        return self.factor * step**self.order


def fit_order(
    step: FloatArray,
    error: FloatArray,
    *,
    least: float = LEAST_ERROR,
    most: float = MOST_ERROR,
    deviation: float = DEVIATION,
) -> OrderFit:
    """Fit the order of a method over the straight part of its curve.

    Candidates are steps with errors between `least` (well above rounding) and `most`.
    The fit uses the finest of them and as many consecutive coarser ones as leave every
    error within `deviation` decades of the line through them.

    Parameters
    ----------
    step, error : (N,) array
        Step sizes in any order, and the error at each.
    least, most : float
        Range of errors that may be used.
    deviation : float
        Largest distance of an error from the line, decades.
    """
    order = np.argsort(step)
    # From the finest step to the coarsest; coarse ones are given up one by one.
    inside = [int(i) for i in order if least <= error[i] <= most]
    for count in range(len(inside), FEWEST - 1, -1):
        chosen = inside[:count]
        rows = np.stack([np.log10(step[chosen]), np.ones(count)])
        line, line_errors, residual = _regression(rows, np.log10(error[chosen]))
        if np.abs(residual).max() <= deviation:
            used = np.zeros(len(step), dtype=bool)
            used[chosen] = True
            slope, shift = line
            return OrderFit(
                order=float(slope),
                factor=float(10.0**shift),
                used=used,
                standard_error=float(line_errors[0]),
            )
    none = np.zeros(len(step), dtype=bool)
    return OrderFit(order=np.nan, factor=np.nan, used=none, standard_error=np.nan)


@dataclass(frozen=True)
class LimitFit:
    """The order in the limit of short steps: error = factor step^order exp(bend step).

    Parameters
    ----------
    order, standard_error, bend : float
        NaN if there are fewer than five steps.
    n_steps : int
        Number of steps in the fit.
    """

    order: float
    standard_error: float
    bend: float
    n_steps: int


def fit_limit(
    step: FloatArray,
    error: FloatArray,
    shortest_piece: float,
    *,
    least: float = LEAST_ERROR,
) -> LimitFit:
    """Fit order and next term over all short steps with errors well above rounding.

    Parameters
    ----------
    step, error : (N,) array
        Step sizes in any order, and the error at each.
    shortest_piece : float
        Shortest time between two events, or between an event and an end of the
        trajectory.
    least : float
        Least error that is used.
    """
    used = (step <= shortest_piece / STEPS_PER_PIECE) & (error >= least)
    count = int(used.sum())
    if count < FEWEST + 1:
        return LimitFit(np.nan, np.nan, np.nan, count)
    # log error = order log step + bend step + constant
    rows = np.stack([np.log(step[used]), step[used], np.ones(count)])
    found, errors, _ = _regression(rows, np.log(error[used]))
    return LimitFit(
        order=float(found[0]),
        standard_error=float(errors[0]),
        bend=float(found[1]),
        n_steps=count,
    )


def _regression(
    rows: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return least-squares coefficients, their standard errors, and the residual.

    Each row of `rows`, (k, N), is what a coefficient is multiplied with.
    """
    found, *_ = np.linalg.lstsq(rows.T, y, rcond=None)
    coefficients = np.asarray(found, dtype=np.float64)
    residual: FloatArray = y - coefficients @ rows
    degrees_of_freedom = max(len(y) - len(rows), 1)
    variance = residual @ residual / degrees_of_freedom
    inverse = np.linalg.inv(rows @ rows.T)
    errors: FloatArray = np.sqrt(np.diag(inverse) * variance)
    return coefficients, errors, residual
