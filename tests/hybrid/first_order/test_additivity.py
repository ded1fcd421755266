"""Measures of additivity on numbers that are known."""

from __future__ import annotations

import numpy as np
import pytest

from hopdata.hybrid.first_order.additivity import (
    additive_residual,
    increments,
    largest_relative,
    spread,
)
from hopdata.hybrid.first_order.local import Linearisation


def modes(rates):
    return {
        crossed: Linearisation(None, np.array(rate, dtype=float), np.eye(2), np.zeros(2))
        for crossed, rate in rates.items()
    }


ADDITIVE = {(): [1, 0], (3,): [1, 2], (5,): [1, -7], (3, 5): [1, -5]}


def test_sums_of_single_changes():
    assert additive_residual(modes(ADDITIVE)) == 0
    changed = modes(ADDITIVE | {(3, 5): [1, -4.3]})
    assert additive_residual(changed) == pytest.approx(0.1)
    single, size = increments(changed)
    assert single.tolist() == [[0, 2], [0, -7]]
    assert size.tolist() == [1, 7]


def test_two_that_vanish_are_equal():
    assert largest_relative(np.array([0.0, 1.0]), np.array([0.0, 4.0])) == 0.25
    assert largest_relative(np.zeros(2), np.zeros(2)) == 0


def test_spread_is_relative_to_the_effect():
    one = np.array([[1.0, 0.0], [3.0, 1.0]])
    other = np.array([[1.0, 0.0], [4.0, 1.0]])
    assert spread([one, other, one]) == pytest.approx(0.25)
    assert spread([one, one]) == 0
    assert spread([np.eye(2)]) == 0
