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
from hopdata.steering.frame_changes import (
    FrameChanges,
    StanceStates,
    frame_changes,
    joined,
)
from hopdata.steering.observation.calibration import algebraic_circle, calibrate
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.stances import Stances, find_stances, local_fit
from hopdata.steering.observation.tracking import HopperMotion, hopper_motion, unwrapped

# Pose and boom angle at each stance, from which the frame changes are computed.

POSE_HALF_S = 0.035  # half-width of the window of the fit to the poses
BOOM_S = 0.11  # the dissertation's 11 frames at 100 Hz
LEAST_BOOM_FRAMES = 3


def observe_stances(recording: Recording, geometry: HopperGeometry) -> StanceStates:
    """Find the stances of a recording and their states, with the defaults of all steps."""
    return stance_states(*_seen(recording, geometry))


def _seen(
    recording: Recording, geometry: HopperGeometry
) -> tuple[HopperMotion, Stances]:
    motion = hopper_motion(recording, geometry)
    band = (geometry.stance_below_m, geometry.flight_above_m)
    return motion, find_stances(motion.time, motion.height, band)


def stance_states(motion: HopperMotion, stances: Stances) -> StanceStates:
    """Return the states at stances.

    The pose is read from a parabola through the frames near the lowest point. The boom
    angle is the median over a short time after the stance, in which the boom is at rest
    (footnote 4 of chapter III); it is unknown with fewer than three frames.
    """
    pose, boom = _poses(motion, stances), _boom_angles(motion, stances)
    return StanceStates(
        stances.time_s, pose, boom, stances.pairs, motion.tilt_rad[stances.frame]
    )


def _poses(motion: HopperMotion, stances: Stances) -> FloatArray:
    known = np.isfinite(motion.pose).all(axis=1)
    time, pose = motion.time[known], motion.pose[known]
    poses = motion.pose[stances.frame]  # fallback where the parabola lacks frames
    for row, instant in zip(poses, stances.time_s, strict=True):
        fit = local_fit(
            time, pose, instant - POSE_HALF_S, instant + POSE_HALF_S, degree=2
        )
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


# Observation as printed (Algorithms 2 to 4), with its slips corrected: taken literally
# it finds no hop at all.

REST_FRAMES = 40  # first frames, whose mean is the home configuration


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
    return np.column_stack(
        [middle.real, middle.imag, unwrapped(np.angle(phasors @ ratios))]
    )


def printed_boom_angles(body: FloatArray, boom: FloatArray) -> FloatArray:
    """Return boom angles, (N,), rad, wrapped, with an arbitrary zero and sense (Algorithm 3).

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
    first, second = body[:, 1] - body[:, 0], body[:, 2] - body[:, 0]
    across, arms = np.cross(first, second), np.linalg.norm([first, second], axis=2)
    length = arms.mean(axis=0) / np.linalg.norm(across, axis=1)
    four = np.concatenate(
        [body, (body[:, 0] + length[:, None] * across)[:, None]], axis=1
    )
    home = np.nanmean(four[:REST_FRAMES], axis=0)
    fit = rigid_fit(four, home - home.mean(axis=0))
    places = np.einsum("nji,nj->ni", fit.rotation, boom - fit.centre)
    known = np.isfinite(places).all(axis=1)
    places -= places[known].mean(axis=0)
    flat = places @ np.linalg.svd(places[known], full_matrices=False)[2][:2].T
    x, y = (flat - algebraic_circle(flat[known])[0]).T
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

    frames, known = np.arange(len(height)), np.isfinite(height)
    z = np.interp(frames, frames[known], height[known])
    low, high = z.mean() - z.std(), z.mean() + z.std()
    turn = np.diff((savgol_filter(z, 7, 3, deriv=derivative) < 0).astype(int))
    stances, flights = np.flatnonzero(turn < 0) + 1, np.flatnonzero(turn > 0) + 1
    group = np.searchsorted(flights[z[flights] > high], stances)
    order = np.lexsort([z[stances], group])
    stances = stances[order][np.unique(group[order], return_index=True)[1]]
    z, end = (
        np.append(z, np.nan),
        len(z),
    )  # a sentinel after the last frame, neither low nor high
    flight = np.append(flights, end)[np.searchsorted(flights, stances)]
    last = np.append(stances, end)[np.searchsorted(stances, flight)]
    paired = (z[stances] < low) & (z[flight] > high) & (z[last] < low)
    return np.column_stack([stances, last])[paired]


def _as_printed(
    recording: Recording, motion: HopperMotion
) -> tuple[HopperMotion, Stances, StanceStates]:
    """Return the motion, its stances and their states, with poses of single frames.

    The print leaves the zeros and senses of the angles open; they are taken from
    `motion`.
    """
    poses, boom = (
        phasor_poses(recording.body),
        recording.positions[:, recording.indices("boom")[0]],
    )
    poses[:, 2] = _alike(poses[:, 2], motion.pose[:, 2])
    angles = _alike(
        printed_boom_angles(recording.body[:, :3], boom), motion.boom_angle_rad
    )
    motion = replace(
        motion, pose=poses, boom_angle_rad=angles, tilt_rad=np.nan * motion.tilt_rad
    )
    frames, pairs = np.unique(
        printed_stance_pairs(recording.body_height), return_inverse=True
    )
    at = (
        motion.time[frames],
        motion.height[frames],
        frames,
        np.zeros(len(frames), dtype=bool),
    )
    stances = Stances(*at, pairs.reshape(-1, 2), {})
    return motion, stances, replace(stance_states(motion, stances), pose=poses[frames])


def _alike(angle: FloatArray, other: FloatArray) -> FloatArray:
    """Return angles (N,) with the sense and zero that best match the other angles."""
    off = {sense: np.nanmean(np.exp(1j * (other - sense * angle))) for sense in (1, -1)}
    sense = max(off, key=lambda one: abs(off[one]))
    return unwrapped(sense * angle + np.angle(off[sense]))


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
    """Observe pose, boom angle and stances of recordings, and collect their frame changes.

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
        wanted = "a marker with the role boom (markers.boom), on whose angle the frame changes depend"
        raise AnalysisError.at(
            recording.name, wanted, f"only {', '.join(recording.markers)}"
        )
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
    tables = _stance_table(name, stances, states), _motion_table(name, motion)
    return Observed(geometry, changes, *tables, [counts])


def _stance_table(name: str, stances: Stances, states: StanceStates) -> pd.DataFrame:
    x, y, heading = states.pose.T
    follows = np.zeros(len(stances.time_s), dtype=bool)
    follows[stances.pairs[:, 1]] = True
    return pd.DataFrame(
        {
            "recording": name, "frame": stances.frame, "time_s": stances.time_s,
            "height_m": stances.height_m, "x_m": x, "y_m": y, "heading_rad": heading,
            "boom_angle_rad": states.boom_angle_rad, "tilt_rad": states.tilt_rad,
            "follows": follows
        }
    )  # fmt: skip


def _motion_table(name: str, motion: HopperMotion) -> pd.DataFrame:
    x, y, heading = motion.pose.T
    return pd.DataFrame(
        {
            "recording": name, "time_s": motion.time, "x_m": x, "y_m": y, "heading_rad": heading,
            "height_m": motion.height, "boom_angle_rad": motion.boom_angle_rad,
            "residual_m": motion.residual, "status": motion.status
        }
    )  # fmt: skip
