"""The Rosenbrock method with a sparse Jacobian: as the dense one, for large systems."""

from __future__ import annotations

import numpy as np
import pytest
from large_systems import (
    cooling,
    heated_rod,
    membrane,
    membrane_pattern,
    network,
    network_of,
    rod,
    rod_by_diagonals,
    rod_by_entries,
    rod_start,
    switch,
    thermostat,
)
from numba import njit

from hopdata.hybrid import System, field, solve, solve_batch

TRIDIAGONAL = np.tri(400, k=1) * np.tri(400, k=1).T


def rod_of(n, **more):
    return System(rod, n_states=n, sparsity=(1, 1), **more)


@pytest.mark.parametrize("method", ["rosenbrock", "auto"])
def test_heat_in_few_steps(method):
    """An explicit method takes 30,000 steps."""
    params, y0, exact = rod_start(400)
    found = solve(rod_of(400), (0.0, 0.1), y0, params=params, method=method)
    assert np.abs(found.y_end - exact(0.1)).max() < 1e-10
    assert found.success
    assert found.n_steps < 150


def test_auto_stays_explicit_without_a_pattern():
    params, y0, _ = rod_start(400)
    options = {"params": params, "rtol": 1e-6, "atol": 1e-9}
    blind = solve(System(rod, n_states=400), (0.0, 0.005), y0, **options)
    told = solve(rod_of(400), (0.0, 0.005), y0, **options)
    assert told.n_steps < 100 < blind.n_steps


@pytest.mark.parametrize("seed", range(5))
def test_results_equal_those_of_the_dense_method(seed):
    """A band of a random network is not narrow, so this takes the sparse factors."""
    n = 60
    params, pattern, y0 = network_of(seed, n)
    system = System(network, n_states=n, sparsity=pattern)
    dense = System(network, n_states=n)
    assert not system.sparsity.structure.factors.is_band
    for rtol in (1e-5, 1e-9):
        options = {"params": params, "method": "rosenbrock", "rtol": rtol, "atol": rtol}
        found = solve(system, (0.0, 2.0), y0, **options)
        expected = solve(dense, (0.0, 2.0), y0, **options)
        assert np.abs(found.y_end - expected.y_end).max() < 0.1 * rtol
        assert found.n_steps == pytest.approx(expected.n_steps, abs=2)
        one_by_one = 2 * n * found.n_steps  # differences by each state
        assert found.nfev < one_by_one / 3


def test_the_derivative_in_sparse_form_by_diagonals_and_by_entries():
    params, y0, exact = rod_start(400)
    options = {"params": params, "method": "rosenbrock"}
    expected = solve(rod_of(400), (0.0, 0.1), y0, **options)
    by_entries = System(
        rod, jacobian=rod_by_entries, n_states=400, sparsity=TRIDIAGONAL
    )
    for system in (rod_of(400, jacobian=rod_by_diagonals), by_entries):
        found = solve(system, (0.0, 0.1), y0, **options)
        assert found.n_steps == pytest.approx(expected.n_steps, abs=3)
        assert found.nfev < 9.5 * found.n_steps
        assert expected.nfev < 8.5 * expected.n_steps  # by duals, that in time too
        assert np.abs(found.y_end - exact(0.1)).max() < 1e-10


@field
def rod_without_duals(t, y, mode, params, dy):
    rod_rates(t, y, mode, params, dy)
    dy[0] *= np.linalg.det(np.diag(np.array([1.0 + 0.0 * y[0], 1.0])))


rod_rates = njit(rod.function)


def test_differences_where_the_field_has_no_code_for_duals():
    params, y0, exact = rod_start(400)
    options = {"params": params, "method": "rosenbrock"}
    by_duals = solve(rod_of(400), (0.0, 0.1), y0, **options)
    other = System(rod_without_duals, n_states=400, sparsity=(1, 1))
    found = solve(other, (0.0, 0.1), y0, **options)
    assert found.nfev > 14.5 * found.n_steps  # two for each of three colours
    assert "det" in found.by_differences
    assert found.by_differences in found.message
    assert by_duals.by_differences == ""
    for one in (found, by_duals):
        assert np.abs(one.y_end - exact(0.1)).max() < 1e-10


@field
def driven_ring(t, y, mode, params, dy):
    """Each of many rates depends on the time, and on three states out of order."""
    n = len(y)
    for i in range(n):
        far = y[(7 * i + 3) % n]
        dy[i] = -params[0] * y[i] ** 3 + far * y[(i + 1) % n] * np.sin(3.0 * t + i)


def test_more_colours_than_a_dual_carries_and_the_time():
    n = 23
    draw = np.random.default_rng(np.random.SeedSequence(5))
    pattern = draw.random((n, n)) < 0.4
    rows = np.arange(n)
    for column in (rows, (rows + 1) % n, (7 * rows + 3) % n):
        pattern[rows, column] = True
    options = {
        "params": (50.0,), "method": "rosenbrock", "rtol": 1e-8, "atol": 1e-10,
    }  # fmt: skip
    y0 = draw.uniform(0.5, 1.0, n)
    dense = solve(System(driven_ring, n_states=n), (0.0, 1.0), y0, **options)
    system = System(driven_ring, n_states=n, sparsity=pattern)
    assert system.sparsity.structure.n_colours > 8
    found = solve(system, (0.0, 1.0), y0, **options)
    assert found.n_steps == dense.n_steps
    assert found.nfev == dense.nfev
    np.testing.assert_allclose(found.y_end, dense.y_end, rtol=1e-11)


def test_an_explicit_methods_derivative_of_the_flow_does_without_the_sparse_form():
    params, y0, _ = rod_start(5)
    flows = []
    for system in (
        System(rod, n_states=5),
        System(rod, jacobian=rod_by_diagonals, n_states=5, sparsity=(1, 1)),
    ):
        options = {"params": params, "rtol": 1e-11}
        flows.append(solve(system, (0.0, 0.1), y0, jacobian=True, **options).jacobian)
        with_params = solve(system, (0.0, 0.1), y0, jacobian="params", **options)
        assert np.abs(with_params.jacobian - flows[-1]).max() < 1e-8
    assert np.abs(flows[0] - flows[1]).max() < 1e-9


# Pivots. Of heights and velocities with hard springs, the diagonal is small.


@pytest.mark.parametrize("stiffness", [1.0, 1e4, 1e8])
@pytest.mark.parametrize("m", [3, 12], ids=["band", "sparse"])
def test_waves_whose_diagonal_is_small(m, stiffness):
    """Overdamped: the exact solution of the slowest shape is two exponentials."""
    system = System(membrane, n_states=2 * m * m, sparsity=membrane_pattern(m))
    assert system.sparsity.structure.factors.is_band == (m == 3)
    x = np.sin(np.pi * np.arange(1, m + 1) / (m + 1))
    shape = np.outer(x, x).ravel()
    k = 8.0 * stiffness * np.sin(0.5 * np.pi / (m + 1)) ** 2
    damping = 4.0 * np.sqrt(8.0 * stiffness)
    root = np.sqrt(0.25 * damping**2 - k)
    fast = -0.5 * damping - root
    slow = k / fast
    end = -3.0 / slow
    at_end = (fast * np.exp(slow * end) - slow * np.exp(fast * end)) / (fast - slow)
    found = solve(
        system, (0.0, end), np.concatenate([shape, 0.0 * shape]),
        params=[m, stiffness, damping], method="rosenbrock", rtol=1e-8, atol=1e-10,
    )  # fmt: skip
    assert found.success
    assert np.abs(found.y_end[: m * m] - at_end * shape).max() < 1e-7
    assert found.n_steps < 200


# Events.


def test_the_instant_at_which_a_rod_has_cooled():
    n = 400
    params, y0, _ = rod_start(n, modes=(1,))
    rate = -4.0 * (n + 1) ** 2 * np.sin(0.5 * np.pi / (n + 1)) ** 2
    system = rod_of(n, guards=cooling, guard_names=("cold",), terminal=(True,))
    for method in ("rosenbrock", "auto"):
        threshold = 0.5 * y0[n // 2]
        found = solve(
            system, (0.0, 1.0), y0, params=[*params, threshold], method=method
        )
        assert found.t_end == pytest.approx(np.log(0.5) / rate, rel=1e-9)


def test_a_thermostat_on_a_rod_switches_as_with_the_dense_method():
    runs = []
    for sparsity in (None, (1, 1)):
        system = System(
            heated_rod, thermostat, switch, n_states=60, n_extra_modes=1,
            guard_names=("cold", "warm"), directions=(1, 1), sparsity=sparsity,
        )  # fmt: skip
        found = solve(
            system, (0.0, 1.0), np.zeros(60), params=[1 / 61], mode=[1],
            method="rosenbrock",
        )  # fmt: skip
        assert found.success
        runs.append(found.events)
    assert len(runs[0]) > 20
    assert np.array_equal(runs[0].guard, runs[1].guard)
    assert np.abs(runs[0].time - runs[1].time).max() < 1e-8
    assert set(runs[0].guard) == {0, 1}


# Memory, and the same bytes.


def test_the_bytes_are_the_same_in_each_run_and_in_a_batch():
    n = 60
    params, pattern, y0 = network_of(11, n)
    starts = np.stack([y0, 0.5 * y0, y0])
    options = {"params": params, "method": "rosenbrock"}
    ends = []
    for _ in range(2):
        system = System(network, n_states=n, sparsity=pattern)
        ends += [solve(system, (0.0, 1.0), one, **options).y_end for one in starts]
    batch = solve_batch(
        System(network, n_states=n, sparsity=pattern), (0.0, 1.0), starts, workers=2,
        **options,
    )  # fmt: skip
    assert np.array_equal(ends[:3], ends[3:])
    assert np.array_equal(ends[0], ends[2])
    assert np.array_equal(ends[:3], batch.y_end)


def test_memory_is_a_number_of_rows_whatever_the_number_of_states():
    rows = set()
    for n in (100, 10_000, 200_000):
        rows.add(rod_of(n).methods("rosenbrock", False).work_rows)
    assert len(rows) == 1
    assert rows.pop() < 25 + 11  # duals of states and rates, and of the time


def test_a_hundred_thousand_states():
    n = 100_000
    params, y0, exact = rod_start(n)
    found = solve(
        rod_of(n), (0.0, 0.1), y0, params=params, method="rosenbrock", t_eval=(),
        rtol=1e-6, atol=1e-9,
    )  # fmt: skip
    assert found.success
    assert found.n_steps < 40
    assert np.abs(found.y_end - exact(0.1)).max() < 1e-8
