"""One-step methods have their orders in the sense of Definition 4.2.1."""

from __future__ import annotations

import numpy as np
import pytest

from hopdata.hybrid.printed.one_step import dopri5_step, heun3_step, rk4_step
from hopdata.hybrid.printed.order import order_of_step


def slope(t, y):
    return y * np.cos(t)


def solution(t):
    return np.array([np.exp(np.sin(t))])


@pytest.mark.parametrize(
    ("one_step", "order", "longest"),
    [(heun3_step, 3, 0.05), (rk4_step, 4, 0.1), (dopri5_step, 5, 0.2)],
)
def test_the_error_of_one_step_shrinks_as_the_order_says(one_step, order, longest):
    steps = longest / 2.0 ** np.arange(4)
    found = order_of_step(one_step, slope, solution, steps, start=0.4)
    assert found == pytest.approx(order, abs=0.15)


def test_a_step_of_the_wrong_slope_has_no_order():
    """Its error is that of the slope, in proportion to the step: order 0."""

    def wrong(f, t, y, dt):
        return rk4_step(lambda t, y: 1.01 * f(t, y), t, y, dt)

    steps = 0.02 / 2.0 ** np.arange(4)
    assert order_of_step(wrong, slope, solution, steps) == pytest.approx(0.0, abs=0.02)
