"""Pose, height and boom angle in every frame of a recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.recordings.recording import Recording
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.rigid import RigidFit, headings, rigid_fit
from hopdata.steering.observation.tracking import (
    BOOM_MISS_M,
    HOLD_S,
    LEANED,
    MISFIT,
    MISFIT_NOISES,
    SEEN,
    STATUSES,
    UNSEEN,
)

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class HopperMotion:
    """What N frames tell; see `tracking.Observation` for the meaning of its parts.

    Parameters
    ----------
    time : (N,) array
        s.
    pose : (N, 3) array
        x m, y m, heading rad, which is not wrapped; NaN where unknown.
    height : (N,) array
        Height of the mean body marker, m; NaN where unknown.
    boom_angle_rad : (N,) array
        rad, not wrapped; NaN where unknown.
    residual : (N,) array
        m.
    status : (N,) array of str
    tilt_rad : (N,) array
        Angle between the body's z axis and the vertical, rad; NaN where unknown.
    """

    time: FloatArray
    pose: FloatArray
    height: FloatArray
    boom_angle_rad: FloatArray
    residual: FloatArray
    status: NDArray[np.str_]
    tilt_rad: FloatArray

    @property
    def counts(self) -> dict[str, int]:
        """How many frames have each status."""
        return {status: int(np.sum(self.status == status)) for status in STATUSES}


def hopper_motion(
    recording: Recording, geometry: HopperGeometry, *, hold_s: float = HOLD_S
) -> HopperMotion:
    """Observe a hopper in all frames of a recording, by laying its geometry over the markers.

    Parameters
    ----------
    recording : Recording
    geometry : HopperGeometry
    hold_s : float
        Where two body markers are seen, the turn about their line is that between the frames
        with more before and after, or of the one that is within this time, s.

    Raises
    ------
    AnalysisError
        If a marker of the geometry is not in the recording.
    """
    body = recording.positions[:, geometry.body_places(recording.markers)]
    fit = rigid_fit(body, geometry.body_m)
    fits = fit.known & (fit.residual_m <= MISFIT_NOISES * geometry.noise_m)
    if not fits.all() and fits.any():
        fit = rigid_fit(body, geometry.body_m, _between(recording.time, fit.rotation, fits, hold_s))
    status = _statuses(fit, geometry.noise_m)
    known = (status == SEEN) | (status == LEANED)
    centre = np.where(known[:, None], fit.centre, np.nan)
    heading = _unwrapped(np.where(known, headings(fit.rotation), np.nan))
    return HopperMotion(
        recording.time,
        np.column_stack([centre[:, :2], heading]),
        centre[:, 2],
        _boom_angles(recording, geometry, centre, fit.rotation),
        fit.residual_m,
        status,
        np.where(known, np.arccos(np.clip(fit.rotation[:, 2, 2], -1, 1)), np.nan),
    )


def _between(time: FloatArray, rotation: FloatArray, fits: BoolArray, hold_s: float) -> FloatArray:
    """Attitude between the frames before and after that fit, (N, 3, 3); NaN beyond `hold_s`.

    A line between two rotations is none, but as something to lean on it serves: the rotation
    nearest to it is their mean. It has no step in the middle of a gap, which would be a bottom.
    """
    good = np.flatnonzero(fits)
    place = np.searchsorted(good, np.arange(len(time)))
    before, after = good[(place - 1).clip(0)], good[place.clip(0, len(good) - 1)]
    waits = np.abs(np.stack([time - time[before], time[after] - time]))
    weights = np.where(waits <= hold_s, 1.0 / np.maximum(waits, 1e-9), 0.0)
    total = weights.sum(axis=0)
    first, second = weights / np.where(total > 0, total, np.nan)
    return np.asarray(
        first[:, None, None] * rotation[before] + second[:, None, None] * rotation[after]
    )


def _statuses(fit: RigidFit, noise_m: float) -> NDArray[np.str_]:
    bad = fit.residual_m > MISFIT_NOISES * noise_m
    return np.select([~fit.known, bad, fit.leaned], [UNSEEN, MISFIT, LEANED], SEEN)


def _boom_angles(
    recording: Recording, geometry: HopperGeometry, centre: FloatArray, rotation: FloatArray
) -> FloatArray:
    place = geometry.boom_place(recording.markers)
    if place is None or geometry.circle is None:
        return np.full(len(centre), np.nan)
    boom = np.einsum("nji,nj->ni", rotation, recording.positions[:, place] - centre)
    on_circle = geometry.circle.misses(boom) < BOOM_MISS_M
    return _unwrapped(np.where(on_circle, geometry.circle.angles(boom), np.nan))


def _unwrapped(angle: FloatArray) -> FloatArray:
    """Unwrap angles (N,) over those that are known."""
    known = np.isfinite(angle)
    result = angle.copy()
    result[known] = np.unwrap(angle[known])
    return result
