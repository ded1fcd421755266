"""Patterns of Jacobians from the fields' own code."""

from __future__ import annotations

import numpy as np
import pytest
from large_systems import (
    membrane,
    membrane_pattern,
    network,
    network_of,
    ring,
    ring_pattern,
    rod,
    rod_start,
)
from numba import njit

from hopdata.errors import ArgumentError
from hopdata.hybrid import System, field, find_sparsity, solve
from hopdata.hybrid.methods.sparsity import pattern_of


def matrix(pattern):
    found = np.zeros((pattern.n_states, pattern.n_states), dtype=bool)
    found[pattern.rows, pattern.columns] = True
    return found


def test_loops_over_neighbours():
    assert find_sparsity(rod, 50, params=[1.0]) == pattern_of(
        matrix(pattern_of((1, 1), 50)), 50
    )
    assert find_sparsity(ring, 20, params=[1.0]) == pattern_of(ring_pattern(20), 20)


# Both sides of each branch count, whatever states, time and mode are at the start.


@field
def branching(t, y, mode, params, dy):
    dy[0] = y[1] if y[0] > 0.0 else y[2]
    dy[1] = max(y[0], 0.0) * params[0]
    dy[2] = 0.0
    if mode[0] > 0:
        dy[2] = y[3]
        if y[4] > 1.0 and t > 1e9:
            dy[2] += y[1]
    dy[3] = np.where(t > 1.0, np.interp(y[0], TABLE, TABLE), min(y[1], y[2], 3.0))
    dy[4] = 0.0 if params[1] == 7.25 else np.floor(y[4]) ** 2 % 3


TABLE = np.array([0.0, 1.0, 2.0])


def test_all_branches():
    expected = np.zeros((5, 5), dtype=bool)
    for row, columns in enumerate([(1, 2), (0,), (1, 3), (0, 1, 2), (4,)]):
        expected[row, list(columns)] = True
    found = find_sparsity(branching, 5, n_modes=1)
    assert np.array_equal(matrix(found), expected)
    assert found.is_proven
    with_params = find_sparsity(branching, 5, n_modes=1, params=[1.0, 7.25])
    expected[4] = False
    assert np.array_equal(matrix(with_params), expected)
    assert not with_params.is_proven


@njit
def flow(a, b):
    made = np.zeros(2)
    made[0] = a - b
    return made[0]


def whole_arrays(t, y, p):
    dy = np.zeros(len(y))
    dy[1:-1] = y[2:] - 2.0 * y[1:-1] + y[:-2]
    dy[0] = flow(y[1], y[0])
    dy[-1] = np.sum(y[:3]) + np.dot(y[-2:], y[-2:])
    return dy * p[0]


def test_whole_arrays_helpers_and_a_plain_function():
    n = 9
    expected = matrix(pattern_of((1, 1), n))
    expected[-1, :3] = True
    system = System(whole_arrays, n_states=n, sparsity="auto")
    assert np.array_equal(matrix(system.sparsity), expected)


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_random_networks_of_indices_in_the_parameters(seed):
    params, pattern, _ = network_of(seed, 30)
    found = find_sparsity(network, 30, params=params)
    assert np.array_equal(matrix(found), pattern)


def test_auto_gives_the_solution_of_the_given_pattern():
    params, y0, _ = rod_start(60)
    given = System(rod, n_states=60, sparsity=matrix(pattern_of((1, 1), 60)))
    auto = System(rod, n_states=60, sparsity="auto")
    ends = []
    for system in (given, auto):
        options = {"params": params, "method": "rosenbrock"}
        ends.append(solve(system, (0.0, 0.1), y0, **options).y_end)
    assert np.array_equal(*ends)


def test_a_grid_whose_size_is_a_parameter():
    with pytest.raises(ArgumentError, match="decides an index, a loop"):
        System(membrane, n_states=32, sparsity="auto")
    found = find_sparsity(membrane, 32, params=[4.0, 1.0, 0.1])
    given = pattern_of(membrane_pattern(4), 32)
    assert not np.any(matrix(found) & ~matrix(given))
    assert (
        matrix(found).sum() == 16 + (5 * 16 - 16) + 16
    )  # velocities, five points, damping


# What the code does not tell is refused.


def upwind(t, y):
    dy = np.zeros(len(y))
    for i in range(1, len(y)):
        dy[i] = y[i - 1] if y[i] > 0.0 else y[i]
    return dy


def by_index(t, y):
    return np.array([y[int(y[0])], y[0]])


def waits(t, y):
    k = 0.0
    while k < y[0]:
        k += 1.0
    return np.array([k, y[1]])


def determinant(t, y):
    return y * np.linalg.det(np.outer(y, y))


@pytest.mark.parametrize(
    ("function", "n", "said"),
    [
        (upwind, 100, "decides"),
        (upwind, 12, "outcomes"),
        (by_index, 2, "decides"),
        (waits, 2, "decides|outcomes"),
        (determinant, 2, "np.linalg.det"),
    ],
)
def test_what_cannot_be_told_is_refused(function, n, said):
    with pytest.raises(ArgumentError, match=said):
        System(function, n_states=n, sparsity="auto")
