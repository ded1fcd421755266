"""Rests above the floor: of a foot that hangs low or drags, or that stands on something.

Nothing is below the floor, so what spoils its fit lies above it, and often in one part of the run
or of the ground, where a polynomial can follow it. An M-estimator that starts from least squares
then stays there. The start here is a low quantile, which most of the rests may leave upwards.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.landings.modes import ground_mode
from hopdata.landings.quantile_regression import quantile_regression

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_QUANTILE = 0.05
_START_POINTS = 2000  # enough to start from
_MOST_FITS = 300
_SIGMAS = 4.0  # of the ground mode's left flank: what is farther above it is raised
_ROUNDS = 4
_LEAST_POINTS = 20  # that a ground mode is found from
_LEAST_SHARE = 0.02  # of the points: the regression deals with fewer by itself


def raised_rests(heights: FloatArray, columns: FloatArray, *, band_m: float) -> BoolArray:
    """Find the rests that are above the floor.

    Parameters
    ----------
    heights : (P,) array
        Of feet at rest, m.
    columns : (P, T) array
        Terms of the floor and of the mount heights at each.
    band_m : float
        How far from the floor a resting foot may be, m: what is farther away tells nothing of it.

    Returns
    -------
    (P,) bool array
        Those higher above the fitted surface than four standard deviations of the scatter below
        the mode of all heights above it; none if these are fewer than 2 % of the points, which a
        robust regression deals with by itself.

    Notes
    -----
    Start by quantile regression (`hopdata.landings.quantile_regression`), then least squares of the
    points about the mode, a few times.
    """
    residuals = heights - columns @ _low_surface(heights, columns)
    raised = np.zeros(len(heights), dtype=bool)
    for _ in range(_ROUNDS):
        near = residuals[np.abs(residuals) <= band_m]
        if len(near) < _LEAST_POINTS:
            return np.zeros(len(heights), dtype=bool)
        mode = ground_mode(near)
        above = (residuals - mode.height_m) / mode.sigma_m
        raised, core = above > _SIGMAS, np.abs(above) <= _SIGMAS
        found = np.linalg.lstsq(columns[core], heights[core], rcond=None)[0]
        residuals = heights - columns @ found
    near_floor = np.abs(residuals) <= band_m
    enough = (raised & near_floor).sum() >= _LEAST_SHARE * near_floor.sum()
    return raised if enough else np.zeros(len(heights), dtype=bool)


def _low_surface(heights: FloatArray, columns: FloatArray) -> FloatArray:
    """Coefficients of the surface that a twentieth of the points is below; nearly the optimum."""
    step = max(1, len(heights) // _START_POINTS)
    return quantile_regression(
        columns[::step], heights[::step], quantile=_QUANTILE, most_fits=_MOST_FITS
    )
