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

from hopdata.maps.linear.compensated import centred_product

#: Singular values of the scaled, centred inputs below this share of the largest count as zero.
RANK_TOLERANCE = 1e-11
#: So few rows that no BLAS shares them out to threads, of which the last bits would depend.
_BLOCK_ROWS = 256

Floats = NDArray[np.float64]


def pooled_basis(
    x: Floats, *, rank_tolerance: float = RANK_TOLERANCE, compiled: bool = False
) -> Floats:
    """Return the whitened design of a population: a column of ones, then the input directions.

    Parameters
    ----------
    x
        (n, p) inputs.
    rank_tolerance
        See `RANK_TOLERANCE`.
    compiled
        Whether compiled code is worth loading: see `compensated.centred_product`.

    Returns
    -------
    ndarray
        (n, 1 + rank), columns orthogonal, each of mean square one. It spans the space of the
        inputs to about 1e-15, whatever their condition number.
    """
    x = np.asarray(x, float)
    scale = column_scales(x)
    _, values, right = truncated_svd(_triangle((x - x.mean(0)) / scale), rank_tolerance)
    directions = right.T / values / scale[:, None]
    spread = centred_product(x, x.mean(0), directions, compiled=compiled)
    spread -= spread.mean(0)
    # Already near to orthogonal, so that Cholesky's factor serves as well as a QR.
    factor = np.linalg.cholesky(cross_product(spread, spread) / len(x))
    return np.column_stack([np.ones(len(x)), row_product(spread, np.linalg.inv(factor).T)])


def cross_product(a: Floats, b: Floats) -> Floats:
    """Return ``a.T @ b``, the same bytes on any number of threads."""
    parts = [a[rows].T @ b[rows] for rows in _blocks(len(a))]
    return np.sum(parts, axis=0) if parts else np.zeros((a.shape[1], b.shape[1]))


def row_product(a: Floats, b: Floats) -> Floats:
    """Return ``a @ b``, the same bytes on any number of threads."""
    return np.concatenate([a[:0] @ b, *(a[rows] @ b for rows in _blocks(len(a)))])


def _triangle(matrix: Floats) -> Floats:
    """Return the R of a QR factorisation, from those of blocks of rows."""
    parts = [np.linalg.qr(matrix[rows], mode="r") for rows in _blocks(len(matrix))]
    return np.asarray(np.linalg.qr(np.concatenate([matrix[:0], *parts]), mode="r"))


def _blocks(count: int) -> list[slice]:
    return [slice(first, first + _BLOCK_ROWS) for first in range(0, count, _BLOCK_ROWS)]


def truncated_svd(matrix: Floats, rank_tolerance: float) -> tuple[Floats, Floats, Floats]:
    """Return U, s, Vt without the singular values that count as zero."""
    left, values, right = np.linalg.svd(matrix, full_matrices=False)
    rank = int(np.sum(values > rank_tolerance * values[0])) if values.size else 0
    return left[:, :rank], values[:rank], right[:rank]


def column_scales(x: Floats) -> Floats:
    """Return the sd of each column; infinite where it is constant up to rounding."""
    rounding = 8 * np.finfo(float).eps * np.abs(x).max(axis=0)
    return np.where(np.ptp(x, axis=0) > rounding, x.std(axis=0), np.inf)
