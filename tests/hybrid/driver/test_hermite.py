"""The Hermite cubic against NumPy's polynomials."""

from __future__ import annotations

import numpy as np
import pytest

from hopdata.hybrid.driver.hermite import NOWHERE, cubic, cubic_root, turning_points


def ends(polynomial):
    slope = polynomial.deriv()
    return polynomial(0.0), slope(0.0), polynomial(1.0), slope(1.0)


@pytest.fixture
def rng():
    return np.random.default_rng(11)


def test_value(rng):
    for coefficients in rng.normal(size=(50, 4)):
        polynomial = np.polynomial.Polynomial(coefficients)
        x = rng.uniform()
        assert cubic(*ends(polynomial), x) == pytest.approx(polynomial(x), abs=1e-13)


def test_turning_points(rng):
    seen = 0
    for coefficients in rng.normal(size=(300, 4)):
        polynomial = np.polynomial.Polynomial(coefficients)
        top, bottom = turning_points(*ends(polynomial))
        curvature = polynomial.deriv(2)
        roots = [x.real for x in polynomial.deriv().roots() if x.imag == 0 and 0 < x.real < 1]
        for found, kind in ((top, -1), (bottom, 1)):
            expected = [x for x in roots if np.sign(curvature(x)) == kind]
            assert (found == NOWHERE) == (not expected)
            if expected:
                assert found == pytest.approx(expected[0], abs=1e-9)
                seen += 1
    assert seen > 50


@pytest.mark.parametrize("b", [1.0, 0.0, -1.0])
def test_turning_points_of_parabolas(b):
    polynomial = np.polynomial.Polynomial([0.0, -b, b])
    top, bottom = turning_points(*ends(polynomial))
    assert (top, bottom) == {1.0: (NOWHERE, 0.5), 0.0: (NOWHERE,) * 2, -1.0: (0.5, NOWHERE)}[b]


def test_root(rng):
    for _ in range(100):
        a, c = rng.uniform(0.1, 0.9), rng.uniform(1.1, 3.0)
        polynomial = np.polynomial.Polynomial.fromroots([a, c, -c]) * rng.uniform(0.1, 10)
        assert cubic_root(*ends(polynomial), 0.0, 1.0) == pytest.approx(a, rel=1e-6)


def test_root_past_a_top_that_the_search_begins_before():
    polynomial = np.polynomial.Polynomial.fromroots([0.0, 0.0, 0.9]) * -1.0
    assert polynomial.deriv()(0.5) > 0
    assert cubic_root(*ends(polynomial), 0.0, 1.0) == pytest.approx(0.9, rel=1e-6)
