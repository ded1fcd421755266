"""Rests above the floor: the foot hangs low, drags, or stands on something.

Nothing is below the floor, so rests that spoil the fit lie above it, often in one part
of the run or of the ground, where a polynomial can follow them. An M-estimator that
starts from least squares then stays there. The fit here starts from a low quantile,
which tolerates that most rests are raised.
"""

from __future__ import annotations

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.landings.sections.modes import ground_mode

#: Share of the rests that lie below the surface from which the fit starts.
#: Unit: 1. Origin: chosen.
QUANTILE = 0.05

#: Points that suffice for the start.
#: Unit: points. Origin: chosen.
START_POINTS = 2000

#: Most fits of the start.
#: Unit: 1. Origin: chosen.
MOST_FITS = 300

#: Change of the surface at which these fits end, as a share of the band.
#: Unit: 1. Origin: chosen.
STILL = 5e-5

#: Height above the mode, in deviations of its left flank, at which a rest is raised.
#: Unit: standard deviations. Origin: chosen.
SIGMAS = 4.0

#: Rounds of fitting the points about the mode.
#: Unit: 1. Origin: chosen.
ROUNDS = 4

#: Fewest points that determine a ground mode.
#: Unit: points. Origin: chosen.
LEAST_POINTS = 20

#: Share of the points below which a robust regression copes with raised ones by itself.
#: Unit: 1. Origin: chosen.
LEAST_SHARE = 0.02


def raised_rests(
    heights: FloatArray, columns: FloatArray, band_m: float, scale: float = 1.0
) -> BoolArray:
    """Find the rests that are above the floor.

    Parameters
    ----------
    heights : (P,) array
        Heights of feet at rest, m.
    columns : (P, T) array
        Terms of the floor and of the mount heights at each of them.
    band_m : float
        Largest distance of a resting foot from the floor, m; points farther away are
        uninformative.
    scale : float
        Scale of the recording.

    Returns
    -------
    (P,) bool array
        Rests that lie above the mode of the heights over the fitted surface by more
        than four standard deviations of the scatter below that mode. None if these are
        fewer than 2 % of the points, since a robust regression then copes by itself.

    Notes
    -----
    The first fit is a quantile regression (iterated weights, as in statsmodels'
    `QuantReg`). A few least-squares fits of the points about the mode follow.
    """
    none = np.zeros(len(heights), dtype=bool)
    raised = none
    residuals = heights - columns @ low_surface(heights, columns, STILL * band_m)
    for _ in range(ROUNDS):
        near = residuals[np.abs(residuals) <= band_m]
        if len(near) < LEAST_POINTS:
            return none
        mode = ground_mode(near, scale=scale)
        above = (residuals - mode.height_m) / mode.sigma_m
        raised = above > SIGMAS
        core = np.abs(above) <= SIGMAS
        fit = np.linalg.lstsq(columns[core], heights[core], rcond=None)[0]
        residuals = heights - columns @ fit
    near_floor = np.abs(residuals) <= band_m
    if (raised & near_floor).sum() < LEAST_SHARE * near_floor.sum():
        return none
    return raised


def low_surface(
    heights: FloatArray, columns: FloatArray, still_m: float = 1e-6
) -> FloatArray:
    """Return coefficients of the surface with a twentieth of the points below it.

    They are nearly optimal: the fit ends when the surface moves by less than `still_m`.
    """
    step = max(1, len(heights) // START_POINTS)
    heights = heights[::step]
    columns = columns[::step]
    found = np.zeros(columns.shape[1])
    weights = np.ones_like(heights)
    for _ in range(MOST_FITS):
        before = found
        root = np.sqrt(weights)
        found = np.asarray(
            np.linalg.lstsq(columns * root[:, None], heights * root, rcond=None)[0]
        )
        # Unlike the coefficients, the surface moves alike in any axes.
        moved = columns @ (found - before)
        if np.abs(moved).max() <= still_m:
            break
        residuals = heights - columns @ found
        share = np.where(residuals < 0, 1 - QUANTILE, QUANTILE)
        weights = share / np.maximum(np.abs(residuals), still_m)
    return np.asarray(found)
