"""Rodas5P: fifth order, L-stable, with a dense output, on problems of any stiffness."""

from __future__ import annotations

import numpy as np
import pytest
from method_harness import END, KEND, Y
from stiff_problems import (
    CONTACT,
    FOLLOWER,
    KAPS,
    SMOOTH,
    damped_contact,
    exact,
    field,
    stepper,
)

from hopdata.hybrid.methods import stiff as rosenbrock
from hopdata.hybrid.methods.stiff import GAMMA, STAGES, TIME, A, C, D, H

BOTH = pytest.mark.parametrize("given", [True, False], ids=["given", "differences"])


def fitted_order(sizes, errors):
    return np.polyfit(np.log(sizes), np.log(errors), 1)[0]


def global_error(params, steps, **options):
    one = stepper(params, 0.0, exact(params, 0.0), **options)
    one.run_fixed(2.0, steps)
    return np.abs(one.s[Y] - exact(params, 2.0)).max()


# The coefficients in the form with products by the Jacobian (Hairer and Wanner, section
# IV.7).
GAMMAS = np.linalg.inv(np.eye(STAGES) / GAMMA - C)
ALPHAS = A @ GAMMAS
BETAS = ALPHAS + GAMMAS
LAST = A[-1] + np.eye(STAGES)[-1]


def test_the_coefficients_are_consistent():
    """The sums of the stages' weights are their times."""
    assert ALPHAS.sum(axis=1) == pytest.approx(TIME, abs=1e-12)
    assert GAMMAS.sum(axis=1) == pytest.approx(D, abs=1e-12)


def order_conditions(weights, theta):
    """Return the residuals of the eight conditions of order 4 at a fraction of the step."""
    a = ALPHAS.sum(axis=1)
    b = BETAS.sum(axis=1)
    of_trees = [
        np.ones(STAGES), b, a**2, BETAS @ b,
        a**3, a * (ALPHAS @ b), BETAS @ a**2, BETAS @ BETAS @ b,
    ]  # fmt: skip
    wanted = theta ** np.array([1, 2, 3, 3, 4, 4, 4, 4]) / [1, 2, 3, 6, 4, 8, 12, 24]
    return np.array(of_trees) @ (weights @ GAMMAS) - wanted


@pytest.mark.parametrize("theta", [0.2, 0.5, 0.8, 1.0])
def test_the_conditions_of_order_four_are_met_within_the_step(theta):
    inner = H[0] + theta * H[1] + theta**2 * H[2]
    weights = theta * (LAST + (1.0 - theta) * inner)
    assert np.abs(order_conditions(weights, theta)).max() < 1e-11
    assert np.abs(order_conditions(A[-1], 1.0)).max() < 1e-11


def stability(z, *, embedded=False):
    """Return the factor by which a step multiplies y in y' = z y / dt."""
    slopes = np.linalg.solve(np.eye(STAGES) - z * BETAS, np.full(STAGES, z))
    return 1.0 + (A[-1] if embedded else LAST) @ GAMMAS @ slopes


def test_stability_is_that_of_a_stiffly_accurate_method():
    angles = np.linspace(0.0, np.pi / 2, 50)
    for size in (0.1, 1.0, 10.0, 1e3):
        assert (
            max(abs(stability(-size * np.exp(1j * x))) for x in angles) <= 1.0 + 1e-12
        )
    assert abs(stability(-1e9)) < 1e-6
    assert abs(stability(-1e9, embedded=True)) < 1e-6


@BOTH
def test_fifth_order_on_a_nonlinear_problem_that_depends_on_time(given):
    steps = np.array([20, 40, 80, 160])
    errors = [global_error((SMOOTH, 0.0), n, given=given) for n in steps]
    assert 4.7 < fitted_order(2.0 / steps, errors) < 5.3


@BOTH
def test_fourth_order_at_least_where_stiff(given):
    steps = np.array([10, 20, 40])
    errors = [global_error((FOLLOWER, 1e6), n, given=given) for n in steps]
    assert fitted_order(2.0 / steps, errors) > 3.8


def test_the_error_estimate_goes_with_the_power_that_is_declared():
    sizes = 0.2 / 2.0 ** np.arange(4)
    one = stepper((SMOOTH, 0.0), 0.5, exact((SMOOTH, 0.0), 0.5))
    estimates = [one.step(dt) for dt in sizes]
    assert abs(fitted_order(sizes, estimates) - rosenbrock.ORDER) < 0.3


@BOTH
@pytest.mark.parametrize("rtol", [1e-4, 1e-7, 1e-10])
@pytest.mark.parametrize(
    "params", [(SMOOTH, 0.0), (KAPS, 1e3), (KAPS, 1e9), (FOLLOWER, 1e4)]
)
def test_the_tolerance_is_met(params, rtol, given):
    one = stepper(params, 0.0, exact(params, 0.0), rtol=rtol, atol=rtol, given=given)
    one.run(2.0, 1e-3)
    assert np.abs(one.s[Y] - exact(params, 2.0)).max() < 3.0 * rtol


@BOTH
def test_stiffness_does_not_limit_the_step(given):
    """An explicit method would take 600,000 steps at the first rate, and 6e11 at the last."""
    taken = []
    for rate in (1e6, 1e8, 1e10, 1e12):
        one = stepper((KAPS, rate), 0.0, [1.0, 1.0], given=given)
        taken.append(sum(one.run(2.0, 1e-3)))
    assert max(taken) < 100
    assert max(taken[1:]) < 40


@BOTH
@pytest.mark.parametrize("rate", [1e2, 1e6, 1e9, 1e12])
def test_a_landing_on_a_strong_damper(rate, given):
    """The test covers the impact of the landing, which lasts 1 / rate, and the creep after it."""
    weight = 9.81
    stiffness = 2.0 * rate
    one = stepper(
        (CONTACT, rate, weight, stiffness, 0.0), 0.0, [0.0, -3.0], given=given
    )
    one.atol = np.array([1e-9 * 3.0 / rate, 1e-9])
    steps = sum(one.run(2.0, 0.01 / rate))
    error = np.abs(one.s[Y] - damped_contact(weight, rate, stiffness, [0.0, -3.0], 2.0))
    assert np.all(error < 3.0 * (one.atol + one.rtol * np.abs(one.s[Y])))
    assert steps < 300


@BOTH
def test_the_interpolant_is_fourth_order(given):
    params = (SMOOTH, 0.0)
    sizes = 0.2 / 2.0 ** np.arange(4)
    one = stepper(params, 0.5, exact(params, 0.5), given=given)
    errors = []
    for dt in sizes:
        one.step(dt)
        inside = [
            one.interpolate(x) - exact(params, 0.5 + x * dt) for x in (0.25, 0.5, 0.8)
        ]
        errors.append(np.abs(inside).max())
    assert (
        fitted_order(sizes, errors) > 4.7
    )  # error of one step: the method's order of 4 plus one


def test_the_interpolant_meets_both_ends():
    one = stepper((FOLLOWER, 1e5), 0.5, exact((FOLLOWER, 1e5), 0.5))
    one.step(0.1)
    assert np.array_equal(one.interpolate(0.0), one.s[Y])
    assert one.interpolate(1.0) == pytest.approx(one.s[END], rel=1e-15)


@pytest.mark.parametrize("params", [(KAPS, 1e9), (FOLLOWER, 1e6)])
def test_the_interpolant_is_accurate_where_stiff(params):
    one = stepper(params, 0.3, exact(params, 0.3), rtol=1e-6, atol=1e-6)
    dt = 0.05
    assert one.step(dt) < 1.0
    for theta in (0.2, 0.5, 0.9):
        error = one.interpolate(theta) - exact(params, 0.3 + theta * dt)
        assert np.abs(error).max() < 3e-6


def test_the_slope_at_the_end_is_the_field():
    one = stepper((SMOOTH, 0.0), 0.5, exact((SMOOTH, 0.0), 0.5))
    one.step(0.1)
    slope = np.empty(2)
    field(0.6, one.s[END], one.mode, one.params, slope)
    assert np.array_equal(one.s[KEND], slope)


@pytest.mark.parametrize(
    ("params", "given", "count"),
    [((KAPS, 1e6), True, 9), ((KAPS, 1e6), False, 13), ((FOLLOWER, 1e6), True, 11)],
)
def test_evaluations_are_counted(params, given, count):
    one = stepper(params, 0.5, exact(params, 0.5), given=given)
    one.step(0.01)
    assert one.s[rosenbrock.INFO, 0] == count


def test_a_field_that_is_not_finite_is_rejected():
    one = stepper((KAPS, np.inf), 0.0, [1.0, 1.0])
    assert not np.isfinite(one.step(0.1))


@BOTH
@pytest.mark.parametrize("scale", [2.0**-40, 2.0**40])
def test_units_of_length_change_nothing(scale, given):
    weight = 9.81
    rate = 1e4
    spring = 1e5
    square = 1e6
    y = np.array([-0.01, -3.0])
    one = stepper((CONTACT, rate, weight, spring, square), 0.0, y, given=given)
    plain = one.step(1e-3)
    end = one.s[END].copy()
    scaled = (CONTACT, rate, weight * scale, spring, square / scale)
    one = stepper(scaled, 0.0, y * scale, given=given, atol=1e-12 * scale)
    assert one.step(1e-3) == plain
    assert np.array_equal(one.s[END], end * scale)


@BOTH
@pytest.mark.parametrize("scale", [2.0**-20, 2.0**20])
def test_units_of_time_change_nothing(scale, given):
    """Only rounding differs, because pivots may be chosen in another order."""
    weight = 9.81
    rate = 1e4
    spring = 1e5
    square = 1e6
    y = np.array([-0.01, -3.0])
    one = stepper((CONTACT, rate, weight, spring, square), 0.0, y, given=given)
    plain = one.step(1e-3)
    end = one.s[END].copy()
    faster = (
        CONTACT,
        rate * scale,
        weight * scale**2,
        spring * scale**2,
        square * scale**2,
    )
    units = np.array([1.0, scale])
    one = stepper(faster, 0.0, y * units, given=given, atol=1e-12 * units)
    assert one.step(1e-3 / scale) == pytest.approx(plain, rel=1e-6)
    assert one.s[END] == pytest.approx(end * units, rel=1e-12)
