"""Stance pairs as printed (dissertation, Algorithm 4), with its mistakes put right or not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import require_choice

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

WINDOW, ORDER = 7, 3
EXTREMA_OF = ("height", "speed")


def printed_stance_pairs(height: FloatArray, *, extrema_of: str = "height") -> IntArray:
    """Return frames of consecutive stances, (P, 2).

    Candidates are the extrema of the height, where the speed of a Savitzky-Golay filter passes
    zero; literally printed are the extrema of that speed. Stances lie more than a standard
    deviation below the mean height, flights as far above. Of several stance candidates without a
    flight between them, the lowest counts. Frames with an unknown height are bridged by straight
    lines first, which is not printed.

    Parameters
    ----------
    height : (N,) array
        m, at a constant frame rate; NaN where unknown.
    extrema_of : str
        "height", or "speed" as printed.
    """
    from scipy.signal import savgol_filter

    require_choice("extrema_of", extrema_of, EXTREMA_OF)
    frames, known = np.arange(len(height)), np.isfinite(height)
    z = np.interp(frames, frames[known], height[known])
    low, high = z.mean() - z.std(), z.mean() + z.std()
    falling = savgol_filter(z, WINDOW, ORDER, deriv=1 if extrema_of == "height" else 2) < 0
    turn = np.diff(falling.astype(int))
    stances, flights = np.flatnonzero(turn < 0) + 1, np.flatnonzero(turn > 0) + 1
    if extrema_of == "height":
        stances = _merged(stances, flights[z[flights] > high], z)
    return _paired(stances, flights, z, low, high)


def _merged(stances: IntArray, flights: IntArray, z: FloatArray) -> IntArray:
    """Return the lowest of the stances between two flights."""
    group = np.searchsorted(flights, stances)
    return np.array(
        [min(stances[group == one], key=lambda k: z[k]) for one in np.unique(group)], dtype=int
    )


def _paired(
    stances: IntArray, flights: IntArray, z: FloatArray, low: float, high: float
) -> IntArray:
    """Pair each low stance with that after the next flight, if both are far enough from the mean.

    With merged stances, a low rise in a stance must not pass for the flight: only high ones count.
    """
    pairs = []
    for first in stances[z[stances] < low]:
        flight = flights[flights > first][:1]
        last = stances[stances > flight[0]][:1] if flight.size and z[flight[0]] > high else []
        if len(last) and z[last[0]] < low:
            pairs.append((first, last[0]))
    return np.array(pairs, dtype=int).reshape(-1, 2)
