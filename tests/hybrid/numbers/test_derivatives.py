"""A system's functions, compiled unchanged for duals: rates of guards, and what has no code."""

from __future__ import annotations

import numpy as np
from numba import njit

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
