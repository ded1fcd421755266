"""Where the body markers are in the body: from the recording itself, robustly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError
from hopdata.steering.observation.rigid import rigid_fit

FloatArray = NDArray[np.float64]

MOST_FRAMES = 4000
LEAST_FRAMES = 20
ROUNDS = 10
OUTLIER_SIGMAS = 4.0
ON_A_LINE = 0.02  # width of the markers across their line, relative to along it


def marker_shape(markers: FloatArray) -> tuple[FloatArray, float]:
    """Estimate the shape of a rigid set of markers, and the noise.

    It starts from the median distances between markers and is refined by generalised Procrustes
    alignment (Gower 1975) with unseen markers left out. Frames that do not fit, such as those with
    two markers exchanged, are set aside: their residual is beyond four times what is typical.

    Parameters
    ----------
    markers : (N, B, 3) array
        Positions, m; NaN where unseen. B is at least three.

    Returns
    -------
    (B, 3) array
        Positions, m, from their mean; the attitude is arbitrary.
    float
        Standard deviation of the noise per coordinate, m.

    Raises
    ------
    AnalysisError
        If there are too few markers or frames, the markers lie on a line, or of four and more
        hardly ever four are seen at once.
    """
    number = markers.shape[1]
    if number < 3:
        raise AnalysisError(f"body markers: expected at least 3, found {number}")
    frames = _usable(markers)
    shape = _handed(frames, _from_distances(frames))
    kept = frames
    for _ in range(ROUNDS):
        residual = rigid_fit(frames, shape).residual_m
        kept = frames[residual <= OUTLIER_SIGMAS * np.median(residual)]
        shape = _mean_shape(kept, shape)
    residual = rigid_fit(kept, shape).residual_m
    return shape, float(np.sqrt(np.mean(residual**2)))


def _handed(frames: FloatArray, shape: FloatArray) -> FloatArray:
    """Return the shape or its mirror image, which have the same distances."""
    widths = np.linalg.norm(shape, axis=0)
    if widths[2] < ON_A_LINE * widths[0]:
        return shape
    both = [shape, shape * [1, 1, -1]]
    residuals = [float(np.median(rigid_fit(frames, one).residual_m)) for one in both]
    if min(residuals) > 0.5 * max(residuals):
        raise AnalysisError(
            "body markers: expected four off one plane in sight together in most frames, to tell "
            "their shape from its mirror image; found them too seldom"
        )
    return both[int(np.argmin(residuals))]


def _usable(markers: FloatArray) -> FloatArray:
    """Return at most so many frames, evenly taken from those with three markers or more."""
    seen = np.isfinite(markers).all(axis=2)
    usable = np.flatnonzero(seen.sum(axis=1) >= 3)
    together = seen.T.astype(int) @ seen.astype(int)
    if len(usable) < LEAST_FRAMES or together.min() == 0:
        raise AnalysisError(
            f"body markers: expected {LEAST_FRAMES} frames with three of them in sight, and each "
            f"pair in sight together, found {len(usable)} of {len(markers)} frames"
        )
    step = -(-len(usable) // MOST_FRAMES)
    return markers[usable[::step]]


def _from_distances(frames: FloatArray) -> FloatArray:
    """Return a shape with the median distances, by classical scaling (Torgerson 1952)."""
    apart = np.linalg.norm(frames[:, :, None] - frames[:, None], axis=3)
    square = np.nanmedian(apart, axis=0) ** 2
    centring = np.eye(len(square)) - 1.0 / len(square)
    values, vectors = np.linalg.eigh(-0.5 * centring @ square @ centring)
    largest = np.argsort(values)[: -len(square) - 1 : -1][:3]
    width = np.sqrt(np.maximum(values[largest], 0.0))
    if width[1] < ON_A_LINE * width[0]:
        raise AnalysisError("body markers: expected them off one line, found them on it")
    return np.asarray(vectors[:, largest] * width)


def _mean_shape(frames: FloatArray, shape: FloatArray) -> FloatArray:
    fit = rigid_fit(frames, shape)
    known = fit.known
    arms = frames[known] - fit.centre[known, None]
    aligned = np.nanmean(np.einsum("nji,nbj->nbi", fit.rotation[known], arms), axis=0)
    return np.asarray(aligned - aligned.mean(axis=0))
