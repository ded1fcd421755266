"""Visits of a height below a threshold, and what lies between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.gravity import GRAVITY_M_S2
from hopdata.steering.observation.bottoms import side_speeds

FloatArray = NDArray[np.float64]

HOLE_S = 0.3  # without a height for so long, anything may have happened
SIDE_HOLE_S = 0.04
SHORTEST, LONGEST = 0.6, 1.5  # time above the threshold over that of free fall from the apex

HELD, HOLE = "held or carried in between", "heights missing in between"


@dataclass(frozen=True)
class Visits:
    """Visits below one threshold, each before the height is above the other one again.

    Parameters
    ----------
    first, last : (V,) array of int
        Outermost frames below the threshold.
    lowest : (V,) array of int
        The lowest frame.
    after_hole : (V,) bool array
        Whether heights are missing for long between the visit before and this one.
    """

    first: NDArray[np.int64]
    last: NDArray[np.int64]
    lowest: NDArray[np.int64]
    after_hole: NDArray[np.bool_]


def find_visits(time: FloatArray, height: FloatArray, below_m: float, above_m: float) -> Visits:
    """Find the visits below a threshold, with the other one as hysteresis.

    A long hole ends a visit.

    Parameters
    ----------
    time, height : (N,) array
        Frames with a known height; s, m.
    below_m, above_m : float
        The two thresholds.
    """
    side = np.where(height < below_m, -1, np.where(height > above_m, 1, 0))
    outside = np.flatnonzero(side)
    hole = np.cumsum(np.diff(time, prepend=time[:1]) > HOLE_S)[outside]
    low = side[outside] < 0
    begins = low.copy()
    begins[1:] &= ~low[:-1] | (hole[1:] > hole[:-1])
    number = np.cumsum(begins)[low] - 1
    inside = outside[low]
    first = inside[np.flatnonzero(np.diff(number, prepend=-1))]
    last = inside[np.flatnonzero(np.diff(number, append=number[-1:] + 1))]
    lowest = [a + int(np.argmin(height[a : b + 1])) for a, b in zip(first, last, strict=True)]
    holes = np.cumsum(np.diff(time, prepend=time[:1]) > HOLE_S)
    after_hole = np.zeros(len(first), dtype=bool)
    after_hole[1:] = holes[first[1:]] > holes[last[:-1]]
    return Visits(first, last, np.array(lowest, dtype=int), after_hole)


def not_a_hop(
    time: FloatArray, height: FloatArray, leave: int, back: int, above_m: float
) -> str | None:
    """Say why the frames between two visits are no flight; None if they are one.

    The time above the threshold is compared with that of free fall from the apex, which is where
    the height before or after a hole leads if it is higher than all that is seen.

    Parameters
    ----------
    time, height : (N,) array
        Frames with a known height; s, m.
    leave, back : int
        Last frame of one visit and first of the next.
    above_m : float
    """
    high = leave + np.flatnonzero(height[leave : back + 1] > above_m)
    up = _crossing(time, height, int(high[0]) - 1, above_m)
    down = _crossing(time, height, int(high[-1]), above_m)
    top = float(height[high].max())
    for before in high[0] - 1 + np.flatnonzero(np.diff(time[high[0] - 1 : back + 1]) > SIDE_HOLE_S):
        rise, fall = side_speeds(time, height, int(before))
        for speed, frame in ((rise, before), (-fall, before + 1)):
            if speed > 0:
                top = max(top, float(height[frame] + speed**2 / (2 * GRAVITY_M_S2)))
    free = 2 * np.sqrt(2 * (top - above_m) / GRAVITY_M_S2)
    return None if SHORTEST * free <= down - up <= LONGEST * free else HELD


def _crossing(time: FloatArray, height: FloatArray, frame: int, level_m: float) -> float:
    """Time at which a level is crossed between a frame and the next, s."""
    share = (level_m - height[frame]) / (height[frame + 1] - height[frame])
    return float(time[frame] + share * (time[frame + 1] - time[frame]))
