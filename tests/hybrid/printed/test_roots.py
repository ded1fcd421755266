"""Both root finders against polynomials whose roots are known."""

from __future__ import annotations

import numpy as np
import pytest

from hopdata.hybrid.printed.roots import FINDERS, closed_form, illinois_root, value

EPS = 2.0**-52
each = pytest.mark.parametrize("find", FINDERS.values(), ids=FINDERS)


def rising_cubics(count, *, stretch=1.0):
    """Coefficients with one root in (0, 1), where they rise, and that root."""
    rng = np.random.default_rng(8)
    for _ in range(count):
        root = rng.uniform(0.01, 0.99)
        others = stretch * rng.uniform(1.5, 4.0, 2) * rng.choice([-1, 1], 2)
        polynomial = np.polynomial.Polynomial.fromroots([root, *others])
        sign = np.sign(polynomial.deriv()(root))
        yield tuple(float(c) for c in sign * polynomial.coef), root


@each
@pytest.mark.parametrize("stretch", [1.0, 30.0, 1e4])  # the larger, the nearer to a line
def test_one_root(find, stretch):
    for cubic, root in rising_cubics(200, stretch=stretch):
        found = find(cubic)
        assert found == pytest.approx(root, abs=8 * EPS)
        assert 0.0 <= found <= 1.0


@each
def test_complex_pair_beside_the_root(find):
    for root in (0.1, 0.5, 0.93):
        cubic = tuple(np.polymul([1.0, -root], [1.0, -0.6, 0.4])[::-1])
        assert find(cubic) == pytest.approx(root, abs=8 * EPS)


@each
@pytest.mark.parametrize("start", [-1e-17, -1e-300])
def test_root_at_the_very_start(find, start):
    cubic = (start, 1.0, 0.1, -0.05)
    assert find(cubic) == pytest.approx(-start, rel=1e-6, abs=0)


@each
@pytest.mark.parametrize("start", [-1e-17, -1e-120, -1e-300])
def test_line_from_the_very_start(find, start):
    assert find((start, 1.0, 0.0, 0.0)) == pytest.approx(-start, rel=1e-6, abs=0)


@each
@pytest.mark.parametrize("before", [1e-7, 1e-12, 1e-16])
def test_a_guard_that_has_just_left_zero_comes_back_later(find, before):
    cubic = tuple(np.poly([-before, 0.6, -5.0])[::-1])
    assert find(cubic) == pytest.approx(0.6, abs=8 * EPS)


@each
def test_lines_parabolas_and_ends(find):
    assert find((-0.25, 1.0, 0.0, 0.0)) == pytest.approx(0.25, abs=EPS)
    assert find((-0.25, 0.0, 1.0, 0.0)) == pytest.approx(0.5, abs=EPS)
    assert find((-1.0, 0.0, 0.0, 1.0)) == 1.0
    assert find((-1.0, 1.0, 0.0, 0.0)) == 1.0


@each
def test_triple_root_as_far_as_it_is_defined(find):
    cubic = tuple(np.poly([0.5, 0.5, 0.5])[::-1])
    assert abs(value(cubic, find(cubic))) < 4 * EPS


def test_the_closed_form_gives_the_first_of_three():
    cubic = tuple(np.poly([0.2, 0.5, 0.8])[::-1])
    assert closed_form(cubic) == pytest.approx(0.2, abs=8 * EPS)


def test_illinois_beats_bisection():
    calls = []

    def function(x):
        calls.append(x)
        return np.exp(3 * x) - 4.0

    assert illinois_root(function, 0.0, 1.0) == pytest.approx(np.log(4) / 3, abs=2 * EPS)
    assert len(calls) < 20
