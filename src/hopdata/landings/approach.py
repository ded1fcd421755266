"""Where to look for a contact: the last descent of each foot to its lowest level."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.landings.transitions import Transitions

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LANDED, ALREADY_DOWN, NOT_LANDED, MISSING, POOR_FIT = range(5)
NEAR_FLOOR = 0.15  # of the descent: where a foot counts as nearly down
ON_ITS_WAY = 0.4  # of the descent: from here on its mean speed is taken
LEAST_FRAMES = 5
LEAST_NOISE_M = 5e-5  # no cameras do better; what has no noise is not exactly like the model


def height_noise(heights: FloatArray) -> float:
    """Estimate the standard deviation of the noise of heights (N, n), m.

    From third differences: those of a smooth motion all but vanish, those of white noise have
    variance 20 sigma^2; the median is not moved by the few frames about the contacts. Where only
    every k-th frame is seen they are taken over k frames. Never less than `LEAST_NOISE_M`.
    """
    seen = np.flatnonzero(~np.isnan(heights).all(axis=1))
    step = int(np.median(np.diff(seen))) if len(seen) > 1 else 1
    z0, z1, z2, z3 = (heights[k * step : len(heights) - (3 - k) * step] for k in range(4))
    third = z3 - 3 * z2 + 3 * z1 - z0
    third = np.abs(third[~np.isnan(third)])
    if third.size == 0:
        return float("nan")
    return max(float(np.median(third) / 0.6744897501960817 / np.sqrt(20.0)), LEAST_NOISE_M)


def approaches(
    time: FloatArray,
    heights: FloatArray,
    transitions: Transitions,
    *,
    noise_m: float,
    down_height_m: float,
    lead_s: float,
    trail_s: float,
) -> tuple[FloatArray, IntArray]:
    """Find roughly when each foot came down in each complete transition.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    heights : (N, n) array
        Heights of the feet, m; NaN where unseen.
    transitions : Transitions
        L descents of the body.
    noise_m : float
        Standard deviation of a height, m.
    down_height_m : float
        A foot that never sinks below this height has not landed, m.
    lead_s, trail_s : float
        The search begins so long before the pre section and ends so long after the post section, s.

    Returns
    -------
    near : (L, n) array
        Rough instants, s; NaN where the foot did not come down from above.
    status : (L, n) int array
        `LANDED`, `ALREADY_DOWN`, `NOT_LANDED` or `MISSING`.
    """
    shape = (len(transitions), heights.shape[1])
    near, status = np.full(shape, np.nan), np.full(shape, NOT_LANDED, dtype=np.int64)
    starts = np.searchsorted(time, transitions.t_pre - lead_s)
    stops = np.searchsorted(time, transitions.t_post + trail_s)
    for row in np.flatnonzero(transitions.complete):
        frames = slice(starts[row], stops[row])
        for foot in range(shape[1]):
            near[row, foot], status[row, foot] = _descent(
                time[frames], heights[frames, foot], noise_m, down_height_m
            )
    return near, status


def _descent(
    t: FloatArray, z: FloatArray, noise_m: float, down_height_m: float
) -> tuple[float, int]:
    """Rough instant at which one foot came down within one window, and its status."""
    seen = ~np.isnan(z)
    t, z = t[seen], z[seen]
    if len(z) < LEAST_FRAMES:
        return np.nan, MISSING
    bottom = int(np.argmin(z))
    low, depth = z[bottom], z.max() - z[bottom]
    if low > down_height_m:
        return np.nan, NOT_LANDED
    above = np.flatnonzero(z[:bottom] > low + max(5 * noise_m, NEAR_FLOOR * depth))
    if len(above) == 0:
        return np.nan, ALREADY_DOWN
    last = int(above[-1])
    higher = np.flatnonzero(z[: last + 1] > low + ON_ITS_WAY * depth)
    first = int(higher[-1]) if len(higher) else last
    fall = (z[first] - z[last + 1]) / (t[last + 1] - t[first])
    return float(t[last + 1] + (z[last + 1] - low) / fall), LANDED
