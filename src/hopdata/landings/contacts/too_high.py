"""Contacts at which the foot is still too high, by its own speed there, to touch.

A leg may slow a foot in late swing, some centimetres above the floor, on which the foot
falls on. That is below the bound of `hopdata.landings.contacts.approach`, which knows
only how fast the foot was at its fastest. What a foot on the floor still sinks is what
skin gives, and its own speed times the time in which the softest contact yields.
Everything here is of an animal of 1 m.
"""

from __future__ import annotations

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.landings.contacts import approach, glides
from hopdata.landings.contacts.falls_on import STOPS_S


def low_enough_from(
    time: FloatArray, height: FloatArray, contact_s: float, noise_m: float
) -> float | None:
    """Return when a foot (N,) is first low enough to touch, s, if not at a contact.

    None if the foot is low enough at `contact_s` (s), or is not seen to sink on. The
    floor is at height 0, and `noise_m` (m) is the standard deviation of a height.
    """
    begin, end = np.searchsorted(time, [contact_s, contact_s + STOPS_S])
    seen = np.isfinite(height)
    after = seen[begin:end]
    frames_m = height[begin:end][after]
    frames_m = frames_m[: glides.stays_until(frames_m)]
    if len(frames_m) < 2:
        return None
    # Between two frames about a kink a height is not known: from the first one on.
    at_s = time[begin:end][after][: len(frames_m)]
    before_m = np.interp(at_s - approach.SOFTEST_S, time[seen], height[seen])
    # Below the floor a marker only tilts, as a toe's when the heel comes down.
    lowest_m = max(frames_m.min(), 0.0) + glides.LOWEST_SIGMAS * noise_m
    may_sink_m = approach.SKIN_M + np.maximum(before_m - frames_m, 0.0)
    too_high_m = frames_m - lowest_m - may_sink_m
    sinks_m = frames_m[0] - lowest_m
    if too_high_m[0] <= 0 or sinks_m < glides.BOUNCE_SHARE * glides.rises(frames_m):
        return None
    # The lowest frame is never too high.
    low = int(np.argmax(too_high_m <= 0))
    share = too_high_m[low - 1] / (too_high_m[low - 1] - too_high_m[low])
    return float(at_s[low - 1] + share * (at_s[low] - at_s[low - 1]))
