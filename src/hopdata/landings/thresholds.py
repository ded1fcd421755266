"""Thresholds of foot height: the upper knees of the ground modes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hopdata.landings.contact_frames import Heights
from hopdata.landings.modes import GroundMode, ground_mode
from hopdata.recordings.recording import Recording

LEAST_KNEE_M = 3e-4  # above the mode: no floor is known better, even without noise


@dataclass(frozen=True)
class Thresholds:
    """Heights that tell a foot on the ground from one in the air.

    Parameters
    ----------
    ground_m : float
        Ground mode of the heights of all feet together, m.
    min_foot_mode, max_foot_mode : GroundMode
        Ground mode of the lowest and of the highest foot. With noise they lie below and above
        the ground.
    min_foot_m : float
        Height of the lowest foot above which all feet are up, m.
    max_foot_m : float
        Height of the highest foot above which some foot is up, m.
    min_foot_excess_m, max_foot_excess_m : float
        How far above the ground a foot may be and still count as down, m; zero for a threshold
        that was given, which is taken at its word.
    """

    ground_m: float
    min_foot_mode: GroundMode
    max_foot_mode: GroundMode
    min_foot_m: float
    max_foot_m: float
    min_foot_excess_m: float
    max_foot_excess_m: float


def select_thresholds(
    recordings: Sequence[Recording],
    heights: Sequence[Heights],
    *,
    sigmas: float,
    bandwidth_m: float | None,
    min_foot_m: float | None,
    max_foot_m: float | None,
) -> Thresholds:
    """Take the upper knees of the two ground modes, or the thresholds given.

    Parameters
    ----------
    recordings, heights : sequence
        Recordings above the floor, and the heights in them.
    sigmas : float
        Deviations of the left flank from a mode to its knee.
    bandwidth_m : float or None
        Bandwidth for the place of the modes, m; None for one from the data.
    min_foot_m, max_foot_m : float or None
        Thresholds to use instead, m.
    """
    lowest = np.concatenate([h.min_foot for h in heights])
    highest = np.concatenate([h.max_foot for h in heights])
    every = np.concatenate([r.feet[:, :, 2].ravel() for r in recordings])
    min_mode = ground_mode(lowest, bandwidth_m=bandwidth_m)
    max_mode = ground_mode(highest, bandwidth_m=bandwidth_m)
    ground_m = ground_mode(every, bandwidth_m=bandwidth_m).height_m
    min_knee, max_knee = (
        max(mode.knee(sigmas), mode.height_m + LEAST_KNEE_M) for mode in (min_mode, max_mode)
    )
    return Thresholds(
        ground_m=ground_m,
        min_foot_mode=min_mode,
        max_foot_mode=max_mode,
        min_foot_m=min_knee if min_foot_m is None else min_foot_m,
        max_foot_m=max_knee if max_foot_m is None else max_foot_m,
        min_foot_excess_m=max(min_knee - ground_m, 0.0) if min_foot_m is None else 0.0,
        max_foot_excess_m=max(max_knee - ground_m, 0.0) if max_foot_m is None else 0.0,
    )
