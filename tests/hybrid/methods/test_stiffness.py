"""The tests by which the driver changes between explicit and Rosenbrock steps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import DOP853, RK45

from hopdata.hybrid.methods.rows import END, KEND, SCRATCH, W1, Y
from hopdata.hybrid.methods.stiffness import (
    DOP853_LIMIT,
    DOPRI5_LIMIT,
    STIFF,
    explicit_stiffness,
    implicit_stiffness,
    stiffness_score,
)

RTOL = 1e-6


def table_after(solver, start):
    """The rows that the test needs, of a step that SciPy took, and the step's length."""
    before, y = start
    dt, s = solver.t - before, np.zeros((W1 + 4, solver.n))
    last = len(solver.A) - 1
    s[Y], s[END], s[KEND], s[W1] = y, solver.y, solver.f, solver.K[last]
    s[SCRATCH] = y + dt * (solver.K[:last].T @ solver.A[last, :last])
    return s, dt


def scores(method, limit, damping, t_end=1.0):
    """Highest score while SciPy lets a mass fall on a spring with a damper."""

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
        score = stiffness_score(score, explicit_stiffness(s, dt, RTOL, atol, W1, 2), limit)
        highest = max(highest, score)
    return highest, solver.t


@pytest.mark.parametrize(("method", "limit"), [(RK45, DOPRI5_LIMIT), (DOP853, DOP853_LIMIT)])
def test_a_strong_damper_is_found_stiff(method, limit):
    score, t = scores(method, limit, 1e4)
    assert score >= STIFF
    assert t < 0.2  # after the blow of the landing and a few dozen steps


@pytest.mark.parametrize(("method", "limit"), [(RK45, DOPRI5_LIMIT), (DOP853, DOP853_LIMIT)])
def test_a_weak_damper_is_not(method, limit):
    assert scores(method, limit, 1.0, t_end=20.0)[0] < 3.0


def linear_table(matrix, y, dt):
    """A table after a step of y' = A y whose last stage was a little off the new state."""
    n = len(y)
    s = np.zeros((W1 + 2 + n, n))
    s[Y], s[END], s[SCRATCH] = y, y, np.asarray(y) + 1e-3 * np.arange(1, n + 1)
    s[KEND], s[W1] = matrix @ s[END], matrix @ s[SCRATCH]
    s[W1 + 1], s[W1 + 2 :] = np.nan, matrix
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
    matrix, units = np.array(matrix), np.array(units)
    s = linear_table(matrix * units[:, None] / units, units, 1.0)
    found = implicit_stiffness(s, 0.5, RTOL, 1e-9 * units, W1 + 2, W1 + 1, 3)
    radius = np.abs(np.linalg.eigvals(matrix)).max()
    assert 0.7 * 0.5 * radius < found < 1.4 * 0.5 * radius


def test_a_flight_is_not_stiff():
    s = linear_table(np.array([[0.0, 1.0], [0.0, 0.0]]), [1.0, 1.0], 1.0)
    assert implicit_stiffness(s, 1e6, RTOL, np.full(2, 1e-9), W1 + 2, W1 + 1, 2) == 0.0
