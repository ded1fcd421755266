"""Guards that branch on what varies, or do not, in the many ways of source code."""

from __future__ import annotations

import functools
import math

import numpy as np
from numba import njit

VARYING = (0, 1, 2, 5, 6)  # t, y, dy, h, hdot


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


def has_a_method(t, y, dy, mode, params, h, hdot):
    h[0] = y.max() - 1.0
    hdot[0] = dy[0]


def has_an_index_of_the_largest(t, y, dy, mode, params, h, hdot):
    h[0] = 1.0 * y.argmax()
    hdot[0] = dy[0]


def has_whole_numbers(t, y, dy, mode, params, h, hdot):
    h[0] = y.astype(int)[0]
    hdot[0] = dy[0]


def has_a_list(t, y, dy, mode, params, h, hdot):
    sizes = [abs(v) for v in y]
    h[0] = sizes[0]
    hdot[0] = dy[0]


def has_a_list_by_number(t, y, dy, mode, params, h, hdot):
    sizes = [abs(v) for v in [t, 1.0]]
    h[0] = sizes[0]
    hdot[0] = dy[0]


def has_a_shorter_list(t, y, dy, mode, params, h, hdot):
    h[0] = 1.0 * len([1.0 for k in range(2) if y[k]])
    hdot[0] = dy[0]


def hides_a_helper(t, y, dy, mode, params, h, hdot):
    bend = max
    h[0] = bend(y[0], 0.0)
    hdot[0] = dy[0]


def has_a_root_of_a_square(t, y, dy, mode, params, h, hdot):
    h[0] = (y[0] ** 2) ** 0.5
    hdot[0] = dy[0]


def has_a_power_by_parameter(t, y, dy, mode, params, h, hdot):
    h[0] = (y[0] * y[0]) ** params[0]
    hdot[0] = dy[0]


def has_a_power_in_place(t, y, dy, mode, params, h, hdot):
    u = y[0] * y[0]
    u **= 0.5
    h[0] = u
    hdot[0] = dy[0]


def has_a_square_root(t, y, dy, mode, params, h, hdot):
    h[0] = np.sqrt(y[0] ** 2)
    hdot[0] = dy[0]


def has_a_length(t, y, dy, mode, params, h, hdot):
    h[0] = math.hypot(y[0], y[1])
    hdot[0] = dy[0]


def has_a_zigzag(t, y, dy, mode, params, h, hdot):
    h[0] = math.acos(math.cos(t))
    hdot[0] = dy[0]


def has_no_zero(t, y, dy, mode, params, h, hdot):
    h[0] = not t
    hdot[0] = dy[0]


def writes_by_another_name(t, y, dy, mode, params, h, hdot):
    room = np.zeros(2)
    part = room[:1]
    part[0] = y[0]
    h[0] = 1.0 if room[0] > 0.0 else 0.0
    hdot[0] = dy[0]


@njit
def put(room, u):
    room[0] = u


def writes_by_a_helper(t, y, dy, mode, params, h, hdot):
    room = np.zeros(2)
    put(room, y[0])
    h[0] = 1.0 if room[0] > 0.0 else 0.0
    hdot[0] = dy[0]


def has_a_function_inside(t, y, dy, mode, params, h, hdot):
    def height():
        return y[0]

    h[0] = 1.0 if height() > 0.0 else 0.0
    hdot[0] = dy[0]


NOT_SMOOTH = (
    has_a_method, has_an_index_of_the_largest, has_whole_numbers, has_a_list, has_a_list_by_number,
    has_a_root_of_a_square, has_a_power_by_parameter, has_a_power_in_place, has_a_square_root,
    has_a_length, has_a_zigzag, has_no_zero, writes_by_another_name, writes_by_a_helper,
    has_a_function_inside, has_a_shorter_list, hides_a_helper,
)  # fmt: skip


def has_smooth_roots(t, y, dy, mode, params, h, hdot):
    h[0] = np.sqrt(2.0) * y[0] - params[0] ** 0.5 + y[1] ** 3 + 2.0**t
    h[1] = math.sqrt(1.0 + y[0] ** 2 + y[1] * y[1]) + math.hypot(1.0, y[0])
    h[2] = sum([params[k] for k in range(2)]) + math.exp(t) ** 0.5
    put(h, y[0])
    doubled = [2.0 * v for v in y]
    h[3] = doubled[0]
    hdot[0] = dy[0]


def positional_only(t, y, /, mode):
    return 1.0 if mode > 0.0 else t + y


def any_number(*u):
    return abs(u[0])


@njit
def again(u, n):
    return again(0.5 * u, n - 1) + u


@njit
def there(u):
    return back(u)


@njit
def back(u):
    return there(u)


def wrapped(function):
    @functools.wraps(function)
    def folded(t, y, dy, mode, params, h, hdot):
        h[0] = abs(y[0])

    return folded


BRANCHING = (
    compares, compares_later, compares_what_it_wrote, has_a_rest, has_a_corner, reads_a_table,
    has_a_helper, has_a_logical_value,
)  # fmt: skip
