"""Taylor series of affine modes: exact except for rounding, and also the dense output."""

from __future__ import annotations

import os
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest
from method_harness import (
    END,
    K1,
    KEND,
    NO_ADDRESS,
    P1,
    Stepper,
    Y,
    compiled,
    specialised,
)

from hopdata.hybrid.compiled.memory import view
from hopdata.hybrid.methods import taylor

EPS = 2.0**-52


@compiled
def affine(mode, params, a, b):
    """Fill in A and b row by row from the parameters; zeros are left out, as a user would."""
    n = len(b)
    for i in range(n):
        if params[n * n + i] != 0.0:
            b[i] = params[n * n + i]
        for j in range(n):
            if params[n * i + j] != 0.0:
                a[i, j] = params[n * i + j]


@compiled
def affine_field(t, y, mode, params, dy):
    n = len(y)
    for i in range(n):
        dy[i] = params[n * n + i]
        for j in range(n):
            dy[i] += params[n * i + j] * y[j]


CODES = {}


@compiled
def fastest_motion(table, first):
    return taylor.fastest_motion(view(table), first)


def stepper(a, b, y, **options):
    """Return a stepper at t = 0 for y' = a y + b."""
    a = np.asarray(a, dtype=float)
    b = np.asarray(b, dtype=float)
    n = len(b)
    method = SimpleNamespace(**{**vars(taylor), "step": taylor.step_function(n)})
    made = CODES.setdefault(n, Stepper(method, affine_field, n, AFFINE=affine))
    made.s[:] = np.nan
    made.params = np.concatenate([a.ravel(), b])
    made.rtol = options.get("rtol", 1e-9)
    made.atol = np.full(n, options.get("atol", 1e-12))
    names = {"AFFINE": affine, "N": n, "fastest_motion": fastest_motion}
    refresh = CODES.setdefault((n, "refresh"), specialised(taylor.refresh, **names))
    refresh(made.s, made.mode, made.params)
    made.start(0.0, y)
    return made


def flow(a, b, y, t):
    """Return the state at `t`, by a matrix exponential in 50 digits."""
    n = len(b)
    with mpmath.workdps(50):
        generator = mpmath.zeros(n + 1)
        for i in range(n):
            for j in range(n):
                generator[i, j] = mpmath.mpf(float(a[i][j])) * mpmath.mpf(t)
            generator[i, n] = mpmath.mpf(float(b[i])) * mpmath.mpf(t)
        end = mpmath.expm(generator) * mpmath.matrix([*(float(x) for x in y), 1.0])
        return np.array([float(end[i]) for i in range(n)])


def random_mode(n, seed=0):
    """Return a mode whose fastest rate is 1, and a state."""
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(n, n))
    return a / abs(np.linalg.eigvals(a)).max(), rng.normal(size=n), rng.normal(size=n)


SPRING = ([[0.0, 1.0], [-1000.0, 0.0]], [0.0, -9.81], [0.0, -5.0])
OMEGA = np.sqrt(1000.0)


#: Each number of states compiles: one, an even and an odd one, and many.
SIZES = [1, 2, 3, 4, 5, 6, 12] if "ALL" in os.environ else [1, 2, 5, 12]


@pytest.mark.parametrize("n", SIZES)
@pytest.mark.parametrize("dt", [1e-3, 0.3, 1.0, 2.0])
def test_a_step_is_exact_but_for_rounding(n, dt):
    a, b, y = random_mode(n)
    one = stepper(a, b, y)
    assert one.step(dt) < 1.0
    exact = flow(a, b, y, dt)
    assert np.abs(one.s[END] - exact).max() < 4 * EPS * np.abs(exact).max()


@pytest.mark.parametrize("z", [2.0, 4.0])
def test_where_a_mode_decays_terms_that_alternate_cost_no_digits(z):
    """Rounding each term once gives at most exp(z) / 2 eps, of which the mean is a small part."""
    rng = np.random.default_rng(3)
    errors = []
    for dt in z * (1.0 + 0.01 * rng.random(100)):
        one = stepper([[-1.0]], [0.0], [1.0])
        one.step(dt)
        errors += [one.s[END, 0] - np.exp(-dt), one.interpolate(1.0)[0] - one.s[END, 0]]
    assert np.sqrt(np.mean(np.square(errors))) < 0.1 * np.exp(z) * EPS


def test_a_flight_is_one_step_of_any_length():
    one = stepper([[0.0, 1.0], [0.0, 0.0]], [0.0, -9.81], [2.0, 3.0])
    for dt in (0.5, 100.0, 1e6):
        assert one.step(dt) == 0.0
        exact = [2.0 + 3.0 * dt - 9.81 * dt**2 / 2, 3.0 - 9.81 * dt]
        assert one.s[END] == pytest.approx(exact, rel=2 * EPS)


def test_a_chain_of_integrators_is_not_cut_short():
    """Only the last state is not zero, so in each component every term but one vanishes."""
    n = 12
    one = stepper(np.diag(np.ones(n - 1), 1), np.zeros(n), np.eye(n)[-1])
    assert one.step(2.0) == 0.0
    powers = 2.0 ** np.arange(n - 1, -1, -1)
    factorials = np.cumprod([1.0, *range(1, n)])[::-1]
    assert one.s[END] == pytest.approx(powers / factorials, rel=4 * EPS)


def test_a_term_may_rest_in_the_states_that_count():
    """Every second term moves only the speed, whose tolerance is loose; the series continues."""
    one = stepper([[0.0, 1.0], [-1.0, 0.0]], [0.0, 0.0], [1.0, 0.0])
    one.atol = np.array([0.0, 1e3])
    one.step(1.0)
    assert one.s[END, 0] == pytest.approx(np.cos(1.0), rel=2 * EPS)


def test_half_a_stance_is_one_step():
    """A spring turns by 3 radians: the step is accepted at 1e-9 and is far more accurate."""
    one = stepper(*SPRING)
    assert one.step(3.0 / OMEGA) < 1.0
    exact = flow(*SPRING, 3.0 / OMEGA)
    assert one.s[END] == pytest.approx(exact, rel=1e-12)


def test_an_equilibrium_stays():
    one = stepper([[0.0, 1.0], [-1000.0, -1.0]], [0.0, -10.0], [-0.01, 0.0])
    assert one.step(10.0) == 0.0
    assert one.s[END].tolist() == [-0.01, 0.0]


@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("turn", [2.0, 4.0, 6.0, 8.0, 12.0])
def test_the_error_estimate_bounds_the_error(turn, rtol):
    """Beyond degree 32 the error is truncation; its estimate is at most ten times too large."""
    a, b, y = SPRING
    one = stepper(a, b, y, rtol=rtol, atol=1e-12 * rtol)
    estimate = one.step(turn / OMEGA) / max(rtol / taylor.SHARP, 1.0)
    error = np.abs(one.s[END] - flow(a, b, y, turn / OMEGA))
    size = np.maximum(np.abs(y), np.abs(one.s[P1]))
    in_tolerances = (error / (rtol * size)).max()
    rounding = 10 * EPS * np.exp(turn) / rtol
    assert in_tolerances < 2.0 * estimate + rounding
    if in_tolerances > 100 * rounding:
        assert estimate < 30.0 * in_tolerances


def test_the_estimate_goes_with_the_power_that_is_declared():
    estimates = [
        stepper(*SPRING).step(turn / OMEGA) for turn in (0.5, 1.0, 2.0, 4.0, 8.0)
    ]
    orders = np.diff(np.log2(estimates))
    assert orders == pytest.approx(np.full(4, taylor.ORDER), abs=1.5)


def test_step_control_needs_few_rejections():
    """The first step is a million times too long; after it none is rejected."""
    one = stepper(*SPRING)
    end = 40 * np.pi / OMEGA
    taken, rejected = one.run(end, 1e6)
    assert rejected <= 15
    assert taken <= 50  # at least 2.5 radians per step
    assert one.s[Y] == pytest.approx(SPRING[2], rel=1e-8, abs=1e-8)


def test_a_tight_tolerance_is_met_over_many_steps():
    one = stepper(*SPRING, rtol=1e-15, atol=0.0)
    one.run(2.0, 0.01)
    exact = flow(*SPRING, 2.0)
    assert np.abs(one.s[Y] - exact).max() < 1e-13 * np.abs(exact).max()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_state_that_is_not_finite_is_rejected(bad):
    one = stepper(*SPRING)
    one.s[K1, 1] = bad
    assert not np.isfinite(one.step(0.01)) or not np.isfinite(one.s[END]).all()
    assert not one.step(0.01) <= 1.0


def test_overflow_is_rejected():
    one = stepper([[1e200, 0.0], [0.0, 1e200]], [0.0, 0.0], [1.0, 1.0])
    assert not one.step(1.0) <= 1.0


def test_the_slope_at_the_end_is_the_field():
    one = stepper(*SPRING)
    one.step(0.05)
    slope = np.empty(2)
    affine_field(0.05, one.s[END], one.mode, one.params, slope)
    assert one.s[KEND] == pytest.approx(slope, rel=2 * EPS)


def test_a_field_that_is_not_the_affine_one_is_found():
    a, b, y = random_mode(3)
    one = stepper(a, b, y)
    refresh = CODES[3, "refresh"]
    assert refresh(one.s, one.mode, one.params) < 4 * EPS
    one.s[K1, 1] *= 1.0 + 1e-9
    assert refresh(one.s, one.mode, one.params) > 1e-11


@pytest.mark.parametrize("turn", [1e3, 1e6, 1e9])
def test_a_step_far_too_long_is_cut_to_size_at_once(turn):
    one = stepper(*SPRING)
    dt = turn / OMEGA
    rejected = 0
    while not (error := one.step(dt)) <= 1.0:
        dt *= 0.9 / error ** (1.0 / taylor.ORDER)
        rejected += 1
    assert rejected <= 2
    assert 3.0 < dt * OMEGA < 5.0


@pytest.mark.parametrize("n", [2, 6])
def test_the_interpolant_is_as_exact_as_the_step(n):
    a, b, y = random_mode(n, seed=1)
    one = stepper(a, b, y)
    one.step(2.0)
    assert one.interpolate(0.0).tolist() == list(y)
    ulp = np.spacing(np.abs(one.s[END]).max())
    assert np.abs(one.interpolate(1.0) - one.s[END]).max() <= 2 * ulp
    for theta in (0.1, 0.5, 0.9):
        exact = flow(a, b, y, theta * 2.0)
        assert (
            np.abs(one.interpolate(theta) - exact).max() < 8 * EPS * np.abs(exact).max()
        )


def test_the_interpolant_is_as_long_as_the_series():
    """A fall is a parabola: two vanishing terms end the series, and further ones are not read."""
    one = stepper([[0.0, 1.0], [0.0, 0.0]], [0.0, -9.81], [2.0, 3.0])
    one.step(0.5)
    degree = one.interpolant_code(
        one.t, one.dt, one.s, one.mode, one.params, NO_ADDRESS
    )
    assert 2 <= degree <= 4
    assert one.interpolate(0.5) == pytest.approx(
        [2.0 + 0.75 - 9.81 / 32, 3.0 - 9.81 / 4]
    )
    assert np.isnan(one.s[P1 + degree : P1 + taylor.DEGREE]).all()


@pytest.mark.parametrize("scale", [2.0**-40, 2.0**40])
def test_units_of_length_change_nothing(scale):
    a, b, y = SPRING
    one = stepper(a, b, y)
    plain = one.step(0.1)
    end = one.s[END].copy()
    one = stepper(a, np.multiply(b, scale), np.multiply(y, scale), atol=1e-12 * scale)
    assert one.step(0.1) == plain
    assert one.s[END].tolist() == (scale * end).tolist()


def test_units_of_time_change_nothing():
    """Positions and speeds have tolerances in their own units."""
    a, b, y = SPRING
    one = stepper(a, b, y)
    plain = one.step(0.1)
    end = one.s[END].copy()
    rate = 2.0**20
    faster = np.multiply(a, [[1.0, 1.0], [rate**2, rate]])
    one = stepper(faster, np.multiply(b, [1.0, rate**2]), np.multiply(y, [1.0, rate]))
    one.atol = np.array([1e-12, 1e-12 * rate])
    assert one.step(0.1 / rate) == plain
    assert one.s[END].tolist() == (end * [1.0, rate]).tolist()
