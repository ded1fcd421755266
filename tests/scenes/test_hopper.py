"""The hopper's equations against momentum, energy and the conditions for a C1 landing."""

import math
from itertools import permutations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hopdata.hybrid import solve
from hopdata.hybrid.numbers.modes import is_same_in_all_modes
from hopdata.scenes import hopper_vector as at
from hopdata.scenes.body import (
    cross,
    euler_rates,
    flight_mode,
    rotation_entries,
    rotation_matrices,
)
from hopdata.scenes.hopper import (
    boom_motion,
    foot_gap,
    hopper_event,
    hopper_field,
    hopper_guards,
    hopper_system,
    leg_wrench,
    solve_with_point_mass,
)
from hopdata.scenes.hopper_parameters import HopperParameters

SWINGING = HopperParameters(boom_swing_rad=1.1, boom_duration_s=0.3)
FRICTIONLESS = HopperParameters(damping_n_s_m=0.0, friction=0.0)


def rate(t, y, mode, parameters):
    dy = np.zeros(12)
    hopper_field(t, y, mode, parameters.vector(), dy)
    return dy


def surfaces(y, mode, parameters, dy=None):
    n = parameters.n_legs
    h, hdot = np.zeros(n + 2), np.zeros(n + 2)
    dy = np.zeros(12) if dy is None else dy
    hopper_guards(0.0, y, dy, mode, parameters.vector(), h, hdot)
    return h, hdot


def modes(*legs, n_legs=3):
    mode = flight_mode(hopper_system(n_legs), -1.0)
    mode[list(legs)] = 1
    return mode


def random_state(rng):
    y = rng.normal(size=12)
    y[2], y[3:6] = 0.25, 0.3 * y[3:6]
    return y


def momenta(t, y, parameters):
    """Return linear and angular momentum of chassis and counterweight about the world's origin."""
    c, c_rate, _ = (np.array(v) for v in boom_motion.py_func(t, parameters.vector()))
    turn, w = rotation_matrices(y[3:6]), y[9:12]
    point = y[:3] + turn @ c
    speed = y[6:9] + turn @ (np.cross(w, c) + c_rate)
    small, large = parameters.counterweight_mass_kg, parameters.mass_kg
    inertia = np.array(
        [
            parameters.inertia_x_kg_m2,
            parameters.inertia_y_kg_m2,
            parameters.inertia_z_kg_m2,
        ]
    )
    linear = large * y[6:9] + small * speed
    angular = large * np.cross(y[:3], y[6:9]) + small * np.cross(point, speed)
    return linear, angular + turn @ (inertia * w), point


def energy(y, standing, parameters):
    """Return kinetic, gravitational and elastic energy, with the boom at rest."""
    linear, _, point = momenta(0.0, y, parameters)
    turn, w = rotation_matrices(y[3:6]), y[9:12]
    inertia = np.array(
        [
            parameters.inertia_x_kg_m2,
            parameters.inertia_y_kg_m2,
            parameters.inertia_z_kg_m2,
        ]
    )
    small, large = parameters.counterweight_mass_kg, parameters.mass_kg
    speed = (linear - large * y[6:9]) / small
    kinetic = (large * y[6:9] @ y[6:9] + small * speed @ speed + w @ (inertia * w)) / 2
    gaps = (y[:3] + parameters.rest_feet() @ turn.T)[standing, 2]
    elastic = np.sum(
        parameters.stiffness_n_m * gaps**2 / 2 - parameters.preload_n * gaps
    )
    return (
        kinetic + parameters.gravity_m_s2 * (large * y[2] + small * point[2]) + elastic
    )


def floor_forces(y, legs, parameters):
    """Return forces and points of attack in the world, derived independently with vectors."""
    turn = rotation_matrices(y[3:6])
    for leg in legs:
        arm = turn @ parameters.rest_feet()[leg]
        foot = y[:3] + arm
        gap_rate = (y[6:9] + turn @ np.cross(y[9:12], parameters.rest_feet()[leg]))[2]
        point = foot * [1, 1, 0]
        sliding = (y[6:9] + np.cross(turn @ y[9:12], point - y[:3]))[:2]
        normal = (
            parameters.preload_n
            - parameters.stiffness_n_m * foot[2]
            - parameters.damping_n_s_m * gap_rate
        )
        drag = (
            -parameters.friction
            * normal
            / math.hypot(*sliding, parameters.slip_velocity_m_s)
        )
        yield point, np.array([*(drag * sliding), normal])


@pytest.mark.parametrize("legs", [(), (1,), (0, 2), (0, 1, 2)])
def test_momentum_changes_by_the_forces_from_outside(legs):
    rng, step, t = np.random.default_rng(3), 1e-6, 0.11
    for _ in range(5):
        y = random_state(rng)
        dy = rate(t, y, modes(*legs), SWINGING)
        ahead, behind = (
            momenta(t + s * step, y + s * step * dy, SWINGING) for s in (1, -1)
        )
        point = momenta(t, y, SWINGING)[2]
        small, large = SWINGING.counterweight_mass_kg, SWINGING.mass_kg
        weight = np.array([0.0, 0.0, -SWINGING.gravity_m_s2])
        force = (small + large) * weight
        torque = np.cross(large * y[:3] + small * point, weight)
        for where, push in floor_forces(y, legs, SWINGING):
            force = force + push
            torque = torque + np.cross(where, push)
        np.testing.assert_allclose(
            (ahead[0] - behind[0]) / (2 * step), force, atol=1e-6
        )
        np.testing.assert_allclose(
            (ahead[1] - behind[1]) / (2 * step), torque, atol=1e-6
        )


def fly(parameters, state, t_span, *, rtol=1e-10, **options):
    n = parameters.n_legs
    return solve(
        hopper_system(n),
        t_span,
        state,
        params=parameters.vector(),
        mode=flight_mode(hopper_system(n), state[8]),
        rtol=rtol,
        atol=1e-12,
        **options,
    )


def test_boom_swing_in_flight_turns_the_body_and_keeps_the_momenta():
    state = np.zeros(12)
    state[2], state[6:12] = 2.0, [0.2, -0.1, 0.3, 0.1, -0.2, 0.3]
    state[9:12] = 0.0
    times = np.linspace(0, 0.4, 9)
    y = fly(SWINGING, state, (0, 0.4), t_eval=times, rtol=1e-12).y.T
    total = SWINGING.total_mass_kg

    def about_centre(t, state):
        linear, angular, point = momenta(t, state, SWINGING)
        centre = SWINGING.mass_kg * state[:3] + SWINGING.counterweight_mass_kg * point
        return linear, angular - np.cross(centre / total, linear)

    start = about_centre(0.0, state)
    for t, now in zip(times, y, strict=True):
        linear, angular = about_centre(t, now)
        np.testing.assert_allclose(angular, start[1], atol=1e-10)
        np.testing.assert_allclose(
            linear - start[0], [0, 0, -total * 9.81 * t], atol=1e-9
        )
    assert np.abs(y[-1, 3:6]).max() > 0.02
    still = fly(HopperParameters(), state, (0, 0.4), t_eval=times).y.T
    np.testing.assert_allclose(still[:, 3:6], 0, atol=1e-12)


def tilted_start():
    state = np.zeros(12)
    state[2], state[3:6] = 0.27 + 0.24, [0.4, 0.03, -0.02]
    state[6:12] = [0.1, -0.05, 0.0, 0.1, -0.2, 0.1]
    return state


def test_energy_is_conserved_through_a_landing_without_friction_damping_and_release():
    hopper = HopperParameters(damping_n_s_m=0.0, friction=0.0, release_extension_m=0.0)
    state = tilted_start()
    solution = fly(hopper, state, (0, 2.0))
    assert solution.status == 1
    assert len(set(solution.events.time)) >= 6
    end = solution.events.after[-1]
    assert energy(end, [], hopper) == pytest.approx(energy(state, [], hopper), abs=1e-8)


def test_release_puts_back_exactly_the_work_of_the_extended_legs():
    state = tilted_start()
    end = fly(FRICTIONLESS, state, (0, 2.0)).events.after[-1]
    e = FRICTIONLESS.release_extension_m
    work = 3 * (FRICTIONLESS.preload_n * e - FRICTIONLESS.stiffness_n_m * e**2 / 2)
    gain = energy(end, [], FRICTIONLESS) - energy(state, [], FRICTIONLESS)
    assert gain == pytest.approx(work, abs=1e-8)


@pytest.mark.parametrize("lossy", [{"damping_n_s_m": 0.0}, {"friction": 0.0}])
def test_friction_and_damping_only_take_energy(lossy):
    hopper = HopperParameters(release_extension_m=0.0, **lossy)
    state = tilted_start()
    end = fly(hopper, state, (0, 2.0)).events.after[-1]
    assert energy(end, [], hopper) < energy(state, [], hopper) - 1e-3


def test_forces_of_the_legs_add_up():
    rng, hopper = np.random.default_rng(4), HopperParameters()
    for _ in range(5):
        y = random_state(rng)
        none = rate(0.0, y, modes(), hopper)
        single = [rate(0.0, y, modes(leg), hopper) - none for leg in range(3)]
        together = rate(0.0, y, modes(0, 1, 2), hopper) - none
        np.testing.assert_allclose(sum(single), together, atol=1e-11)
        assert min(np.abs(jump[6:]).max() for jump in single) > 1


def test_contact_depends_on_position_alone_and_rates_are_derivatives():
    rng, hopper, step = np.random.default_rng(5), HopperParameters(), 1e-6
    y, other = random_state(rng), random_state(rng)
    other[:6] = y[:6]
    h, _ = surfaces(y, modes(), hopper)
    np.testing.assert_array_equal(h[:3], surfaces(other, modes(), hopper)[0][:3])
    assert h[3] != surfaces(other, modes(), hopper)[0][3]
    dy = rate(0.0, y, modes(1), hopper)
    ahead, behind = (surfaces(y + s * step * dy, modes(), hopper)[0] for s in (1, -1))
    hdot = surfaces(y, modes(), hopper, dy)[1]
    np.testing.assert_allclose((ahead - behind) / (2 * step), hdot, atol=1e-8)


def saltations(y, hopper, guard_delay_s):
    """Return the product of three saltation matrices for each order, guards h + delay dh/dt."""
    step = 1e-6
    slopes = np.array(
        [
            [
                np.subtract(
                    *(surfaces(y + s * d, modes(), hopper)[0][leg] for s in (1, -1))
                )
                for d in step * np.eye(12)
            ]
            for leg in range(3)
        ]
    ) / (2 * step)
    slopes[:, 6:9] += guard_delay_s * slopes[:, :3]
    for order in permutations(range(3)):
        product = np.eye(12)
        for k, leg in enumerate(order):
            before = rate(0.0, y, modes(*order[:k]), hopper)
            jump = rate(0.0, y, modes(*order[: k + 1]), hopper) - before
            product = (
                np.eye(12) + np.outer(jump, slopes[leg]) / (slopes[leg] @ before)
            ) @ product
        yield product


def test_all_orders_of_contact_have_one_jacobian_at_triple_contact():
    y = np.zeros(12)
    y[2], y[6:12] = 0.27, [0.05, -0.03, -2.1, 0.1, -0.2, 0.05]
    products = list(saltations(y, HopperParameters(), 0.0))
    spread = max(np.abs(p - products[0]).max() for p in products)
    assert spread < 1e-13
    delayed = list(saltations(y, HopperParameters(), 0.01))
    assert max(np.abs(p - delayed[0]).max() for p in delayed) > 1e-3


def test_legs_are_released_together_and_armed_one_by_one():
    hopper, y = HopperParameters(), np.zeros(12)
    p, mode = hopper.vector(), modes(0, 2)
    assert hopper_event(0.0, y, mode, p, 2, 1) == 0
    np.testing.assert_array_equal(mode[5:], [0, 0, 0, 1])
    mode[1] = 1
    assert hopper_event(0.0, y, mode, p, 1, 1) == 0
    np.testing.assert_array_equal(mode[5:], [1, 1, 1, 1])
    y[2] = 0.27
    np.testing.assert_allclose(surfaces(y, mode, hopper)[0][:3], 0.125)
    mode[0] = -1
    hopper_event(0.0, y, mode, p, 0, -1)
    np.testing.assert_array_equal(mode[5:], [0, 1, 1, 1])
    np.testing.assert_allclose(
        surfaces(y, mode, hopper)[0][:3], [0, 0.125, 0.125], atol=1e-15
    )


@pytest.mark.parametrize(
    ("legs", "touched", "stops"),
    [((), 1, 1), ((), 0, 0), ((1,), 1, 0), ((0, 1, 2), 1, 0)],
)
def test_an_apex_ends_a_hop_only_in_flight_and_after_contact(legs, touched, stops):
    mode = modes(*legs)
    mode[-1] = touched
    assert (
        hopper_event(0.0, np.zeros(12), mode, HopperParameters().vector(), 3, -1)
        == stops
    )


def test_a_hopper_that_tips_over_stops_as_fallen():
    state = tilted_start()
    state[2], state[9:12] = 3.0, [4.0, 0.0, 0.0]
    solution = fly(HopperParameters(), state, (0, 2.0))
    assert solution.status == 1
    assert solution.events.guard[-1] == 4
    upright = rotation_matrices(solution.events.after[-1][3:6])[2, 2]
    assert upright == pytest.approx(np.cos(1.0), abs=1e-9)


@pytest.mark.parametrize("n_legs", [2, 4, 6])
def test_any_number_of_legs_lands_and_takes_off_again(n_legs):
    hopper = HopperParameters(
        n_legs=n_legs,
        stiffness_n_m=270 / n_legs,
        preload_n=66 / n_legs,
        damping_n_s_m=14.4 / n_legs,
    )
    state = np.zeros(12)
    state[2] = 0.27 + 0.24
    solution = fly(hopper, state, (0, 2.0))
    assert solution.status == 1
    assert sorted(solution.events.guard[solution.events.direction > 0]) == list(
        range(n_legs)
    )
    assert solution.events.time[-1] == pytest.approx(0.6354, abs=2e-3)


BOOM_SWINGING = HopperParameters(boom_swing_rad=1.1, boom_duration_s=0.3)


def test_boom_moves_by_its_swing_and_its_rates_are_its_derivatives():
    p, step = BOOM_SWINGING.vector(), 1e-5
    for t in (-0.1, 0.05, 0.17, 0.29, 0.5):
        place, speed, acceleration = (np.array(v) for v in boom_motion.py_func(t, p))
        before, after = (
            np.array(boom_motion.py_func(t + s * step, p)[0]) for s in (-1, 1)
        )
        np.testing.assert_allclose((after - before) / (2 * step), speed, atol=1e-8)
        np.testing.assert_allclose(
            (after - 2 * place + before) / step**2, acceleration, atol=1e-4
        )
    angles = [
        np.arctan2(place[1], place[0] - BOOM_SWINGING.boom_offset_m)
        for place in (boom_motion.py_func(t, p)[0] for t in (0.0, 0.3))
    ]
    assert (angles[1] - angles[0]) % (2 * np.pi) == pytest.approx(1.1)


def test_neutral_boom_holds_the_counterweight_on_the_body_axis():
    place, speed, acceleration = boom_motion.py_func(0.1, HopperParameters().vector())
    assert place == pytest.approx((0.0, 0.0, -0.03), abs=1e-15)
    assert speed == acceleration == (0.0, 0.0, 0.0)


def test_places_at_many_times_are_those_at_each():
    p, times = BOOM_SWINGING.vector(), np.linspace(-0.1, 0.5, 7)
    single = [boom_motion.py_func(t, p)[0] for t in times]
    np.testing.assert_allclose(BOOM_SWINGING.boom_places(times), single, rtol=1e-15)


HOPPER = HopperParameters()


def wrench(state, hopper=HOPPER, leg=0):
    """Return the force in the world frame and the torque about O in the body frame."""
    force, torque = leg_wrench(
        leg, state, rotation_entries(*state[3:6]), hopper.vector()
    )
    return rotation_matrices(state[3:6]) @ force, np.array(torque)


def level(gap_m, *velocity):
    state = np.zeros(12)
    state[2], state[6 : 6 + len(velocity)] = HOPPER.leg_length_m + gap_m, velocity
    return state


def test_gap_and_its_rate_are_those_of_the_rest_foot():
    rng = np.random.default_rng(1)
    for leg in range(3):
        y = 0.3 * rng.normal(size=12)
        foot, turn = HOPPER.rest_feet()[leg], rotation_matrices(y[3:6])
        gap, rate = foot_gap(leg, y, rotation_entries(*y[3:6]), HOPPER.vector())
        assert gap == pytest.approx((y[:3] + turn @ foot)[2])
        assert rate == pytest.approx((y[6:9] + turn @ np.cross(y[9:12], foot))[2])


def test_force_jumps_to_the_preload_and_is_affine_in_compression_and_its_rate():
    assert wrench(level(0.0))[0] == pytest.approx([0, 0, 22.0])
    assert wrench(level(-0.05))[0] == pytest.approx([0, 0, 22.0 + 90 * 0.05])
    assert wrench(level(0.125))[0] == pytest.approx([0, 0, 22 - 90 * 0.125])
    assert wrench(level(0.0, 0, 0, -2.0))[0] == pytest.approx([0, 0, 22.0 + 4.8 * 2])


def test_friction_opposes_sliding_and_saturates():
    slow, fast = wrench(level(0.0, 0.17, 0.0))[0], wrench(level(0.0, 3.0, -4.0))[0]
    assert slow == pytest.approx([-0.4 * 22 / np.sqrt(2), 0, 22])
    np.testing.assert_allclose(fast[:2], -0.4 * 22 * np.array([0.6, -0.8]), rtol=1e-3)
    assert np.hypot(*fast[:2]) < 0.4 * 22


def test_force_acts_at_the_floor_under_the_foot():
    state = level(-0.05, 0.1, 0.2, -0.5)
    state[3:6], state[9:12] = [0.3, 0.1, -0.05], [0.2, -0.1, 0.4]
    force, torque = wrench(state, leg=1)
    turn = rotation_matrices(state[3:6])
    point = (state[:3] + turn @ HOPPER.rest_feet()[1]) * [1, 1, 0]
    np.testing.assert_allclose(
        turn @ torque, np.cross(point - state[:3], force), atol=1e-12
    )


def test_each_leg_has_its_own_preload():
    y, p = level(0.0), HOPPER.vector(np.array([20.0, 21.0, 23.0]))
    found = [
        leg_wrench(leg, y, rotation_entries(0.0, 0.0, 0.0), p)[0][2] for leg in range(3)
    ]
    assert found == pytest.approx([20.0, 21.0, 23.0])
    assert p[at.N_LEGS] == 3


@pytest.fixture
def rng():
    return np.random.default_rng(1)


def test_rotation_is_yaw_pitch_roll_from_body_to_world(rng):
    angles = rng.uniform(-1.4, 1.4, (20, 3))
    oracle = Rotation.from_euler("ZYX", angles).as_matrix()
    np.testing.assert_allclose(rotation_matrices(angles), oracle, atol=1e-15)
    entries = [rotation_entries.py_func(*a) for a in angles]
    np.testing.assert_allclose(np.reshape(entries, (20, 3, 3)), oracle, atol=1e-15)


def test_the_order_of_the_angles_matters(rng):
    angles = rng.uniform(0.5, 1.0, (5, 3))
    other = Rotation.from_euler("XYZ", angles[:, ::-1]).as_matrix()
    assert np.abs(rotation_matrices(angles) - other).max() > 0.1


def test_euler_rates_turn_the_body_at_its_angular_velocity(rng):
    step = 1e-6
    for _ in range(10):
        angles, w = rng.uniform(-1.2, 1.2, 3), rng.normal(size=3)
        rates = np.array(euler_rates.py_func(*angles[1:], w))
        ahead, behind = (rotation_matrices(angles + s * step * rates) for s in (1, -1))
        spin = rotation_matrices(angles).T @ (ahead - behind) / (2 * step)
        np.testing.assert_allclose([spin[2, 1], spin[0, 2], spin[1, 0]], w, atol=1e-8)


def test_cross_product(rng):
    a, b = rng.normal(size=(2, 3))
    np.testing.assert_allclose(
        cross.py_func(a, b), np.cross(a, b), rtol=1e-15, atol=1e-15
    )


def test_solve_with_point_mass_solves_the_full_matrix(rng):
    inertia, c, b = rng.uniform(0.05, 0.2, 3), rng.normal(size=3), rng.normal(size=3)
    matrix = np.diag(inertia) + 0.7 * (c @ c * np.eye(3) - np.outer(c, c))
    found = solve_with_point_mass.py_func(inertia, 0.7, c, b)
    np.testing.assert_allclose(found, np.linalg.solve(matrix, b), rtol=1e-12)


def test_the_parameters_can_be_differentiated_and_the_number_of_legs_stays():
    """A whole number that a derivative moves by a little must not lose a leg."""
    params = HopperParameters().vector()
    start = np.zeros(12)
    start[2:6], start[6:9] = (0.4, 0.1, 0.03, -0.02), (0.1, 0.0, -1.0)
    system = hopper_system()
    options = {"mode": flight_mode(system, -1.0), "rtol": 1e-10}

    def end(p):
        return solve(system, (0.0, 0.25), start, params=p, **options).y_end

    found = solve(
        system, (0.0, 0.25), start, params=params, jacobian="params", **options
    )
    assert found.success
    assert len(found.events) >= 3
    np.testing.assert_array_equal(found.sensitivity[:, at.N_LEGS], 0.0)
    for index in (at.STIFFNESS, at.LEGS + at.PRELOAD, at.LEG_LENGTH):
        step = 1e-5 * params[index] * np.eye(len(params))[index]
        slope = (end(params + step) - end(params - step)) / (2 * step[index])
        size = np.abs(slope).max()
        np.testing.assert_allclose(found.sensitivity[:, index], slope, atol=1e-5 * size)


def test_the_ramp_in_time_is_the_same_in_all_modes():
    """The legs, which stand or not by the mode, know nothing of the time."""
    function, times = hopper_field.source_and_places(frozenset(("t",)))
    modes = hopper_field.source_and_places(frozenset(("mode",)))[1]
    assert is_same_in_all_modes(function, times, modes, range(4))
    assert not is_same_in_all_modes(function, (*times, *modes), modes)
