"""Robust regression of the floor, at the highest degree that the feet at rest can fix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.landings.rest import RestPoints
from hopdata.landings.robust_regression import robust_regression, robust_rms
from hopdata.landings.surface import (
    Terms,
    design,
    directions,
    polynomial_terms,
    rim_of,
    within_rim,
)

FloatArray = NDArray[np.float64]

RIM_DIRECTIONS = 24  # the polygon overshoots a round rim by at most 0.9 %
_COLLINEAR = 1e-6  # singular value, against the largest, below which columns are one


@dataclass(frozen=True)
class FloorRegression:
    """Outcome of one regression.

    Parameters
    ----------
    terms, coefficients_m : tuple, (T,) array
        Exponents of the polynomial, and the coefficients, m.
    offsets_m : (n,) array
        Mount heights of the feet, m, that sum to zero.
    residuals : (P,) array
        Of all rest points, also those not fitted, m.
    degree : int
        Degree of the polynomial.
    """

    terms: Terms
    coefficients_m: FloatArray
    offsets_m: FloatArray
    residuals: FloatArray
    degree: int


def regress_floor(
    rest: RestPoints,
    scaled: FloatArray,
    near: NDArray[np.bool_],
    *,
    degree: int,
    norm: str,
    largest_error_m: float,
    independent_share: float,
) -> FloorRegression:
    """Fit floor and mount heights at the highest degree whose floor is sure enough.

    Parameters
    ----------
    rest : RestPoints
        Feet at rest.
    scaled : (P, 2) array
        Their places in scaled coordinates.
    near : (P,) bool array
        Those to fit.
    degree : int
        Highest degree to try.
    norm : {"tukey", "huber"}
        Norm of the robust regression.
    largest_error_m : float
        Largest standard error of the floor on its rim, m.
    independent_share : float
        Independent points over points, 0 to 1: those of one step share their error.
    """
    contrasts = _sum_to_zero(len(rest.start_m))
    far = 1e3 * directions(RIM_DIRECTIONS)
    rim = within_rim(far, rim_of(scaled[near], RIM_DIRECTIONS))
    for tried in range(degree, -1, -1):
        terms = polynomial_terms(tried)
        columns = floor_columns(rest, scaled, terms)
        spread = _floor_spread(columns[near], design(rim, terms))
        if tried > 0 and not np.isfinite(spread):
            continue
        estimate = robust_regression(columns[near], rest.points[near, 2], norm=norm)
        residuals = rest.points[:, 2] - columns @ estimate
        error_m = robust_rms(residuals[near]) * spread / np.sqrt(independent_share)
        if tried == 0 or error_m <= largest_error_m:
            break
    n_terms = len(terms)
    offsets = contrasts @ estimate[n_terms:]
    return FloorRegression(terms, estimate[:n_terms], offsets, residuals, tried)


def floor_columns(rest: RestPoints, scaled: FloatArray, terms: Terms) -> FloatArray:
    """Terms of the polynomial at places (P, 2), and contrasts of the mounts, (P, T + n - 1)."""
    return np.hstack([design(scaled, terms), _sum_to_zero(len(rest.start_m))[rest.foot]])


def _floor_spread(columns: FloatArray, rim: FloatArray) -> float:
    """Largest standard error of the floor on its rim for unit residuals; inf if undetermined.

    The floor alone, without the offset of the foot that stands on it: where feet keep to
    places of their own, a slope and their mount heights are the same to the data, and only
    their sum is sure. A polynomial is least sure at its rim.
    """
    _, values, right = np.linalg.svd(columns, full_matrices=False)
    if len(columns) <= columns.shape[1] or values[-1] < _COLLINEAR * values[0]:
        return float("inf")
    errors = rim @ (right / values[:, np.newaxis]).T[: rim.shape[1]]
    return float(np.linalg.norm(errors, axis=1).max())


def _sum_to_zero(n_feet: int) -> FloatArray:
    """Contrasts (n, n - 1) whose combinations are all offsets that sum to zero."""
    return np.vstack([np.eye(n_feet - 1), -np.ones((1, n_feet - 1))])
