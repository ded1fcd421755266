"""Means of kinks and steps over what nobody foretells, against draws."""

import numpy as np
import pytest

from hopdata.maps.coordinates import kinks
from hopdata.maps.verdict import averaged


@pytest.fixture
def rng():
    return np.random.default_rng(4)


@pytest.mark.parametrize("feet", [2, 3, 4])
def test_means_are_those_of_draws(rng, feet):
    instants = rng.standard_normal((50, feet))
    instants -= instants.mean(axis=1, keepdims=True)
    root = 0.6 * rng.standard_normal((feet, feet))
    root -= root.mean(axis=1, keepdims=True)
    rest = rng.standard_normal((40_000, feet)) @ root
    drawn = np.mean([kinks(instants + r) for r in rest], axis=0)
    found = averaged.mean_kinks(instants, root.T @ root)
    np.testing.assert_allclose(found, drawn, atol=0.02)

    pairs = averaged.pairs_that_exchange(instants, 5)
    signs = [
        [np.mean(np.sign(one[i] - one[j] + rest[:, i] - rest[:, j])) for i, j in pairs]
        for one in instants
    ]
    steps = averaged.steps(instants, root.T @ root, pairs)
    np.testing.assert_allclose(steps, signs, atol=0.03)


def test_nothing_unforetold_leaves_kinks_and_steps_sharp(rng):
    instants = rng.standard_normal((200, 3))
    nothing = np.zeros((3, 3))
    np.testing.assert_array_equal(
        averaged.mean_kinks(instants, nothing), kinks(instants)
    )
    pairs = averaged.pairs_that_exchange(instants, 20)
    assert pairs == [(0, 1), (0, 2), (1, 2)]
    steps = averaged.steps(instants, nothing, pairs)
    assert set(np.unique(steps)) == {-1.0, 1.0}


def test_a_rest_in_one_direction_only_is_averaged_over(rng):
    """Two of three feet then err alike."""
    instants = rng.standard_normal((50, 3))
    instants -= instants.mean(axis=1, keepdims=True)
    way = 0.5 * np.array([2.0, -1.0, -1.0])
    rest = rng.standard_normal((40_000, 1)) * way
    drawn = np.mean([kinks(instants + r) for r in rest], axis=0)
    found = averaged.mean_kinks(instants, np.outer(way, way))
    np.testing.assert_allclose(found, drawn, atol=0.02)


def test_the_order_of_the_feet_changes_no_mean(rng):
    instants = rng.standard_normal((100, 3))
    root = 0.4 * rng.standard_normal((3, 3))
    covariance = root @ root.T
    order = [2, 0, 1]
    one = averaged.mean_kinks(instants, covariance)
    turned = averaged.mean_kinks(instants[:, order], covariance[np.ix_(order, order)])
    # The sets of feet come in another order: {2, 0}, {2, 1}, {0, 1}, all.
    np.testing.assert_allclose(turned, one[:, [1, 2, 0, 3]], atol=1e-12)


@pytest.mark.parametrize("correlation", [-0.9, 0.0, 0.4, 0.999])
def test_both_below_is_the_normal_distribution_of_two_variables(rng, correlation):
    from scipy.stats import multivariate_normal

    limits = rng.standard_normal((20, 2))
    limits[0] = 0.0, 0.0
    limits[1] = 0.0, -1.0
    law = multivariate_normal(cov=[[1.0, correlation], [correlation, 1.0]])
    wanted = [law.cdf(one) for one in limits]
    found = averaged.both_below(limits[:, 0], limits[:, 1], correlation)
    np.testing.assert_allclose(found, wanted, atol=1e-5)
