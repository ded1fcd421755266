"""The ground mode: where the heights of feet on the ground pile up, and how far they scatter."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.errors import AnalysisError
from hopdata.landings.density import finite, kde
from hopdata.landings.robust_regression import NORMAL_MEDIAN

FloatArray = NDArray[np.float64]

_FINEST_M = 1e-5  # no optical system resolves less; keeps data without noise from sigma = 0
_LEAST_SAMPLES = 20
_COARSE = 0.04  # coarse bandwidth, as a share of the range from the 2 % to the 98 % quantile
_STEP_REACH_M = 5e-3  # about the mode, in which printed steps are looked for
_COARSE_STEP_M = 1e-4  # finer steps are below the noise of cameras
_TIES, _LEAST_TIES = 20, 2  # heights a level, mean and median, above which they come in steps
_LARGE = 0.2  # a mode counts from this share of the highest density on


@dataclass(frozen=True)
class GroundMode:
    """Mode of the heights of feet on the ground.

    Parameters
    ----------
    height_m : float
        Place of the mode, m.
    sigma_m : float
        Standard deviation of its left flank, m. Nothing is below the ground, so that flank is
        scatter alone: measurement noise and what is left of the floor.
    bandwidth_m : float
        Bandwidth of the density whose highest point is the mode, m.
    """

    height_m: float
    sigma_m: float
    bandwidth_m: float

    def knee(self, sigmas: float) -> float:
        """Upper knee of the mode: `sigmas` times the left flank's deviation above it, m."""
        return self.height_m + sigmas * self.sigma_m

    def to_dict(self) -> dict[str, float]:
        """Return the fields as a dictionary for JSON."""
        return asdict(self)


def ground_mode(heights: ArrayLike, *, bandwidth_m: float | None = None) -> GroundMode:
    """Find the lowest large mode of `heights` and the scatter on its left flank.

    The mode is narrower than any bandwidth made for the whole density, so a bandwidth is
    made for it alone: sigma n^(-1/7), the rate that suits a mode, with sigma from the flank.

    Parameters
    ----------
    heights : array of any shape
        Foot heights, m; those not finite are ignored.
    bandwidth_m : float, optional
        Bandwidth for the place of the mode, m; by default from the data as above. One wider
        than sigma is narrowed to it: its top would be that of all heights, not of the mode.

    Raises
    ------
    AnalysisError
        Fewer than 20 finite heights.
    """
    values = np.sort(finite(heights))
    if values.size < _LEAST_SAMPLES:
        raise AnalysisError(
            f"ground mode: expected at least {_LEAST_SAMPLES} frames with foot heights, "
            f"found {values.size}"
        )
    place = _densest(values[values <= _upper_end_of_lowest_mode(values)])
    sigma = _left_flank(values, place)
    for _ in range(3):
        n_ground = 2 * max(int(np.searchsorted(values, place)), 1)
        width = sigma * n_ground ** (-1 / 7)
        if bandwidth_m is not None:
            width = float(np.clip(bandwidth_m, _FINEST_M, sigma))
        place = _highest_near(values, place, reach=6 * sigma + 2 * width, bandwidth=width)
        sigma = _left_flank(values, place)
    return GroundMode(height_m=place, sigma_m=sigma, bandwidth_m=width)


def _upper_end_of_lowest_mode(values: FloatArray) -> float:
    """Where the lowest large mode of a coarse density ends, m."""
    low, high = np.quantile(values, [0.02, 0.98])
    width = max(_COARSE * float(high - low), _FINEST_M)
    grid = np.linspace(low - 3 * width, high + 3 * width, 512)
    density = kde(values, bandwidth=width, grid=grid)
    inner = density[1:-1]
    is_peak = (inner > density[:-2]) & (inner >= density[2:]) & (inner >= _LARGE * density.max())
    return float(grid[1:-1][np.argmax(is_peak)]) + 2 * width


def _densest(values: FloatArray) -> float:
    """Half-sample mode of sorted values (Bickel and Fruehwirth 2006): needs no bandwidth."""
    while values.size > 8:
        half = (values.size + 1) // 2
        start = int(np.argmin(values[half - 1 :] - values[: values.size - half + 1]))
        values = values[start : start + half]
    return float(values.mean())


def _left_flank(values: FloatArray, place: float) -> float:
    """Robust deviation of what lies below `place`, taken as half of a normal, m."""
    least = max(_FINEST_M, 0.5 * _printed_step(values, place))
    below = values[: np.searchsorted(values, place)]
    if below.size == 0:
        return least
    return max(float(place - np.median(below)) / NORMAL_MEDIAN, least)


def _printed_step(values: FloatArray, place: float) -> float:
    """Return the step in which heights near `place` were printed, m; 0 if none is to be seen."""
    first, last = np.searchsorted(values, (place - _STEP_REACH_M, place + _STEP_REACH_M))
    near = np.round(values[first:last], 6)
    levels, ties = np.unique(near, return_counts=True)
    if len(levels) < 2 or ties.mean() <= _TIES or np.median(ties) <= _LEAST_TIES:
        return 0.0
    step = float(np.median(np.diff(levels)))
    return step if step >= _COARSE_STEP_M else 0.0


def _highest_near(values: FloatArray, place: float, *, reach: float, bandwidth: float) -> float:
    """Highest point of the density within `reach` of `place`, by a parabola through its top."""
    grid = np.linspace(place - reach, place + reach, 401)
    density = kde(values, bandwidth=bandwidth, grid=grid)
    top = int(np.clip(np.argmax(density), 1, len(grid) - 2))
    left, middle, right = density[top - 1 : top + 2]
    curvature = left - 2 * middle + right
    shift = 0.5 * (left - right) / curvature if curvature < 0 else 0.0
    return float(grid[top] + np.clip(shift, -1.0, 1.0) * (grid[1] - grid[0]))
