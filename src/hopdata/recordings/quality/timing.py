"""Time stamps: frames that were dropped, steps that are irregular or run back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.recordings.quality.runs import IntArray

FloatArray = NDArray[np.float64]

IRREGULAR = 0.2  # of a frame: a step further from the median than this, but not by whole frames


@dataclass(frozen=True)
class Timing:
    """What the time stamps say.

    Parameters
    ----------
    rate_hz : float
        Rate by the median step, Hz; NaN with fewer than two frames.
    drops : (K, 2) array
        Frame (from 0) after which frames are missing, and how many.
    irregular : (J,) array
        Frames whose step to the next is irregular: neither one frame nor several whole ones.
    backward : (L,) array
        Frames whose next time stamp is not later.
    jitter_s : float
        Largest deviation of the other steps from the median, s.
    """

    rate_hz: float
    drops: IntArray
    irregular: IntArray
    backward: IntArray
    jitter_s: float

    @property
    def n_dropped(self) -> int:
        """Number of frames that are missing between the stamps."""
        return int(self.drops[:, 1].sum())


def check_stamps(time: FloatArray) -> Timing:
    """Judge (N,) time stamps, s, by their own median step."""
    steps = np.diff(time)
    forward = steps[steps > 0]
    if not len(forward):
        none = np.zeros(0, dtype=np.int64)
        return Timing(np.nan, none.reshape(0, 2), none, np.flatnonzero(steps <= 0), np.nan)
    step = float(np.median(forward))
    frames = steps / step
    whole = np.round(frames)
    is_forward = steps > 0
    on_grid = np.abs(frames - whole) <= IRREGULAR
    dropped = np.flatnonzero(is_forward & on_grid & (whole > 1))
    regular = is_forward & on_grid & (whole == 1)
    return Timing(
        rate_hz=1 / step,
        drops=np.column_stack([dropped, whole[dropped].astype(np.int64) - 1]),
        irregular=np.flatnonzero(is_forward & ~on_grid),
        backward=np.flatnonzero(~is_forward),
        jitter_s=float(np.abs(steps[regular] - step).max(initial=0.0)),
    )
