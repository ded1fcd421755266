"""Guards that meet at one instant: a derivative where no order matters, and else none."""

import numpy as np
import pytest

from hopdata.hybrid import System, field, guards, solve
from hopdata.hybrid.first_order import check_c1
from hopdata.hybrid.gradients import gradient
from hopdata.hybrid.layout import TIE_IN_JACOBIAN

# Three feet at heights y[0:3] that fall at 1, 2 and 3 m/s, and a body y[3] that their
# locks push: each by its own force, pairs by one of their own, and the last two by one
# that the first takes away. `params[6]` is what the first foot's lock adds to the rate
# of the second one's height.
ALONE, PAIR, LAST_TWO, SLOWS = [0.5, -0.3, 0.8], 3, 5, 6


@field
def pushed(t, y, mode, params, dy):
    a = 1.0 if mode[0] > 0 else 0.0
    b = 1.0 if mode[1] > 0 else 0.0
    c = 1.0 if mode[2] > 0 else 0.0
    dy[0] = 1.0
    dy[1] = 2.0 + params[6] * a
    dy[2] = 3.0
    dy[3] = params[0] * a + params[1] * b + params[2] * c
    dy[3] += params[3] * a * b + params[4] * a * b * c + params[5] * b * c * (1.0 - a)


@guards
def heights(t, y, dy, mode, params, h, hdot):
    for k in range(3):
        h[k] = y[k]
        hdot[k] = dy[k]


@guards
def one_height(t, y, dy, mode, params, h, hdot):
    for k in range(3):
        h[k] = y[0]
        hdot[k] = dy[0]


NAMES = ("a", "b", "c")
FEET = System(pushed, heights, n_states=4, guard_names=NAMES)
ONE_FOOT = System(pushed, one_height, n_states=4, guard_names=NAMES)
AT_ONCE = [-0.5, -1.0, -1.5, 0.0]


def body(t, y, params):
    return y[3]


def params_with(**terms):
    params = np.array([*ALONE, 0.0, 0.0, 0.0, 0.0])
    for place, value in terms.items():
        params[int(place[1:])] = value
    return params


def differences(system, start, params, step=1e-4):
    columns = []
    for axis in step * np.eye(4):
        ends = [
            solve(system, (0.0, 1.0), start + way * axis, params=params).y_end
            for way in (1.0, -1.0)
        ]
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    return np.transpose(columns)


def carried(system, start, params):
    forward = solve(system, (0.0, 1.0), start, params=params, jacobian=True)
    backward = gradient(system, (0.0, 1.0), start, params=params, at_end=body)
    assert forward.status == backward.status
    if forward.status == 0:
        np.testing.assert_allclose(backward.by_start, forward.jacobian[3], atol=1e-9)
    return forward


def test_forces_that_add_have_a_derivative():
    found = carried(FEET, AT_ONCE, params_with())
    assert found.status == 0
    assert len(set(found.events.time)) == 1
    expected = np.eye(4)
    expected[3, :3] = np.divide(ALONE, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(found.jacobian, expected, atol=1e-12)
    by_difference = differences(FEET, AT_ONCE, params_with())
    np.testing.assert_allclose(by_difference, expected, atol=1e-9)


@pytest.mark.parametrize(
    "terms",
    [
        {"p3": 0.4},  # a force of two feet together
        {"p3": 1e-4},
        {"p4": 0.4},  # of all three
        {"p5": 0.4},  # of two before the first, which the order a, b, c never shows
        {"p6": 0.5},  # one foot's lock changes when the next one lands
        {"p6": -3.0},  # or whether it lands at all
    ],
)
def test_where_the_order_matters_there_is_none(terms):
    params = params_with(**terms)
    found = carried(FEET, AT_ONCE, params)
    assert found.status == TIE_IN_JACOBIAN
    assert "the flow depends on their order, or one of them turns" in found.message
    there = check_c1(FEET, np.zeros(4), guards=[0, 1, 2], params=params, mode=[-1] * 3)
    assert there.verdict != "C1"


@pytest.mark.parametrize("apart", [1e-3, 1e-7])
def test_beside_such_an_instant_there_is_that_of_one_order(apart):
    start = np.add(AT_ONCE, [apart, 0.0, -apart, 0.0])
    params = params_with(p3=0.4, p5=0.2)
    found = carried(FEET, start, params)
    assert found.status == 0
    by_difference = differences(FEET, start, params, step=0.1 * apart)
    np.testing.assert_allclose(found.jacobian, by_difference, atol=1e-6)


def test_guards_of_one_surface_always_flip_together():
    """Neighbours cannot exchange them, whatever the field makes of their locks."""
    params = params_with(p3=0.4, p4=0.3, p5=0.2)
    found = carried(ONE_FOOT, AT_ONCE, params)
    assert found.status == 0
    by_difference = differences(ONE_FOOT, AT_ONCE, params)
    np.testing.assert_allclose(found.jacobian, by_difference, atol=1e-9)


def test_rounding_of_a_force_that_begins_with_zero_is_no_order():
    """Springs push by their depth, which is rounding at the instant of the contact."""

    @field
    def sprung(t, y, mode, params, dy):
        push = 0.0
        for k in range(2):
            if mode[k] > 0:
                push += params[0] * y[k]
        dy[0], dy[1] = y[2] + 0.3 * y[3], y[2] - 0.3 * y[3]
        dy[2], dy[3] = 9.81 - push, -0.2 * push

    @guards
    def depths(t, y, dy, mode, params, h, hdot):
        for k in range(2):
            h[k], hdot[k] = y[k], dy[k]

    system = System(sprung, depths, n_states=4, guard_names=("left", "right"))
    start = np.array([-0.7, -0.7, 0.3, 0.0])
    found = solve(system, (0.0, 0.4), start, params=[3e5], jacobian=True, rtol=1e-10)
    assert found.events.time[0] == found.events.time[1]
    assert found.status == 0
