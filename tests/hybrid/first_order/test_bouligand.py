"""D_v against differences of `solve` through states at which guards meet."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hopdata.hybrid import solve
from hopdata.hybrid.first_order import bouligand_derivative
from hopdata.scenes.hopper import flight_mode, hopper_system
from hopdata.scenes.hopper_control import HopperControl, control_system
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.octant import octant

HOPPER = HopperParameters()
FEET = ("foot1", "foot2", "foot3")


def octant_case():
    return octant(), np.zeros(3), (), [-1, -1, -1], ("x", "y", "z")


def hopper_case():
    y = np.array([0, 0, 0.27, 0, 0, 0, 0.05, -0.03, -2.1, 0.1, -0.2, 0.05])
    return hopper_system(), y, HOPPER.vector(), flight_mode(3, -1.0), FEET


def control_case(control):
    y = np.zeros(12)
    y[2], y[6:9] = 0.27 + 2.1 * control.delay_s, [0.05, -0.03, -2.1]
    return control_system(), y, control.vector(HOPPER), flight_mode(3, -1.0), FEET


CASES = {
    "octant": octant_case,
    "hopper": hopper_case,
    "coupling": lambda: control_case(HopperControl(coupling=0.1)),
    "delay": lambda: control_case(HopperControl(delay_s=0.005)),
    "impulse": lambda: control_case(HopperControl(impulse=0.1)),
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
    """Take a state back by the first field, forward by `solve`, back by the last field."""
    system, _, params, mode, names = case
    numbers, locks = np.array(params, dtype=float), np.array(mode)
    before = backwards(system, state, numbers, locks, duration)
    there = solve(
        system, (0, 2 * duration), before, params=params, mode=mode, rtol=1e-13, atol=1e-14
    )
    crossed = [system.guard_names[k] for k in there.events.guard]
    assert sorted(crossed) == sorted(names)
    return backwards(system, there.y_end, numbers, there.mode, duration), there.events.guard


@pytest.mark.parametrize("name", CASES)
def test_differences_of_the_flow_approach_it_in_every_direction(name):
    case = CASES[name]()
    d = derivative(case)
    rng = np.random.default_rng(11)
    errors, orders = [], set()
    for v in rng.normal(size=(12, len(case[1]))):
        v = v / np.linalg.norm(v)
        order = d.order(v)
        end = d.tree.node(order).here.instant.y
        error = []
        for eps in (1e-4, 1e-5):
            image, guards = carried_through(case, case[1] + eps * v, 0.02)
            error.append((image - end) / eps - d(v))
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


@pytest.mark.parametrize(("name", "linear"), [("octant", 0), ("hopper", 1), ("coupling", 0)])
def test_only_a_c1_flow_has_one_matrix_for_all_directions(name, linear):
    d = derivative(CASES[name]())
    v = np.random.default_rng(12).normal(size=(d.tree.system.n_states, 50))
    first = d.pieces()[0].matrix
    off = np.linalg.norm(first @ v - d(v), axis=0) / np.linalg.norm(v, axis=0)
    assert (off.max() < 1e-13) == bool(linear)
    assert linear or off.max() > 0.03


@pytest.mark.parametrize("name", CASES)
def test_pieces_meet_continuously_unless_the_state_jumps(name):
    """Between the insides of two cones a straight line of deviations has no jump of D_v."""
    d = derivative(CASES[name]())
    rng, steps = np.random.default_rng(13), np.linspace(0, 1, 2001)
    a, b = rng.normal(size=(2, d.tree.system.n_states))
    images = d(np.outer(a, 1 - steps) + np.outer(b, steps))
    jump = np.linalg.norm(np.diff(images, axis=1), axis=0).max()
    limit = 3 * np.linalg.norm(b - a) / 2000 * max(np.linalg.norm(p.matrix, 2) for p in d.pieces())
    assert (jump < limit) == (name != "impulse")


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
