"""Guards that branch on what varies, or do not, in several ways."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit
def bend(u, kind):
    if kind > 0:
        return math.sin(u)
    return u * u


@njit
def fold(u, kind):
    return u if u > 0.0 else -u * kind


def smooth(t, y, dy, mode, params, h, hdot):
    gain = 1.0 if mode[0] > 0 else params[0]
    for k in range(len(h)):
        if k > 0 and params[1] > 0.5:
            gain = 2.0
        h[k] = gain * np.cos(y[k]) + bend(t, mode[1])
        hdot[k] = -gain * np.sin(y[k]) * dy[k]


def compares(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] if y[0] > params[0] else 0.0
    hdot[0] = dy[0]


def compares_later(t, y, dy, mode, params, h, hdot):
    u = params[0]
    for _ in range(2):
        u = u + t
    h[0] = 1.0
    if u > 0.0:
        h[0] = 2.0
    hdot[0] = dy[0]


def compares_what_it_wrote(t, y, dy, mode, params, h, hdot):
    h[0] = y[0]
    while h[0] > 1.0:
        h[0] -= 1.0
    hdot[0] = dy[0]


def has_a_rest(t, y, dy, mode, params, h, hdot):
    h[0] = t % 1.0
    hdot[0] = dy[0]


def has_a_corner(t, y, dy, mode, params, h, hdot):
    h[0] = max(0.0, y[0])
    hdot[0] = dy[0]


def reads_a_table(t, y, dy, mode, params, h, hdot):
    h[0] = params[int(y[0])]
    hdot[0] = dy[0]


def has_a_helper(t, y, dy, mode, params, h, hdot):
    h[0] = fold(y[0], 1.0)
    hdot[0] = dy[0]


def has_a_logical_value(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] * (y[0] > 0.0)
    hdot[0] = dy[0]


BRANCHING = (
    compares, compares_later, compares_what_it_wrote, has_a_rest, has_a_corner, reads_a_table,
    has_a_helper, has_a_logical_value,
)  # fmt: skip
