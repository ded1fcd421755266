"""The oracle is statsmodels' QuantReg, which stops at a change of 1e-6."""

import numpy as np
import pytest
from scipy.optimize import linprog
from statsmodels.regression.quantile_regression import QuantReg

from hopdata.landings.quantile_regression import quantile_regression


def problem(seed, n=400, k=4):
    rng = np.random.default_rng(seed)
    columns = np.column_stack([np.ones(n), rng.uniform(-1, 1, (n, k - 1))])
    return columns, columns @ rng.standard_normal(k) + rng.gamma(2.0, 0.1, n)


def loss(columns, values, quantile, coefficients):
    rest = values - columns @ coefficients
    return np.mean(np.maximum(quantile * rest, (quantile - 1) * rest))


@pytest.mark.parametrize("quantile", [0.05, 0.5, 0.8])
@pytest.mark.parametrize("seed", range(3))
def test_agrees_with_statsmodels(seed, quantile):
    columns, values = problem(seed)
    found = quantile_regression(columns, values, quantile=quantile)
    expected = QuantReg(values, columns).fit(q=quantile).params
    np.testing.assert_allclose(found, expected, atol=2e-6)


@pytest.mark.parametrize("quantile", [0.05, 0.5])
def test_its_loss_is_nearly_the_least(quantile):
    columns, values = problem(4)
    n, k = columns.shape
    prices = np.repeat([0.0, quantile / n, (1 - quantile) / n], [k, n, n])
    identity = np.eye(n)
    best = linprog(
        prices,
        A_eq=np.hstack([columns, identity, -identity]),
        b_eq=values,
        bounds=[(None, None)] * k + [(0, None)] * (2 * n),
    ).fun
    found = quantile_regression(columns, values, quantile=quantile)
    assert loss(columns, values, quantile, found) < best * (1 + 1e-4)


def test_values_without_noise_are_met():
    columns, _ = problem(5)
    truth = np.array([1.0, -2.0, 0.5, 3.0])
    found = quantile_regression(columns, columns @ truth, quantile=0.05)
    np.testing.assert_allclose(found, truth, rtol=1e-12)


def test_dependent_columns_share_their_coefficient():
    columns, values = problem(6)
    found = quantile_regression(np.column_stack([columns, columns[:, 1]]), values, quantile=0.3)
    alone = quantile_regression(columns, values, quantile=0.3)
    assert found[4] == pytest.approx(found[1], rel=1e-9)
    assert found[1] == pytest.approx(0.5 * alone[1], rel=1e-3)
