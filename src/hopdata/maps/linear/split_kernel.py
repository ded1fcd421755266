"""Compiled core of the bootstrap: one least-squares fit and its test errors for each split."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.code_cache import kept_njit
from hopdata.maps.linear.vectors import (
    TILE_ROWS,
    WIDTH,
    gram_tile,
    gram_tile_wide,
    gram_tile_widest,
    squared_misses,
    subtract_row,
)

Floats = NDArray[np.float64]


@kept_njit(nogil=True)
def _normal_equations(rows, index, count, normal):  # type: ignore[no-untyped-def]
    """Fill the first `count` rows of `normal`, on and right of the diagonal."""
    for a in range(0, count, TILE_ROWS):
        b = a // WIDTH * WIDTH
        while b < rows.shape[1]:
            blocks = (rows.shape[1] - b) // WIDTH
            if blocks == 1:
                gram_tile(rows, index, a, b, normal)
                b += WIDTH
            elif blocks == 2 or blocks == 4:
                gram_tile_wide(rows, index, a, b, normal)
                b += 2 * WIDTH
            else:
                gram_tile_widest(rows, index, a, b, normal)
                b += 3 * WIDTH


@kept_njit(nogil=True)
def _solve(count, normal):  # type: ignore[no-untyped-def]
    """Solve the normal equations in place; return the smallest over the largest pivot, 0 if bad."""
    smallest, largest = np.inf, 0.0
    for k in range(count):
        pivot = normal[k, k]
        if not pivot > 0.0:
            return 0.0
        smallest, largest = min(smallest, pivot), max(largest, pivot)
        inverse = 1.0 / pivot
        for i in range(k + 1, count):
            subtract_row(normal, i, k, normal[k, i] * inverse, i // WIDTH * WIDTH)
    right = count // WIDTH * WIDTH
    for i in range(count - 1, -1, -1):
        inverse = 1.0 / normal[i, i]
        normal[i, right:count] = 0.0  # so that these columns of other rows stay as they are
        for j in range(count, normal.shape[1]):
            normal[i, j] *= inverse
        for k in range(i):
            subtract_row(normal, k, i, normal[k, i], right)
    return smallest / largest


def padded_rows(inputs: Floats, outputs: Floats) -> Floats:
    """Return inputs and outputs side by side, with columns of zeros up to a multiple of `WIDTH`."""
    used = inputs.shape[1] + outputs.shape[1]
    rows = np.zeros((len(inputs), -(-used // WIDTH) * WIDTH))
    rows[:, : inputs.shape[1]] = inputs
    rows[:, inputs.shape[1] : used] = outputs
    return rows


@kept_njit(nogil=True)
def affine_split_errors(rows, count, train, test, errors, spread):  # type: ignore[no-untyped-def]
    """Fit each training set by its normal equations and sum the squares of its test errors.

    Parameters
    ----------
    rows : (n, W) array
        In each row `count` inputs, the outputs, and zeros up to a multiple of `WIDTH`.
    train, test : (R, m) and (R, t) int64 arrays
        Row numbers of each split.
    errors : (R, W) array
        Filled, in the columns of the outputs, with the sums of squares.
    spread : (R,) array
        Filled with the smallest pivot over the largest; where it is too small, the errors are
        nothing.
    """
    size = (count + TILE_ROWS - 1) // TILE_ROWS * TILE_ROWS
    normal = np.zeros((size, rows.shape[1]))
    for r in range(len(train)):
        _normal_equations(rows, train[r], count, normal)
        spread[r] = _solve(count, normal)
        squared_misses(rows, test[r], normal, count, count // WIDTH * WIDTH, errors[r])
