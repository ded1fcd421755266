"""Hops with their true contacts and states."""

from itertools import permutations

import numpy as np
import pytest

from hopdata.errors import AnalysisError
from hopdata.rigid import relative
from hopdata.scenes.scene import Control
from hopdata.steering import robot as plant
from hopdata.steering.true_hops import VELOCITY, true_hops

ROBOT = plant.SteeredHopper()
SWINGS = np.radians([20.0, -60.0, 45.0, 10.0, -30.0, 60.0, -10.0])


@pytest.fixture(scope="module")
def hops():
    return true_hops(ROBOT, SWINGS, seed=3)


def test_rows_are_the_hops_between_the_stances_of_the_robot(hops):
    rng = np.random.default_rng(3)
    apex = plant.released(ROBOT, np.zeros(3))
    poses = []
    booms = []
    for swing in SWINGS:
        hop = plant.steer_hop(ROBOT, apex, swing, rng=rng)
        poses.append(hop.stance.pose)
        booms.append(hop.start.boom_angle_rad % (2 * np.pi))
        apex = hop.end
    assert len(hops) == len(SWINGS) - 1
    expected = relative(np.array(poses)[:-1], np.array(poses)[1:])
    np.testing.assert_array_equal(hops.changes.change, expected)
    np.testing.assert_array_equal(hops.changes.swing_rad, SWINGS[1:])
    np.testing.assert_array_equal(hops.previous_swing_rad, SWINGS[:-1])
    np.testing.assert_array_equal(hops.changes.boom_angle_rad, booms[1:])


def test_orders_name_each_leg_once(hops):
    orders = {">".join(order) for order in permutations("123")}
    assert set(hops.lift_off) <= orders
    assert set(hops.landing) <= orders
    assert hops.schedule[0] == f"{hops.lift_off[0]}, {hops.landing[0]}"


def test_a_leg_that_lands_harder_first_is_first():
    """A hopper tilted towards leg 1 lands on it, and one tilted away lands on it last."""
    still = ROBOT.still()
    firsts = []
    for pitch in (0.05, -0.05):
        apex = plant.released(still, np.zeros(3))
        tilted = apex.state.copy()
        tilted[4] = pitch
        start = plant.Apex(0.0, tilted, apex.boom_angle_rad)
        hop = plant.steer_hop(still, start, 0.0, rng=np.random.default_rng(0))
        firsts.append(int(hop.hop.event_leg[0]))
    assert firsts[0] == 0  # pitch lowers the front, where leg 1 is
    assert firsts[1] != 0


def test_states_are_told_in_the_frame_of_the_first_stance(hops):
    """The hop before ends somewhere near; its heading and place are forgotten."""
    assert np.abs(hops.apex[:, :2]).max() < 0.2
    assert np.abs(hops.apex[:, 3]).max() < 0.5
    # The hopper goes on in the direction in which it moved: in the frame of the stance
    # the velocity at the apex and the way to it point alike.
    along = (hops.apex[:, VELOCITY][:, :2] * hops.apex[:, :2]).sum(axis=1)
    assert (along > 0).mean() > 0.6


def test_a_control_without_strength_lands_as_the_robot_does(hops):
    same = true_hops(ROBOT, SWINGS, seed=3, control=Control())
    np.testing.assert_allclose(same.changes.change, hops.changes.change, atol=1e-7)
    coupled = true_hops(ROBOT, SWINGS, seed=3, control=Control(coupling=0.5))
    assert np.abs(coupled.changes.change - hops.changes.change).max() > 1e-3
    # It begins in the same states.
    np.testing.assert_array_equal(coupled.apex, hops.apex)


def test_rows_are_chosen_by_number_or_truth(hops):
    some = hops.rows(np.array([4, 1]))
    np.testing.assert_array_equal(some.apex, hops.apex[[4, 1]])
    assert some.landing.tolist() == hops.landing[[4, 1]].tolist()
    late = hops.rows(hops.changes.time_s > hops.changes.time_s[2])
    assert len(late) == len(hops) - 3
    assert len(hops.rows(slice(1, 3))) == 2


def test_without_a_hop_from_stance_to_stance_there_is_an_error():
    with pytest.raises(AnalysisError, match="hops in which all legs stand"):
        true_hops(ROBOT, SWINGS[:1], seed=1)
