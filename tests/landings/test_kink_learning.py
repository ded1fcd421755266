"""Distributions of the laws over the landings."""

import numpy as np
import pytest

from hopdata.landings.kink import FlightPriors, KinkFits
from hopdata.landings.kink_learning import learn


def posteriors(value, variance, prior_mean, prior_sd):
    """Fits of two feet whose creep the data know to within `variance`, under a normal prior."""
    landings = len(value)
    flight, se = np.zeros((landings, 2, 4)), np.full((landings, 2, 4), np.inf)
    precision = 1 / variance + 1 / prior_sd**2
    flight[:, 0, 3] = (value / variance + prior_mean / prior_sd**2) / precision
    se[:, 0, 3] = 1 / np.sqrt(precision)
    blank, counts = np.zeros((landings, 2)), np.zeros((landings, 2), dtype=np.int64)
    return KinkFits(blank, blank, blank, blank, flight, se, blank, blank, blank, counts, counts)


def creep_learned(value, variance, prior_mean=0.0, prior_sd=0.1):
    prior = FlightPriors(np.zeros((2, 4)), np.full((2, 4), prior_sd))
    prior.mean[:, 3] = prior_mean
    found = learn(posteriors(value, variance, prior_mean, prior_sd), noise_m=1.0, prior=prior)
    return found.mean[0, 3], found.sd[0, 3]


@pytest.mark.parametrize("prior_mean", [0.0, 0.05])
def test_the_distribution_behind_is_found_whatever_the_prior(prior_mean):
    rng = np.random.default_rng(1)
    variance = rng.uniform(1e-4, 4e-4, 2000)
    value = rng.normal(0.02, 0.01, 2000) + rng.normal(0, np.sqrt(variance))
    mean, sd = creep_learned(value, variance, prior_mean)
    assert mean == pytest.approx(0.02, abs=0.0015)
    assert sd == pytest.approx(0.01, abs=0.0015)


def test_what_does_not_vary_has_no_spread():
    rng = np.random.default_rng(2)
    variance = np.full(1000, 1e-4)
    mean, sd = creep_learned(0.02 + rng.normal(0, 0.01, 1000), variance)
    assert mean == pytest.approx(0.02, abs=0.001)
    assert sd < 0.004


def test_outliers_do_not_widen_it():
    rng = np.random.default_rng(3)
    variance = np.full(1000, 1e-5)
    value = rng.normal(0.0, 0.01, 1000)
    value[:20] = 5.0
    _, sd = creep_learned(value, variance)
    assert sd == pytest.approx(0.011, abs=0.002)


def test_too_few_or_too_vague_leave_the_prior():
    assert creep_learned(np.full(7, 0.02), np.full(7, 1e-4)) == (0.0, 0.1)
    assert creep_learned(np.full(100, 0.02), np.full(100, 1.0)) == (0.0, 0.1)
