"""Ranges of states and slopes, beside values of the interpolant inside a step."""

from typing import NamedTuple

import numpy as np
import pytest
from numba import njit

from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.memory import view
from hopdata.hybrid.driver.dense import interpolate
from hopdata.hybrid.driver.enclosure import begin_enclosing, begin_pieces, enclose

DT = 0.37
SAMPLES = np.linspace(0.0, 1.0, 65)


class Problem(NamedTuple):
    """What the enclosure reads of a problem."""

    methods: object


class Memory(NamedTuple):
    """What it reads and writes of the memory."""

    states: object
    clock: object
    counts: object


@njit
def ranges_of(tables, dt, pieces, thetas, out):
    """Write ranges of states and slopes in pieces, and samples of both in them."""
    states, clock, counts, methods = tables
    p = Problem(view(methods))
    m = Memory(view(states), view(clock), view(counts))
    begin_enclosing(p, m)
    for piece in range(len(pieces)):
        a, z = pieces[piece]
        if piece > 0 and a != pieces[piece - 1, 0]:
            begin_pieces(m)
        enclose(m, dt, a, z)
        for i in range(states.shape[1]):
            out[piece, 0, i] = states[at.LEAST, i]
            out[piece, 1, i] = states[at.MOST, i]
            out[piece, 2, i] = states[at.LEAST_SLOPE, i]
            out[piece, 3, i] = states[at.MOST_SLOPE, i]
        for j in range(len(thetas)):
            interpolate(p, m, a + thetas[j] * (z - a), at.SCRATCH, 1.0 / dt)
            for i in range(states.shape[1]):
                out[piece, 4 + 2 * j, i] = states[at.SCRATCH, i]
                out[piece, 5 + 2 * j, i] = states[at.SLOPE, i]


def enclosed(coefficients, in_powers, pieces):
    """Return the four ranges, (pieces, 4, n), and samples of values and of slopes."""
    degree, n = coefficients.shape
    degree -= 1
    states = np.zeros((at.W1 + 4 * (degree + 2), n))
    states[at.Y] = coefficients[0]
    states[at.P1 : at.P1 + degree] = coefficients[1:]
    methods = np.zeros((1, at.METHOD_SLOTS), dtype=np.int64)
    methods[0, at.IN_POWERS] = in_powers
    methods[0, at.ENCLOSED_AT] = at.W1
    counts = np.zeros(at.COUNT_SLOTS, dtype=np.int64)
    counts[at.DEGREE] = degree
    pieces = np.array(pieces)
    out = np.zeros((len(pieces), 4 + 2 * len(SAMPLES), n))
    tables = states, np.zeros(at.CLOCK_SLOTS), counts, methods
    ranges_of(tables, DT, pieces, SAMPLES, out)
    return out[:, :4], out[:, 4::2], out[:, 5::2]


def check(ranges, values, slopes):
    """Check that all samples are inside."""
    assert (values.min(axis=1) >= ranges[:, 0]).all()
    assert (values.max(axis=1) <= ranges[:, 1]).all()
    assert (slopes.min(axis=1) >= ranges[:, 2]).all()
    assert (slopes.max(axis=1) <= ranges[:, 3]).all()


PIECES = (
    (0.0, 1.0),
    (0.0, 0.25),
    (0.25, 0.75),
    (0.25, 0.3),
    (0.75, 1.0),
    (0.9, 0.9 + 1e-7),
)


@pytest.mark.parametrize("degree", [3, 4, 5, 7])
@pytest.mark.parametrize("n", [1, 2, 9])
def test_ranges_enclose_the_interpolant_of_an_explicit_method(degree, n):
    rng = np.random.default_rng([degree, n])
    for _ in range(40):
        sizes = 10.0 ** rng.uniform(-3.0, 1.0, (degree + 1, n))
        sizes[rng.random((degree + 1, n)) < 0.2] = 0.0
        coefficients = sizes * rng.choice((-1.0, 1.0), sizes.shape)
        found = enclosed(coefficients, 0, PIECES)
        check(*found)


@pytest.mark.parametrize("fastest", [0.1, 2.0, 4.5])
def test_ranges_enclose_a_series_of_many_terms(fastest):
    rng = np.random.default_rng(5)
    order = np.arange(at.LARGEST_DEGREE + 1)
    factorials = np.cumprod(np.maximum(order, 1.0))
    for _ in range(20):
        turn = rng.uniform(0.2, 1.0, 3) * fastest
        phase = rng.uniform(0.0, 2.0 * np.pi, 3)
        rates = np.cos(phase + 0.5 * np.pi * order[:, None])
        coefficients = rates * turn ** order[:, None] / factorials[:, None]
        found = enclosed(coefficients, 1, PIECES)
        check(*found)
        ranges, _, slopes = found
        # No range is much wider than what is in it.
        width = ranges[:, 3] - ranges[:, 2]
        largest = abs(slopes).max(axis=1)
        assert (width < 3.0 * np.ptp(slopes, axis=1) + 0.1 * largest).all()


@pytest.mark.parametrize("in_powers", [0, 1])
def test_a_straight_path_has_its_own_ranges(in_powers):
    coefficients = np.zeros((5, 2))
    coefficients[0] = 1.0, -2.0
    coefficients[1] = 0.5, 0.0
    ranges, _, _ = enclosed(coefficients, in_powers, PIECES)
    np.testing.assert_allclose(ranges[0, :2, 0], (1.0, 1.5), atol=1e-13)
    np.testing.assert_allclose(ranges[:, 2:, 0], 0.5 / DT, atol=1e-12)
    assert (ranges[:, :2, 1] == -2.0).all()
    assert (ranges[:, 2:, 1] == 0.0).all()


def test_what_is_not_a_number_is_in_no_range():
    coefficients = np.ones((5, 1))
    coefficients[4] = np.nan
    ranges, _, _ = enclosed(coefficients, 0, PIECES[:1])
    assert np.isnan(ranges[0, :2]).all()
