"""When markers rest on a floor, how high feet rest, and which way is up then."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.messages import Message
from hopdata.recordings.axes import DIRECTIONS, along
from hopdata.recordings.quality.stretches import quantiles, runs
from hopdata.scale import extent

#: A rest is at most this far above a marker's lowest height, for an animal of 1 m.
#: Unit: m. Origin: chosen.
BAND_M = 0.02

#: How far a soft floor or sole may give when a body lands, for an animal of 1 m.
#: Unit: m. Origin: chosen.
SINKS_M = 0.06

#: Vertical speed below which a marker may rest, for an animal of 1 m.
#: Unit: m/s. Origin: chosen.
SPEED_M_S = 0.15

#: Time over which that speed is measured, for an animal of 1 m.
#: Unit: s. Origin: chosen.
WINDOW_S = 0.04

#: Shortest rest, for an animal of 1 m.
#: Unit: s. Origin: chosen.
LEAST_REST_S = 0.03

#: Largest span of the lowest tenth of a foot's frames, relative to that of all.
#: Unit: 1. Origin: chosen.
FLAT = 0.05

#: Ratio of that of the next best direction to that of a clear one.
#: Unit: 1. Origin: chosen.
CLEARER = 2.0

#: Largest height of another resting marker above the lowest, relative to the extent.
#: Unit: 1. Origin: chosen.
ON_THE_FLOOR = 0.05

#: Least number of descents of a marker that stands on a floor again and again.
#: Unit: 1. Origin: chosen.
LEAST_TIMES_DOWN = 5

#: Evenly spaced frames used of a longer recording.
#: Unit: frames. Origin: chosen.
MOST_FRAMES = 200_000

#: Height above its lowest from which on a foot is off the floor, relative to its range.
#: Unit: 1. Origin: chosen.
OFF_THE_FLOOR = 0.1

#: Heights whose difference varies less are copies.
#: Unit: m. Origin: chosen. It is below any camera's noise.
ONE_M = 1e-5


def scale_of_all(positions: FloatArray) -> float:
    """Return a rough scale of markers (N, M, 3), m: ..., 1/16, 1/4 or 1.

    Their roles are not known. It is their `extent`, rounded to a power of four, and at
    most 1, since some may belong to the room. Only drafts, remarks and refusals use it,
    never an estimate, which has the continuous `hopdata.scale.scale_of` the body
    and the feet.
    """
    size_m = extent(positions)
    if not size_m > 0:
        return 1.0
    power_of_four = np.round(0.5 * np.log2(np.clip(size_m, 1e-3, 1e3)))
    return float(min(4.0**power_of_four, 1.0))


def lowest(heights: FloatArray) -> FloatArray:
    """Return the lowest height of each marker but for 1 % of frames, (M,).

    NaN if it is never seen.
    """
    return quantiles(heights, [0.01])[0]


def high_feet(
    heights: FloatArray, names: Sequence[str], *, above_m: float
) -> list[Message]:
    """Report feet, of heights (N, n) m, that stay `above_m` above the lowest one."""
    low_m = lowest(heights)
    floor = int(np.nanargmin(low_m))
    remarks = []
    for name, height_m in zip(names, (low_m - low_m[floor]).tolist(), strict=True):
        if height_m > above_m:
            values = {"foot": name, "height_m": height_m, "lowest": names[floor]}
            remarks.append(Message("recordings.high_foot", values))
    return remarks


def feet_as_one(heights: FloatArray, names: Sequence[str]) -> list[Message]:
    """Report pairs of feet, of heights (N, n) m, at a constant difference in height.

    Noise prevents this for separate markers. Only frames in which one of the two is off
    the floor are used, because on the floor rounding alone can make heights equal. The
    outer tenths may be wrong.
    """
    remarks = []
    low, high = quantiles(heights, [0.01, 0.99])
    up = heights > low + OFF_THE_FLOOR * (high - low)
    for i, j in combinations(range(len(names)), 2):
        either_up = up[:, i] | up[:, j]
        apart = heights[either_up, i] - heights[either_up, j]
        least, usual, most = quantiles(apart[:, None], [0.1, 0.5, 0.9])[:, 0].tolist()
        if not most - least < ONE_M:
            continue
        values: dict[str, object] = {"one": names[i], "other": names[j]}
        if abs(usual) > ONE_M:
            values["apart_mm"] = 1e3 * abs(usual)
            remarks.append(Message("recordings.feet_at_one_distance", values))
        else:
            remarks.append(Message("recordings.feet_the_same", values))
    return remarks


def at_rest(heights: FloatArray, rate_hz: float) -> BoolArray:
    """Tell when each marker rests near its lowest height, or settles on a soft floor.

    Parameters
    ----------
    heights : (N, M) array
        Heights, m, of an animal of about 1 m; NaN where not seen.
    rate_hz : float
        Frame rate, Hz.

    Returns
    -------
    (N, M) bool array
        True where a marker rests; rests shorter than `LEAST_REST_S` are left out.
    """
    half = max(1, round(WINDOW_S * rate_hz / 2))
    speed = np.full_like(heights, np.nan)
    if len(heights) > 2 * half:
        rise = heights[2 * half :] - heights[: -2 * half]
        speed[half:-half] = rise * rate_hz / (2 * half)
    low = lowest(heights)
    with np.errstate(invalid="ignore"):
        slow = np.abs(speed) < SPEED_M_S
        slow_and_low = np.where(slow & (heights < low + SINKS_M), heights, np.nan)
        settled = quantiles(slow_and_low, [0.5])[0]
        # On a soft floor the band lies about the height at which the marker settles.
        floor = np.fmax(low, settled - 0.5 * BAND_M)
        resting = slow & (heights < floor + BAND_M)
    least_frames = max(2, round(LEAST_REST_S * rate_hz))
    for m in range(heights.shape[1]):
        for start, stop in runs(resting[:, m]):
            if stop - start < least_frames:
                resting[start:stop, m] = False
    return resting


def flattest_direction(
    positions: FloatArray, feet: Sequence[int] = ()
) -> tuple[str, float, float]:
    """Find the direction at whose lower end two markers or more stay again and again.

    Someone who stands still does so only once, along any direction.

    Parameters
    ----------
    positions : (N, M, 3) array
        In any unit.
    feet : sequence of int
        The markers on feet, if they are known; otherwise any may stand on the floor.

    Returns
    -------
    direction : str
        ``"z"``, ``"-y"`` and so on: the up direction, if something stands on a floor.
    flatness, next_flatness : float
        Range of the lowest tenth of the frames over the range of all, for the second
        flattest marker, in this direction and in the next best.
    """
    found: dict[str, float] = {}
    stride = max(1, -(-len(positions) // MOST_FRAMES))
    positions = positions[::stride]
    may_stand = np.ones(positions.shape[1], dtype=bool)
    if len(feet):
        may_stand[:] = False
        may_stand[list(feet)] = True
    for up in DIRECTIONS:
        heights = along(positions, up)
        low, tenth, high = quantiles(heights, [0.01, 0.1, 0.99])
        floor = np.nanmin(low, initial=np.inf)
        top = np.nanmax(high, initial=-np.inf)
        comes_down = may_stand & (low - floor < ON_THE_FLOOR * (top - floor))
        comes_down &= _times_down(heights, low, high) >= LEAST_TIMES_DOWN
        with np.errstate(invalid="ignore", divide="ignore"):
            flatness = np.sort(((tenth - low) / (high - low))[comes_down])
        found[up] = float(flatness[1]) if len(flatness) > 1 else np.inf
    best, following = sorted(found, key=lambda up: found[up])[:2]
    return best, found[best], found[following]


def _times_down(values: FloatArray, low: FloatArray, high: FloatArray) -> IntArray:
    """Count descents of each column (N, M) from its upper half to its lowest tenth."""
    counts = np.zeros(values.shape[1], dtype=np.int64)
    with np.errstate(invalid="ignore", divide="ignore"):
        level = (values - low) / (high - low)
    for m in np.flatnonzero(high > low):
        is_end = (level[:, m] > 0.5) | (level[:, m] < 0.1)
        is_up = level[is_end, m] > 0.5
        counts[m] = np.count_nonzero(is_up[:-1] & ~is_up[1:])
    return counts
