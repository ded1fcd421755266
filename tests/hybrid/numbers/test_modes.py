"""Which fields do the same with the time in all modes, from their source."""

import math

import numpy as np
import pytest

from hopdata.hybrid.numbers.modes import is_same_in_all_modes

TIME, MODE, READ = (0,), (3,), (0, 1, 2, 3)


def since(t, start):
    return max(t - start, 0.0)


def fill(t, into):
    into[0] = since(t, 1.0)


def keep(values):
    return values


def only_time(t, y, p, mode):
    return since(t, p[0]) - mode[0] * y[0]


def mode_before_time(t, y, p, mode):
    push = 0.0
    if mode[0] > 0:
        push = math.sqrt(abs(y[0]))
    if t > 2.0:
        push += 1.0
    return push


def smooth_by_mode(t, y, p, mode):
    u = 1.0 if t % p[0] < 0.5 else -1.0
    return mode[0] * u + mode[1] * math.sin(t)


def read_by_helper(t, y, p, mode):
    rows = (y[0], y[1])
    push = 0.0
    if mode[0] > 0:
        push = since(rows[0], 0.0)
    return np.interp(t, p[:3], p[3:6]) + push


FREE = [only_time, mode_before_time, smooth_by_mode, read_by_helper]


def chosen(t, y, p, mode):
    if mode[0] > 0:
        return since(t, p[0])
    return 0.0


def left_early(t, y, p, mode):
    if mode[0] > 0:
        return 0.0
    return since(t, p[0])


def by_both(t, y, p, mode):
    shifted = t - mode[0]
    return 1.0 if shifted > 1.0 else 0.0


def by_truth(t, y, p, mode):
    return 1.0 if t * mode[0] else 0.0


def by_remainder(t, y, p, mode):
    period = 1.0
    if mode[0] > 0:
        period = 2.0
    phase = t
    phase %= period
    return phase


def by_rounds(t, y, p, mode):
    rate = 1.0
    for _ in range(mode[0]):
        rate += 1.0
    return abs(math.sin(rate * t))


def by_place(t, y, p, mode):
    return np.interp(t, p[:3], p[mode[0] : 6])


def by_helper(t, y, p, mode):
    return since(t, mode[0])


def by_order(t, y, p, mode):
    return (mode[0] > 0 and t > 1.0) * 1.0


def through_array(t, y, p, mode):
    room = np.zeros(2)
    fill(t, room)
    return 1.0 if room[0] > mode[0] else 0.0


def through_other_name(t, y, p, mode):
    room = np.zeros(2)
    other = keep(room)
    other[0] = t
    return 1.0 if room[0] > mode[0] else 0.0


def through_part(t, y, p, mode):
    room = np.zeros(2)
    pair = (room, 1.0)
    pair[0][0] = t
    return 1.0 if room[0] > mode[0] else 0.0


def through_method(t, y, p, mode):
    room = np.zeros(2)
    other = room.reshape(2, 1)
    other[0] = t
    return 1.0 if room[0] > mode[0] else 0.0


def within(t, y, p, mode):
    def inner():
        return t > mode[0]

    return inner()


BOUND = [
    chosen,
    left_early,
    by_both,
    by_truth,
    by_remainder,
    by_rounds,
    by_place,
    by_helper,
    by_order,
    through_array,
    through_other_name,
    through_part,
    through_method,
    within,
]


@pytest.mark.parametrize("function", FREE)
def test_a_mode_that_only_stands_beside_the_time_does_not_matter(function):
    assert is_same_in_all_modes(function, TIME, MODE, READ)


@pytest.mark.parametrize("function", BOUND)
def test_a_mode_that_may_choose_a_jump_in_time_matters(function):
    assert not is_same_in_all_modes(function, TIME, MODE, READ)
