import numpy as np
import pytest

from hopdata.maps.verdict import leading
from hopdata.maps.verdict.leading import leading_spaces


def alike(values, *, change=0.05, shape=(3, 20), seed=0):
    """Positive semidefinite matrices with about these eigenvalues, turned a little."""
    rng = np.random.default_rng(seed)
    D = len(values)
    turns = np.linalg.qr(rng.standard_normal((shape[0], 1, D, D)))[0]
    turns = turns @ np.linalg.qr(np.eye(D) + change * rng.standard_normal((*shape, D, D)))[0]
    factors = turns * np.sqrt(values * rng.uniform(0.9, 1.1, D))
    return factors @ np.swapaxes(factors, -1, -2)


def gaps(found, matrices, rank):
    """Sine of the largest angle between a space and that of the full decomposition."""
    rest = np.linalg.eigh(matrices)[1][..., : matrices.shape[-1] - rank]
    return np.linalg.norm(np.swapaxes(rest, -1, -2) @ found, ord=2, axis=(-2, -1))


def check(matrices, rank, error=1e-11):
    found = leading_spaces(matrices, rank)
    assert found.shape == (*matrices.shape[:-1], rank)
    gram = np.swapaxes(found, -1, -2) @ found
    np.testing.assert_allclose(gram, np.broadcast_to(np.eye(rank), gram.shape), atol=1e-13)
    assert gaps(found, matrices, rank).max(initial=0.0) < error


def test_finds_the_space_above_a_gap():
    check(alike(np.r_[2e5, 1e5, 5e4, 300.0, 100.0, 10.0, 1.0]), 3)


def test_a_wide_spread_above_the_gap_costs_few_digits():
    check(alike(np.r_[1e8, 1e6, 1e5, 10.0, 1.0], change=0.001), 3)


def test_matrices_that_differ_much_are_right_as_well():
    check(alike(np.r_[1e3, 5e2, 3.0, 1.0], change=1.0, shape=(2, 50)), 2)


def test_without_a_gap_they_are_decomposed():
    check(alike(np.arange(6.0, 0.0, -1.0)), 3, error=1e-11)


def test_one_outlier_among_the_matrices_is_decomposed(monkeypatch):
    matrices = alike(np.r_[1e5, 1e4, 10.0, 1.0], shape=(1, 30))
    matrices[0, 7] = np.diag([1.0, 2.0, 1.9, 0.5])
    counts = []
    decomposed = leading._decomposed

    def counting(stack, rank):
        counts.append(len(stack))
        return decomposed(stack, rank)

    monkeypatch.setattr(leading, "_decomposed", counting)
    check(matrices, 2)
    assert counts == [1]


def test_one_matrix_is_its_own_mean():
    check(alike(np.r_[100.0, 90.0, 1.0], shape=(4, 1)), 2)


def test_all_directions():
    check(alike(np.r_[3.0, 2.0, 1.0]), 3)


@pytest.mark.parametrize("rank", [1, 2, 3])
def test_matrices_without_rank(rank):
    matrices = alike(np.r_[1.0, 0.0, 0.0, 0.0], change=0.0, shape=(1, 3))
    found = leading_spaces(matrices, rank)
    projected = matrices - found @ (np.swapaxes(found, -1, -2) @ matrices)
    assert np.abs(projected).max() < 1e-12


@pytest.mark.parametrize("tilt", [0.0, 1e-12, 1e-8])
def test_an_invariant_space_of_smaller_eigenvalues_is_noticed(tilt):
    """In one of the matrices the third direction takes the place of the second."""
    values = np.tile([1e5, 1e4, 10.0, 1.0, 1.0], (60, 1))
    values[-1, 2] = 1.01e4
    matrices = np.stack([np.diag(row) for row in values])
    turn = np.linalg.qr(np.eye(5) + tilt * np.random.default_rng(1).standard_normal((5, 5)))[0]
    matrices[-1] = turn @ matrices[-1] @ turn.T
    check(matrices[np.newaxis], 2, error=1e-9)


@pytest.mark.filterwarnings("error")
def test_a_matrix_of_zeros_among_others_is_decomposed():
    matrices = alike(np.r_[1e5, 1e4, 10.0, 1.0], shape=(1, 30))
    matrices[0, 7] = 0.0
    found = leading_spaces(matrices, 2)
    assert np.isfinite(found).all()
    assert found.flags.writeable


def test_the_whole_space_can_be_written_to():
    assert leading_spaces(alike(np.r_[3.0, 2.0, 1.0]), 3).flags.writeable
