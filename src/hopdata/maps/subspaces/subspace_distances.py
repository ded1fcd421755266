"""The distances between subspaces that Edelman, Arias and Smith (1998, Sec. 4.3) collate.

All are functions of the principal angles. In the names of that paper; others call the chordal
F-norm the Procrustes distance (the least ``norm(a q - b)`` over rotations q), the projection F-norm
the chordal distance, and the projection 2-norm the gap.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def arc_length_of(angles: Floats) -> Floats:
    """Return the geodesic distance, the 2-norm of the angles, rad."""
    return _norm(angles)


def fubini_study(angles: Floats) -> Floats:
    """Return the angle between the subspaces' exterior products, acos of the product of cosines.

    From ``1 - prod(cos^2)`` by logarithms, so that small angles keep their digits.
    """
    with np.errstate(divide="ignore"):  # a right angle: minus infinity, of which exp is zero
        logarithm = np.sum(np.log1p(-(np.sin(angles) ** 2)), axis=-1)
    return np.arctan2(np.sqrt(-np.expm1(logarithm)), np.exp(logarithm / 2))


def chordal_2(angles: Floats) -> Floats:
    """Return the least 2-norm of the difference of two orthonormal bases."""
    return np.asarray(2 * np.sin(angles.max(axis=-1) / 2))


def chordal_f(angles: Floats) -> Floats:
    """Return the least Frobenius norm of the difference of two orthonormal bases (Procrustes)."""
    return 2 * _norm(np.sin(angles / 2))


def projection_2(angles: Floats) -> Floats:
    """Return the 2-norm of the difference of the projections, the sine of the largest angle."""
    return np.asarray(np.sin(angles.max(axis=-1)))


def projection_f(angles: Floats) -> Floats:
    """Return the Frobenius norm of the difference of the projections over the root of two."""
    return _norm(np.sin(angles))


#: Name -> function of (..., k) principal angles in rad, as `.grassmann` finds them.
DISTANCES: dict[str, Callable[[Floats], Floats]] = {
    "arc_length": arc_length_of,
    "chordal_f": chordal_f,
    "projection_f": projection_f,
    "fubini_study": fubini_study,
    "chordal_2": chordal_2,
    "projection_2": projection_2,
}


def _norm(values: Floats) -> Floats:
    return np.asarray(np.linalg.norm(values, axis=-1))
