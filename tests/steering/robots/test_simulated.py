"""The simulated robots: what an input does, and what a stride leaves for the next."""

from dataclasses import replace

import numpy as np
import pytest

from hopdata.steering.robot import SOFT_KICKS, SteeredHopper, released, steer_hop
from hopdata.steering.robots.interface import Simulation, excited
from hopdata.steering.robots.planar_hopper import PlanarHopper
from hopdata.steering.robots.quadruped import SteeredQuadruped
from hopdata.steering.robots.steered_hopper import StridingHopper

STILL = replace(
    SOFT_KICKS, velocity_m_s=0.0, angular_velocity_rad_s=0.0, preload_fraction=0.0
)
EVEN = (1.0, 1.0, 1.0, 1.0)


def made(robot, inputs, pose=(0.0, 0.0, 0.0)):
    """Return the stances after strides with these inputs, from a release."""
    rng = np.random.default_rng(1)
    stances = [robot.release(pose)]
    for one in inputs:
        stances.append(robot.stride(stances[-1], np.array([one]), rng))
    return stances


@pytest.mark.parametrize(
    "robot",
    [
        PlanarHopper(kicks=STILL),
        SteeredQuadruped(kicks=STILL, preload_shares=EVEN),
    ],
)
def test_mirrored_inputs_make_mirrored_strides(robot):
    pushed = made(robot, [0.04, 0.02, -0.03])
    mirrored = made(robot, [-0.04, -0.02, 0.03])
    mirror = [1, -1, -1] if isinstance(robot, SteeredQuadruped) else [-1, 1, 1]
    for one, other in zip(pushed, mirrored, strict=True):
        np.testing.assert_allclose(one.pose * mirror, other.pose, atol=1e-5)
        np.testing.assert_allclose(one.state, -other.state, atol=1e-5)
    assert np.abs(pushed[-1].pose).max() > 0.05


def test_a_foot_ahead_slows_the_planar_hopper_down():
    behind, none, ahead = (
        made(PlanarHopper(kicks=STILL), [-0.03, u])[-1].state[0]
        for u in (-0.03, 0.0, 0.03)
    )
    assert ahead < none < behind
    at_first = made(PlanarHopper(kicks=STILL), [-0.03])[-1].state[0]
    # Half of the speed is left after a stride without an input.
    assert none / at_first == pytest.approx(0.5, abs=0.1)


def test_the_planar_hopper_s_hop_is_that_of_the_steered_hopper():
    """Both have the same legs and mass, so a hop on the spot lasts as long."""
    hop = made(PlanarHopper(kicks=STILL), [0.0])[-1]
    assert hop.time_s == pytest.approx(0.634, abs=0.01)
    assert not hop.fell
    # A leg far behind the mass throws it down.
    assert made(PlanarHopper(kicks=STILL), [-1.4])[-1].fell


def test_a_longer_stride_on_the_right_turns_the_quadruped_to_the_left():
    robot = SteeredQuadruped(kicks=STILL, preload_shares=EVEN)
    once, then = made(robot, [0.3, 0.0])[1:]
    assert once.pose[2] > 0.1
    assert once.pose[0] > 0.05
    # The turn goes on in the next stride, which the state foretells.
    assert then.pose[2] - once.pose[2] > 0.03
    np.testing.assert_array_equal(once.state, [0.3])
    np.testing.assert_array_equal(then.state, [0.0])


def test_a_pose_moves_the_quadruped_s_strides_with_it():
    robot = SteeredQuadruped(kicks=STILL)
    here = made(robot, [0.2])[-1].pose
    there = made(robot, [0.2], pose=(1.0, -2.0, np.pi / 2))[-1].pose
    moved = [1.0 - here[1], -2.0 + here[0], np.pi / 2 + here[2]]
    np.testing.assert_allclose(there, moved, atol=1e-6)


def test_the_steered_hopper_behind_the_interface_is_the_steered_hopper():
    hopper = SteeredHopper()
    stances = made(StridingHopper(hopper), [0.5, -0.4], pose=(0.3, 0.2, 1.0))
    rng = np.random.default_rng(1)
    apex = released(hopper, (0.3, 0.2, 1.0))
    for swing, stance in zip((0.5, -0.4), stances[1:], strict=True):
        hop = steer_hop(hopper, apex, swing, rng=rng)
        np.testing.assert_array_equal(stance.pose, hop.stance.pose)
        assert stance.state[0] == hop.stance.boom_angle_rad
        apex = hop.end


@pytest.mark.parametrize("robot", [PlanarHopper(), SteeredQuadruped()])
def test_a_hundred_random_strides_are_all_used(robot):
    rng = np.random.default_rng(2)
    axes = robot.axes
    inputs = rng.uniform(axes.lower, axes.upper, (100, 1))
    log = excited(Simulation(robot, seed=2), inputs)
    assert not log.fell
    assert len(log.strides().used()) == 100
