"""Angles and arc lengths between subspaces, many pairs at once.

Björck and Golub (1973): the cosines of the principal angles are the singular values of
``a.T @ b`` and their sines those of ``b - a @ (a.T @ b)``. A cosine near one has lost half the
digits of a small angle, a sine near one those of an angle near a right angle, so each angle is
taken from the form that is good for it. The arc length is the 2-norm of the angles (Edelman,
Arias and Smith 1998, Sec. 4.3), the geodesic distance on the Grassmann manifold.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Arc lengths below this need the sines: an error e in each cosine moves a length d by k e / d.
_SMALL_ARC_LENGTH = 0.5
#: Error of an arc length, rad, above which its pair is computed again by the sine form.
CERTIFIED_ERROR_RAD = 1e-12
#: From so many pairs on the compiled kernel is quicker, with the time that it takes to load.
_MANY_PAIRS = 20_000

Floats = NDArray[np.float64]


def principal_angles(a: Floats, b: Floats) -> Floats:
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


def arc_length(a: Floats, b: Floats) -> Floats:
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
    a, b = np.broadcast_arrays(np.asarray(a, float), np.asarray(b, float))
    shape, each = a.shape[:-2], a.shape[-2:]
    a, b = a.reshape(-1, *each), b.reshape(-1, *each)
    measure = exact_arc_length if len(a) < _MANY_PAIRS else certified_arc_length
    return measure(a, b).reshape(shape)


def certified_arc_length(a: Floats, b: Floats) -> Floats:
    """Return arc lengths of pairs of (R, D, k) bases by the compiled kernel, error below 1e-12.

    The kernel bounds the error of each; pairs that it cannot certify are computed again.
    """
    from hopdata.maps.subspaces.angle_kernel import paired_lengths, workspace

    a, b = np.ascontiguousarray(a, float), np.ascontiguousarray(b, float)
    lengths, bounds = np.zeros(len(a)), np.zeros(len(a))
    paired_lengths(a, b, *workspace(*a.shape[1:]), lengths, bounds)
    again = uncertified(bounds)
    lengths[again] = exact_arc_length(a[again], b[again])
    return lengths


def uncertified(bounds: Floats) -> NDArray[np.bool_]:
    """Return which error bounds are not below `CERTIFIED_ERROR_RAD`; NaN is not."""
    return ~(bounds <= CERTIFIED_ERROR_RAD)


def exact_arc_length(a: Floats, b: Floats) -> Floats:
    """Return arc lengths of pairs of (R, D, k) bases by singular value decompositions.

    Slower than `arc_length`, with an error of a few 1e-15 wherever the angles are.
    """
    cosines = np.linalg.svd(a.swapaxes(-1, -2) @ b, compute_uv=False)
    lengths = np.asarray(np.linalg.norm(np.arccos(np.minimum(cosines, 1)), axis=-1))
    close = lengths < _SMALL_ARC_LENGTH
    if close.any():
        lengths[close] = np.linalg.norm(principal_angles(a[close], b[close]), axis=-1)
    return lengths


def orthonormalised(matrices: Floats) -> Floats:
    """Return orthonormal bases of the column spaces of (..., D, k) matrices of full rank."""
    return np.linalg.qr(np.asarray(matrices, float))[0]


def _ordered(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Return the bases with the wider one first, so that sines and cosines pair up."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    return (a, b) if a.shape[-1] >= b.shape[-1] else (b, a)
