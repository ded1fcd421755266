import numpy as np
import pytest

from hopdata.landings.reweighted import Reweighted


def problem(n=200, k=5, seed=0):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((n, k)), rng.standard_normal(n), rng.uniform(0.01, 1.0, n)


def direct(columns, values, weights):
    roots = np.sqrt(weights)
    return np.linalg.pinv(roots[:, np.newaxis] * columns, rcond=1e-12) @ (roots * values)


def refit(columns, values, weights):
    fits = Reweighted(columns, values)
    start = fits.unweighted()
    return fits.refit(start, fits.residuals(start), weights)


def test_without_weights_it_is_least_squares():
    columns, values, _ = problem()
    expected = np.linalg.lstsq(columns, values, rcond=None)[0]
    np.testing.assert_allclose(Reweighted(columns, values).unweighted(), expected, rtol=1e-12)


def test_with_weights_it_is_weighted_least_squares():
    columns, values, weights = problem()
    np.testing.assert_allclose(
        refit(columns, values, weights), direct(columns, values, weights), rtol=1e-12
    )


def test_columns_that_are_nearly_one_lose_no_more_than_they_must():
    columns, _, weights = problem()
    columns[:, 1] = columns[:, 0] + 1e-6 * columns[:, 1]
    truth = np.arange(1.0, 6.0)
    np.testing.assert_allclose(refit(columns, columns @ truth, weights), truth, rtol=1e-8)


def test_of_dependent_columns_it_takes_the_shortest_coefficients():
    columns, values, weights = problem()
    columns[:, 4] = columns[:, 0] - columns[:, 1]
    found = refit(columns, values, weights)
    np.testing.assert_allclose(found, direct(columns, values, weights), rtol=1e-11)
    assert found @ [1.0, -1.0, 0.0, 0.0, -1.0] == pytest.approx(0.0, abs=1e-14)


def test_weights_may_leave_a_column_out():
    columns, values, weights = problem()
    columns[:, 2] = np.arange(200) < 50
    weights[:50] = 0.0
    found = refit(columns, values, weights)
    np.testing.assert_allclose(found, direct(columns, values, weights), atol=1e-13)
    assert abs(found[2]) < 1e-14


def test_weights_of_zero_alone_find_nothing():
    columns, values, weights = problem()
    np.testing.assert_array_equal(refit(columns, values, 0.0 * weights), 0.0)


def test_fewer_values_than_columns():
    columns, values, weights = problem(n=3)
    np.testing.assert_allclose(
        refit(columns, values, weights), direct(columns, values, weights), rtol=1e-12
    )
