"""The rule by which an order is fitted."""

from __future__ import annotations

import numpy as np
import pytest

from hopdata.hybrid.printed.order import fit_order

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
