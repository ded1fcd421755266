"""Markers that come to rest at their lowest again and again, as feet do."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from hopdata.recordings.quality.runs import runs

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

BAND_M = 0.02  # above a marker's own lowest height
SPEED_M_S = 0.15
WINDOW_S = 0.04
LEAST_REST_S = 0.03
FLAT = 0.05  # of the range of heights: the lowest tenth of the frames of a foot spans less
CLEARER = 2.0
MOST_FRAMES = 200_000  # of a longer recording, evenly spaced
ONE_M = 1e-5  # no camera system is so exact: heights whose difference varies by less are copies


def lowest(heights: FloatArray) -> FloatArray:
    """Lowest height of each marker but for 1 % of the frames, (M,); NaN if never seen."""
    return _quantiles(heights, [0.01])[0]


def high_feet(heights: FloatArray, names: Sequence[str], *, above_m: float) -> list[str]:
    """Say which feet, of heights (N, n) m, stay so far above where the lowest of them goes."""
    low = lowest(heights)
    if np.isnan(low).all():
        return []
    floor = int(np.nanargmin(low))
    return [
        f"foot '{name}' comes no nearer to the floor than {height:.3f} m above '{names[floor]}'"
        for name, height in zip(names, low - low[floor], strict=True)
        if height > above_m
    ]


def feet_as_one(heights: FloatArray, names: Sequence[str]) -> list[str]:
    """Say which two feet, of heights (N, n) m, are always as far apart in height.

    Markers of their own never are, for their noise. Asked are the frames in which one of the two is
    off the floor, where rounding alone does not make them equal; the outer tenths may be wrong.
    """
    remarks = []
    up = heights > lowest(heights) + BAND_M
    for i, j in combinations(range(len(names)), 2):
        apart = heights[up[:, i] | up[:, j], i] - heights[up[:, i] | up[:, j], j]
        low, middle, high = _quantiles(apart[:, None], [0.1, 0.5, 0.9])[:, 0]
        if high - low < ONE_M:
            where = f"{1e3 * abs(middle):.1f} mm apart" if abs(middle) > ONE_M else "the same"
            remarks.append(f"the heights of feet '{names[i]}' and '{names[j]}' are always {where}")
    return remarks


def at_rest(heights: FloatArray, rate_hz: float) -> BoolArray:
    """Tell when each marker rests near its own lowest height.

    Parameters
    ----------
    heights : (N, M) array
        Height, m; NaN where not seen.
    rate_hz : float
        Frame rate, Hz.

    Returns
    -------
    (N, M) bool array
        Rests shorter than `LEAST_REST_S` are left out.
    """
    half = max(1, round(WINDOW_S * rate_hz / 2))
    speed = np.full_like(heights, np.nan)
    if len(heights) > 2 * half:
        speed[half:-half] = (heights[2 * half :] - heights[: -2 * half]) * rate_hz / (2 * half)
    with np.errstate(invalid="ignore"):
        resting = (heights < lowest(heights) + BAND_M) & (np.abs(speed) < SPEED_M_S)
    least = max(2, round(LEAST_REST_S * rate_hz))
    for m in range(heights.shape[1]):
        for start, stop in runs(resting[:, m]):
            if stop - start < least:
                resting[start:stop, m] = False
    return resting


def flattest_direction(positions: FloatArray) -> tuple[str, float, float]:
    """Find the direction at whose lower end at least two markers stay for a while.

    Parameters
    ----------
    positions : (N, M, 3) array
        In any unit.

    Returns
    -------
    direction : str
        ``"z"``, ``"-y"`` and so on: up, if something stands on a floor.
    flatness, next_flatness : float
        Range of the lowest tenth of the frames over that of all, of the second flattest marker,
        for this direction and for the next best.
    """
    found: dict[str, float] = {}
    positions = positions[:: max(1, -(-len(positions) // MOST_FRAMES))]
    for axis, name in enumerate("xyz"):
        for sign in (1, -1):
            low, tenth, high = _quantiles(sign * positions[:, :, axis], [0.01, 0.1, 0.99])
            with np.errstate(invalid="ignore", divide="ignore"):
                flatness = np.sort(((tenth - low) / (high - low))[high > low])
            direction = name if sign > 0 else f"-{name}"
            found[direction] = float(flatness[1]) if len(flatness) > 1 else np.inf
    best, following = sorted(found, key=lambda d: found[d])[:2]
    return best, found[best], found[following]


def _quantiles(values: FloatArray, levels: list[float]) -> FloatArray:
    """Quantiles of each column of (N, M) values, (len(levels), M); NaN for an empty column."""
    result = np.full((len(levels), values.shape[1]), np.nan)
    for m in range(values.shape[1]):
        known = values[np.isfinite(values[:, m]), m]
        if len(known):
            result[:, m] = np.quantile(known, levels)
    return result
