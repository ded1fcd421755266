"""The ground mode: where heights of feet on the ground pile up, and their scatter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import BoolArray, FloatArray
from hopdata.errors import AnalysisError
from hopdata.landings.sections.densities import finite, kde

#: Least scatter of a mode, so that sigma > 0 for noise-free data: below the resolution
#: of optical systems.
#: Unit: m. Origin: chosen.
FINEST_M = 1e-5

#: Fewest heights from which a mode is found.
#: Unit: heights. Origin: chosen.
LEAST_SAMPLES = 20

#: Bandwidth of the coarse density, as a share of the range from the 2 % to the 98 %
#: quantile.
#: Unit: 1. Origin: chosen.
COARSE = 0.04

#: Quantiles of that range.
#: Unit: 1. Origin: chosen.
RANGE_QUANTILES = (0.02, 0.98)

#: Smallest density of a mode that counts, as a share of the highest density.
#: Unit: 1. Origin: chosen.
LARGE = 0.2

#: Rounds in which the mode and the scatter of its flank are found anew.
#: Unit: 1. Origin: chosen.
ROUNDS = 3

#: Distance from the mode within which printed steps of the heights are sought.
#: Unit: m. Origin: chosen.
STEP_REACH_M = 5e-3

#: Smallest step that counts: finer ones are below the noise of cameras.
#: Unit: m. Origin: chosen.
COARSE_STEP_M = 1e-4

#: Mean number of heights per level above which heights come in steps.
#: Unit: heights. Origin: chosen.
TIES = 20

#: Median number of heights per level above which heights come in steps.
#: Unit: heights. Origin: chosen.
LEAST_TIES = 2

#: Median of |z| for a standard normal z.
#: Unit: 1. Origin: derived: its quartile.
NORMAL_MEDIAN = 0.6744897501960817


@dataclass(frozen=True)
class GroundMode:
    """Mode of the heights of feet on the ground.

    Parameters
    ----------
    height_m : float
        Place of the mode, m.
    sigma_m : float
        Standard deviation of its left flank, m. Nothing is below the ground, so this
        flank contains only scatter: measurement noise and the remaining error of the
        floor.
    bandwidth_m : float
        Bandwidth of the density whose highest point is the mode, m.
    """

    height_m: float
    sigma_m: float
    bandwidth_m: float

    def knee(self, sigmas: float) -> float:
        """Return the upper knee, m: `sigmas` of the left flank above the mode."""
        return self.height_m + sigmas * self.sigma_m


def ground_mode(heights: ArrayLike, *, scale: float = 1.0) -> GroundMode:
    """Find the lowest large mode of `heights` and the scatter on its left flank.

    The mode is narrower than any bandwidth suited to the whole density, so it has a
    bandwidth of its own: sigma n^(-1/7), the rate suited to a mode, with sigma from the
    left flank.

    Parameters
    ----------
    heights : array of any shape
        Foot heights, m; non-finite ones are ignored.
    scale : float
        Scale of the recording (`hopdata.scale.scale_of`).

    Raises
    ------
    AnalysisError
        If there are fewer than 20 finite heights.
    """
    values = finite(heights) / scale
    values.sort()
    if values.size < LEAST_SAMPLES:
        wanted = f"at least {LEAST_SAMPLES} frames with foot heights"
        raise AnalysisError.at("ground mode", wanted, values.size)
    n_low = np.searchsorted(values, _upper_end_of_lowest_mode(values), side="right")
    place = _densest(values[:n_low])
    sigma = _left_flank(values, place)
    for _ in range(ROUNDS):
        n_ground = 2 * max(int(np.searchsorted(values, place)), 1)
        width = sigma * n_ground ** (-1 / 7)
        reach = 6 * sigma + 2 * width
        place = _highest_near(values, place, reach=reach, bandwidth=width)
        sigma = _left_flank(values, place)
    return GroundMode(
        height_m=scale * place, sigma_m=scale * sigma, bandwidth_m=scale * width
    )


def _upper_end_of_lowest_mode(values: FloatArray) -> float:
    """Return the upper end of the lowest large mode of a coarse density, m."""
    low, high = np.quantile(values, RANGE_QUANTILES)
    width = max(COARSE * float(high - low), FINEST_M)
    grid = np.linspace(low - 3 * width, high + 3 * width, 512)
    density = kde(values, bandwidth=width, grid=grid)
    lowest = int(np.argmax(large_modes(density)))
    return float(grid[1:-1][lowest]) + 2 * width


def large_modes(density: FloatArray) -> BoolArray:
    """Mark the inner nodes (G - 2,) at which a density (G,) has a large mode."""
    inner = density[1:-1]
    is_peak = (inner > density[:-2]) & (inner >= density[2:])
    return np.asarray(is_peak & (inner >= LARGE * density.max()))


def _densest(values: FloatArray) -> float:
    """Return the half-sample mode of sorted values, which has no bandwidth.

    See Bickel and Fruehwirth (2006).
    """
    while values.size > 8:
        half = (values.size + 1) // 2
        widths = values[half - 1 :] - values[: values.size - half + 1]
        start = int(np.argmin(widths))
        values = values[start : start + half]
    return float(values.mean())


def _left_flank(values: FloatArray, place: float) -> float:
    """Return the robust deviation of the values below `place`, m, as half a normal."""
    least = max(FINEST_M, 0.5 * _printed_step(values, place))
    below = values[: np.searchsorted(values, place)]
    if not below.size:
        return least
    return max(float(place - np.median(below)) / NORMAL_MEDIAN, least)


def _printed_step(values: FloatArray, place: float) -> float:
    """Return the step, m, in which heights near `place` were printed, or 0."""
    first = np.searchsorted(values, place - STEP_REACH_M)
    last = np.searchsorted(values, place + STEP_REACH_M)
    near = np.round(values[first:last], 6)
    starts = np.flatnonzero(np.diff(near, prepend=-np.inf))  # the values are sorted
    levels = near[starts]
    ties = np.diff(starts, append=len(near))
    if len(levels) < 2 or ties.mean() <= TIES or np.median(ties) <= LEAST_TIES:
        return 0.0
    step = float(np.median(np.diff(levels)))
    if step < COARSE_STEP_M:
        return 0.0
    return step


def _highest_near(
    values: FloatArray, place: float, *, reach: float, bandwidth: float
) -> float:
    """Return the peak of the density near `place`, by a parabola through its top."""
    grid = np.linspace(place - reach, place + reach, 401)
    density = kde(values, bandwidth=bandwidth, grid=grid)
    top = int(np.clip(np.argmax(density), 1, len(grid) - 2))
    left, middle, right = density[top - 1 : top + 2]
    curvature = left - 2 * middle + right
    shift = 0.0
    if curvature < 0:
        shift = 0.5 * (left - right) / curvature
    return float(grid[top] + np.clip(shift, -1.0, 1.0) * (grid[1] - grid[0]))


def robust_rms(residuals: FloatArray) -> float:
    """Return the sd about zero of a normal with the same median absolute residual."""
    return float(np.median(np.abs(residuals))) / NORMAL_MEDIAN
