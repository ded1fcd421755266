"""The Numba type for lanes: a user's scalar code gives each lane what plain Python gives.

These tests fail if a version of Numba removes something that `lanes.vectors` relies on.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from mpmath import mp
from numba import njit

from hopdata.hybrid.lanes.vectors import (
    WIDTH,
    aligned,
    bits,
    fma,
    part,
    rough_power,
    where,
)

two = part(2)


@cache
def compiled(function):
    inner = njit(error_model="numpy")(function)

    @njit(error_model="numpy")
    def call(given, result):
        numbers = two(given, 0)
        out = two(result, 0)
        out[0] = inner(numbers[0], numbers[-1])

    return call


def outcome(function, x, y):
    """Return the result of a function of two numbers in all lanes."""
    given = aligned(2)
    result = aligned(2)
    given[:WIDTH] = x
    given[WIDTH:] = y
    compiled(function)(given, result)
    return result[:WIDTH].copy()


def sine(x, y):
    return math.sin(x) + 0.0 * y


def cosine(x, y):
    return math.cos(x) + 0.0 * y


def arithmetic(x, y):
    z = -x + 2 * y - x / 3.0 + (1 + y) * x
    z += y
    z *= 0.5
    return z - abs(y)


def powers(x, y):
    return x**2 + 2.0 * x**-3 + abs(y) ** 0.5 + pow(abs(x), y)


def choices(x, y):
    inside = ((x > 0.0) & (y <= 1)) | ~(x != y)
    return (
        np.where(inside, x, 2)
        + min(x, 1.0)
        + max(0, y)
        + np.maximum(x, y)
        - np.minimum(y, x)
    )


def elementary(x, y):
    s = math.sin(x) * np.cos(y) + math.tan(0.1 * x) + np.sqrt(abs(x)) + math.exp(-x * x)
    return (
        s
        + np.log(1.0 + y * y)
        + np.arctan(x)
        + math.atan2(y, x)
        + math.hypot(x, y)
        + np.tanh(y)
    )


@pytest.mark.parametrize("function", [arithmetic, powers, choices, elementary])
def test_the_numbers_of_scalar_code(function):
    rng = np.random.default_rng(1)
    for _ in range(5):
        x, y = rng.uniform(-3.0, 3.0, (2, WIDTH))
        wanted = [function(a, b) for a, b in zip(x, y, strict=True)]
        assert np.allclose(outcome(function, x, y), wanted, rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("size", [1.0, 30.0, 1e4, 1e8, 1e12])
def test_sine_and_cosine_err_by_at_most_two_ulps(size):
    rng = np.random.default_rng(2)
    for ours, exact in ((sine, mp.sin), (cosine, mp.cos)):
        for _ in range(20):
            x = rng.uniform(-size, size, WIDTH)
            found = outcome(ours, x, x)
            wanted = np.array([float(exact(mp.mpf(one))) for one in x])
            assert (np.abs(found - wanted) <= 2 * np.spacing(np.abs(wanted))).all()


def test_what_is_not_finite_stays_in_its_lane():
    x = np.ones(WIDTH)
    x[:3] = np.inf, -np.inf, np.nan
    found = outcome(lambda a, b: math.sin(a) + b, x, np.zeros(WIDTH))
    assert np.isnan(found[:3]).all()
    assert np.allclose(found[3:], np.sin(1.0))


def test_masks_and_bits():
    found = outcome(lambda a, b: where(a > b, bits(a > b), -1.0), np.arange(WIDTH), 1.5)
    assert found.tolist() == [-1.0] * 2 + [float((1 << WIDTH) - 4)] * (WIDTH - 2)


def test_fused_and_rough():
    x = np.full(WIDTH, 1.0 + 2.0**-30)
    exact = outcome(lambda a, b: fma(a, a, -b), x, x * x)
    assert exact.tolist() == [2.0**-60] * WIDTH
    rough = outcome(
        lambda a, b: rough_power(a, -0.125) + 0.0 * b, 10.0 ** np.arange(WIDTH), 0.0
    )
    assert np.allclose(rough, 10.0 ** (-0.125 * np.arange(WIDTH)), rtol=0.08)
