"""The lowest point of a stance, between frames, and also where frames are missing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.steering.observation.local_fits import local_fit

FloatArray = NDArray[np.float64]

BOTTOM_S = 0.045  # half the window of the fit at the lowest point
SIDE_S = 0.05  # window of the fit beside a hole
WIDEST_HOLE_FRAMES = 3.5  # beside the lowest point, for the fit through it
LONGEST_BRIDGE_S = 0.2
LEAST_BEND_M_S2 = 5.0  # half of g: a floor throws back harder than a hand lifts

BOTTOM_UNSEEN, NO_BOUNCE = "lowest point not seen", "no bounce"


@dataclass(frozen=True)
class Bottom:
    """A lowest point: its instant, s, its height, m, and whether it fell into a hole."""

    time_s: float
    height_m: float
    bridged: bool = False


def find_bottom(time: FloatArray, height: FloatArray, lowest: int, frame_s: float) -> Bottom | str:
    """Find the lowest point near the lowest frame, or say why it is none.

    It is the minimum of a cubic through the frames there. If too many of these are missing, it is
    where the speed passes zero, on a line from its value before the hole to that after it. Either
    way the acceleration must be half of g at least.

    Parameters
    ----------
    time, height : (N,) array
        Frames with a known height; s, m.
    lowest : int
        Number of the lowest one.
    frame_s : float
        Time between frames, s.
    """
    begin, end = time[lowest] - BOTTOM_S, time[lowest] + BOTTOM_S
    first, last = np.searchsorted(time, [begin - 1e-9, end + 1e-9])
    waits = np.diff(np.concatenate([[begin], time[first:last], [end]]))
    fit = local_fit(time, height, begin, end, degree=3)
    if fit is None or waits.max() > WIDEST_HOLE_FRAMES * frame_s:
        return _bridged(time, height, lowest)
    instant = fit.lowest()
    if instant is None or fit.at(instant, 2) < LEAST_BEND_M_S2:
        return NO_BOUNCE
    return Bottom(instant, float(fit.at(instant)))


def _bridged(time: FloatArray, height: FloatArray, lowest: int) -> Bottom | str:
    """Find the lowest point in the widest hole beside the lowest frame."""
    if lowest == 0 or lowest == len(time) - 1:
        return BOTTOM_UNSEEN
    before = (
        lowest - 1 if time[lowest] - time[lowest - 1] > time[lowest + 1] - time[lowest] else lowest
    )
    out_s, in_s = time[before], time[before + 1]
    if in_s - out_s > LONGEST_BRIDGE_S:
        return BOTTOM_UNSEEN
    fall, rise = side_speeds(time, height, before)
    if not (fall < 0 < rise):
        return BOTTOM_UNSEEN
    if (rise - fall) / (in_s - out_s) < LEAST_BEND_M_S2:
        return NO_BOUNCE
    after = (in_s - out_s) * fall / (fall - rise)
    return Bottom(float(out_s + after), float(height[before] + 0.5 * fall * after), bridged=True)


def side_speeds(time: FloatArray, height: FloatArray, before: int) -> tuple[float, float]:
    """Speed in the last frame before a hole and in the first after it, m/s; NaN if unknown."""
    speeds = []
    for frame, begin, end in ((before, -SIDE_S, 0.0), (before + 1, 0.0, SIDE_S)):
        at = time[frame]
        fit = local_fit(time, height, at + begin, at + end, degree=2) or local_fit(
            time, height, at + begin, at + end, degree=1
        )
        speeds.append(float("nan") if fit is None else float(fit.at(at, 1)))
    return speeds[0], speeds[1]
