"""Matrix products with twice the digits of a double (Dekker 1971; Ogita, Rump and Oishi 2005)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

_SPLITTER = 134217729.0  # 2^27 + 1: halves a double into two of 26 bits

Floats = NDArray[np.float64]


def centred_product(x: Floats, centre: Floats, matrix: Floats) -> Floats:
    """Return ``(x - centre) @ matrix``, each entry as if computed in 32 digits and rounded.

    Parameters
    ----------
    x
        (n, p), finite.
    centre
        (p,).
    matrix
        (p, r).

    Returns
    -------
    ndarray
        (n, r). The error is a rounding of the result plus 1e-31 of the terms of its sum, so that
        terms that cancel leave the digits that the data have.
    """
    out = np.zeros((2, len(x), matrix.shape[1]))
    matrix = np.ascontiguousarray(matrix)
    scaled = matrix * _SPLITTER
    top = scaled - (scaled - matrix)
    _centred_product(np.ascontiguousarray(x), centre, matrix, top, matrix - top, *out)
    return out[0] + out[1]


@njit(cache=True, nogil=True)
def _centred_product(x, centre, matrix, top, rest, high, low):  # type: ignore[no-untyped-def]
    """Add the products to `high`, and what its roundings lose to `low`."""
    for i in range(x.shape[0]):
        for k in range(x.shape[1]):
            value = x[i, k] - centre[k]
            back = value - x[i, k]
            lost = (x[i, k] - (value - back)) - (centre[k] + back)
            first = value * _SPLITTER - (value * _SPLITTER - value)
            second = value - first
            for j in range(matrix.shape[1]):
                product = value * matrix[k, j]
                error = first * top[k, j] - product
                error = ((error + first * rest[k, j]) + second * top[k, j]) + second * rest[k, j]
                total = high[i, j] + product
                part = total - high[i, j]
                error += (high[i, j] - (total - part)) + (product - part)
                low[i, j] += error + lost * matrix[k, j]
                high[i, j] = total
