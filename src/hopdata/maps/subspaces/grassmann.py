"""Angles and arc lengths between subspaces, many pairs at once.

Björck and Golub (1973): the cosines of the principal angles are the singular values of
``a.T @ b`` and their sines those of ``b - a @ (a.T @ b)``. A cosine near one has lost half the
digits of a small angle, a sine near one those of an angle near a right angle, so each angle is
taken from the form that is good for it. The arc length is the 2-norm of the angles (Edelman,
Arias and Smith 1998, Sec. 4.3), the geodesic distance on the Grassmann manifold.
"""

from __future__ import annotations

import numpy as np

from hopdata.arrays import FloatArray

#: Arc lengths below this need the sines: an error e in each cosine moves a length d by k e / d.
_SMALL_ARC_LENGTH = 0.5


def principal_angles(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the principal angles between subspaces.

    Parameters
    ----------
    a, b
        (..., D, k) and (..., D, m) orthonormal bases; leading axes broadcast.

    Returns
    -------
    ndarray
        (..., min(k, m)) angles in rad, increasing, in [0, pi/2]; absolute error a few 1e-16 times
        the departure of the bases from orthonormality.
    """
    a, b = _ordered(a, b)
    overlap = a.swapaxes(-1, -2) @ b
    cosines = np.linalg.svd(overlap, compute_uv=False)
    sines = np.linalg.svd(b - a @ overlap, compute_uv=False)[..., ::-1]
    small = cosines**2 > 0.5
    return np.where(small, np.arcsin(np.minimum(sines, 1)), np.arccos(np.minimum(cosines, 1)))


def arc_length(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the arc-length (geodesic) distance between subspaces, in rad.

    Parameters
    ----------
    a, b
        (..., D, k) orthonormal bases of equal shape.

    Returns
    -------
    ndarray
        (...) distances in [0, sqrt(k) pi/2]; absolute error below 1e-12.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    cosines = np.linalg.svd(a.swapaxes(-1, -2) @ b, compute_uv=False)
    lengths = np.asarray(np.linalg.norm(np.arccos(np.minimum(cosines, 1)), axis=-1))
    close = lengths < _SMALL_ARC_LENGTH
    if close.any():
        a, b = (np.broadcast_to(part, (*lengths.shape, *part.shape[-2:])) for part in (a, b))
        lengths[close] = np.linalg.norm(principal_angles(a[close], b[close]), axis=-1)
    return lengths


def orthonormalised(matrices: FloatArray) -> FloatArray:
    """Return orthonormal bases of the column spaces of (..., D, k) matrices of full rank."""
    return np.linalg.qr(np.asarray(matrices, float))[0]


def _ordered(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the bases with the wider one first, so that sines and cosines pair up."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    return (a, b) if a.shape[-1] >= b.shape[-1] else (b, a)


# What distances between subspaces are without any data: equal but noisy, or unrelated ones.


def noised_identity(
    generator: np.random.Generator, shape: tuple[int, int], count: int, noise_sd: float
) -> FloatArray:
    """Return arc lengths of `count` pairs of (D, k) identities with normal noise on each entry.

    The dissertation compares with "noised identical matrices ... with a signal-to-noise ratio of
    10" (Sec. 2.3) and does not say what is noised or how the ratio is counted. Of all ways to read
    it, noise of sd 0.1 on every entry of both gives distances like the printed ones.
    """
    noise = noise_sd * generator.standard_normal((2, count, *shape))
    return arc_length(*orthonormalised(np.eye(*shape) + noise))


def random(generator: np.random.Generator, shape: tuple[int, int], count: int) -> FloatArray:
    """Return arc lengths of `count` pairs of uniform (Haar) random subspaces."""
    return arc_length(*orthonormalised(generator.standard_normal((2, count, *shape))))
