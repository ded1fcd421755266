"""Orders of the states in which a matrix's factors stay small, and their pattern.

The orders are SciPy's: reverse Cuthill-McKee for a narrow band, and SuperLU's minimum
degree for the smallest number of entries. This module is imported only for systems with
a sparse Jacobian.
"""

from typing import Any

import numpy as np

from hopdata.arrays import IntArray
from hopdata.code_cache import kept_njit


@kept_njit(error_model="numpy")
def colour_columns(
    sequence: IntArray,
    column_starts: IntArray,
    rows_of: IntArray,
    row_starts: IntArray,
    columns_of: IntArray,
) -> IntArray:
    """Return the group of each column; in a group, no two share a row.

    Each column of the sequence gets the first group that none of its neighbours has.
    """
    n = len(sequence)
    colours = np.full(n, -1)
    taken_by = np.full(n + 1, -1)  # the column whose neighbour has this colour
    for column in sequence:
        for a in range(column_starts[column], column_starts[column + 1]):
            row = rows_of[a]
            for b in range(row_starts[row], row_starts[row + 1]):
                other = colours[columns_of[b]]
                if other >= 0:
                    taken_by[other] = column
        colour = 0
        while taken_by[colour] == column:
            colour += 1
        colours[column] = colour
    return colours


def _symmetric(n_states: int, rows: IntArray, columns: IntArray) -> Any:
    """Return a matrix with ones at the places, their mirror images and the diagonal."""
    from scipy.sparse import csc_array

    diagonal = np.arange(n_states)
    row = np.concatenate([rows, columns, diagonal])
    column = np.concatenate([columns, rows, diagonal])
    shape = (n_states, n_states)
    matrix = csc_array((np.ones(len(row)), (row, column)), shape=shape)
    matrix.sum_duplicates()
    matrix.data[:] = 1.0
    return matrix


def narrow_order(n_states: int, rows: IntArray, columns: IntArray) -> IntArray:
    """Return the order of reverse Cuthill and McKee."""
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    matrix = _symmetric(n_states, rows, columns).tocsr()
    found = reverse_cuthill_mckee(matrix, symmetric_mode=True)
    return np.asarray(found, dtype=np.int64)


def sparse_order(n_states: int, rows: IntArray, columns: IntArray) -> IntArray:
    """Return the order of minimum degree, by which SuperLU eliminates.

    It is taken from a factorisation of a matrix with this pattern and a heavy diagonal.
    """
    from scipy.sparse.linalg import splu

    matrix = _symmetric(n_states, rows, columns)
    degree = np.diff(matrix.indptr)
    matrix.data[:] = -1.0
    matrix.setdiag(degree.astype(float))
    factors = splu(
        matrix,
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return np.argsort(factors.perm_c)


def symbolic(
    order: IntArray, rows: IntArray, columns: IntArray, n_states: int
) -> tuple[IntArray, IntArray, IntArray]:
    """Return the pattern of the factors in an order: row starts, columns, diagonals."""
    matrix = _symmetric(n_states, rows, columns).tocsr()
    permuted = matrix[order][:, order].tocsr()
    permuted.sort_indices()
    starts = permuted.indptr.astype(np.int64)
    entries = permuted.indices.astype(np.int64)
    parents = elimination_tree(starts, entries)
    counts = count_upper(starts, entries, parents)
    return fill_factors(starts, entries, parents, counts)


@kept_njit(error_model="numpy")
def elimination_tree(starts: IntArray, columns: IntArray) -> IntArray:
    """Return the parent of each row in the elimination tree, -1 of a root (Liu)."""
    n = len(starts) - 1
    parents = np.full(n, -1)
    ancestors = np.full(n, -1)
    for i in range(n):
        for a in range(starts[i], starts[i + 1]):
            k = columns[a]
            while k != -1 and k < i:
                following = ancestors[k]
                ancestors[k] = i
                if following == -1:
                    parents[k] = i
                k = following
    return parents


@kept_njit(error_model="numpy")
def count_upper(starts: IntArray, columns: IntArray, parents: IntArray) -> IntArray:
    """Return the number of entries right of the diagonal in each row of the factors."""
    n = len(starts) - 1
    counts = np.zeros(n, dtype=np.int64)
    seen = np.full(n, -1)
    for i in range(n):
        seen[i] = i
        for a in range(starts[i], starts[i + 1]):
            k = columns[a]
            while k < i and seen[k] != i:
                seen[k] = i
                counts[k] += 1
                k = parents[k]
    return counts


@kept_njit(error_model="numpy")
def fill_factors(
    starts: IntArray, columns: IntArray, parents: IntArray, upper: IntArray
) -> tuple[IntArray, IntArray, IntArray]:
    """Return row starts, columns and diagonals of both factors in one matrix.

    Its pattern is symmetric. `upper` are the entries right of the diagonal in each row.
    """
    n = len(starts) - 1
    lower = np.zeros(n, dtype=np.int64)
    seen = np.full(n, -1)
    for i in range(n):
        seen[i] = i
        for a in range(starts[i], starts[i + 1]):
            k = columns[a]
            while k < i and seen[k] != i:
                seen[k] = i
                lower[i] += 1
                k = parents[k]
    first = np.zeros(n + 1, dtype=np.int64)
    diagonal = np.zeros(n, dtype=np.int64)
    for i in range(n):
        diagonal[i] = first[i] + lower[i]
        first[i + 1] = diagonal[i] + 1 + upper[i]
    found = np.empty(first[n], dtype=np.int64)
    right = diagonal + 1  # the next free place right of the diagonal
    seen[:] = -1
    for i in range(n):
        found[diagonal[i]] = i
        seen[i] = i
        for a in range(starts[i], starts[i + 1]):
            k = columns[a]
            while k < i and seen[k] != i:
                seen[k] = i
                found[right[k]] = i
                right[k] += 1
                k = parents[k]
    left = first[:n].copy()
    for k in range(n):
        for a in range(diagonal[k] + 1, first[k + 1]):
            i = found[a]
            found[left[i]] = k
            left[i] += 1
    return first, found, diagonal
