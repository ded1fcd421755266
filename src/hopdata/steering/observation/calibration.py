"""Calibration: the geometry of a hopper from a recording of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError, require_choice
from hopdata.recordings.recording import Recording
from hopdata.steering.observation.boom_circle import fit_boom_circle
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.height_band import height_band
from hopdata.steering.observation.reference import marker_shape
from hopdata.steering.observation.rigid import RigidFit, rigid_fit

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

LEAST_LENGTH_M = 1e-3
LEVELS = ("auto", "feet", "median")
FORWARDS = ("foot", "marker")


def calibrate(
    recording: Recording,
    *,
    level: str = "auto",
    level_s: tuple[float, float] | None = None,
    forward: str = "foot",
    forward_offset_rad: float = 0.0,
) -> HopperGeometry:
    """Find out where the markers are in the body, how the boom moves, and how high it hops.

    Parameters
    ----------
    recording : Recording
        At least three markers with the role "body"; some hops; if it has a marker with the role
        "boom", this moves through 30 degrees or more.
    level : str
        What is level: the plane of the "feet" in free fall, or the attitude in the "median" over
        the recording, which leans if the boom does. "auto" takes the feet if there are three.
    level_s : (float, float), optional
        First and last time of a stretch in which the hopper stands level, s; its median counts.
    forward : str
        Direction of the body x axis: towards the first "foot", from the middle of the feet in
        free fall; or towards the first body "marker", from the middle of these.
    forward_offset_rad : float
        Turn the x axis on from there, counter-clockwise.

    Raises
    ------
    AnalysisError
        If the recording does not suffice; see `marker_shape` and `fit_boom_circle`.
    ConfigError
        If `level` or `forward` is none of their choices.
    """
    require_choice("level", level, LEVELS)
    require_choice("forward", forward, FORWARDS)
    shape, noise_m = marker_shape(recording.body)
    fit = rigid_fit(recording.body, shape)
    below, above = height_band(fit.centre[:, 2])
    feet = _feet(recording, fit, above)
    if level_s is not None:
        up = _median_up(fit, _within(recording, level_s), f"within {level_s} s")
    elif level == "median" or (level == "auto" and len(feet) < 3):
        up = _median_up(fit, fit.known, "of the recording")
    else:
        up = _normal_of(feet, _median_up(fit, fit.known, "of the recording"))
    toward = shape[0] if forward == "marker" else _first_foot(feet)
    axes = _body_axes(up, toward, forward_offset_rad)
    boom_name, circle = None, None
    if recording.indices("boom"):
        boom_name = recording.names("boom")[0]
        boom = recording.positions[:, recording.indices("boom")[0]]
        circle = fit_boom_circle(_in_body(fit, boom) @ axes.T, noise_m)
    return HopperGeometry(
        recording.names("body"), shape @ axes.T, noise_m, below, above, boom_name, circle
    )


def _within(recording: Recording, stretch_s: tuple[float, float]) -> BoolArray:
    return np.asarray((recording.time >= stretch_s[0]) & (recording.time <= stretch_s[1]))


def _in_body(fit: RigidFit, marker: FloatArray) -> FloatArray:
    """Return one marker (N, 3) in the axes of the fit, from its origin."""
    return np.asarray(np.einsum("nji,nj->ni", fit.rotation, marker - fit.centre))


def _feet(recording: Recording, fit: RigidFit, above_m: float) -> FloatArray:
    """Median places (n, 3) of the feet in free fall, in the axes of the fit; NaN if never seen.

    The legs are still drawing back while the hopper rises.
    """
    height = fit.centre[:, 2]
    flying = (height > above_m) & (np.gradient(height, recording.time) < 0)
    places = np.full((len(recording.indices("foot")), 3), np.nan)
    for row, index in zip(places, recording.indices("foot"), strict=True):
        seen = _in_body(fit, recording.positions[:, index])[flying]
        seen = seen[np.isfinite(seen).all(axis=1)]
        if len(seen):
            row[:] = np.median(seen, axis=0)
    return places


def _median_up(fit: RigidFit, frames: BoolArray, where: str) -> FloatArray:
    """Direction that points up in the median over frames, in the axes of the fit."""
    if not (fit.known & frames).any():
        raise AnalysisError(f"level: expected frames {where} with a pose, found none")
    up = np.median(fit.rotation[fit.known & frames, 2], axis=0)
    return np.asarray(up / np.linalg.norm(up))


def _normal_of(feet: FloatArray, up: FloatArray) -> FloatArray:
    """Return the normal of the plane through the feet, on the side of `up`."""
    feet = feet[np.isfinite(feet).all(axis=1)]
    if len(feet) < 3:
        raise AnalysisError(
            f"level: expected at least 3 feet in sight in flight, found {len(feet)}"
        )
    normal = np.linalg.svd(feet - feet.mean(axis=0))[2][2]
    return np.asarray(normal * np.sign(normal @ up))


def _first_foot(feet: FloatArray) -> FloatArray:
    """Return the direction from the middle of the feet to the first."""
    if len(feet) < 2 or not np.isfinite(feet).all():
        raise AnalysisError(
            f"forward: expected at least two foot markers, each seen in flight, found "
            f"{np.isfinite(feet).all(axis=1).sum()} of {len(feet)}"
        )
    return np.asarray(feet[0] - feet.mean(axis=0))


def _body_axes(up: FloatArray, toward: FloatArray, offset_rad: float) -> FloatArray:
    """Body axes as rows, in the axes of the shape."""
    flat = toward - (toward @ up) * up
    if np.linalg.norm(flat) < LEAST_LENGTH_M:
        raise AnalysisError(
            "forward: expected a direction across the vertical, found one along it within 1 mm"
        )
    ahead = flat / np.linalg.norm(flat)
    side = np.cross(up, ahead)
    c, s = np.cos(offset_rad), np.sin(offset_rad)
    return np.stack([c * ahead + s * side, c * side - s * ahead, up])
