"""Where an unseen body marker must be, from the others on the same rigid body."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

LEAST_SEEN = 3  # other markers that a place is told from
LEAST_FRAMES = 20  # with the whole body, to learn its shape from
SAMPLE_FRAMES = 4000
LARGEST_GAIN = 4.0  # of the noise of the seen markers, in the place of the unseen one
LARGEST_MISFIT = 4.0  # of the seen markers to the shape, in the rms misfit of the whole body
ALIGNMENTS = 5


@dataclass(frozen=True)
class BodyShape:
    """A rigid body as its markers show it.

    Parameters
    ----------
    points : (B, 3) array
        Mean places of the markers in the body, centred, m.
    misfit_m : float
        Rms distance per degree of freedom by which markers leave the shape: their noise, and what
        the body bends.
    """

    points: FloatArray
    misfit_m: float


def learn_shape(body: FloatArray) -> BodyShape | None:
    """Learn the shape of a body from the frames in which all of it is seen.

    Generalised Procrustes alignment without scaling (Gower 1975), over at most `SAMPLE_FRAMES`.

    Parameters
    ----------
    body : (N, B, 3) array
        Body markers, m; NaN where unseen.

    Returns
    -------
    BodyShape or None
        None with fewer than four markers or than `LEAST_FRAMES` frames with the whole body.
    """
    n_markers = body.shape[1]
    whole = body[np.isfinite(body).all(axis=(1, 2))]
    if n_markers <= LEAST_SEEN or len(whole) < LEAST_FRAMES:
        return None
    frames = whole[:: -(-len(whole) // SAMPLE_FRAMES)]
    points = frames[0] - frames[0].mean(axis=0)
    for _ in range(ALIGNMENTS):
        rotation, place = align(points, frames)
        inside = np.einsum("nji,nbj->nbi", rotation, frames - place[:, None])
        points = np.median(inside, axis=0)
        points -= points.mean(axis=0)
    return BodyShape(points, float(np.median(_misfits(points, frames))))


def align(points: FloatArray, frames: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations (N, 3, 3) and places (N, 3) that bring `points` (m, 3) nearest to frames (N, m, 3).

    Least squares (Kabsch 1976); a frame is about rotation @ point + place.
    """
    middle, centre = points.mean(axis=0), frames.mean(axis=1)
    u, _, vt = np.linalg.svd(np.einsum("mi,nmj->nij", points - middle, frames - centre[:, None]))
    handed = np.ones((len(frames), 3))
    handed[:, 2] = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    rotation = np.swapaxes((u * handed[:, None, :]) @ vt, 1, 2)
    return rotation, centre - rotation @ middle


def rigid_places(body: FloatArray, wanted: BoolArray, shape: BodyShape) -> FloatArray:
    """Places of the wanted markers, from those seen in the same frame.

    Parameters
    ----------
    body : (N, B, 3) array
        Body markers, m; NaN where unseen.
    wanted : (N, B) bool array
        Which to place; none of them is seen.
    shape : BodyShape
        Of the same markers.

    Returns
    -------
    (N, B, 3) array
        m; NaN where not wanted, where fewer than three others are seen or they lie too near a line
        to tell the place, and where they do not fit the shape.
    """
    places = np.full(body.shape, np.nan)
    seen = np.asarray(np.isfinite(body).all(axis=2))
    for frames, present in _patterns(seen, np.asarray(wanted.any(axis=1))):
        points = shape.points[present]
        rotation, at = align(points, body[frames][:, present])
        fits = _misfits(points, body[frames][:, present]) <= LARGEST_MISFIT * shape.misfit_m
        for marker in np.flatnonzero(~present):
            if noise_gain(points, shape.points[marker]) > LARGEST_GAIN:
                continue
            use = fits & wanted[frames, marker]
            places[frames[use], marker] = rotation[use] @ shape.points[marker] + at[use]
    return places


def noise_gain(points: FloatArray, target: FloatArray) -> float:
    """Return the worst standard deviation of a placed marker, per unit of the others' noise.

    From the six small motions that `points` (m, 3) fix, carried to `target` (3,); infinite if the
    points lie on a line.
    """
    design = np.concatenate([_motions(point) for point in points])
    scale = np.repeat([1.0, max(float(np.abs(points).max()), 1e-9)], 3)
    _, values, right = np.linalg.svd(design / scale, full_matrices=False)
    if values[-1] < 1e-6 * values[0]:
        return float("inf")
    return float(np.linalg.norm(_motions(target) / scale @ (right.T / values), 2))


def _motions(point: FloatArray) -> FloatArray:
    """Displacement of a point by small shifts and turns of the body, (3, 6)."""
    x, y, z = point
    return np.hstack([np.eye(3), [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]])


def _misfits(points: FloatArray, frames: FloatArray) -> FloatArray:
    """Rms of what is left after alignment, per degree of freedom, (N,), m."""
    rotation, place = align(points, frames)
    left = frames - np.einsum("nij,mj->nmi", rotation, points) - place[:, None]
    result: FloatArray = np.sqrt((left**2).sum(axis=(1, 2)) / (3 * len(points) - 6))
    return result


def _patterns(seen: BoolArray, frames: BoolArray) -> Iterator[tuple[NDArray[np.int64], BoolArray]]:
    """Frames that show the same markers, at least three of them, with which these are."""
    chosen = np.flatnonzero(frames & (seen.sum(axis=1) >= LEAST_SEEN))
    patterns, which = np.unique(seen[chosen], axis=0, return_inverse=True)
    for k, present in enumerate(patterns):
        yield chosen[which.reshape(-1) == k], present
