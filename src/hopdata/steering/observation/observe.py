"""From recordings in which the boom moves to the table of frame changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import FloatArray, one_blas_thread, pd
from hopdata.errors import AnalysisError
from hopdata.recording import Recording
from hopdata.steering.frame_changes import FrameChanges, frame_changes, joined
from hopdata.steering.observation.calibration import calibrate
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.stances import Stances, find_stances, local_fit
from hopdata.steering.observation.tracking import HopperMotion, hopper_motion

# Pose and boom angle of each stance: what the frame changes are made of.

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
    return stance_states(*_seen(recording, geometry))


def _seen(recording: Recording, geometry: HopperGeometry) -> tuple[HopperMotion, Stances]:
    motion = hopper_motion(recording, geometry)
    band = (geometry.stance_below_m, geometry.flight_above_m)
    return motion, find_stances(motion.time, motion.height, band)


def stance_states(motion: HopperMotion, stances: Stances) -> StanceStates:
    """Return the states at stances.

    The pose is that of a parabola through the frames near the lowest point. The boom angle is the
    median over a while from the stance on, in which the boom stands still (footnote 4 of chapter
    III); it is unknown with fewer than three frames.
    """
    return StanceStates(
        stances.time_s,
        _poses(motion, stances),
        _boom_angles(motion, stances),
        stances.pairs,
        motion.tilt_rad[stances.frame],
    )


def _poses(motion: HopperMotion, stances: Stances) -> FloatArray:
    known = np.isfinite(motion.pose).all(axis=1)
    time, pose = motion.time[known], motion.pose[known]
    poses = motion.pose[stances.frame]  # where a parabola wants frames
    for row, instant in zip(poses, stances.time_s, strict=True):
        fit = local_fit(time, pose, instant - POSE_HALF_S, instant + POSE_HALF_S, degree=2)
        if fit is not None and fit.first_s < instant < fit.last_s:
            row[:] = fit.at(instant)
    return poses


def _boom_angles(motion: HopperMotion, stances: Stances) -> FloatArray:
    begin = motion.time[stances.frame]
    first = np.searchsorted(motion.time, begin, side="right")
    last = np.searchsorted(motion.time, begin + BOOM_S + 1e-9, side="right")
    medians = np.full(len(begin), np.nan)
    for k, (i, j) in enumerate(zip(first, last, strict=True)):
        angles = motion.boom_angle_rad[i:j]
        angles = angles[np.isfinite(angles)]
        if len(angles) >= LEAST_BOOM_FRAMES:
            medians[k] = np.median(angles)
    return medians


@dataclass(frozen=True)
class Observed:
    """What the recordings tell.

    Parameters
    ----------
    geometry : HopperGeometry
        Of the first recording; live use begins with it.
    changes : FrameChanges
        Hops of all recordings, those not used included.
    stances, motion : DataFrame
        One row a stance, and one row a frame, of all recordings.
    counts : list of mappings
        Frames by status, stances, hops, and what was left out with its reason, by recording.
    """

    geometry: HopperGeometry
    changes: FrameChanges
    stances: pd.DataFrame
    motion: pd.DataFrame
    counts: list[dict[str, Any]]


@one_blas_thread()
def observe_recordings(recordings: Sequence[Recording], *, swing_limit_rad: float) -> Observed:
    """Observe pose, boom angle and stances, and collect the frame changes.

    Parameters
    ----------
    recordings : sequence of Recording
        Each is calibrated by itself: markers may have been glued anew.
    swing_limit_rad : float
        Largest swing that was commanded.

    Raises
    ------
    AnalysisError
        If a recording has no boom marker, or cannot be calibrated; it is named.
    """
    parts = [_observed(recording, swing_limit_rad) for recording in recordings]
    return Observed(
        geometry=parts[0].geometry,
        changes=joined(part.changes for part in parts),
        stances=pd.concat([part.stances for part in parts], ignore_index=True),
        motion=pd.concat([part.motion for part in parts], ignore_index=True),
        counts=[count for part in parts for count in part.counts],
    )


def _observed(recording: Recording, swing_limit_rad: float) -> Observed:
    if not recording.indices("boom"):
        raise AnalysisError(
            f"{recording.name}: expected a marker with the role boom (markers.boom), on whose "
            f"angle the frame changes depend, found only {', '.join(recording.markers)}"
        )
    try:
        geometry = calibrate(recording)
    except AnalysisError as error:
        raise AnalysisError(f"{recording.name}: {error}") from None
    motion, stances = _seen(recording, geometry)
    states = stance_states(motion, stances)
    changes = frame_changes(
        states.time_s,
        states.pose,
        states.boom_angle_rad,
        states.pairs,
        swing_limit_rad=swing_limit_rad,
        recording=recording.name,
        tilts_rad=states.tilt_rad,
    )
    return Observed(
        geometry,
        changes,
        _stance_table(recording.name, stances, states),
        _motion_table(recording.name, motion),
        [_counts(recording.name, motion, stances, changes)],
    )


def _counts(
    name: str, motion: HopperMotion, stances: Stances, changes: FrameChanges
) -> dict[str, Any]:
    return {
        "recording": name,
        "frames": motion.counts,
        "stances": len(stances.time_s),
        "pairs": len(stances.pairs),
        "rejected": stances.rejected,
        "used": len(changes.used()),
        "excluded": changes.excluded(),
    }


def _stance_table(name: str, stances: Stances, states: StanceStates) -> pd.DataFrame:
    x, y, heading = states.pose.T
    follows = np.zeros(len(stances.time_s), dtype=bool)
    follows[stances.pairs[:, 1]] = True
    return pd.DataFrame(
        {
            "recording": name, "frame": stances.frame, "time_s": stances.time_s,
            "height_m": stances.height_m, "x_m": x, "y_m": y, "heading_rad": heading,
            "boom_angle_rad": states.boom_angle_rad, "tilt_rad": states.tilt_rad,
            "follows": follows,
        }
    )  # fmt: skip


def _motion_table(name: str, motion: HopperMotion) -> pd.DataFrame:
    x, y, heading = motion.pose.T
    return pd.DataFrame(
        {
            "recording": name, "time_s": motion.time, "x_m": x, "y_m": y, "heading_rad": heading,
            "height_m": motion.height, "boom_angle_rad": motion.boom_angle_rad,
            "residual_m": motion.residual, "status": motion.status,
        }
    )  # fmt: skip
