"""From markers to pose, boom angle and height: frame by frame, or a whole recording."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import BoolArray, FloatArray
from hopdata.recording import Recording
from hopdata.rigid import RigidFit, headings, rigid_fit
from hopdata.steering.observation.geometry import BoomCircle, HopperGeometry

SEEN = "seen"
LEANED = "leaned on an earlier frame"
MISFIT = "misfit"
UNSEEN = "unseen"
STATUSES = (SEEN, LEANED, MISFIT, UNSEEN)
KNOWN = (SEEN, LEANED)  # with a pose

#: Largest residual of a rigid body, in noises of a coordinate: larger ones mean that
#: markers are mixed up.
#: Unit: 1. Origin: chosen.
MISFIT_NOISES = 5.0
#: Largest distance of the boom marker from its circle; beyond, it is another marker.
#: Unit: m. Origin: chosen.
BOOM_MISS_M = 0.02
#: Body markers that give a pose on their own.
#: Unit: 1. Origin: derived: three points that are not on a line fix a rigid body.
LEAST_BODY = 3
#: With two markers, the attitude of a frame within this time is used.
#: Unit: s. Origin: chosen.
HOLD_S = 0.5


@dataclass(frozen=True)
class Observation:
    """Observation of one frame.

    Parameters
    ----------
    pose : (3,) array
        x and y of the mean body marker, m, and yaw of the body x axis, rad; NaN unless
        known.
    height_m : float
        Height of the mean body marker; NaN unless known.
    boom_angle_rad : float
        In (-pi, pi]; NaN if the pose is unknown, or the boom marker is unseen or off
        its circle.
    residual_m : float
        Rms residual of the rigid body per degree of freedom, normally close to the
        noise of a coordinate. NaN if nothing could be fitted.
    status : str
        "seen": three or more markers, and they fit. "leaned on an earlier frame": two
        markers; the rotation about the line through them is taken from an earlier
        frame. "misfit": the markers do not fit together, and nothing is estimated.
        "unseen": too few markers.
    rotation : (3, 3) array
        From body axes to the world; NaN if unknown.
    lacking : tuple of str
        What the frame lacks of the markers that are needed, each in words: those of the
        body if fewer than three are seen, and the boom's.
    """

    pose: FloatArray
    height_m: float
    boom_angle_rad: float
    residual_m: float
    status: str
    rotation: FloatArray
    lacking: tuple[str, ...] = ()

    @property
    def state(self) -> tuple[float, ...]:
        """States of the robot that the frame shows; the hopper's is its boom angle."""
        return (self.boom_angle_rad,)

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
    """Estimate the state of the hopper from one frame.

    Parameters
    ----------
    geometry : HopperGeometry
    body : (B, 3) array
        Body markers in the order of `geometry.body_names`, m; NaN where unseen.
    boom : (3,) array, optional
        Boom marker, m; NaN where unseen.
    earlier : (3, 3) array, optional
        Rotation of an earlier frame, used if only two markers are seen.
    """
    earlier_frames = None if earlier is None else earlier[None]
    fit = rigid_fit(body[None], geometry.body_m, earlier_frames)
    statuses, centres, rotations = _poses_of(fit, geometry.noise_m)
    centre = centres[0]
    rotation = rotations[0]
    angle = np.nan
    if boom is not None and geometry.circle is not None:
        angle = float(_angles_on(geometry.circle, (boom - centre) @ rotation))
    return Observation(
        pose=np.array([centre[0], centre[1], headings(rotation)]),
        height_m=float(centre[2]),
        boom_angle_rad=angle,
        residual_m=float(fit.residual_m[0]),
        status=statuses[0],
        rotation=rotation,
    )


def _angles_on(circle: BoomCircle, boom: FloatArray) -> FloatArray:
    """Return boom angles of markers (..., 3); NaN where unseen or off the circle."""
    is_on_it = circle.misses(boom) < BOOM_MISS_M
    return np.where(is_on_it, circle.angles(boom), np.nan)


class HopperTracker:
    """Tracks a hopper frame by frame, with an unwrapped heading.

    Parameters
    ----------
    geometry : HopperGeometry
    markers : sequence of str
        Names of the stream's markers, in order.

    Raises
    ------
    AnalysisError
        If a marker of the geometry is not in the stream.
    """

    def __init__(self, geometry: HopperGeometry, markers: Sequence[str]) -> None:
        self.geometry = geometry
        self._body = geometry.body_places(markers)
        self._boom = geometry.boom_place(markers)
        self._names = tuple(markers)
        # When at least three markers were last seen, and the rotation then.
        self._seen_s = -np.inf
        self._rotation = np.full((3, 3), np.nan)
        self._heading = 0.0
        # Observations of frames to come that need no earlier one, by their markers.
        self._ahead: dict[bytes, Observation] = {}

    def feed(self, time_s: float, markers: FloatArray) -> Observation:
        """Take the next frame.

        Parameters
        ----------
        time_s : float
            Time of the frame, s.
        markers : (M, 3) array
            Its markers, m; NaN where unseen.
        """
        found = self._ahead.pop(markers.tobytes(), None)
        if found is None:
            found = self._observed(time_s, markers)
        if not found.known:
            return found
        if found.status == SEEN:
            self._seen_s = time_s
            self._rotation = found.rotation
        x, y, heading = found.pose.tolist()
        self._heading += (heading - self._heading + math.pi) % math.tau - math.pi
        # `dataclasses.replace` would take three times as long.
        return Observation(
            pose=np.array([x, y, self._heading]),
            height_m=found.height_m,
            boom_angle_rad=found.boom_angle_rad,
            residual_m=found.residual_m,
            status=found.status,
            rotation=found.rotation,
            lacking=found.lacking,
        )

    def fit_ahead(self, markers: FloatArray) -> None:
        """Fit the body to frames that will be fed, all at once, which is much quicker.

        When they are fed, they give what they would have given without this (the boom
        angle but for rounding). Frames that lack a marker are left for then.

        Parameters
        ----------
        markers : (K, M, 3) array
            Markers of K frames, m; NaN where unseen.
        """
        whole = markers[np.isfinite(markers).all(axis=(1, 2))]
        if self._boom is None or self.geometry.circle is None:
            return
        fit = rigid_fit(whole[:, self._body], self.geometry.body_m)
        status, centre, rotation = _poses_of(fit, self.geometry.noise_m)
        arm = whole[:, self._boom] - centre
        in_body = np.einsum("ni,nij->nj", arm, rotation)
        angles = _angles_on(self.geometry.circle, in_body).tolist()
        poses = np.column_stack([centre[:, :2], headings(rotation)])
        heights = centre[:, 2].tolist()
        residuals = fit.residual_m.tolist()
        is_whole = (status == SEEN) & np.isfinite(angles)
        self._ahead = {
            whole[k].tobytes(): Observation(
                pose=poses[k],
                height_m=heights[k],
                boom_angle_rad=angles[k],
                residual_m=residuals[k],
                status=SEEN,
                rotation=rotation[k],
            )
            for k in np.flatnonzero(is_whole).tolist()
        }

    def _observed(self, time_s: float, markers: FloatArray) -> Observation:
        """Observe a frame on its own, or leaning on an earlier one."""
        earlier = None
        if 0 <= time_s - self._seen_s <= HOLD_S:
            earlier = self._rotation
        boom = None if self._boom is None else markers[self._boom]
        found = observe_frame(self.geometry, markers[self._body], boom, earlier)
        return replace(found, lacking=self._lacking(markers, found))

    def _lacking(self, markers: FloatArray, found: Observation) -> tuple[str, ...]:
        """Return which of the markers that are needed a frame does not show."""
        lacking = []
        unseen = [k for k in self._body if np.isnan(markers[k]).any()]
        if len(self._body) - len(unseen) < LEAST_BODY:
            lacking = [f"marker '{self._names[k]}' is not seen" for k in unseen]
        if self._boom is None:
            return tuple(lacking)
        boom = f"marker '{self._names[self._boom]}'"
        if np.isnan(markers[self._boom]).any():
            lacking.append(f"{boom} is not seen")
        elif found.known and np.isnan(found.boom_angle_rad):
            lacking.append(f"{boom} is off the circle of the boom")
        return tuple(lacking)


# Pose, height and boom angle in every frame of a recording.


@dataclass(frozen=True)
class HopperMotion:
    """Observation of N frames; see `Observation` for the meaning of its parts.

    Parameters
    ----------
    time : (N,) array
        s.
    pose : (N, 3) array
        x m, y m, unwrapped heading rad; NaN where unknown.
    height : (N,) array
        Height of the mean body marker, m; NaN where unknown.
    boom_angle_rad : (N,) array
        Unwrapped, rad; NaN where unknown.
    residual : (N,) array
        Rms residual of the rigid body, m.
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
        """Number of frames with each status."""
        return {status: int(np.sum(self.status == status)) for status in STATUSES}


def hopper_motion(recording: Recording, geometry: HopperGeometry) -> HopperMotion:
    """Observe a hopper in all frames of a recording, by fitting its geometry to them.

    Where only two body markers are seen, the rotation about the line through them is
    taken from the frames with more markers before and after, or from one of them,
    within `HOLD_S`.

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
        # Only frames whose own markers leave the rotation open lean on neighbours.
        neighbours = _between(recording.time, fit.rotation, fits)
        fit = rigid_fit(body, geometry.body_m, neighbours)
    status, centre, rotation = _poses_of(fit, geometry.noise_m)
    return HopperMotion(
        time=recording.time,
        pose=np.column_stack([centre[:, :2], unwrapped(headings(rotation))]),
        height=centre[:, 2],
        boom_angle_rad=_boom_angles(recording, geometry, centre, rotation),
        residual=fit.residual_m,
        status=status,
        tilt_rad=np.arccos(np.clip(rotation[:, 2, 2], -1, 1)),
    )


def _between(time: FloatArray, rotation: FloatArray, fits: BoolArray) -> FloatArray:
    """Interpolate the attitude between frames that fit, (N, 3, 3); NaN beyond `HOLD_S`.

    A linear mix of two rotations is not a rotation, but it is good enough to lean on:
    the rotation nearest to it is their weighted mean. It has no step in the middle of a
    gap, which would look like a lowest point.
    """
    good = np.flatnonzero(fits)
    following = np.searchsorted(good, np.arange(len(time)))
    before = good[(following - 1).clip(0)]
    after = good[following.clip(0, len(good) - 1)]
    waits = np.abs(np.stack([time - time[before], time[after] - time]))
    weights = np.where(waits <= HOLD_S, 1.0 / np.maximum(waits, 1e-9), 0.0)
    total = weights.sum(axis=0)
    shares = weights / np.where(total > 0, total, np.nan)
    share_before = shares[0][:, None, None]
    share_after = shares[1][:, None, None]
    return np.asarray(share_before * rotation[before] + share_after * rotation[after])


def _poses_of(
    fit: RigidFit, noise_m: float
) -> tuple[NDArray[np.str_], FloatArray, FloatArray]:
    """Return the status of each frame, its centre and its rotation.

    Centre and rotation are NaN where the status says that there is no pose.
    """
    misfit = fit.residual_m > MISFIT_NOISES * noise_m
    # The first that applies counts.
    status = np.select([~fit.known, misfit, fit.leaned], [UNSEEN, MISFIT, LEANED], SEEN)
    known = np.isin(status, KNOWN)
    centre = np.where(known[:, None], fit.centre, np.nan)
    rotation = np.where(known[:, None, None], fit.rotation, np.nan)
    return status, centre, rotation


def _boom_angles(
    recording: Recording,
    geometry: HopperGeometry,
    centre: FloatArray,
    rotation: FloatArray,
) -> FloatArray:
    """Return the unwrapped boom angle of each frame, rad; NaN where unknown."""
    index = geometry.boom_place(recording.markers)
    if index is None or geometry.circle is None:
        return np.full(len(centre), np.nan)
    arm = recording.positions[:, index] - centre
    in_body = np.einsum("nji,nj->ni", rotation, arm)
    return unwrapped(_angles_on(geometry.circle, in_body))


def unwrapped(angle: FloatArray) -> FloatArray:
    """Unwrap angles (N,), ignoring those that are NaN."""
    known = np.isfinite(angle)
    result = angle.copy()
    result[known] = np.unwrap(angle[known])
    return result
