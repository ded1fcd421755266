"""Estimates of a linear map on data whose map and noise are known."""

import numpy as np
import pytest
from made_up_landings import inputs

from hopdata.errors import AnalysisError
from hopdata.maps.corrected.calibration import LEAST_RELIABILITY, calibration
from hopdata.maps.corrected.marker_noise import InputErrors
from hopdata.maps.corrected.regression import corrected_map, curved_map, ols_map
from hopdata.maps.linear.affine import fit_affine

SLOPES = np.random.default_rng(7).normal(size=(8, 2))
NOISE = 0.15 * np.array(np.random.default_rng(8).normal(size=(8, 8)))
COMMON = np.random.default_rng(6).normal(size=(8, 2))
ERRORS = InputErrors(NOISE @ NOISE.T, NOISE @ NOISE.T @ COMMON)


def measured(count, seed=0, bend=0.0, noise=1.0):
    """Inputs and outputs with normal errors of the moments `ERRORS`, and contact instants."""
    x, instants = inputs(count, seed)
    d = 100 * np.column_stack([instants[:, 0] - instants[:, 1], instants[:, 1] - instants[:, 2]])
    y = x @ SLOPES + bend * d * np.abs(d) + 0.3 * x[:, :2] ** 2 * bend
    rng = np.random.default_rng((seed, 1))
    error = noise * rng.normal(size=(count, 8)) @ NOISE.T
    y = y + error @ COMMON + noise * rng.normal(size=y.shape)
    return x + error, y, instants + 1e-4 * rng.normal(size=instants.shape)


def plain(x, y, _):
    return ols_map(x, y).coefficients


def corrected(x, y, _):
    return corrected_map(x, y, ERRORS).coefficients


def mean_miss(fit, repeats=40, count=400, **options):
    """Mean error over repeated data in units of its own standard error."""
    found = np.array([fit(*measured(count, seed, **options)) for seed in range(repeats)])
    miss = found.mean(axis=0) - SLOPES
    return np.abs(miss).max(), np.abs(miss / (found.std(axis=0) / np.sqrt(repeats))).max()


def test_least_squares_is_biased_and_the_correction_is_not():
    biased, _ = mean_miss(plain)
    assert biased > 0.3
    miss, in_errors = mean_miss(corrected)
    assert miss < 0.06
    assert in_errors < 4.5  # largest of 16


def test_the_curved_estimate_is_right_where_least_squares_is_not():
    none = {"bend": 0.5, "noise": 0.0, "count": 900, "repeats": 3}
    straight, _ = mean_miss(plain, **none)
    curved, _ = mean_miss(lambda x, y, t: curved_map(x, y, t).coefficients, **none)
    assert straight > 0.1
    assert curved < 0.02


def test_both_corrections_are_right_where_one_is_not():
    many = {"bend": 0.5, "count": 2500, "repeats": 8}
    ways = {
        "curved": lambda x, y, t: curved_map(x, y, t).coefficients,
        "corrected": corrected,
        "both": lambda x, y, t: curved_map(x, y, t, ERRORS).coefficients,
    }
    miss = {name: mean_miss(fit, **many)[0] for name, fit in ways.items()}
    assert miss["both"] < 0.5 * min(miss["curved"], miss["corrected"])


def test_the_correction_is_the_moment_estimate():
    x, y, _ = measured(300)
    moments = np.cov(np.hstack([x, y]), rowvar=False)
    expected = np.linalg.solve(moments[:8, :8] - ERRORS.inputs, moments[:8, 8:] - ERRORS.shared)
    np.testing.assert_allclose(corrected_map(x, y, ERRORS).coefficients, expected, atol=1e-12)


def test_without_noise_the_corrections_are_least_squares():
    x, y, t = measured(300)
    none = InputErrors.none(8, 2)
    straight = ols_map(x, y)
    np.testing.assert_allclose(straight.coefficients, fit_affine(x, y).coefficients, atol=1e-12)
    same = corrected_map(x, y, none)
    np.testing.assert_allclose(same.coefficients, straight.coefficients, atol=1e-12)
    np.testing.assert_allclose(same.standard_errors, straight.standard_errors, rtol=1e-9)
    assert same.removed == 1.0
    curved = curved_map(x, y, t, none).coefficients
    np.testing.assert_array_equal(curved, curved_map(x, y, t).coefficients)


def test_standard_errors_are_those_of_repeated_data():
    fits = [corrected_map(*measured(400, seed)[:2], ERRORS) for seed in range(150)]
    found = np.array([fit.coefficients for fit in fits]).std(axis=0)
    said = np.sqrt(np.mean([fit.standard_errors**2 for fit in fits], axis=0))
    assert np.abs(said / found - 1).max() < 0.25
    assert abs(np.mean(said / found) - 1) < 0.1


def test_the_units_of_inputs_and_outputs_do_not_matter():
    x, y, t = measured(400, bend=0.3)
    a, b = np.logspace(-3, 3, 8), np.array([1e-4, 1e4])
    for fit in (
        lambda x, y, e: corrected_map(x, y, e).coefficients,
        lambda x, y, e: curved_map(x, y, t, e).coefficients,
    ):
        other = fit(x * a + 5.0 * a, y * b - 3.0, ERRORS.scaled(a, b))
        np.testing.assert_allclose(other, fit(x, y, ERRORS) / a[:, None] * b, rtol=1e-6)


@pytest.mark.parametrize("factor", [0.0, 0.5, 0.999, 1.0, 1.5, 100.0])
def test_no_more_noise_is_taken_off_than_there_is_spread(factor):
    x, y, _ = measured(200)
    moments = np.cov(x, rowvar=False)
    values, vectors = np.linalg.eigh(moments)
    noise = factor * values[0] * np.outer(vectors[:, 0], vectors[:, 0])
    known = calibration(x, InputErrors(noise, np.zeros((8, 2))))
    left = np.linalg.eigvalsh(moments - known.removed * noise)
    assert left[0] > 0.3 * values[0] * (1 - 1e-9)
    assert known.removed == pytest.approx(min(1.0, (1 - LEAST_RELIABILITY) / max(factor, 0.1)))
    assert np.isfinite(corrected_map(x, y, InputErrors(noise, np.zeros((8, 2)))).coefficients).all()


def test_few_landings_bear_fewer_terms():
    x, y, t = measured(900, bend=0.5, noise=0.0)
    y = y + 0.2 * x[:, :2] ** 3
    degrees = [curved_map(x[:n], y[:n], t[:n]).degree for n in (30, 100, 250, 900)]
    assert degrees == [0, 1, 2, 3]


def test_terms_that_only_scatter_are_left_out():
    degrees = [curved_map(*measured(900, seed)).degree for seed in range(10)]
    assert np.mean(degrees) < 1.0
    x, y, t = measured(900, bend=0.2)
    assert curved_map(x, y * [1.0, 0.0], t).degree == curved_map(x, y[:, :1], t).degree
    loud = np.column_stack([y[:, 0], 1e3 * np.random.default_rng(5).normal(size=900)])
    quiet = curved_map(x, loud, t, units=np.array([1.0, 1e9])).degree
    assert quiet == curved_map(x, y[:, :1], t).degree


def test_bad_input_is_refused():
    x, y, t = measured(60)
    with pytest.raises(ValueError, match="finite"):
        ols_map(np.where(x > 2, np.nan, x), y)
    with pytest.raises(ValueError, match=r"\(n, p\) and \(n, q\)"):
        ols_map(x, y[:-1])
    with pytest.raises(AnalysisError, match="9 landings do not suffice for 8 inputs"):
        ols_map(x[:9], y[:9])
    with pytest.raises(AnalysisError, match="vary in all directions"):
        corrected_map(x * np.array([0, 1, 1, 1, 1, 1, 1, 1]), y, ERRORS)
    with pytest.raises(ValueError, match="symmetric matrix for 8 inputs"):
        corrected_map(x, y, InputErrors(np.eye(7), np.zeros((7, 2))))
    with pytest.raises(ValueError, match="covariance"):
        corrected_map(x, y, InputErrors(-np.eye(8), np.zeros((8, 2))))
    with pytest.raises(ValueError, match="instants"):
        curved_map(x, y, np.full_like(t, np.nan))
    with pytest.raises(AnalysisError, match="instants that differ"):
        curved_map(x, y, np.zeros_like(t))
