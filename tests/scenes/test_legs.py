import numpy as np
import pytest

from hopdata.scenes import hopper_parameters as hp
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.legs import foot_gap, leg_wrench
from hopdata.scenes.rigid_body import rotation_entries, rotation_matrices

HOPPER = HopperParameters()


def wrench(state, hopper=HOPPER, leg=0):
    """Force in the world and torque about O in the body."""
    force, torque = leg_wrench(leg, state, rotation_entries(*state[3:6]), hopper.vector())
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
    assert wrench(level(0.125))[0] == pytest.approx([0, 0, HOPPER.push_at_release_n])
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
    np.testing.assert_allclose(turn @ torque, np.cross(point - state[:3], force), atol=1e-12)


def test_each_leg_has_its_own_preload():
    y, p = level(0.0), HOPPER.vector(np.array([20.0, 21.0, 23.0]))
    found = [leg_wrench(leg, y, rotation_entries(0.0, 0.0, 0.0), p)[0][2] for leg in range(3)]
    assert found == pytest.approx([20.0, 21.0, 23.0])
    assert p[hp.N_LEGS] == 3
