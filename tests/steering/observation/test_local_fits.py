import numpy as np
import pytest

from hopdata.steering.observation.local_fits import local_fit


def test_a_polynomial_is_found_with_its_derivatives_also_with_frames_missing():
    t = np.delete(np.arange(0, 1, 0.01), [48, 52, 53])
    fit = local_fit(t, 2 + 3 * (t - 0.4) ** 2 - (t - 0.4) ** 3, 0.45, 0.55, degree=3)
    assert fit.at(0.5) == pytest.approx(2 + 0.03 - 0.001)
    assert fit.at(0.5, 1) == pytest.approx(0.6 - 0.03)
    assert fit.at(0.5, 2) == pytest.approx(6 - 0.6)


def test_several_quantities_are_fitted_at_once():
    t = np.arange(0, 1, 0.1)
    fit = local_fit(t, np.column_stack([t, t**2]), 0.0, 1.0, degree=2)
    np.testing.assert_allclose(fit.at(0.35), [0.35, 0.35**2], atol=1e-12)


def test_the_lowest_point_lies_between_frames_and_is_no_maximum():
    t = np.arange(0, 1, 0.01)
    assert local_fit(t, (t - 0.503) ** 2, 0.45, 0.55, degree=3).lowest() == pytest.approx(0.503)
    assert local_fit(t, -((t - 0.503) ** 2), 0.45, 0.55, degree=2).lowest() is None
    assert local_fit(t, t, 0.45, 0.55, degree=1).lowest() is None


def test_a_minimum_beyond_the_frames_is_none():
    t = np.arange(0, 1, 0.01)
    assert local_fit(t, (t - 0.6) ** 2, 0.45, 0.55, degree=2).lowest() is None


def test_too_few_frames_give_nothing():
    t = np.arange(0, 1, 0.1)
    assert local_fit(t, t, 0.41, 0.59, degree=1) is None
