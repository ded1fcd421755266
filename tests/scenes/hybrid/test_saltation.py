"""Saltation matrices of the scenes against known flows."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from jacobian_checks import saltation_product
from scipy.integrate import solve_ivp

from hopdata.hybrid import solve
from hopdata.hybrid.first_order import (
    NoDerivativeError,
    bouligand_derivative,
)
from hopdata.scenes.body import flight_mode
from hopdata.scenes.hopper import hopper_system
from hopdata.scenes.hopper_control import control_system
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.octant import octant
from hopdata.scenes.scene import Control


def test_product_multiplies_in_the_order_of_crossing():
    first = saltation_product(octant(), [0, 0, 0], [0], mode=[-1, -1, -1])
    then = saltation_product(octant(), [0, 0, 0], [1], mode=[1, -1, -1])
    both = saltation_product(octant(), [0, 0, 0], [0, 1], mode=[-1, -1, -1])
    np.testing.assert_array_equal(both, then @ first)
    assert np.abs(both - first @ then).max() > 0.1


HOPPER = HopperParameters()
FEET = ("foot1", "foot2", "foot3")


def octant_case():
    return octant(), np.zeros(3), (), [-1, -1, -1], ("x", "y", "z")


def hopper_case():
    y = np.array([0, 0, 0.27, 0, 0, 0, 0.05, -0.03, -2.1, 0.1, -0.2, 0.05])
    return hopper_system(), y, HOPPER.vector(), flight_mode(hopper_system(), -1.0), FEET


def control_case(control):
    y = np.zeros(12)
    y[2], y[6:9] = 0.27 + 2.1 * control.delay_s, [0.05, -0.03, -2.1]
    return (
        control_system(),
        y,
        HOPPER.vector(variant=control),
        flight_mode(hopper_system(), -1.0),
        FEET,
    )


CASES = {
    "octant": octant_case,
    "hopper": hopper_case,
    "coupling": lambda: control_case(Control(coupling=0.1)),
    "delay": lambda: control_case(Control(delay_s=0.005)),
    "impulse": lambda: control_case(Control(impulse=0.1)),
}


def derivative(case):
    system, state, params, mode, names = case
    return bouligand_derivative(system, state, params=params, mode=mode, guards=names)


def backwards(system, y, params, mode, duration):
    """Follow the field of one mode backwards in time; guards are ignored."""

    def rate(t, y):
        dy = np.zeros_like(y)
        system.field.function(0.0, y, mode, params, dy)
        return -dy

    span = (0.0, duration)
    return solve_ivp(rate, span, y, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]


def carried_through(case, state, duration):
    """Take a state back by the first field, forward by `solve`, and back by the last field."""
    system, _, params, mode, names = case
    numbers, locks = np.array(params, dtype=float), np.array(mode)
    before = backwards(system, state, numbers, locks, duration)
    there = solve(
        system,
        (0, 2 * duration),
        before,
        params=params,
        mode=mode,
        rtol=1e-13,
        atol=1e-14,
    )
    crossed = [system.guard_names[k] for k in there.events.guard]
    assert sorted(crossed) == sorted(names)
    return backwards(
        system, there.y_end, numbers, there.mode, duration
    ), there.events.guard


@pytest.mark.parametrize("name", CASES)
def test_differences_of_the_flow_approach_it_in_every_direction(name):
    case = CASES[name]()
    d = derivative(case)
    rng = np.random.default_rng(11)
    errors, orders = [], set()
    for v in rng.normal(size=(12, len(case[1]))):
        v = v / np.linalg.norm(v)
        order = d.order(v)
        end = d.node(order).here.instant.y
        error = []
        for eps in (1e-4, 1e-5):
            image, guards = carried_through(case, case[1] + eps * v, 0.02)
            error.append((image - end) / eps - d.node(order).product @ v)
            assert tuple(guards) == order
        errors.append(error)
        orders.add(order)
    coarse, fine = np.array(errors).swapaxes(0, 1)
    first, then, rest = (
        np.linalg.norm(e, axis=1) for e in (coarse, fine, (10 * fine - coarse) / 9)
    )
    assert len(orders) >= 4
    assert (then < 0.15 * first + 1e-7).all()
    assert rest.max() < 1e-4


@pytest.mark.parametrize(
    ("name", "linear"), [("octant", 0), ("hopper", 1), ("coupling", 0)]
)
def test_only_a_c1_flow_has_one_matrix_for_all_directions(name, linear):
    d = derivative(CASES[name]())
    v = np.random.default_rng(12).normal(size=(d.system.n_states, 50))
    first = d.pieces()[0].matrix
    off = np.linalg.norm(first @ v - d(v), axis=0) / np.linalg.norm(v, axis=0)
    assert (off.max() < 1e-13) == bool(linear)
    assert linear or off.max() > 0.03


def test_a_flow_that_jumps_has_no_derivative():
    d = derivative(CASES["impulse"]())
    with pytest.raises(NoDerivativeError, match="the flow jumps"):
        d(np.random.default_rng(13).normal(size=(d.system.n_states, 20)))


@pytest.mark.parametrize("name", [name for name in CASES if name != "impulse"])
def test_pieces_meet_continuously(name):
    """Between the insides of two cones, D_v does not jump along a straight line of deviations."""
    d = derivative(CASES[name]())
    rng, steps = np.random.default_rng(13), np.linspace(0, 1, 2001)
    a, b = rng.normal(size=(2, d.system.n_states))
    images = d(np.outer(a, 1 - steps) + np.outer(b, steps))
    jump = np.linalg.norm(np.diff(images, axis=1), axis=0).max()
    limit = (
        3
        * np.linalg.norm(b - a)
        / 2000
        * max(np.linalg.norm(p.matrix, 2) for p in d.pieces())
    )
    assert jump < limit


def test_homogeneous_but_not_additive():
    d = derivative(octant_case())
    v = np.array([0.3, -0.2, 0.1])
    np.testing.assert_allclose(d(3.0 * v), 3.0 * d(v), rtol=1e-15)
    assert np.abs(d(v) + d(-v)).max() > 0.01


def test_one_direction_is_a_column_of_many():
    d = derivative(octant_case())
    v = np.random.default_rng(14).normal(size=(3, 5))
    assert d(v).shape == (3, 5)
    assert d(v[:, 2]).tolist() == d(v)[:, 2].tolist()
    assert d(np.zeros((3, 0))).shape == (3, 0)


def test_shape_is_checked():
    with pytest.raises(ValueError, match="deviations"):
        derivative(octant_case())(np.zeros(4))


def test_octant_has_six_orders_and_two_products():
    orders = bouligand_derivative(octant(), [0, 0, 0], mode=[-1, -1, -1]).pieces()
    assert {order.guards for order in orders} == set(permutations(range(3)))
    distinct = {order.matrix.tobytes() for order in orders}
    assert len(distinct) == 2
    for order in orders:
        first_x = order.guards.index(0) < order.guards.index(1)
        expected = np.eye(3)
        if first_x:
            expected[1, :2] = 0.5
        np.testing.assert_allclose(order.matrix, expected, atol=1e-15)
