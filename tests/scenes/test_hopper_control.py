"""The controls: at strength zero they do nothing, otherwise each breaks what it states."""

import numpy as np
import pytest

from hopdata.hybrid import solve
from hopdata.hybrid.first_order import bouligand_derivative
from hopdata.scenes.body import flight_mode, rotation_matrices
from hopdata.scenes.hopper import (
    boom_motion,
    hopper_field,
    hopper_guards,
    hopper_system,
)
from hopdata.scenes.hopper_control import (
    control_event,
    control_field,
    control_guards,
    control_system,
)
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.scene import Control

HOPPER = HopperParameters()
SWINGING = HopperParameters(boom_swing_rad=1.1, boom_duration_s=0.3)
SPEEDS = [0.05, -0.03, -2.1, 0.1, -0.2, 0.05]


NONE = Control()


def landing(control):
    """Return the upright state in which all feet meet their guards at once."""
    y = np.zeros(12)
    y[2], y[6:9] = HOPPER.leg_length_m - control.delay_s * SPEEDS[2], SPEEDS[:3]
    if control.delay_s == 0:
        y[9:] = SPEEDS[3:]
    return y


def modes(*legs):
    mode = flight_mode(hopper_system(), -1.0)
    mode[list(legs)] = 1
    return mode


def rate(y, mode, control, hopper=HOPPER, t=0.0):
    dy = np.zeros(12)
    control_field(t, y, mode, hopper.vector(variant=control), dy)
    return dy


def surfaces(y, mode, control, dy):
    h, hdot = np.zeros(5), np.zeros(5)
    control_guards(0.0, y, dy, mode, HOPPER.vector(variant=control), h, hdot)
    return h, hdot


def tilted_start():
    state = np.zeros(12)
    state[2], state[3:6] = 0.27 + 0.24, [0.4, 0.03, -0.02]
    state[6:12] = [0.1, -0.05, 0.0, 0.1, -0.2, 0.1]
    return state


def hop(system, params):
    return solve(
        system,
        (0, 2.0),
        tilted_start(),
        params=params,
        mode=flight_mode(hopper_system(), 0.0),
    )


@pytest.mark.parametrize("hopper", [HOPPER, SWINGING])
def test_at_strength_zero_a_hop_is_bit_for_bit_the_hoppers(hopper):
    plain = hop(hopper_system(), hopper.vector())
    control = hop(control_system(), hopper.vector(variant=NONE))
    assert plain.status == control.status == 1
    assert len(plain.events) >= 7
    assert control.y.tobytes() == plain.y.tobytes()
    assert control.t.tobytes() == plain.t.tobytes()


@pytest.mark.parametrize(
    "control",
    [Control(coupling=0.1), Control(impulse=0.1), Control(delay_s=0.005)],
)
def test_a_control_hops_too_but_otherwise(control):
    plain = hop(hopper_system(), HOPPER.vector())
    other = hop(control_system(), HOPPER.vector(variant=control))
    assert other.status == 1
    assert np.abs(other.y_end - plain.y_end).max() > 1e-3


@pytest.mark.parametrize(
    ("legs", "share"), [((), 1), ((1,), 0.6), ((0, 2), 0.8), ((0, 1, 2), 1)]
)
def test_coupling_scales_the_forces_of_all_legs(legs, share):
    rng = np.random.default_rng(2)
    y = 0.2 * rng.normal(size=12)
    y[2] = 0.25
    free, plain = np.zeros(12), np.zeros(12)
    hopper_field(0.0, y, modes(), HOPPER.vector(), free)
    hopper_field(0.0, y, modes(*legs), HOPPER.vector(), plain)
    coupled = rate(y, modes(*legs), Control(coupling=0.2))
    np.testing.assert_allclose(coupled - free, share * (plain - free), atol=1e-11)


def test_delayed_guards_are_ahead_and_their_rates_are_derivatives():
    rng, step, control = np.random.default_rng(6), 1e-6, Control(delay_s=0.02)
    y = 0.3 * rng.normal(size=12)
    dy = rate(y, modes(1), control)
    h, hdot = surfaces(y, modes(), control, dy)
    plain, plain_rate = np.zeros(5), np.zeros(5)
    hopper_guards(0.0, y, dy, modes(), HOPPER.vector(), plain, plain_rate)
    np.testing.assert_allclose(h[:3], plain[:3] + 0.02 * plain_rate[:3], rtol=1e-15)
    np.testing.assert_array_equal(h[3:], plain[3:])
    ahead, behind = (
        surfaces(y + s * step * dy, modes(), control, dy)[0] for s in (1, -1)
    )
    np.testing.assert_allclose((ahead - behind) / (2 * step), hdot, atol=1e-7)


def foot_velocity(y, leg, hopper):
    return y[6:9] + rotation_matrices(y[3:6]) @ np.cross(
        y[9:12], hopper.rest_feet()[leg]
    )


def momenta(t, y, hopper):
    """Return linear momentum, and angular momentum about the centre of the chassis (world axes)."""
    c, c_rate, _ = (np.array(v) for v in boom_motion.py_func(t, hopper.vector()))
    turn, w = rotation_matrices(y[3:6]), y[9:12]
    inertia = np.array(
        [hopper.inertia_x_kg_m2, hopper.inertia_y_kg_m2, hopper.inertia_z_kg_m2]
    )
    point = hopper.counterweight_mass_kg * (y[6:9] + turn @ (np.cross(w, c) + c_rate))
    return hopper.mass_kg * y[6:9] + point, turn @ (inertia * w) + np.cross(
        turn @ c, point
    )


def test_the_impulse_acts_at_the_foot_and_takes_its_share_of_the_velocity():
    rng, t, leg, eps = np.random.default_rng(7), 0.1, 1, 0.3
    params = SWINGING.vector(variant=Control(impulse=eps))
    for _ in range(5):
        y = 0.3 * rng.normal(size=12)
        y[8] -= 2.0
        after, mode = y.copy(), modes(leg)
        assert control_event(t, after, mode, params, leg, 1) == 0
        assert mode[-1] == 1
        np.testing.assert_array_equal(after[:6], y[:6])
        before_z, after_z = (foot_velocity(s, leg, SWINGING)[2] for s in (y, after))
        assert after_z == pytest.approx((1 - eps) * before_z, rel=1e-12)
        linear, angular = (
            a - b
            for a, b in zip(
                momenta(t, after, SWINGING), momenta(t, y, SWINGING), strict=True
            )
        )
        np.testing.assert_allclose(linear[:2], 0, atol=1e-12)
        arm = rotation_matrices(y[3:6]) @ SWINGING.rest_feet()[leg]
        np.testing.assert_allclose(angular, np.cross(arm, linear), atol=1e-12)


def test_lift_off_apex_and_fall_have_no_impulse():
    params, y = HOPPER.vector(variant=Control(impulse=0.3)), tilted_start()
    for guard, direction in ((1, -1), (3, -1), (4, 1)):
        after = y.copy()
        control_event(0.0, after, modes(0), params, guard, direction)
        np.testing.assert_array_equal(after, y)


def orders_of_landing(control, hopper=HOPPER):
    return bouligand_derivative(
        control_system(), landing(control), params=hopper.vector(variant=control),
        mode=flight_mode(hopper_system(), -1.0), guards=(0, 1, 2),
    ).pieces()  # fmt: skip


def spread(control, hopper=HOPPER):
    """Return the largest difference of two orders' saltation products, relative to their effect."""
    products = [order.matrix for order in orders_of_landing(control, hopper)]
    assert len(products) == 6
    effect = max(np.linalg.norm(p - np.eye(12)) for p in products)
    return max(np.linalg.norm(a - b) for a in products for b in products) / effect


def end_spread(control, hopper=HOPPER):
    """Return the largest difference between the final states of two orders."""
    ends = [order.state for order in orders_of_landing(control, hopper)]
    return max(np.linalg.norm(a - b) for a in ends for b in ends)


def orthogonal_hopper():
    """Return a hopper in which an impulse at one foot does not change the other feet's speeds.

    With masses m and m_t, c below O, and I about the common centre of mass: 1/m_t = R^2
    / (2 I).
    """
    share = HOPPER.counterweight_mass_kg / HOPPER.total_mass_kg
    reduced = HOPPER.counterweight_mass_kg * (1 - share)
    inertia = HOPPER.total_mass_kg * HOPPER.foot_radius_m**2 / 2
    inertia -= reduced * HOPPER.boom_height_m**2
    return HopperParameters(inertia_x_kg_m2=inertia, inertia_y_kg_m2=inertia)


def test_where_the_feet_are_orthogonal_impulses_end_in_one_state_but_not_one_jacobian():
    control = Control(impulse=0.1)
    assert end_spread(control) == pytest.approx(0.0395, abs=1e-4)
    assert end_spread(control, orthogonal_hopper()) < 1e-14
    assert spread(control, orthogonal_hopper()) == pytest.approx(0.167, abs=1e-3)


@pytest.mark.parametrize("control", [Control(coupling=0.1), Control(delay_s=0.01)])
def test_other_controls_end_in_the_state_in_which_they_begin(control):
    assert end_spread(control) == 0


def test_six_orders_have_one_jacobian_without_a_control():
    assert spread(NONE) < 1e-13


@pytest.mark.parametrize(
    ("name", "weak", "strong", "apart"),
    [
        ("coupling", 0.1, 0.2, 0.149),
        ("impulse", 0.1, 0.2, 0.285),
        ("delay_s", 0.005, 0.01, 0.049),
    ],
)
def test_a_control_has_several_and_the_stronger_the_more(name, weak, strong, apart):
    little, much = (spread(Control(**{name: value})) for value in (weak, strong))
    assert little == pytest.approx(apart, abs=1e-3)
    assert much > 1.3 * little
