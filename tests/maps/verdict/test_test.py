"""What noise takes from the kinks is found by adding it again, and given back."""

from dataclasses import replace

import numpy as np
import pytest
from kinked_landings import SPREAD_S, landings

from hopdata.maps.coordinates import kinks
from hopdata.maps.verdict.estimate import fit_kinks
from hopdata.maps.verdict.inputs import expected_contacts
from hopdata.maps.verdict.test import attenuation, calibrated

NOISE = np.full(8, 0.12)
INSTANT_NOISE_S = np.full(3, 4e-4)


def studies(noise, instant_noise_s, heights, repeats=12):
    """Kinks found in landings seen with noise, beside the same with the attenuation undone."""
    found, restored = [], []
    for seed in range(repeats):
        data = landings(n=1200, strength=0.0, noise=0.02, seed=seed)
        rng = np.random.default_rng(1000 + seed)
        x = data.x / np.array([0.03, 0.03, 0.07, 0.07, 0.07, 0.3, 0.3, 0.2])
        exact = data.instants - data.instants.mean(axis=1, keepdims=True)
        exact = expected_contacts(x, exact)  # free of the instants' noise, to rounding of the fit
        y = data.y + kinks(exact / SPREAD_S) @ heights
        seen = x + noise * rng.standard_normal(x.shape)
        instants = exact + instant_noise_s * rng.standard_normal(exact.shape)
        expected = expected_contacts(seen, instants)
        fit = fit_kinks(seen, y, expected)[0]
        matrix = attenuation(fit, seen, expected, np.diag(noise**2), instant_noise_s, generator=rng)
        whole = calibrated(fit, matrix)
        found.append(SPREAD_S * fit.seen @ fit.coefficients)
        restored.append(SPREAD_S * whole.seen @ whole.coefficients)
    return np.mean(found, axis=0), np.mean(restored, axis=0)


@pytest.fixture(scope="module")
def heights():
    return 0.8 * np.random.default_rng(3).standard_normal((4, 11))


def share(found, heights):
    """Share of the true kinks in those found."""
    return np.sum(found * heights) / np.sum(heights**2)


def test_most_of_what_noise_took_is_given_back(heights):
    found, restored = studies(NOISE, INSTANT_NOISE_S, heights)
    assert share(found, heights) < 0.95
    assert abs(share(restored, heights) - 1.0) < 0.35 * (1.0 - share(found, heights))


def test_without_noise_nothing_is_changed(heights):
    found, restored = studies(0.0 * NOISE, 0.0 * INSTANT_NOISE_S, heights, repeats=1)
    assert share(found, heights) == pytest.approx(1.0, abs=0.02)
    assert np.allclose(found, restored, atol=1e-9 * np.abs(heights).max())


def test_covariance_grows_with_the_kinks(heights):
    data = landings(n=600, seed=3)
    x = data.x / data.x.std(axis=0)
    fit = fit_kinks(x, data.y, expected_contacts(x, data.instants))[0]
    K = len(fit.coefficients)
    whole = calibrated(fit, 0.5 * np.eye(K))
    assert np.allclose(whole.coefficients, 2.0 * fit.coefficients)
    assert np.allclose(whole.covariance, 4.0 * fit.covariance)
    assert np.allclose(whole.curvature, 4.0 * fit.curvature)


def test_kinks_that_noise_hides_are_left_as_they_are():
    data = landings(n=600, seed=3)
    x = data.x / data.x.std(axis=0)
    fit = fit_kinks(x, data.y, expected_contacts(x, data.instants))[0]
    hidden = np.eye(len(fit.coefficients))
    hidden[0, 0] = 0.1
    assert calibrated(fit, hidden) is fit
    assert calibrated(replace(fit), np.eye(len(hidden))) is not fit
