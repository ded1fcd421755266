"""Orthonormal bases of the inputs of a population, true to the last digits of the data.

The inputs of a landing are nearly or exactly rank-deficient (three rigid markers on a section
have 18 coordinates and at most 11 degrees of freedom). A singular value decomposition finds the
directions, but each only up to rounding of the largest one. So the directions are kept and the
coordinates along them are computed again, with products in twice the digits: what is left of the
error no longer grows with the condition number of the inputs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Singular values of the scaled, centred inputs below this share of the largest count as zero.
RANK_TOLERANCE = 1e-11

Floats = NDArray[np.float64]


def pooled_basis(x: Floats, *, rank_tolerance: float = RANK_TOLERANCE) -> Floats:
    """Return the whitened design of a population: a column of ones, then the input directions.

    Parameters
    ----------
    x
        (n, p) inputs.
    rank_tolerance
        See `RANK_TOLERANCE`.

    Returns
    -------
    ndarray
        (n, 1 + rank), columns orthogonal, each of mean square one. It spans the space of the
        inputs to about 1e-15, whatever their condition number.
    """
    from hopdata.maps.compensated import centred_product

    x = np.asarray(x, float)
    scale = column_scales(x)
    triangle: Floats = np.linalg.qr((x - x.mean(0)) / scale, mode="r")  # type: ignore[assignment]
    _, values, right = truncated_svd(triangle, rank_tolerance)
    spread = centred_product(x, x.mean(0), right.T / values / scale[:, None])
    spread -= spread.mean(0)
    # Already near to orthogonal, so that Cholesky's factor serves as well as a QR.
    factor = np.linalg.cholesky(spread.T @ spread / len(x))
    return np.column_stack([np.ones(len(x)), spread @ np.linalg.inv(factor).T])


def truncated_svd(matrix: Floats, rank_tolerance: float) -> tuple[Floats, Floats, Floats]:
    """Return U, s, Vt without the singular values that count as zero."""
    left, values, right = np.linalg.svd(matrix, full_matrices=False)
    rank = int(np.sum(values > rank_tolerance * values[0])) if values.size else 0
    return left[:, :rank], values[:rank], right[:rank]


def column_scales(x: Floats) -> Floats:
    """Return the sd of each column; infinite where it is constant up to rounding."""
    rounding = 8 * np.finfo(float).eps * np.abs(x).max(axis=0)
    return np.where(np.ptp(x, axis=0) > rounding, x.std(axis=0), np.inf)
