"""Ranges contain every value that a function takes, and tell each branch, jump and kink in them."""

from __future__ import annotations

import math
from ctypes import CFUNCTYPE, c_double, c_int64

import numpy as np
import pytest
from numba import njit

from hopdata.hybrid import guards
from hopdata.hybrid.numbers import answers
from hopdata.hybrid.numbers.guards import guards_for_ranges

N = 3  # states


@njit
def smooth(kind, x, y, t):
    if kind == 0:
        return 2 * x - y + t * x - 3.0
    if kind == 1:
        return x / (y + 7.0) + 1.0 / (8.0 - t)
    if kind == 2:
        return x**2 - y**3 + (t + 6.0) ** 1.5 + (y + 9.0) ** -2
    if kind == 3:
        return math.sin(3.0 * x) + np.cos(y) * math.sin(t)
    if kind == 4:
        return math.exp(-(x**2)) + np.tanh(y) + math.log(t + 6.0)
    if kind == 5:
        return math.sqrt(x + 5.5) + np.arctan(y) + math.hypot(x, y)
    if kind == 6:
        return math.cosh(x) + np.arcsin(0.1 * y) - math.acos(0.1 * t)
    return math.atan2(x, y + 6.0) + math.atan2(y + 6.0, t)


@njit
def branching(kind, x, y, t):
    value = 0.0 * x
    if kind == 0:
        value = x if x < y else t
    elif kind == 1:
        value += 1.0 if -1.0 < x <= 1.0 else 0.0
    elif kind == 2:
        value = x + np.where(y > 0.5, 1.0, 2.0)
    elif kind == 3:
        value = max(x, y) + min(0.0, t)
    elif kind == 4:
        value = abs(x) + np.abs(y - 1.0)
    elif kind == 5:
        value = x % 1.0 + t // 2.0
    elif kind == 6:
        value = math.floor(x) + np.ceil(y) + 1.0 * int(t)
    elif kind == 7:
        value = np.sign(x) + math.copysign(1.0, y)
    elif kind == 8:
        value += 1.0 if x == y else 0.0
    elif kind == 9:
        value = math.tan(x)
    elif kind == 10:
        value = 1.0 / x
    else:
        value = np.interp(x, TABLE, HEIGHTS)
    return value


TABLE, HEIGHTS = np.linspace(-4.0, 4.0, 9), np.cos(np.arange(9.0))


@guards
def smooth_guard(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = smooth(int(params[0]), y[0], y[1], t), 0.0


@guards
def branching_guard(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = branching(int(params[0]), y[0], y[1], t), 0.0


def ranged(declared, kind):
    """Return a function of the ends of the ranges: the range of h, and whether a branch is open."""
    made = guards_for_ranges(declared)
    assert made.address > 0, made.reason
    call = CFUNCTYPE(None, *(3 * [c_double]), *(12 * [c_int64]))(made.address)

    def evaluate(low, high):
        states, slopes = np.array([low, high, low - low, low - low]), np.zeros((2, N))
        mode, params = np.zeros(1, np.int64), np.array([float(kind)])
        room, listed, told = (
            np.zeros(4),
            np.zeros(1, np.int64),
            np.zeros(answers.N_SLOTS, np.int64),
        )
        call(
            low[2], high[2], 1.0, states.ctypes.data, slopes.ctypes.data, N, mode.ctypes.data, 1,
            params.ctypes.data, 1, room.ctypes.data, 1, listed.ctypes.data, 1, told.ctypes.data,
        )  # fmt: skip
        assert made.code is not None
        met = told[answers.OPENED] + told[answers.JUMPED] + told[answers.KINKED]
        return room[0], room[1], bool(met)

    return evaluate


def boxes(rng, count):
    """Yield random ranges, from a point to some units wide."""
    for _ in range(count):
        middle, half = rng.uniform(-4.0, 4.0, N), 10.0 ** rng.uniform(-12, 0, N)
        yield middle - half, middle + half


@pytest.mark.parametrize("kind", range(8))
def test_a_range_contains_all_values_and_no_branch_is_open(kind):
    evaluate, rng, widths = ranged(smooth_guard, kind), np.random.default_rng(1), []
    for low, high in boxes(rng, 300):
        least, most, is_open = evaluate(low, high)
        assert not is_open
        corners = [np.where(rng.random(N) < 0.5, low, high) for _ in range(8)]
        for point in [*corners, *rng.uniform(low, high, (20, N))]:
            assert least <= smooth(kind, *point) <= most, (low, high, point)
        widths.append((most - least) / np.abs(high - low).max())
    assert (
        np.median(widths) < 40.0
    )  # ranges that contain everything would be right as well


@pytest.mark.parametrize("kind", range(12))
def test_a_branch_is_open_where_values_or_slopes_jump(kind):
    """Along a line through the ranges, nothing jumps unless it is told; and often it is not."""
    evaluate, rng, found = ranged(branching_guard, kind), np.random.default_rng(2), 0
    for low, high in boxes(rng, 600):
        least, most, is_open = evaluate(low, high)
        found += is_open
        if is_open:
            continue
        values = np.array(
            [branching(kind, *point) for point in np.linspace(low, high, 101)]
        )
        assert least <= values.min()
        assert values.max() <= most
        bends = np.abs(np.diff(values, 2)).max()
        assert bends <= 0.1 * np.ptp(values) + 1e-9, (low, high)
    assert 3 < found < 500
