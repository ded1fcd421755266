"""Single hops: the drop test, and what a hop reports about its contacts."""

from dataclasses import replace

import numpy as np
import pytest

from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.synthesis.hops import fly_hop, level_state, rest_foot

HOPPER = HopperParameters()
HOP_HEIGHT_M = 0.24


def rebound(hopper, drop_height_m):
    """Height of the feet above the floor at the apex after a drop, over that before it."""
    hop = fly_hop(hopper, level_state(hopper, drop_height_m))
    assert not hop.fell
    return (hop.end_state[2] - hopper.leg_length_m) / drop_height_m


def test_a_dropped_hopper_keeps_its_energy_through_the_landing():
    """The dissertation's drop test (section 2.2.1): legs preloaded, no energy put back."""
    passive = replace(HOPPER, release_extension_m=0.0)
    assert rebound(passive, HOP_HEIGHT_M) > 0.40
    assert rebound(passive, HOP_HEIGHT_M) == pytest.approx(0.489, abs=0.002)
    deadbeat = replace(passive, damping_n_s_m=30.0)
    assert rebound(deadbeat, HOP_HEIGHT_M) < 0.40


def test_release_makes_up_for_the_loss_at_the_hopping_height():
    assert rebound(HOPPER, HOP_HEIGHT_M) == pytest.approx(1.0, abs=0.01)
    assert rebound(HOPPER, 0.15) > 1.1
    assert rebound(HOPPER, 0.35) < 0.9


def test_a_level_drop_touches_when_free_fall_says_and_stands_on_all_legs():
    hop = fly_hop(HOPPER, level_state(HOPPER, HOP_HEIGHT_M))
    touch = hop.event_time[hop.event_down]
    np.testing.assert_allclose(touch, np.sqrt(2 * HOP_HEIGHT_M / 9.81), rtol=1e-9)
    assert hop.all_stood()
    assert sorted(hop.first_contacts()) == [0, 1, 2]
    assert len(hop.legs_down()) == 0


def test_feet_are_on_the_floor_when_they_touch():
    state = level_state(HOPPER, HOP_HEIGHT_M)
    state[9:12] = [0.3, -0.2, 0.1]
    hop = fly_hop(HOPPER, state)
    first = hop.first_contacts()
    gaps = [rest_foot(HOPPER, hop.event_state[k], leg)[2] for leg, k in enumerate(first)]
    np.testing.assert_allclose(gaps, 0, atol=1e-9)
    assert np.ptp(hop.event_time[first]) > 1e-3


def test_states_are_given_at_the_frame_times_up_to_the_apex():
    times = np.arange(300) / 100 + 0.003
    hop = fly_hop(HOPPER, level_state(HOPPER, HOP_HEIGHT_M), frame_times_s=times)
    assert len(hop.states) == np.sum(times <= hop.end_time_s)
    falling = times < 0.2
    heights = HOPPER.leg_length_m + HOP_HEIGHT_M - 9.81 * times[falling] ** 2 / 2
    np.testing.assert_allclose(hop.states[: falling.sum(), 2], heights, atol=1e-9)
    assert hop.end_state[8] == pytest.approx(0.0, abs=1e-9)


def test_a_tumbling_hopper_falls():
    state = level_state(HOPPER, HOP_HEIGHT_M)
    state[9] = 6.0
    hop = fly_hop(HOPPER, state)
    assert hop.ending == "tipped over"
    assert hop.fell


def test_a_hopper_too_weak_to_take_off_counts_as_fallen():
    weak = replace(HOPPER, preload_n=12.0)
    hop = fly_hop(weak, level_state(weak, 0.01), frame_times_s=np.arange(100) / 100, limit_s=1.0)
    assert hop.ending == "no apex in time"
    assert hop.fell
    assert hop.end_time_s == 1.0
    assert len(hop.states) == 100


def test_a_hopper_set_down_on_its_preload_is_stuck_and_one_let_go_above_is_not():
    unreleased = replace(HOPPER, release_extension_m=0.0)
    assert fly_hop(unreleased, level_state(unreleased, 0.0)).ending == "stuck"
    assert fly_hop(unreleased, level_state(unreleased, 1e-6)).ending == "apex"
