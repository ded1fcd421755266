"""A system's functions, compiled unchanged for duals: rates of guards, and what has no code."""

from __future__ import annotations

import os

import numpy as np
import pytest
from numba import njit

from hopdata.hybrid import (
    System,
    field,
    guard,
    guards,
    jacobian,
    on_event,
    solve,
    solve_batch,
)
from hopdata.hybrid.numbers.derivatives import rates_of

AMPLITUDE = 0.5


def surfaces(t, y, mode, params, h):
    h[0] = y[0] - AMPLITUDE * np.sin(3.0 * t)
    h[1] = params[0]
    for k in range(2, len(h)):
        h[k] = y[k % 2] ** 2 * mode[0] - k
    if y[0] > 0.0:
        h[1] -= y[1] * t


def test_guards_without_rates_get_them():
    guards = njit(rates_of(njit(surfaces), 2, 4))
    h = np.full(4, np.nan)
    hdot = np.full(4, np.nan)
    y = np.array([0.3, 0.7])
    dy = np.array([1.1, -2.0])
    guards(0.2, y, dy, np.array([-1]), np.array([0.25]), h, hdot)
    expected = np.empty(4)
    surfaces(0.2, y, np.array([-1]), np.array([0.25]), expected)
    assert h.tolist() == expected.tolist()
    exact = [1.1 - 1.5 * np.cos(0.6), -0.7 + 2.0 * 0.2, -2 * 0.3 * 1.1, 2 * 0.7 * 2.0]
    np.testing.assert_allclose(hdot, exact, rtol=1e-14)


# Derivatives at one place, of few and of many states.


@field
def chain(t, y, mode, params, dy):
    n = len(y)
    for i in range(n):
        dy[i] = params[0] * np.sin(y[(i + 1) % n]) * y[i] + mode[0] * t * y[0] ** 2


@guards
def two_planes(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] * y[1] - np.exp(t)
    h[1] = mode[0] * y[len(y) - 1] + params[0] * dy[1]
    hdot[:] = 0.0


@guard
def one_plane(t, y, dy, mode, params, k, h, hdot):
    if k == 0:
        h[0] = y[0] * y[1] - np.exp(t)
    else:
        h[1] = mode[0] * y[len(y) - 1] + params[0] * dy[1]
    hdot[k] = dy[0] * y[1]


@on_event
def reset(t, y, mode, params, guard, direction):
    mode[0] = -mode[0]
    params[0] = y[0]
    y[0] = params[0] * t + mode[1] * guard * y[1] * direction
    return 1


def place(n):
    y = np.random.default_rng(n).normal(size=n)
    return 0.3, y, np.array([1, -1, 5]), np.array([0.7])


@pytest.mark.parametrize("n", [2, 7, 8, 9, 20])
def test_the_field(n):
    t, y, mode, params = place(n)
    found = System(chain, n_states=n).exact.field(t, y, mode, params)
    following = np.roll(np.arange(n), -1)
    expected = np.diag(0.7 * np.sin(y[following]))
    expected[np.arange(n), following] += 0.7 * np.cos(y[following]) * y
    expected[:, 0] += 2.0 * t * y[0]
    np.testing.assert_allclose(found, expected, rtol=1e-15, atol=1e-15)


@pytest.mark.parametrize("n", [2, 8, 9])
@pytest.mark.parametrize("form", [{"guards": two_planes}, {"guard": one_plane}])
def test_the_guards(n, form):
    t, y, mode, params = place(n)
    names = {"guard_names": ("a", "b"), "n_extra_modes": 1}
    exact = System(chain, n_states=n, **form, **names).exact
    by_state, by_time = exact.guards(t, y, np.ones(n), mode, params)
    expected = np.zeros((2, n))
    expected[0, :2] = [y[1], y[0]]
    expected[1, n - 1] = 1.0
    assert by_state.tolist() == expected.tolist()
    assert by_time.tolist() == [-np.exp(t), 0.0]


@pytest.mark.parametrize("n", [2, 8, 9])
def test_the_handler(n):
    """Also what it does by way of its memory; mode and parameters remain as they were."""
    t, y, mode, params = place(n)
    names = {"guard_names": ("a", "b"), "n_extra_modes": 1}
    exact = System(chain, two_planes, reset, n_states=n, **names).exact
    by_state, by_time = exact.handler(t, y, mode, params, 1, -1)
    expected = np.eye(n)
    expected[0, :2] = [t, 1.0]
    assert by_state.tolist() == expected.tolist()
    assert by_time.tolist() == [y[0], *np.zeros(n - 1)]
    assert mode.tolist() == [1, -1, 5]
    assert params.tolist() == [0.7]


@field
def with_a_determinant(t, y, mode, params, dy):
    dy[0] = y[1]
    dy[1] = np.linalg.det(np.diag(np.array([-y[0], 1.0])))


def test_what_has_no_code_for_duals_is_told_and_differentiated_all_the_same():
    system = System(with_a_determinant, n_states=2)
    assert system.exact.field(*place(2)) is None
    found = solve(system, (0.0, 2.0), (1.0, 0.5), jacobian=True)
    exact = [[np.cos(2.0), np.sin(2.0)], [-np.sin(2.0), np.cos(2.0)]]
    np.testing.assert_allclose(found.jacobian, exact, rtol=0.0, atol=1e-8)
    assert found.by_differences.startswith("field: ")
    assert "dy[1] = np.linalg.det(" in found.by_differences
    assert found.by_differences in found.message
    batch = solve_batch(system, (0.0, 2.0), [[1.0, 0.5]], jacobian=True)
    assert batch.by_differences == found.by_differences
    assert batch.by_differences in batch.message
    state_only = solve(system, (0.0, 2.0), (1.0, 0.5))
    assert state_only.by_differences == ""
    assert "differences" not in state_only.message


def test_with_parameters_as_states():
    """The guard depends on a parameter, by which the instant moves."""

    @field
    def line(t, y, mode, params, dy):
        dy[0] = 2.0 if mode[0] > 0 else params[1]

    @guards
    def place_of_change(t, y, dy, mode, params, h, hdot):
        h[0] = y[0] - params[0]
        hdot[0] = dy[0]

    system = System(line, place_of_change, n_states=1, guard_names=("change",))
    found = solve(system, (0.0, 2.0), (0.0,), params=(0.5, 1.0), jacobian="params")
    # y = p0 + 2 (2 - (p0 - y0) / p1)
    assert found.y_end[0] == pytest.approx(3.5, rel=1e-14)
    np.testing.assert_allclose(found.jacobian, [[2.0]], rtol=1e-14)
    np.testing.assert_allclose(found.sensitivity, [[-1.0, 1.0]], rtol=1e-14)
    assert found.by_differences == ""


# The derivative of a field in stiff steps, in which the time matters, too.


@field
def pursuit(t, y, mode, params, dy):
    """Each state follows the one before it, the first a drive, ever faster."""
    ahead = np.sin(3.0 * t)
    for i in range(len(y)):
        dy[i] = params[0] * (i + 1) * (ahead - y[i] ** 3)
        ahead = y[i]


@jacobian
def of_pursuit(t, y, mode, params, jac):
    for i in range(len(y)):
        jac[i, i] = -params[0] * (i + 1) * 3.0 * y[i] ** 2
        if i > 0:
            jac[i, i - 1] = params[0] * (i + 1)


@field
def pursuit_in_an_array(t, y, mode, params, dy):
    ahead = np.zeros(len(y))
    ahead[0] = np.sin(3.0 * t)
    ahead[1:] = y[:-1]
    dy[:] = params[0] * np.arange(1, len(y) + 1) * (ahead - y**3)


@field
def pursuit_with_a_determinant(t, y, mode, params, dy):
    ahead = np.sin(3.0 * t)
    for i in range(len(y)):
        dy[i] = params[0] * (i + 1) * (ahead - y[i] ** 3)
        ahead = np.linalg.det(np.diag(np.array([y[i], 1.0])))


#: Each compiles for 5 s; nine states take more than one dual.
@pytest.mark.parametrize("n", [2, 9] if "ALL" in os.environ else [9])
def test_stiff_steps_take_the_exact_derivative(n):
    request = {"params": (300.0,), "method": "rosenbrock", "rtol": 1e-8, "atol": 1e-8}
    start = np.linspace(0.5, 1.0, n)
    by_duals = solve(System(pursuit, n_states=n), (0.0, 1.0), start, **request)
    with_given = System(pursuit, n_states=n, jacobian=of_pursuit)
    given = solve(with_given, (0.0, 1.0), start, **request)
    assert by_duals.success
    np.testing.assert_allclose(by_duals.y_end, given.y_end, rtol=1e-12)
    assert by_duals.nfev == given.nfev  # differences would count
    of_arrays = System(pursuit_in_an_array, n_states=n)
    in_arrays = solve(of_arrays, (0.0, 1.0), start, **request)
    np.testing.assert_allclose(in_arrays.y_end, given.y_end, rtol=1e-12)
    assert in_arrays.nfev == given.nfev
    assert in_arrays.by_differences == ""


def test_stiff_steps_by_differences_where_a_field_has_no_code_for_duals():
    request = {"params": (300.0,), "method": "rosenbrock", "rtol": 1e-8, "atol": 1e-8}
    start = np.linspace(0.5, 1.0, 2)
    by_duals = solve(System(pursuit, n_states=2), (0.0, 1.0), start, **request)
    other = System(pursuit_with_a_determinant, n_states=2)
    by_differences = solve(other, (0.0, 1.0), start, **request)
    np.testing.assert_allclose(by_differences.y_end, by_duals.y_end, rtol=1e-6)
    assert by_differences.nfev > by_duals.nfev
    assert by_differences.by_differences.startswith("field, of the stiff method: ")
    assert by_differences.by_differences in by_differences.message
    assert by_duals.by_differences == ""
