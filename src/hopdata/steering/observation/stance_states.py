"""Pose and boom angle of each stance: what the frame changes are made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import ConfigError
from hopdata.recordings.recording import Recording
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.local_fits import local_fit
from hopdata.steering.observation.motion import HopperMotion, hopper_motion
from hopdata.steering.observation.stances import Stances, find_stances

FloatArray = NDArray[np.float64]

POSE_HALF_S = 0.035  # half the window of the fit to the poses
BOOM_S = 0.11  # the dissertation's 11 frames at 100 Hz
LEAST_BOOM_FRAMES = 3


@dataclass(frozen=True)
class StanceStates:
    """States of K stances.

    Parameters
    ----------
    time_s : (K,) array
    pose : (K, 3) array
        x m, y m, heading rad, which is not wrapped; NaN where unknown.
    boom_angle_rad : (K,) array
        rad, not wrapped; NaN where unknown.
    pairs : (P, 2) array of int
        Stances that are a hop apart.
    tilt_rad : (K,) array
        Tilt in the frame of the stance, rad; NaN where unknown.
    """

    time_s: FloatArray
    pose: FloatArray
    boom_angle_rad: FloatArray
    pairs: NDArray[np.int64]
    tilt_rad: FloatArray


def observe_stances(recording: Recording, geometry: HopperGeometry) -> StanceStates:
    """Find the stances of a recording and their states; the defaults of all steps."""
    motion = hopper_motion(recording, geometry)
    band = (geometry.stance_below_m, geometry.flight_above_m)
    return stance_states(motion, find_stances(motion.time, motion.height, band))


def stance_states(
    motion: HopperMotion,
    stances: Stances,
    *,
    pose_half_s: float = POSE_HALF_S,
    boom_s: float = BOOM_S,
) -> StanceStates:
    """Return the states at stances.

    The pose is that of a parabola through the frames near the lowest point. The boom angle is the
    median over a while from the stance on, in which the boom stands still (footnote 4 of chapter
    III); it is unknown with fewer than three frames.

    Parameters
    ----------
    motion : HopperMotion
    stances : Stances
    pose_half_s : float
        Half the window of the parabola, s; 0 takes the pose of the nearest frame, as printed.
    boom_s : float
        How long after the stance the boom angle is taken, s.

    Raises
    ------
    ConfigError
        If one of the times is negative.
    """
    for name, value in (("pose_half_s", pose_half_s), ("boom_s", boom_s)):
        if value < 0:
            raise ConfigError(f"{name}: expected >= 0, found {value}")
    return StanceStates(
        stances.time_s,
        _poses(motion, stances, pose_half_s),
        _boom_angles(motion, stances, boom_s),
        stances.pairs,
        motion.tilt_rad[stances.frame],
    )


def _poses(motion: HopperMotion, stances: Stances, half_s: float) -> FloatArray:
    if half_s == 0:
        return motion.pose[stances.frame]
    known = np.isfinite(motion.pose).all(axis=1)
    time, pose = motion.time[known], motion.pose[known]
    poses = motion.pose[stances.frame]  # where a parabola wants frames
    for row, instant in zip(poses, stances.time_s, strict=True):
        fit = local_fit(time, pose, instant - half_s, instant + half_s, degree=2)
        if fit is not None and fit.first_s < instant < fit.last_s:
            row[:] = fit.at(instant)
    return poses


def _boom_angles(motion: HopperMotion, stances: Stances, boom_s: float) -> FloatArray:
    begin = motion.time[stances.frame]
    first = np.searchsorted(motion.time, begin, side="right")
    last = np.searchsorted(motion.time, begin + boom_s + 1e-9, side="right")
    medians = np.full(len(begin), np.nan)
    for k, (i, j) in enumerate(zip(first, last, strict=True)):
        angles = motion.boom_angle_rad[i:j]
        angles = angles[np.isfinite(angles)]
        if len(angles) >= LEAST_BOOM_FRAMES:
            medians[k] = np.median(angles)
    return medians
