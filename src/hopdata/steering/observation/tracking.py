"""One frame of markers to pose, boom angle and height, for live use."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import BoolArray, FloatArray
from hopdata.recording import Recording
from hopdata.rigid import RigidFit, headings, rigid_fit, wrapped
from hopdata.steering.observation.geometry import BoomCircle, HopperGeometry

SEEN, LEANED, MISFIT, UNSEEN = "seen", "leaned on an earlier frame", "misfit", "unseen"
STATUSES = (SEEN, LEANED, MISFIT, UNSEEN)
KNOWN = (SEEN, LEANED)  # with a pose

MISFIT_NOISES = 5.0  # residuals beyond so many times the noise are no noise: markers mixed up
BOOM_MISS_M = 0.02
HOLD_S = 0.5  # two markers lean on the attitude of a frame at most so far away


@dataclass(frozen=True)
class Observation:
    """What one frame tells.

    Parameters
    ----------
    pose : (3,) array
        x and y of the mean body marker, m, and yaw of the body x axis, rad; NaN unless known.
    height_m : float
        Height of the mean body marker; NaN unless known.
    boom_angle_rad : float
        In (-pi, pi]; NaN if the pose is not known, the boom marker not seen or off its circle.
    residual_m : float
        What a rigid body leaves over, rms per degree of freedom: near the noise of a coordinate if
        all is well. NaN if nothing could be fitted.
    status : str
        "seen": three or more markers, and they fit. "leaned on an earlier frame": two markers, and
        the turn about their line is that of an earlier frame. "misfit": they do not fit together,
        and nothing is said. "unseen": too few markers.
    rotation : (3, 3) array
        From body axes to the world; NaN unless known.
    """

    pose: FloatArray
    height_m: float
    boom_angle_rad: float
    residual_m: float
    status: str
    rotation: FloatArray

    @property
    def known(self) -> bool:
        """Whether there is a pose."""
        return self.status in KNOWN


def observe_frame(
    geometry: HopperGeometry,
    body: FloatArray,
    boom: FloatArray | None = None,
    earlier: FloatArray | None = None,
) -> Observation:
    """Tell where the hopper is from one frame.

    Parameters
    ----------
    geometry : HopperGeometry
    body : (B, 3) array
        Body markers in the order of `geometry.body_names`, m; NaN where unseen.
    boom : (3,) array, optional
        Boom marker, m; NaN where unseen.
    earlier : (3, 3) array, optional
        Rotation of an earlier frame, to lean on if only two markers are seen.
    """
    fit = rigid_fit(body[None], geometry.body_m, None if earlier is None else earlier[None])
    status, centre, rotation = (part[0] for part in _known(fit, geometry.noise_m))
    pose, angle = np.array([centre[0], centre[1], headings(rotation)]), np.nan
    if boom is not None and geometry.circle is not None:
        angle = float(_angles_on(geometry.circle, (boom - centre) @ rotation))
    return Observation(pose, float(centre[2]), angle, float(fit.residual_m[0]), status, rotation)


def _angles_on(circle: BoomCircle, boom: FloatArray) -> FloatArray:
    """Boom angles of markers (..., 3); NaN where one is off the circle, or not seen."""
    return np.where(circle.misses(boom) < BOOM_MISS_M, circle.angles(boom), np.nan)


class HopperTracker:
    """Follows a hopper frame by frame, with headings that count turns.

    Parameters
    ----------
    geometry : HopperGeometry
    markers : sequence of str
        Names of the markers of the stream, in its order.

    Raises
    ------
    AnalysisError
        If a marker of the geometry is not in the stream.
    """

    def __init__(self, geometry: HopperGeometry, markers: Sequence[str]) -> None:
        self.geometry = geometry
        self._body = geometry.body_places(markers)
        self._boom = geometry.boom_place(markers)
        self._seen_s, self._rotation = -np.inf, np.full((3, 3), np.nan)
        self._heading = 0.0

    def feed(self, time_s: float, markers: FloatArray) -> Observation:
        """Take the next frame: its time, s, and its markers, (M, 3), m, NaN where unseen."""
        earlier = self._rotation if 0 <= time_s - self._seen_s <= HOLD_S else None
        boom = None if self._boom is None else markers[self._boom]
        found = observe_frame(self.geometry, markers[self._body], boom, earlier)
        if not found.known:
            return found
        if found.status == SEEN:
            self._seen_s, self._rotation = time_s, found.rotation
        self._heading += float(wrapped(found.pose[2] - self._heading))
        return replace(found, pose=np.append(found.pose[:2], self._heading))


# Pose, height and boom angle in every frame of a recording.


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


def hopper_motion(recording: Recording, geometry: HopperGeometry) -> HopperMotion:
    """Observe a hopper in all frames of a recording, by laying its geometry over the markers.

    Where two body markers are seen, the turn about their line is that between the frames with more
    before and after, or of the one that is within `HOLD_S`.

    Parameters
    ----------
    recording : Recording
    geometry : HopperGeometry

    Raises
    ------
    AnalysisError
        If a marker of the geometry is not in the recording.
    """
    body = recording.positions[:, geometry.body_places(recording.markers)]
    fit = rigid_fit(body, geometry.body_m)
    fits = fit.known & (fit.residual_m <= MISFIT_NOISES * geometry.noise_m)
    if not fits.all() and fits.any():
        fit = rigid_fit(body, geometry.body_m, _between(recording.time, fit.rotation, fits))
    status, centre, rotation = _known(fit, geometry.noise_m)
    pose = np.column_stack([centre[:, :2], unwrapped(headings(rotation))])
    boom = _boom_angles(recording, geometry, centre, rotation)
    tilt = np.arccos(np.clip(rotation[:, 2, 2], -1, 1))
    return HopperMotion(recording.time, pose, centre[:, 2], boom, fit.residual_m, status, tilt)


def _between(time: FloatArray, rotation: FloatArray, fits: BoolArray) -> FloatArray:
    """Attitude between the frames before and after that fit, (N, 3, 3); NaN beyond `HOLD_S`.

    A line between two rotations is none, but as something to lean on it serves: the rotation
    nearest to it is their mean. It has no step in the middle of a gap, which would be a bottom.
    """
    good = np.flatnonzero(fits)
    place = np.searchsorted(good, np.arange(len(time)))
    before, after = good[(place - 1).clip(0)], good[place.clip(0, len(good) - 1)]
    waits = np.abs(np.stack([time - time[before], time[after] - time]))
    weights = np.where(waits <= HOLD_S, 1.0 / np.maximum(waits, 1e-9), 0.0)
    total = weights.sum(axis=0)
    first, second = weights / np.where(total > 0, total, np.nan)
    return np.asarray(
        first[:, None, None] * rotation[before] + second[:, None, None] * rotation[after]
    )


def _known(fit: RigidFit, noise_m: float) -> tuple[NDArray[np.str_], FloatArray, FloatArray]:
    """Return the status of each frame, centre and rotation; NaN where there is no pose."""
    misfit = fit.residual_m > MISFIT_NOISES * noise_m
    status = np.select([~fit.known, misfit, fit.leaned], [UNSEEN, MISFIT, LEANED], SEEN)
    known = np.isin(status, KNOWN)[:, None]
    centre = np.where(known, fit.centre, np.nan)
    return status, centre, np.where(known[..., None], fit.rotation, np.nan)


def _boom_angles(
    recording: Recording, geometry: HopperGeometry, centre: FloatArray, rotation: FloatArray
) -> FloatArray:
    place = geometry.boom_place(recording.markers)
    if place is None or geometry.circle is None:
        return np.full(len(centre), np.nan)
    boom = np.einsum("nji,nj->ni", rotation, recording.positions[:, place] - centre)
    return unwrapped(_angles_on(geometry.circle, boom))


def unwrapped(angle: FloatArray) -> FloatArray:
    """Unwrap angles (N,) over those that are known."""
    known = np.isfinite(angle)
    result = angle.copy()
    result[known] = np.unwrap(angle[known])
    return result
