"""Factorisation with partial pivoting, against NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from method_harness import NO_MODE, specialised
from scipy.integrate import DOP853, RK45
from stiff_problems import CONTACT, FOLLOWER, KAPS, SMOOTH, field, jacobian

from hopdata.hybrid.layout import END, K1, KEND, SCRATCH, W1, Y
from hopdata.hybrid.methods import explicit
from hopdata.hybrid.methods import stiff as differences
from hopdata.hybrid.methods.stiff import (
    STIFF,
    explicit_stiffness,
    factorise,
    implicit_stiffness,
    solve_factorised,
    stiffness_score,
)

TABLE_ROWS = 20
LU, PIVOTS, X = np.array([1, 15, 17])
DOPRI5_LIMIT, DOP853_LIMIT = (
    tableau.stiff_tenths / 10 for tableau in (explicit.DOPRI5, explicit.DOP853)
)


def solution(matrix, right):
    n = len(right)
    s = np.full((TABLE_ROWS, n), np.nan)
    s[LU : LU + n] = matrix
    s[X] = right
    factorise(s, LU, PIVOTS, n)
    solve_factorised(s, LU, PIVOTS, X, n)
    return s[X]


@pytest.mark.parametrize("n", [1, 2, 3, 6, 12])
def test_random_systems(n):
    rng = np.random.default_rng(n)
    for _ in range(20):
        matrix = rng.normal(size=(n, n))
        right = rng.normal(size=n)
        x = solution(matrix, right)
        size = np.linalg.norm(matrix) * np.linalg.norm(x)
        assert np.linalg.norm(matrix @ x - right) < 1e-14 * n * size


def test_rows_are_exchanged_where_the_diagonal_is_zero():
    """A cycle of three needs two exchanges, which must be made in order."""
    matrix = np.array([[0.0, 2.0, 0.0], [0.0, 0.0, 4.0], [8.0, 0.0, 0.0]])
    assert solution(matrix, np.array([2.0, 8.0, 24.0])).tolist() == [3.0, 1.0, 2.0]


def test_a_small_pivot_does_no_harm():
    matrix = np.array([[1e-20, 1.0], [1.0, 1.0]])
    assert solution(matrix, np.array([1.0, 2.0])) == pytest.approx(
        [1.0, 1.0], rel=1e-15
    )


def test_a_singular_matrix_gives_no_finite_solution():
    assert not np.isfinite(solution(np.ones((3, 3)), np.array([1.0, 2.0, 3.0]))).all()


# Derivatives of the field by differences, in arbitrary units.

JAC = W1
RATE = W1 + 2
CODES = {}


def code(name):
    if name not in CODES:
        template = getattr(differences, name)
        CODES[name] = specialised(template, FIELD=field, JACOBIAN=jacobian, N=2)
    return CODES[name]


def table(params, t, y):
    s = np.full((W1 + 3, 2), np.nan)
    s[Y] = y
    field(t, s[Y], NO_MODE, params, s[K1])
    return s


def by(name, params, t, dt, y, atol=(1e-12, 1e-12)):
    params = np.array(params, dtype=float)
    s = table(params, t, y)
    count = code(name)(t, dt, s, NO_MODE, params, np.array(atol), JAC)
    return s[JAC : JAC + 2].copy(), count


@pytest.mark.parametrize(
    ("params", "y"),
    [
        ((SMOOTH, 0.0), (1.5, 0.7)),
        ((KAPS, 1e6), (1.0, 1.0)),
        ((FOLLOWER, 1e4), (0.4, 2.0)),
        ((CONTACT, 10.0, 9.81, 1e3, 1e5), (-0.01, -3.0)),
        ((CONTACT, 1e12, 9.81, 1e3, 1e5), (-0.01, -1e-12)),
    ],
)
def test_differences_agree_with_the_derivative(params, y):
    found, count = by("jacobian_by_differences", params, 0.3, 1e-3, y)
    given, none = by("jacobian_by_user", params, 0.3, 1e-3, y)
    assert (count, none) == (4, 0)
    scale = np.abs(given) + 1e-3  # the smallest entries are of size 1
    assert np.all(
        np.abs(found - given) < 1e-8 * scale + 2e-9 * np.abs(given).max(axis=1)[:, None]
    )


@pytest.mark.parametrize("atol", [1e-12, 0.0])
def test_at_rest_at_the_origin(atol):
    """Neither state nor slope shows the scale of the position: its tolerance does, if it can."""
    found, _ = by("jacobian_by_differences", (CONTACT, 10.0, 0.0, 1e3, 0.0), 0.0, 1e-3, (0.0, 0.0),
                  (atol, atol))  # fmt: skip
    assert found == pytest.approx(
        np.array([[0.0, 1.0], [-1e3, -10.0]]), rel=1e-9, abs=1e-9
    )


def test_a_state_below_its_tolerance_counts_as_zero():
    """An increment in proportion to 1e-30 would vanish in the rounding of the weight."""
    params = (CONTACT, 10.0, 9.81, 1e3, 0.0)
    y = (1e-30, 1e-30)
    found, _ = by("jacobian_by_differences", params, 0.0, 1e-3, y)
    assert found == pytest.approx(
        np.array([[0.0, 1.0], [-1e3, -10.0]]), rel=1e-4, abs=1e-12
    )


@pytest.mark.parametrize("scale", [2.0**-40, 2.0**40])
def test_units_of_length_change_nothing(scale):
    weight = 9.81
    rate = 1e3
    spring = 1e4
    square = 1e6
    y = np.array([-0.01, -3.0])
    plain, _ = by(
        "jacobian_by_differences", (CONTACT, rate, weight, spring, square), 0.0, 1e-3, y
    )
    scaled = (CONTACT, rate, weight * scale, spring, square / scale)
    atol = np.full(2, 1e-12 * scale)
    found, _ = by("jacobian_by_differences", scaled, 0.0, 1e-3, y * scale, atol)
    assert np.array_equal(found, plain)


def rate_of(params, t, dt, y):
    params = np.array(params, dtype=float)
    s = table(params, t, y)
    count = code("time_derivative")(t, dt, s, NO_MODE, params, RATE)
    return s[RATE].copy(), count


def test_the_time_derivative():
    rate = 1e3
    t = 0.7
    y = (0.2, 1.5)
    found, count = rate_of((FOLLOWER, rate), t, 1e-2, y)
    assert count == 3
    assert found[0] == pytest.approx(rate * np.cos(t) - np.sin(t), rel=1e-9)
    assert found[1] == 0.0


@pytest.mark.parametrize("t", [0.0, 1e6])
def test_a_field_that_does_not_depend_on_time_costs_one_evaluation(t):
    found, count = rate_of((KAPS, 1e3), t, 1e-9, (1.0, 1.0))
    assert count == 1
    assert found.tolist() == [0.0, 0.0]


def test_late_in_time_the_increment_is_still_felt():
    """The step is 1e-9 at 1e6 seconds: 2^-9 of it would vanish in the rounding of the time."""
    t = 1e6
    rate = 1.0
    found, count = rate_of((FOLLOWER, rate), t, 1e-9, (0.2, 1.5))
    assert count == 3
    assert found[0] == pytest.approx(rate * np.cos(t) - np.sin(t), abs=1e-3)


# The criteria by which the driver switches between explicit and Rosenbrock steps.

RTOL = 1e-6


def table_after(solver, start):
    """Return the rows that the test needs from a step that SciPy took, and the step's length."""
    before, y = start
    dt = solver.t - before
    s = np.zeros((W1 + 4, solver.n))
    last = len(solver.A) - 1
    s[Y] = y
    s[END] = solver.y
    s[KEND] = solver.f
    s[W1] = solver.K[last]
    s[SCRATCH] = y + dt * (solver.K[:last].T @ solver.A[last, :last])
    return s, dt


def scores(method, limit, damping, t_end=1.0):
    """Return the highest score while SciPy lets a mass fall on a spring with a damper."""

    def contact(t, y):
        return np.array([y[1], -9.81 - damping * y[1] - damping * y[0]])

    solver = method(contact, 0.0, [0.0, -1.0], t_end, rtol=RTOL, atol=1e-9)
    solver.A = solver.A if method is RK45 else solver.A[:12, :12]
    score = highest = 0.0
    atol = np.full(2, 1e-9)
    while solver.status == "running" and highest < STIFF:
        start = solver.t, solver.y.copy()
        solver.step()
        s, dt = table_after(solver, start)
        score = stiffness_score(
            score, explicit_stiffness(s, dt, RTOL, atol, W1, 2), limit
        )
        highest = max(highest, score)
    return highest, solver.t


@pytest.mark.parametrize(
    ("method", "limit"), [(RK45, DOPRI5_LIMIT), (DOP853, DOP853_LIMIT)]
)
def test_a_strong_damper_is_found_stiff(method, limit):
    score, t = scores(method, limit, 1e4)
    assert score >= STIFF
    assert t < 0.2  # after the impact of the landing and a few dozen steps


@pytest.mark.parametrize(
    ("method", "limit"), [(RK45, DOPRI5_LIMIT), (DOP853, DOP853_LIMIT)]
)
def test_a_weak_damper_is_not(method, limit):
    assert scores(method, limit, 1.0, t_end=20.0)[0] < 3.0


def linear_table(matrix, y, dt):
    """Return a table after a step of y' = A y whose last stage is slightly off the new state."""
    n = len(y)
    s = np.zeros((W1 + 2 + n, n))
    s[Y] = y
    s[END] = y
    s[SCRATCH] = np.asarray(y) + 1e-3 * np.arange(1, n + 1)
    s[KEND], s[W1] = matrix @ s[END], matrix @ s[SCRATCH]
    s[W1 + 1] = np.nan
    s[W1 + 2 :] = matrix
    return s


def test_the_rate_is_found_exactly_where_there_is_one():
    s = linear_table(np.diag([-50.0, -50.0]), [1.0, 2.0], 0.1)
    found = explicit_stiffness(s, 0.1, RTOL, np.full(2, 1e-9), W1, 2)
    assert found == pytest.approx(5.0, rel=1e-9)


def test_two_equal_states_tell_nothing():
    s = linear_table(np.diag([-50.0, -50.0]), [1.0, 2.0], 0.1)
    s[SCRATCH], s[W1] = s[END], s[KEND]
    stiffness = explicit_stiffness(s, 0.1, RTOL, np.full(2, 1e-9), W1, 2)
    assert stiffness_score(4.0, stiffness, DOPRI5_LIMIT) == 1.5


@pytest.mark.parametrize(
    "matrix",
    [
        [[-3.0, 0.0, 0.0], [0.0, -700.0, 0.0], [0.0, 0.0, -1.0]],
        [[0.0, 1.0, 0.0], [-90_000.0, 0.0, 0.0], [0.0, 0.0, -1.0]],
        [[0.0, 1.0, 0.0], [-1e6, -1e4, 0.0], [1.0, 0.0, -1.0]],
    ],
    ids=["decay", "vibration", "damper"],
)
@pytest.mark.parametrize("units", [(1.0, 1.0, 1.0), (1.0, 1e-6, 1e6)])
def test_the_spectral_radius_of_the_jacobian(matrix, units):
    matrix = np.array(matrix)
    units = np.array(units)
    s = linear_table(matrix * units[:, None] / units, units, 1.0)
    found = implicit_stiffness(s, 0.5, RTOL, 1e-9 * units, W1 + 2, W1 + 1, 3)
    radius = np.abs(np.linalg.eigvals(matrix)).max()
    assert 0.7 * 0.5 * radius < found < 1.4 * 0.5 * radius


def test_a_flight_is_not_stiff():
    s = linear_table(np.array([[0.0, 1.0], [0.0, 0.0]]), [1.0, 1.0], 1.0)
    assert implicit_stiffness(s, 1e6, RTOL, np.full(2, 1e-9), W1 + 2, W1 + 1, 2) == 0.0
