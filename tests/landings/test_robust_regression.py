"""The oracle is statsmodels' RLM, iterated until the coefficients stand still."""

import warnings

import numpy as np
import pytest
from statsmodels.robust import norms
from statsmodels.robust.robust_linear_model import RLM

from hopdata.errors import ConfigError
from hopdata.landings.robust_regression import NORMS, robust_regression

both_norms = pytest.mark.parametrize("norm", NORMS)


def oracle(columns, values, norm):
    kinds = {"tukey": norms.TukeyBiweight, "huber": norms.HuberT}
    with np.errstate(invalid="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = RLM(values, columns, M=kinds[norm]())
        return model.fit(conv="coefs", tol=1e-15, maxiter=300).params


def problem(seed, n=300, k=4, outliers=0.1):
    """Values of a plane with normal noise, some of them far up."""
    rng = np.random.default_rng(seed)
    columns = np.column_stack([np.ones(n), rng.uniform(-1, 1, (n, k - 1))])
    values = columns @ rng.standard_normal(k) + 0.001 * rng.standard_normal(n)
    values[rng.random(n) < outliers] += rng.uniform(0.01, 1.0)
    return columns, values


def same(columns, values, norm, rtol=1e-9):
    found = robust_regression(columns, values, norm=norm)
    np.testing.assert_allclose(
        found, oracle(columns, values, norm), rtol=0, atol=rtol * np.abs(found).max()
    )


@both_norms
@pytest.mark.parametrize("outliers", [0.0, 0.1, 0.4])
@pytest.mark.parametrize("seed", range(5))
def test_agrees_with_statsmodels(seed, outliers, norm):
    same(*problem(seed, outliers=outliers), norm)


@both_norms
def test_agrees_for_a_polynomial_of_high_degree(norm):
    rng = np.random.default_rng(3)
    places = rng.uniform(-1, 1, 2000)
    columns = places[:, np.newaxis] ** np.arange(12)
    values = np.sin(places) + 0.01 * rng.standard_t(2, 2000)
    same(columns, values, norm)


@both_norms
def test_agrees_with_few_values(norm):
    same(*problem(1, n=9, outliers=0.2), norm)


@both_norms
def test_agrees_where_rows_are_repeated(norm):
    columns, values = problem(2, n=60)
    same(np.repeat(columns, 5, axis=0), np.repeat(values, 5), norm)


@both_norms
def test_agrees_where_a_column_is_zero(norm):
    columns, values = problem(4)
    same(np.column_stack([columns, np.zeros(len(values))]), values, norm)


@both_norms
def test_of_dependent_columns_it_takes_the_shortest_coefficients(norm):
    columns, values = problem(5)
    found = robust_regression(np.column_stack([columns, columns[:, 1]]), values, norm=norm)
    alone = robust_regression(columns, values, norm=norm)
    assert found[1] == pytest.approx(0.5 * alone[1], rel=1e-10)
    assert found[4] == pytest.approx(found[1], rel=1e-10)


def test_agrees_where_all_values_of_a_column_get_no_weight():
    columns, values = problem(6, n=400)
    group = np.arange(400) < 40
    columns = np.column_stack([columns, group * (1 + columns[:, 1])])
    values[group] += 5 * np.random.default_rng(7).choice([-1.0, 1.0], 40)
    same(columns, values, "tukey")


@both_norms
def test_values_without_noise_are_met(norm):
    columns, _ = problem(8)
    truth = np.array([1.0, -2.0, 0.5, 3.0])
    found = robust_regression(columns, columns @ truth, norm=norm)
    np.testing.assert_allclose(found, truth, rtol=1e-13)


@both_norms
def test_a_scale_of_zero_ends_the_steps(norm):
    columns = np.ones((10, 1))
    assert robust_regression(columns, np.zeros(10), norm=norm) == pytest.approx(0.0)
    values = np.repeat([0.0, 1.0], [60, 10])
    found = robust_regression(np.column_stack([values]), 2 * values, norm=norm)
    assert found == pytest.approx(2.0, rel=1e-14)


def test_outliers_do_not_count_for_tukey():
    columns, values = problem(9, outliers=0.0)
    spoiled = values.copy()
    spoiled[:60] += 1.0
    found = robust_regression(columns, spoiled, norm="tukey")
    clean = robust_regression(columns[60:], values[60:], norm="tukey")
    np.testing.assert_allclose(found, clean, atol=1e-4)


@both_norms
def test_a_smaller_tolerance_comes_nearer_to_the_optimum(norm):
    columns, values = problem(10)
    best = robust_regression(columns, values, norm=norm, tolerance=0.0, most_fits=1000)
    gaps = [
        np.abs(robust_regression(columns, values, norm=norm, tolerance=tolerance) - best).max()
        for tolerance in (1e-2, 1e-5, 1e-12)
    ]
    assert gaps[0] > gaps[1] > gaps[2]


def test_an_unknown_norm_is_named():
    with pytest.raises(ConfigError, match="found 'cauchy'"):
        robust_regression(np.ones((3, 1)), np.ones(3), norm="cauchy")
