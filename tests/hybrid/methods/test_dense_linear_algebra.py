"""Factorisation with partial pivoting, against NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from hopdata.hybrid.methods.dense_linear_algebra import factorise, solve_factorised

TABLE_ROWS = 20
LU, PIVOTS, X = np.array([1, 15, 17])


def solution(matrix, right):
    n = len(right)
    s = np.full((TABLE_ROWS, n), np.nan)
    s[LU : LU + n], s[X] = matrix, right
    factorise(s, LU, PIVOTS, n)
    solve_factorised(s, LU, PIVOTS, X, n)
    return s[X]


@pytest.mark.parametrize("n", [1, 2, 3, 6, 12])
def test_random_systems(n):
    rng = np.random.default_rng(n)
    for _ in range(20):
        matrix, right = rng.normal(size=(n, n)), rng.normal(size=n)
        x = solution(matrix, right)
        size = np.linalg.norm(matrix) * np.linalg.norm(x)
        assert np.linalg.norm(matrix @ x - right) < 1e-14 * n * size


def test_rows_are_exchanged_where_the_diagonal_is_zero():
    """A cycle of three: two exchanges, which must be made in their order."""
    matrix = np.array([[0.0, 2.0, 0.0], [0.0, 0.0, 4.0], [8.0, 0.0, 0.0]])
    assert solution(matrix, np.array([2.0, 8.0, 24.0])).tolist() == [3.0, 1.0, 2.0]


def test_a_small_pivot_does_no_harm():
    matrix = np.array([[1e-20, 1.0], [1.0, 1.0]])
    assert solution(matrix, np.array([1.0, 2.0])) == pytest.approx([1.0, 1.0], rel=1e-15)


def test_a_singular_matrix_gives_no_finite_solution():
    assert not np.isfinite(solution(np.ones((3, 3)), np.array([1.0, 2.0, 3.0]))).all()
