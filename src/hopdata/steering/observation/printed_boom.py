"""Boom angle as printed (dissertation, Algorithm 3), with its mistakes put right."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.steering.observation.circle import algebraic_circle
from hopdata.steering.observation.rigid import rigid_fit

FloatArray = NDArray[np.float64]

REST_FRAMES = 40


def printed_boom_angles(
    body: FloatArray, boom: FloatArray, *, rest_frames: int = REST_FRAMES
) -> FloatArray:
    """Return boom angles, (N,), rad, wrapped, with an arbitrary zero and sense.

    The home configuration is the mean over the frames at rest at the beginning, of three body
    markers and a fourth, virtual one across their plane. Circle and angle are in the plane of the
    two leading principal components, by linear least squares. Put right: the fourth marker, the
    determinant of the rotation, the centring, and which component is the normal.

    Parameters
    ----------
    body : (N, 3, 3) array
        Body markers, m; NaN where unseen.
    boom : (N, 3) array
        Boom marker, m.
    rest_frames : int
        How many frames the hopper stands still at first.
    """
    four = np.concatenate([body, _virtual(body)[:, None]], axis=1)
    home = np.nanmean(four[:rest_frames], axis=0)
    fit = rigid_fit(four, home - home.mean(axis=0))
    places = np.einsum("nji,nj->ni", fit.rotation, boom - fit.centre)
    known = np.isfinite(places).all(axis=1)
    centred = places[known] - places[known].mean(axis=0)
    flat = centred @ np.linalg.svd(centred, full_matrices=False)[2][:2].T
    arms = flat - algebraic_circle(flat)[0]
    angles = np.full(len(body), np.nan)
    angles[known] = np.arctan2(arms[:, 1], arms[:, 0])
    return angles


def _virtual(body: FloatArray) -> FloatArray:
    first, second = body[:, 1] - body[:, 0], body[:, 2] - body[:, 0]
    across = np.cross(first, second)
    length = 0.5 * (np.linalg.norm(first, axis=1) + np.linalg.norm(second, axis=1))
    unit = across / np.linalg.norm(across, axis=1, keepdims=True)
    return np.asarray(body[:, 0] + length[:, None] * unit)
