import numpy as np
import pytest

from hopdata.maps.truth.map_differences import input_root, largest_difference, relative_difference

RNG = np.random.default_rng(2)
X = RNG.normal(size=(500, 4)) @ RNG.normal(size=(4, 4))
A, B = RNG.normal(size=(2, 3, 4))
UNITS = np.array([1.0, 20.0, 0.1])


def test_the_root_is_one_of_the_covariance():
    root = input_root(X)
    np.testing.assert_allclose(root @ root.T, np.cov(X.T), atol=1e-12)


def test_a_difference_is_that_of_the_predictions():
    centred = X - X.mean(axis=0)
    apart, size = (np.linalg.norm(centred @ m.T / UNITS) for m in (A - B, B))
    found = relative_difference(A, B, root=input_root(X), units=UNITS)
    assert found == pytest.approx(apart / size, rel=1e-12)
    assert relative_difference(B, B, root=input_root(X), units=UNITS) == 0
    assert relative_difference(2 * B, B, root=input_root(X), units=UNITS) == pytest.approx(1)


def test_it_does_not_change_with_the_coordinates_of_the_inputs():
    turn = RNG.normal(size=(4, 4))
    there, back = X @ turn.T, np.linalg.inv(turn)
    found = relative_difference(A @ back, B @ back, root=input_root(there), units=UNITS)
    assert found == pytest.approx(relative_difference(A, B, root=input_root(X), units=UNITS))


def test_the_largest_of_all_pairs_is_relative_to_the_mean_map():
    maps, root = np.array([B, B + 0.01 * A, B - 0.02 * A]), input_root(X)
    mean = maps.mean(axis=0)
    expected = relative_difference(mean + 0.03 * A, mean, root=root, units=UNITS)
    assert largest_difference(maps, root=root, units=UNITS) == pytest.approx(expected)
    assert largest_difference(maps[:1], root=root, units=UNITS) == 0
