"""From recordings with a moving boom to the table of frame changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, IntArray, one_blas_thread, pd
from hopdata.errors import AnalysisError
from hopdata.recording import Recording
from hopdata.rigid import rigid_fit
from hopdata.steering import CORRECTED, PRINTED
from hopdata.steering.frame_changes import FrameChanges, StanceStates, frame_changes
from hopdata.steering.observation.calibration import algebraic_circle, calibrate
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.stances import Stances, find_stances, local_fit
from hopdata.steering.observation.tracking import HopperMotion, hopper_motion, unwrapped
from hopdata.steering.strides import joined

# Pose and boom angle at each stance, from which the frame changes are computed.

#: Half the window of the parabola that the pose of a stance is read from.
#: Unit: s. Origin: chosen.
POSE_HALF_S = 0.035
#: Time after a stance in which the boom is at rest and its angle is read.
#: Unit: s. Origin: table: the dissertation's 11 frames at 100 Hz (chapter III, note 4).
BOOM_S = 0.11
#: Least frames in that time for the boom angle to be known.
#: Unit: 1. Origin: chosen.
LEAST_BOOM_FRAMES = 3


def observe_stances(recording: Recording, geometry: HopperGeometry) -> StanceStates:
    """Find the stances of a recording and their states, with the default steps."""
    motion, stances = _seen(recording, geometry)
    return stance_states(motion, stances)


def _seen(
    recording: Recording, geometry: HopperGeometry
) -> tuple[HopperMotion, Stances]:
    motion = hopper_motion(recording, geometry)
    return motion, find_stances(motion.time, motion.height, geometry)


def stance_states(motion: HopperMotion, stances: Stances) -> StanceStates:
    """Return the states at stances.

    The pose is read from a parabola through the frames near the lowest point. The boom
    angle is the median over a short time after the stance, in which the boom is at rest
    (footnote 4 of chapter III); it is unknown with fewer than three frames.
    """
    return StanceStates(
        time_s=stances.time_s,
        pose=_poses(motion, stances),
        boom_angle_rad=_boom_angles(motion, stances),
        pairs=stances.pairs,
        tilt_rad=motion.tilt_rad[stances.frame],
    )


def _poses(motion: HopperMotion, stances: Stances) -> FloatArray:
    """Return the pose at each stance; where frames lack, that of the nearest frame."""
    known = np.isfinite(motion.pose).all(axis=1)
    time = motion.time[known]
    pose = motion.pose[known]
    poses = motion.pose[stances.frame]
    for row, instant in zip(poses, stances.time_s, strict=True):
        begin = instant - POSE_HALF_S
        end = instant + POSE_HALF_S
        fit = local_fit(time, pose, begin, end, degree=2)
        if fit is not None and fit.first_s < instant < fit.last_s:
            row[:] = fit.at(instant)
    return poses


def _boom_angles(motion: HopperMotion, stances: Stances) -> FloatArray:
    """Return the median boom angle after each stance, rad; NaN where unknown."""
    begin = motion.time[stances.frame]
    first = np.searchsorted(motion.time, begin, side="right")
    last = np.searchsorted(motion.time, begin + BOOM_S + 1e-9, side="right")
    medians = np.full(len(begin), np.nan)
    for k, (i, j) in enumerate(zip(first, last, strict=True)):
        angles = motion.boom_angle_rad[i:j]
        known = angles[np.isfinite(angles)]
        if len(known) >= LEAST_BOOM_FRAMES:
            medians[k] = np.median(known)
    return medians


# Observation as printed (Algorithms 2 to 4), with its slips corrected: taken literally
# it finds no hop at all.

#: First frames, whose mean is the home configuration.
#: Unit: 1. Origin: chosen.
REST_FRAMES = 40


# The printed filter of the heights: cubics through seven frames.
PRINTED_WINDOW = 7
PRINTED_DEGREE = 3


def phasor_poses(body: FloatArray) -> FloatArray:
    """Return poses by complex phasors, (N, 3): x m, y m, heading rad (Algorithm 2).

    Each marker is a complex number relative to the mean of all. Multiplying each by the
    mean ratio of the first to it turns all onto the first, and the heading is the angle
    of their sum; its zero is close to the direction of the first marker. The method
    treats the body as flat: tilt shortens some phasors more than others. One slip is
    corrected: the pose is the mean itself, not the markers relative to it. Any number
    of markers will do; a frame is unknown (NaN) unless all are seen.

    Parameters
    ----------
    body : (N, B, 3) array
        Body markers, m; NaN where unseen.
    """
    places = body[..., 0] + 1j * body[..., 1]
    middle = places.mean(axis=1)
    phasors = places - middle[:, None]
    with np.errstate(invalid="ignore"):
        ratios = np.nanmean(phasors[:, :1] / phasors, axis=0)
    heading = unwrapped(np.angle(phasors @ ratios))
    return np.column_stack([middle.real, middle.imag, heading])


def printed_boom_angles(body: FloatArray, boom: FloatArray) -> FloatArray:
    """Return boom angles, (N,), rad, wrapped, with any zero and sense (Algorithm 3).

    The home configuration is the mean over the first frames of three body markers and a
    fourth, virtual one normal to their plane. Circle and angle are found in the plane
    of the two leading principal components, by linear least squares. These slips are
    corrected: the fourth marker, the determinant of the rotation, the centring, and
    which component is the normal.

    Parameters
    ----------
    body : (N, 3, 3) array
        Body markers, m; NaN where unseen.
    boom : (N, 3) array
        Boom marker, m.
    """
    first_arm = body[:, 1] - body[:, 0]
    second_arm = body[:, 2] - body[:, 0]
    across = np.cross(first_arm, second_arm)
    lengths = np.linalg.norm([first_arm, second_arm], axis=2)
    # The virtual marker is as far from the first as the other two are on average.
    scale = lengths.mean(axis=0) / np.linalg.norm(across, axis=1)
    virtual = body[:, 0] + scale[:, None] * across
    four = np.concatenate([body, virtual[:, None]], axis=1)
    home = np.nanmean(four[:REST_FRAMES], axis=0)
    fit = rigid_fit(four, home - home.mean(axis=0))
    in_body = np.einsum("nji,nj->ni", fit.rotation, boom - fit.centre)
    known = np.isfinite(in_body).all(axis=1)
    in_body -= in_body[known].mean(axis=0)
    components = np.linalg.svd(in_body[known], full_matrices=False)[2]
    flat = in_body @ components[:2].T
    centre, _ = algebraic_circle(flat[known])
    x, y = (flat - centre).T
    return np.arctan2(y, x)


def printed_stance_pairs(height: FloatArray, *, derivative: int = 1) -> IntArray:
    """Return frames of consecutive stances, (P, 2) (Algorithm 4).

    Candidates are the extrema of the height, where the speed from a Savitzky-Golay
    filter (cubics through seven frames) crosses zero; the print literally says the
    extrema of that speed. Stances are more than a standard deviation below the mean
    height, flights more than one above. Of several stance candidates without a flight
    between them, the lowest counts. Unknown heights are first interpolated linearly,
    which the print does not mention.

    Parameters
    ----------
    height : (N,) array
        Height, m, at a constant frame rate; NaN where unknown.
    derivative : int
        Order of the derivative of the height that crosses zero: 1, or 2 as literally
        printed.
    """
    from scipy.signal import savgol_filter

    frames = np.arange(len(height))
    known = np.isfinite(height)
    heights = np.interp(frames, frames[known], height[known])
    low = heights.mean() - heights.std()
    high = heights.mean() + heights.std()
    speed = savgol_filter(heights, PRINTED_WINDOW, PRINTED_DEGREE, deriv=derivative)
    turns = np.diff((speed < 0).astype(int))
    minima = np.flatnonzero(turns < 0) + 1
    maxima = np.flatnonzero(turns > 0) + 1
    flights = maxima[heights[maxima] > high]
    stances = _lowest_between(minima, heights, flights)
    # A sentinel after the last frame, neither low nor high.
    end = len(heights)
    heights = np.append(heights, np.nan)
    flight = np.append(maxima, end)[np.searchsorted(maxima, stances)]
    following = np.append(stances, end)[np.searchsorted(stances, flight)]
    is_hop = (
        (heights[stances] < low) & (heights[flight] > high) & (heights[following] < low)
    )
    return np.column_stack([stances, following])[is_hop]


def _lowest_between(
    frames: IntArray, heights: FloatArray, flights: IntArray
) -> IntArray:
    """Return the lowest of the frames before, between and after flights."""
    group = np.searchsorted(flights, frames)
    order = np.lexsort([heights[frames], group])
    first_of_group = np.unique(group[order], return_index=True)[1]
    return np.asarray(frames[order][first_of_group])


def _as_printed(
    recording: Recording, motion: HopperMotion
) -> tuple[HopperMotion, Stances, StanceStates]:
    """Return the motion, its stances and their states, with poses of single frames.

    The print leaves the zeros and senses of the angles open; they are taken from
    `motion`.
    """
    boom = recording.positions[:, recording.indices("boom")[0]]
    boom_angles = printed_boom_angles(recording.body[:, :3], boom)
    poses = phasor_poses(recording.body)
    poses[:, 2] = _alike(poses[:, 2], motion.pose[:, 2])
    printed = replace(
        motion,
        pose=poses,
        boom_angle_rad=_alike(boom_angles, motion.boom_angle_rad),
        tilt_rad=np.nan * motion.tilt_rad,
    )
    pairs = printed_stance_pairs(recording.body_height)
    frames, stance_of = np.unique(pairs, return_inverse=True)
    stances = Stances(
        time_s=printed.time[frames],
        height_m=printed.height[frames],
        frame=frames,
        bridged=np.zeros(len(frames), dtype=bool),
        pairs=stance_of.reshape(-1, 2),
        rejected={},
    )
    states = stance_states(printed, stances)
    return printed, stances, replace(states, pose=poses[frames])


def _alike(angle: FloatArray, other: FloatArray) -> FloatArray:
    """Return angles (N,) with the sense and zero that best match the other angles."""
    # The mean phasor of the differences is the longer, the less they scatter.
    same = np.nanmean(np.exp(1j * (other - angle)))
    opposite = np.nanmean(np.exp(1j * (other + angle)))
    if abs(opposite) > abs(same):
        return unwrapped(-angle + np.angle(opposite))
    return unwrapped(angle + np.angle(same))


@dataclass(frozen=True)
class Observed:
    """Stances and frame changes observed in recordings.

    Parameters
    ----------
    geometry : HopperGeometry
        Geometry of the first recording, which live use starts from.
    changes : FrameChanges
        Hops of all recordings, including those not used.
    stances, motion : DataFrame
        One row per stance, and one row per frame, of all recordings.
    counts : list of mappings
        For each recording: frames by status, stances, hops, and what was left out, by
        reason.
    """

    geometry: HopperGeometry
    changes: FrameChanges
    stances: pd.DataFrame
    motion: pd.DataFrame
    counts: list[dict[str, Any]]


@one_blas_thread()
def observe_recordings(
    recordings: Sequence[Recording],
    *,
    swing_limit_rad: float,
    observation: str = CORRECTED,
) -> Observed:
    """Observe pose, boom angle and stances, and collect the frame changes.

    Parameters
    ----------
    recordings : sequence of Recording
        Each is calibrated separately, since markers may have been attached anew.
    swing_limit_rad : float
        Largest commanded swing.
    observation : {"corrected", "printed"}

    Raises
    ------
    AnalysisError
        If a recording, which is named, has no boom marker or cannot be calibrated.
    """
    parts = [
        _observed(recording, swing_limit_rad, observation) for recording in recordings
    ]
    return Observed(
        geometry=parts[0].geometry,
        changes=joined(part.changes for part in parts),
        stances=pd.concat([part.stances for part in parts], ignore_index=True),
        motion=pd.concat([part.motion for part in parts], ignore_index=True),
        counts=[count for part in parts for count in part.counts],
    )


def _observed(
    recording: Recording, swing_limit_rad: float, observation: str
) -> Observed:
    if not recording.indices("boom"):
        wanted = (
            "a marker with the role boom (markers.boom), on whose angle the frame "
            "changes depend"
        )
        found = f"only {', '.join(recording.markers)}"
        raise AnalysisError.at(recording.name, wanted, found)
    try:
        geometry = calibrate(recording)
    except AnalysisError as error:
        raise AnalysisError(f"{recording.name}: {error}") from None
    motion, stances = _seen(recording, geometry)
    states = stance_states(motion, stances)
    if observation == PRINTED:
        motion, stances, states = _as_printed(recording, motion)
    name = recording.name
    changes = frame_changes(states, swing_limit_rad=swing_limit_rad, recording=name)
    counts = {
        "recording": name,
        "frames": motion.counts,
        "stances": len(stances.time_s),
        "pairs": len(stances.pairs),
        "rejected": stances.rejected,
        "used": len(changes.used()),
        "excluded": changes.excluded(),
    }
    return Observed(
        geometry=geometry,
        changes=changes,
        stances=_stance_table(name, stances, states),
        motion=_motion_table(name, motion),
        counts=[counts],
    )


def _stance_table(name: str, stances: Stances, states: StanceStates) -> pd.DataFrame:
    follows = np.zeros(len(stances.time_s), dtype=bool)
    follows[stances.pairs[:, 1]] = True
    return pd.DataFrame(
        {
            "recording": name,
            "frame": stances.frame + 1,
            "time_s": stances.time_s,
            "height_m": stances.height_m,
            "x_m": states.pose[:, 0],
            "y_m": states.pose[:, 1],
            "heading_rad": states.pose[:, 2],
            "boom_angle_rad": states.boom_angle_rad,
            "tilt_rad": states.tilt_rad,
            "follows": follows,
        }
    )


def _motion_table(name: str, motion: HopperMotion) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "recording": name,
            "time_s": motion.time,
            "x_m": motion.pose[:, 0],
            "y_m": motion.pose[:, 1],
            "heading_rad": motion.pose[:, 2],
            "height_m": motion.height,
            "boom_angle_rad": motion.boom_angle_rad,
            "residual_m": motion.residual,
            "status": motion.status,
        }
    )
