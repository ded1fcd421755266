"""The rule that fits an order."""

from __future__ import annotations

import numpy as np
import pytest

from hopdata.hybrid.printed.order import fit_limit, fit_order

STEPS = np.geomspace(1e-3, 1.0, 25)


def test_a_line_is_found_between_plateau_and_rounding():
    error = np.minimum(1e-14 + 2.0 * STEPS**4, 1e-4)
    fit = fit_order(STEPS, error)
    assert fit.order == pytest.approx(4.0, abs=0.02)
    assert fit.factor == pytest.approx(2.0, rel=0.1)
    assert not fit.used[error < 1e-12].any()
    assert not fit.used[STEPS > 0.15].any()
    assert fit.error(STEPS[fit.used]) == pytest.approx(error[fit.used], rel=0.1)


def test_steps_may_come_in_any_order():
    shuffled = np.random.default_rng(1).permutation(len(STEPS))
    one, other = (fit_order(s, 3 * s**5) for s in (STEPS, STEPS[shuffled]))
    assert one.order == pytest.approx(other.order)
    assert one.used[shuffled].tolist() == other.used.tolist()


def test_scatter_is_no_line():
    error = 10.0 ** np.where(np.arange(len(STEPS)) % 2, -4.0, -8.0)
    fit = fit_order(STEPS, error)
    assert np.isnan(fit.order)
    assert not fit.used.any()


def test_the_limit_is_found_where_no_line_is_straight():
    """The error is that of Dormand-Prince at a rate of 10: z^5 (1 - 5/7 z)."""
    z = 10.0 * STEPS
    error = np.where(z < 1.0, z**5 * (1.0 - 5.0 / 7.0 * z), 1.0) + 1e-16
    limit = fit_limit(STEPS, error, shortest_piece=0.05)
    assert limit.order == pytest.approx(5.0, abs=0.01)
    assert limit.bend == pytest.approx(-50.0 / 7.0, rel=0.2)
    assert limit.n_steps == ((STEPS <= 0.0125) & (error >= 1e-12)).sum()
    assert fit_order(STEPS, error).order < 4.97


def test_the_standard_error_is_that_of_the_scatter():
    rng, orders, said = np.random.default_rng(7), [], []
    for _ in range(200):
        error = 2.0 * STEPS**4 * np.exp(3.0 * STEPS + rng.normal(0.0, 0.02, len(STEPS)))
        limit = fit_limit(STEPS, error, shortest_piece=4.0)
        orders.append(limit.order)
        said.append(limit.standard_error)
    assert np.mean(orders) == pytest.approx(4.0, abs=0.005)
    assert np.std(orders) == pytest.approx(np.mean(said), rel=0.2)


def test_too_few_steps_have_no_limit():
    limit = fit_limit(STEPS, STEPS**8, shortest_piece=0.5)
    assert np.isnan(limit.order)
    assert limit.n_steps < 5
