import numpy as np
import pytest

from hopdata.steering.experiments.intervals import (
    median_interval,
    rate_interval,
    ratio_interval,
)


def rng(seed=0):
    return np.random.default_rng(np.random.SeedSequence(seed))


@pytest.mark.parametrize(
    ("successes", "runs", "low", "high"),
    [(27, 30, 0.7347, 0.9789), (30, 30, 0.8843, 1.0), (0, 10, 0.0, 0.3085)],
)
def test_rates_have_the_intervals_of_clopper_and_pearson(successes, runs, low, high):
    np.testing.assert_allclose(rate_interval(successes, runs), [low, high], atol=5e-5)


def test_the_interval_of_a_rate_covers_at_least_as_often_as_it_says():
    from scipy.stats import binom

    for rate in (0.05, 0.3, 0.5, 0.8, 0.97):
        covers = [low <= rate <= high for low, high in (rate_interval(k, 30) for k in range(31))]
        assert binom.pmf(np.arange(31), 30, rate)[covers].sum() >= 0.95


def test_the_interval_of_a_median_by_order_statistics():
    values = np.arange(1, 31)[::-1]
    assert median_interval(values) == (10.0, 21.0)  # ranks 10 and 21 of 30: 95.7 %
    assert all(np.isnan(median_interval([1.0, 2.0, 3.0])))
    assert all(np.isnan(median_interval([])))


def test_the_interval_of_a_median_covers_at_least_as_often_as_it_says():
    drawn = rng(4).exponential(size=(800, 15))
    inside = [low <= np.log(2) <= high for low, high in map(median_interval, drawn)]
    assert np.mean(inside) > 0.93


def test_a_ratio_of_pairs():
    others = rng(1).uniform(20, 40, 25)
    ratio, low, high = ratio_interval(1.2 * others, others, rng=rng(2))
    np.testing.assert_allclose([ratio, low, high], 1.2)
    ratio, low, high = ratio_interval(rng(3).uniform(24, 48, 25), others, rng=rng(2))
    assert low < ratio < high
    assert all(np.isnan(ratio_interval([], [], rng=rng())))


@pytest.mark.parametrize("pairs", [1, 2, 5])
def test_a_ratio_of_few_pairs_has_no_interval(pairs):
    ratio, low, high = ratio_interval(np.full(pairs, 40.0), np.full(pairs, 20.0), rng=rng())
    assert ratio == 2.0
    assert np.isnan([low, high]).all()
