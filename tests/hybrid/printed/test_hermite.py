"""The Hermite cubic against NumPy's polynomials."""

from __future__ import annotations

import numpy as np
import pytest

from hopdata.hybrid.printed.hermite import coefficients, hermite


def test_a_cubic_is_its_own_interpolant():
    rng = np.random.default_rng(3)
    for cubic in (np.polynomial.Polynomial(row) for row in rng.normal(size=(20, 4))):
        slope, dt, start = cubic.deriv(), 0.3, 1.2
        ends = cubic(start), cubic(start + dt), slope(start), slope(start + dt)
        for theta in (0.0, 0.21, 0.5, 1.0):
            expected = cubic(start + theta * dt)
            assert hermite(theta, *ends, dt) == pytest.approx(expected, abs=1e-13)


def test_coefficients_are_those_of_the_same_cubic():
    y0, y1, f0, f1 = np.random.default_rng(4).normal(size=(4, 5))
    whole = np.polynomial.polynomial.polyval(0.37, coefficients(y0, y1, 0.2 * f0, 0.2 * f1))
    assert whole == pytest.approx(hermite(0.37, y0, y1, f0, f1, 0.2), abs=1e-14)
