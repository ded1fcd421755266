"""Patterns of Jacobians: what is accepted, their colours, and orders of elimination."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from large_systems import (
    grid_pattern,
    network,
    network_of,
    ring,
    ring_pattern,
    rod,
    rod_start,
)
from scipy import sparse

from hopdata.hybrid import System, field, guards, solve, solve_batch
from hopdata.hybrid.methods.sparsity import pattern_of, rows_alike

FORMS = {
    "bandwidths": (1, 2),
    "array": np.tri(7, k=2) * np.tri(7, k=1).T,
    "coordinates": sparse.coo_array(np.tri(7, k=2) * np.tri(7, k=1).T),
    "columns": sparse.csc_matrix(np.tri(7, k=2) * np.tri(7, k=1).T),
}


@pytest.mark.parametrize("form", FORMS)
def test_all_forms_describe_the_same_places(form):
    pattern = pattern_of(FORMS[form], 7)
    found = np.zeros((7, 7))
    found[pattern.rows, pattern.columns] = 1.0
    assert np.array_equal(found, FORMS["array"])
    assert (np.diff(7 * pattern.rows + pattern.columns) > 0).all()


@pytest.mark.parametrize(
    ("given", "wanted"),
    [
        ((1, 7), "bandwidths"),
        ((-1, 0), "bandwidths"),
        ((1.0, 1), "bandwidths"),
        (np.eye(6), r"shape \(7, 7\), found shape \(6, 6\)"),
        (sparse.eye_array(8), r"shape \(7, 7\)"),
        (np.ones(7), "a matrix"),
        (3, "a matrix"),
    ],
)
def test_what_is_no_pattern_is_refused(given, wanted):
    with pytest.raises(ValueError, match=f"sparsity: expected .*{wanted}"):
        System(rod, n_states=7, sparsity=given)


PATTERNS = {
    "tridiagonal": pattern_of((1, 1), 50),
    "a band on one side": pattern_of((0, 4), 50),
    "diagonal": pattern_of((0, 0), 50),
    "ring": pattern_of(ring_pattern(50), 50),
    "grid": pattern_of(grid_pattern(12), 144),
    "arrow": pattern_of(
        np.eye(50) + np.eye(50)[:1] + np.eye(50)[:, :1] + np.ones((50, 1)) * np.eye(50)[0],
        50,
    ),
    "network": pattern_of(network_of(5, 80)[1], 80),
    "two grids and a state alone": pattern_of(
        sparse.block_diag([grid_pattern(9), np.eye(1), grid_pattern(11)]), 203
    ),
    "empty": pattern_of(np.zeros((9, 9)), 9),
}  # fmt: skip
OF_ALL = pytest.mark.parametrize("name", PATTERNS)


@OF_ALL
def test_no_row_has_two_entries_of_one_colour(name):
    pattern = PATTERNS[name]
    pairs = pattern.rows * pattern.n_states + pattern.colours[pattern.columns]
    assert len(np.unique(pairs)) == len(pairs)


@pytest.mark.parametrize(
    ("name", "most"),
    [("tridiagonal", 3), ("a band on one side", 5), ("ring", 5), ("grid", 8)],
)
def test_few_colours_suffice(name, most):
    assert PATTERNS[name].structure.n_colours <= most


@OF_ALL
def test_the_factors_have_room_for_each_product(name):
    """Elimination of any matrix with this pattern fills nothing outside the factors."""
    pattern = PATTERNS[name]
    n = pattern.n_states
    factors = pattern.structure.factors
    draw = np.random.default_rng(np.random.SeedSequence(3))
    full = np.zeros((n, n))
    full[pattern.rows, pattern.columns] = draw.uniform(0.5, 1.0, len(pattern.rows))
    full += n * np.eye(n)
    full = full[np.ix_(factors.order, factors.order)]
    for k in range(n):
        full[k + 1 :, k] /= full[k, k]
        full[k + 1 :, k + 1 :] -= np.outer(full[k + 1 :, k], full[k, k + 1 :])
    room = np.zeros((n, n), dtype=bool)
    if factors.is_band:
        room = np.tri(n, k=factors.above, dtype=bool)
        room &= np.tri(n, k=factors.below, dtype=bool).T
    else:
        of_row = np.repeat(np.arange(n), np.diff(factors.starts))
        room[of_row, factors.columns] = True
        assert np.array_equal(factors.columns[factors.diagonal], np.arange(n))
        check_rows_alike(factors)
    assert sorted(factors.order) == list(range(n))
    assert not full[~room].any()


def check_rows_alike(factors):
    """Rows that count as alike have the same columns to the right of all of them."""
    alike = rows_alike(factors)
    of_row = [
        factors.columns[a:b].tolist()
        for a, b in zip(factors.diagonal, factors.starts[1:], strict=True)
    ]
    for row, count in enumerate(alike):
        for k in range(1, count):
            assert of_row[row][k:] == of_row[row + k]
        if row + count < len(alike):
            assert of_row[row][count:] != of_row[row + count]


def test_a_ring_is_a_band_in_another_order_and_a_grid_is_not():
    assert PATTERNS["ring"].structure.factors.width <= 7
    assert not PATTERNS["grid"].structure.factors.is_band
    assert rows_alike(PATTERNS["grid"].structure.factors).max() >= 4
    narrow = pattern_of(grid_pattern(60), 3600).structure.factors
    assert narrow.size < 3600 * 40


# A pattern that does not hold all derivatives is refused, and no other.


def test_a_ring_without_its_closure_is_refused():
    n = 300
    open_ring = System(ring, n_states=n, sparsity=(1, 1))
    message = r"sparsity: .* dy\[(0\] depends on y\[299|299\] depends on y\[0)\]"
    with pytest.raises(ValueError, match=message):
        solve(open_ring, (0.0, 1.0), np.ones(n))
    with pytest.raises(ValueError, match=message):
        solve_batch(open_ring, (0.0, 1.0), np.ones((2, n)))
    closed = System(ring, n_states=n, sparsity=ring_pattern(n))
    y0 = np.cos(2.0 * np.pi * np.arange(n) / n)
    rate = -4.0 * n**2 * np.sin(np.pi / n) ** 2
    found = solve(closed, (0.0, 0.02), y0, method="rosenbrock")
    assert np.abs(found.y_end - np.exp(0.02 * rate) * y0).max() < 1e-9


@pytest.mark.parametrize("seed", range(6))
def test_each_single_omission_from_a_network_is_found(seed):
    n = 60
    params, pattern, y0 = network_of(seed, n)
    draw = np.random.default_rng(np.random.SeedSequence([seed, 1]))
    right = System(network, n_states=n, sparsity=pattern)
    options = {"params": params, "method": "rosenbrock", "max_steps": 1}
    assert solve(right, (0.0, 1.0), y0, **options).n_steps == 1
    rows, columns = np.nonzero(pattern)
    for k in draw.choice(len(rows), 5, replace=False):
        less = pattern.copy()
        less[rows[k], columns[k]] = False
        wrong = System(network, n_states=n, sparsity=less)
        with pytest.raises(ValueError, match=rf"dy\[{rows[k]}\].* y\[{columns[k]}\]"):
            solve(wrong, (0.0, 1.0), y0, **options)


@field
def awkward(t, y, mode, params, dy):
    """A kink, a jump, a product of zeros, heavy cancellation, and a lock."""
    dy[0] = abs(y[0] - 1.0) + (3.0 if y[1] > 0.0 else -3.0)
    dy[1] = y[1] * y[2]
    dy[2] = (1e9 + y[2]) - 1e9 - y[3]
    dy[3] = -1e8 * (y[3] - 1e-9) + np.sqrt(y[4])
    dy[4] = y[0] if mode[0] > 0 else -y[4]


@guards
def at_two(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] - 2.0
    hdot[0] = dy[0]


NEEDED = [
    (0, 0),
    (0, 1),
    (1, 1),
    (1, 2),
    (2, 2),
    (2, 3),
    (3, 3),
    (3, 4),
    (4, 0),
    (4, 4),
]


def with_entries(entries):
    pattern = np.zeros((5, 5))
    for place in entries:
        pattern[place] = 1.0
    return System(awkward, at_two, n_states=5, guard_names=("two",), sparsity=pattern)


def test_kinks_jumps_and_cancellation_are_no_reason_to_refuse():
    start = [1.0, 0.0, 0.0, 1e-9, 0.25]
    options = {"method": "rosenbrock", "max_steps": 1}
    for entries in (NEEDED, [*NEEDED, (0, 4), (3, 1)]):
        assert solve(with_entries(entries), (0.0, 1.0), start, **options).n_steps == 1
    for missing in ((1, 1), (1, 2), (4, 0), (4, 4)):
        less = [place for place in NEEDED if place != missing]
        with pytest.raises(ValueError, match=rf"dy\[{missing[0]}\].*y\[{missing[1]}\]"):
            solve(with_entries(less), (0.0, 1.0), start, **options)


@pytest.mark.parametrize("compiled", [True, False])
def test_a_field_in_plain_form_is_compared_too(compiled):
    @field(compiled=compiled)
    def shifted(t, y, p):
        return np.array([-y[1], -y[2], -y[0]])

    system = System(shifted, n_states=3, sparsity=(0, 1))
    with pytest.raises(ValueError, match=r"dy\[2\] depends on y\[0\]"):
        solve(system, (0.0, 1.0), [1.0, 2.0, 3.0], method="rosenbrock")


# Systems with patterns are values, like others.


def test_a_pattern_survives_pickling_and_copying():
    n = 400
    params, y0, exact = rod_start(n)
    system = System(rod, n_states=n, sparsity=(1, 1))
    options = {"params": params, "method": "rosenbrock"}
    expected = solve(system, (0.0, 0.1), y0, **options).y_end
    for other in (pickle.loads(pickle.dumps(system)), copy.deepcopy(system)):
        assert other.sparsity == system.sparsity
        assert np.array_equal(solve(other, (0.0, 0.1), y0, **options).y_end, expected)
    assert system.sparsity != System(rod, n_states=n, sparsity=(1, 2)).sparsity
    assert np.abs(expected - exact(0.1)).max() < 1e-9
