"""Several events within one step, on a system whose exact trajectory the method can follow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hybrid_systems import ladder, ladder_solution

from hopdata.hybrid.printed import (
    PrintedOptions,
    Step,
    closed_form,
    coefficients,
    hermite,
    heun3_step,
    illinois_root,
    impact_fractions,
    region_of,
    resolve_contacts,
)
from hopdata.hybrid.printed.roots import FINDERS
from hopdata.hybrid.printed.spline import value

each = pytest.mark.parametrize(
    "options", [PrintedOptions(name) for name in FINDERS], ids=FINDERS
)
LONG = 3.0


def resolve(rungs, gains, options=None):
    """Resolve a step of the ladder from rest at 0; its first mode moves at speed 1."""
    region = region_of(ladder(len(rungs)), (*rungs, *gains))
    wrong_end = np.array([LONG, 0.5 * LONG**2])
    locks = region.first_locks(0.0, np.zeros(2))
    return resolve_contacts(region, 0.0, np.zeros(2), LONG, wrong_end, locks, options)


@each
@pytest.mark.parametrize("rungs", [[0.5, 1.0, 1.25], [2.5, 0.3, 0.31], [1.0, 1.0, 1.0]])
def test_any_order_of_events(rungs, options):
    gains = [0.5, -0.9, 3.0]
    found = resolve(rungs, gains, options)
    instants, end = ladder_solution(rungs, gains, LONG)
    assert found.y[0] == pytest.approx(end, abs=1e-14)
    assert {one.guard: one.time for one in found.crossings} == pytest.approx(
        {k: time for k, time in enumerate(instants) if time <= LONG}, abs=1e-14
    )
    assert found.locks.tolist() == [1 if time <= LONG else -1 for time in instants]


def test_guards_that_a_later_mode_does_not_reach_are_not_crossed():
    found = resolve([0.5, 1.5], [-0.9, 0.0])
    assert [one.guard for one in found.crossings] == [0]
    assert found.y[0] == pytest.approx(0.5 + 0.1 * 2.5)


def test_guards_that_only_a_later_mode_reaches_are():
    found = resolve([0.5, 4.0], [2.0, 0.0])
    assert [one.guard for one in found.crossings] == [0, 1]


def test_slopes_not_refreshed_bend_the_state_at_later_events():
    """As printed, the second spline has the slopes of the first mode at both ends."""
    rungs, gains = [0.5, 1.5], [1.0, 1.0]
    end = ladder_solution(rungs, gains, LONG)[1]
    stale = resolve(rungs, gains, PrintedOptions(refresh_slopes=False))
    assert resolve(rungs, gains).y[0] == pytest.approx(end, abs=1e-14)
    assert abs(stale.y[0] - end) > 0.1


@each
@pytest.mark.parametrize("beyond", [1e-17, 0.0, -1e-17])
def test_a_second_guard_at_the_surface_has_an_instant(options, beyond):
    """Guards that cross together are at zero up to rounding; at +1e-17 there is no bracket."""
    region = region_of(ladder(1), (0.0, 1.0))
    y0, y1, f = np.array([beyond, 0.0]), np.array([1.0, 0.0]), np.array([1.0, 0.0])
    locks, candidates = np.array([-1]), np.array([0])
    step = Step(0.0, y0, f, 1.0, y1, f)
    parts = impact_fractions(region, step, locks, candidates, options)
    assert parts == pytest.approx([0.0], abs=2e-17)


@each
def test_a_second_guard_beyond_the_surface_has_no_bracket_as_printed(options):
    region = region_of(ladder(1), (0.0, 1.0))
    slope = np.array([1.0, 0.0])
    locks, candidates = np.array([-1]), np.array([0])
    printed = replace(options, cross_at_surface=False)
    beyond = Step(0.0, np.array([1e-17, 0.0]), slope, 1.0, np.ones(2), slope)
    with pytest.raises(ArithmeticError, match="no bracket for the root of rung0"):
        impact_fractions(region, beyond, locks, candidates, printed)
    before = Step(0.0, np.array([-1e-17, 0.0]), slope, 1.0, np.ones(2), slope)
    assert impact_fractions(region, before, locks, candidates, printed)[0] < 1e-16


def test_with_a_restart_the_step_ends_at_its_first_crossing():
    found = resolve([0.5, 1.5], [1.0, 1.0], PrintedOptions(tail="restart"))
    assert [one.guard for one in found.crossings] == [0]
    assert found.t == pytest.approx(0.5, abs=1e-15)
    assert found.y[0] == pytest.approx(0.5, abs=1e-15)
    assert found.locks.tolist() == [1, -1]


def test_an_event_at_the_very_end_leaves_no_step():
    found = resolve([LONG], [1.0])
    assert [(one.guard, one.time) for one in found.crossings] == [(0, LONG)]
    assert found.y[0] == LONG
    assert found.locks.tolist() == [1]


def test_heun_is_of_third_order():
    steps, errors = 0.05 / 2.0 ** np.arange(5), []
    for dt in steps:
        end = heun3_step(lambda t, y: y * np.cos(t), 0.0, np.ones(1), dt)
        errors.append(abs(end[0] - np.exp(np.sin(dt))))
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(
        4.0, abs=0.1
    )


# The Hermite cubic against NumPy's polynomials.


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
    whole = np.polynomial.polynomial.polyval(
        0.37, coefficients(y0, y1, 0.2 * f0, 0.2 * f1)
    )
    assert whole == pytest.approx(hermite(0.37, y0, y1, f0, f1, 0.2), abs=1e-14)


# Both root finders against polynomials whose roots are known.

EPS = 2.0**-52
each_roots = pytest.mark.parametrize("find", FINDERS.values(), ids=FINDERS)


def rising_cubics(count, *, stretch=1.0):
    """Return coefficients of rising cubics with one root in (0, 1), and that root."""
    rng = np.random.default_rng(8)
    for _ in range(count):
        root = rng.uniform(0.01, 0.99)
        others = stretch * rng.uniform(1.5, 4.0, 2) * rng.choice([-1, 1], 2)
        polynomial = np.polynomial.Polynomial.fromroots([root, *others])
        sign = np.sign(polynomial.deriv()(root))
        yield tuple(float(c) for c in sign * polynomial.coef), root


@each_roots
@pytest.mark.parametrize("stretch", [1.0, 30.0, 1e4])  # larger is closer to a line
def test_one_root(find, stretch):
    for cubic, root in rising_cubics(200, stretch=stretch):
        found = find(cubic)
        assert found == pytest.approx(root, abs=8 * EPS)
        assert 0.0 <= found <= 1.0


@each_roots
def test_complex_pair_beside_the_root(find):
    for root in (0.1, 0.5, 0.93):
        cubic = tuple(np.polymul([1.0, -root], [1.0, -0.6, 0.4])[::-1])
        assert find(cubic) == pytest.approx(root, abs=8 * EPS)


@each_roots
@pytest.mark.parametrize("start", [-1e-17, -1e-300])
def test_root_at_the_very_start(find, start):
    cubic = (start, 1.0, 0.1, -0.05)
    assert find(cubic) == pytest.approx(-start, rel=1e-6, abs=0)


@each_roots
@pytest.mark.parametrize("start", [-1e-17, -1e-120, -1e-300])
def test_line_from_the_very_start(find, start):
    assert find((start, 1.0, 0.0, 0.0)) == pytest.approx(-start, rel=1e-6, abs=0)


@each_roots
@pytest.mark.parametrize("before", [1e-7, 1e-12, 1e-16])
def test_a_guard_that_has_just_left_zero_comes_back_later(find, before):
    cubic = tuple(np.poly([-before, 0.6, -5.0])[::-1])
    assert find(cubic) == pytest.approx(0.6, abs=8 * EPS)


@each_roots
def test_lines_parabolas_and_ends(find):
    assert find((-0.25, 1.0, 0.0, 0.0)) == pytest.approx(0.25, abs=EPS)
    assert find((-0.25, 0.0, 1.0, 0.0)) == pytest.approx(0.5, abs=EPS)
    assert find((-1.0, 0.0, 0.0, 1.0)) == 1.0
    assert find((-1.0, 1.0, 0.0, 0.0)) == 1.0


@each_roots
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

    assert illinois_root(function, 0.0, 1.0) == pytest.approx(
        np.log(4) / 3, abs=2 * EPS
    )
    assert len(calls) < 20
