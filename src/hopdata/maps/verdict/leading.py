"""Leading eigenspaces of many symmetric matrices that are nearly alike.

Where a gap follows the eigenvalues asked for, a few multiplications by the matrix turn the leading
space of the mean into that of each; the result is checked, and what fails is decomposed.
"""

from __future__ import annotations

import numpy as np

from hopdata.arrays import FloatArray

_ROUNDING = 1e-14  # what the multiplications are to leave of a deviation
_MOST = 12  # multiplications that are still cheaper than to decompose
_AT_ONCE = 3  # multiplications before the columns lean on the first too much
_LARGEST_ERROR = 1e-11  # rad


def leading_spaces(matrices: FloatArray, rank: int) -> FloatArray:
    """Return orthonormal bases of the spaces of the largest eigenvalues.

    Parameters
    ----------
    matrices : (..., P, D, D) array
        Positive semidefinite, the P of a stack alike.
    rank : int
        Dimension k of the spaces, 1 to D.

    Returns
    -------
    (..., P, D, k) array
        Bases; `numpy.linalg.eigh` gives other bases of the same spaces. What the matrix takes out
        of a space is below 1e-11 of the k-th eigenvalue of the mean.
    """
    values, vectors = np.linalg.eigh(matrices.mean(axis=-3, keepdims=True))
    values = values[..., ::-1]
    times = _multiplications(values, rank)
    if times is None:
        return _decomposed(matrices, rank)
    unit = values[..., np.newaxis, :rank]
    spaces = np.broadcast_to(vectors[..., ::-1][..., :rank], (*matrices.shape[:-1], rank))
    for first in range(0, times, _AT_ONCE):
        for _ in range(min(_AT_ONCE, times - first)):
            spaces = matrices @ (spaces / unit)
        spaces = _orthonormal(spaces)
    wrong = ~(_errors(matrices, spaces, values[..., rank - 1]) <= _LARGEST_ERROR)
    spaces = np.array(spaces)
    if wrong.any():
        spaces[wrong] = _decomposed(matrices[wrong], rank)
    return spaces


def _errors(matrices: FloatArray, spaces: FloatArray, unit: FloatArray) -> FloatArray:
    """Return how far (..., P) bases are from orthonormal and from invariant, in rad.

    Infinite where a space might be one of other eigenvalues than the largest.
    """
    turned_bases = np.swapaxes(spaces, -1, -2)
    turned = matrices @ spaces
    within = turned_bases @ turned
    off = np.abs(turned - spaces @ within).max(axis=(-2, -1)) / unit
    askew = np.abs(turned_bases @ spaces - np.eye(spaces.shape[-1])).max(axis=(-2, -1))
    others = np.sum(matrices**2, axis=(-2, -1)) - np.sum(within**2, axis=(-2, -1))
    sound = np.asarray(np.isfinite(within).all(axis=(-2, -1)))
    least = np.linalg.eigvalsh(np.where(sound[..., np.newaxis, np.newaxis], within, 0.0))[..., 0]
    return np.where(sound & (others <= least**2), np.maximum(off, askew), np.inf)


def _multiplications(values: FloatArray, rank: int) -> int | None:
    """Return how many it takes, from falling eigenvalues of the means; None if too many."""
    if not (values[..., rank - 1] > 0.0).all():
        return None
    if rank == values.shape[-1]:
        return 0
    ratio = max(float(np.max(values[..., rank] / values[..., rank - 1])), 1e-8)
    times = np.log(_ROUNDING) / np.log(ratio) if ratio < 1.0 else np.inf
    return int(np.ceil(times)) if times <= _MOST else None


def _decomposed(matrices: FloatArray, rank: int) -> FloatArray:
    spaces: FloatArray = np.linalg.eigh(matrices)[1][..., ::-1][..., :rank]
    return spaces


def _orthonormal(spaces: FloatArray) -> FloatArray:
    """Return orthonormal bases (..., D, k) of the spaces of columns, by Gram and Schmidt."""
    rows = np.ascontiguousarray(np.swapaxes(spaces, -1, -2))
    for j in range(rows.shape[-2]):
        row = rows[..., j : j + 1, :]
        if j:
            done = rows[..., :j, :]
            row -= (row @ np.swapaxes(done, -1, -2)) @ done
        with np.errstate(invalid="ignore", divide="ignore"):  # a zero matrix is decomposed later
            row /= np.sqrt(row @ np.swapaxes(row, -1, -2))
    return np.swapaxes(rows, -1, -2)
