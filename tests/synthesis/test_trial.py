"""Many hops in a row: the gait that the issue asks for, and the operator's part."""

import os
from collections import Counter

import numpy as np
import pytest

from hopdata.errors import ArgumentError
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.synthesis.hops import level_state, rest_foot
from hopdata.synthesis.simulate import first_contacts
from hopdata.synthesis.trial import (
    LIFT_S,
    Kicks,
    MarkerOptions,
    Operator,
    carried,
    from_mapping,
    kicked,
    off_the_floor,
    run_trial,
)

HOPPER = HopperParameters()


#: Ten thousand take 11 s: with `ALL=1`.
HOPS = 10_000 if "ALL" in os.environ else 2_500


@pytest.fixture(scope="module")
def long_trial():
    return run_trial(
        HOPPER, hops=HOPS, rate_hz=100.0, rng=np.random.default_rng(20261121)
    )


@pytest.fixture(scope="module")
def contacts(long_trial):
    return first_contacts(long_trial, HOPPER)[0]


def test_thousands_of_hops_without_a_fall(long_trial):
    assert len(long_trial.hops) == HOPS
    assert not any(hop.fell for hop in long_trial.hops)


def test_hops_take_as_long_as_the_robot_s(long_trial):
    durations = np.array([hop.end_time_s for hop in long_trial.hops])
    assert 0.60 < durations.mean() < 0.66
    assert durations.std() < 0.05


def test_all_six_orders_of_contact_occur(long_trial, contacts):
    stood = np.array([hop.all_stood() for hop in long_trial.hops])
    assert stood.mean() > 0.99
    orders = Counter(map(tuple, np.argsort(contacts[stood], axis=1)))
    assert len(orders) == 6
    assert min(orders.values()) / stood.sum() > 0.05


def test_contacts_are_about_ten_milliseconds_apart(contacts):
    spread = np.nanstd(contacts, axis=1)
    assert np.median(spread) == pytest.approx(0.010, abs=0.001)


def test_stronger_kicks_throw_it_over():
    kicks = Kicks(angular_velocity_rad_s=1.5)
    trial = run_trial(
        HOPPER, hops=60, rate_hz=100.0, rng=np.random.default_rng(2), kicks=kicks
    )
    falls = sum(hop.fell for hop in trial.hops)
    assert falls > 0
    assert trial.n_carries >= falls


def test_without_kicks_all_legs_land_at_once():
    still = Kicks(velocity_m_s=0.0, angular_velocity_rad_s=0.0, preload_fraction=0.0)
    trial = run_trial(
        HOPPER, hops=5, rate_hz=100.0, rng=np.random.default_rng(2), kicks=still
    )
    assert np.ptp(first_contacts(trial, HOPPER)[0], axis=1).max() < 1e-9


def test_the_operator_keeps_the_hopper_in_the_arena(long_trial):
    assert long_trial.n_carries > 10
    places = np.array([hop.start_state[:2] for hop in long_trial.hops])
    assert np.abs(places).max() < 0.9
    assert np.abs(long_trial.states[:, :2]).max() > 0.85
    tight = Operator(arena_m=0.3)
    trial = run_trial(
        HOPPER, hops=300, rate_hz=100.0, rng=np.random.default_rng(3), operator=tight
    )
    assert np.abs([hop.start_state[:2] for hop in trial.hops]).max() < 0.3


def test_frames_follow_one_another_without_jumps(long_trial):
    end = long_trial.hop_start_s[-1] + long_trial.hops[-1].end_time_s
    assert abs(len(long_trial.states) - end * 100) <= 1
    steps = np.abs(np.diff(long_trial.states[:, :6], axis=0))
    assert steps[:, :3].max() < 0.03
    assert steps[:, 3:].max() < 0.1


def test_contact_events_are_in_order_and_alternate(long_trial):
    assert np.all(np.diff(long_trial.event_time) >= 0)
    for leg in range(3):
        down = long_trial.event_down[long_trial.event_leg == leg]
        assert down[0]
        assert np.all(down[1:] != down[:-1])


def test_carried_motion_is_smooth_from_the_catch_to_the_release():
    start = level_state(HOPPER, 0.3)
    start[:6] += [0.9, 0.2, 0.0, 2.0, 0.1, -0.2]
    start[6:12] = [0.3, -0.2, 0.0, 0.4, -0.3, 0.2]
    release = level_state(HOPPER, 0.24)
    times = np.linspace(0, 1.5, 15001)
    states = carried(start, release, 1.5, times)
    np.testing.assert_allclose(states[0, :9], start[:9], atol=1e-15)
    np.testing.assert_allclose(states[-1, :9], release[:9], atol=1e-15)
    speed = np.gradient(states[:, :3], times, axis=0)
    np.testing.assert_allclose(speed[1:-1], states[1:-1, 6:9], atol=1e-6)


def test_a_fallen_body_is_lifted_until_its_legs_fit_under_it():
    fallen, release = level_state(HOPPER, -0.15), level_state(HOPPER, 0.24)
    fallen[4:9] = [0.5, -0.3, 0.1, 0.0, -1.0]
    times = np.linspace(0, 1.5, 15001)
    states = carried(fallen, release, 1.5, times)
    lifted = off_the_floor(HOPPER, states, times)

    def lowest(some):
        feet = [rest_foot(HOPPER, some, leg)[:, 2] for leg in range(HOPPER.n_legs)]
        return np.min(feet, axis=0)

    late = times > LIFT_S
    assert lowest(states)[late].min() < -0.1
    assert lowest(lifted)[late].min() > -1e-12
    np.testing.assert_allclose(lifted[0, :6], fallen[:6], atol=1e-12)
    np.testing.assert_allclose(lifted[0, 6:9], fallen[6:9], atol=1e-4)  # differences
    np.testing.assert_array_equal(lifted[-1], states[-1])

    high = carried(level_state(HOPPER, 0.3), release, 1.5, times)
    assert off_the_floor(HOPPER, high, times) is high


def test_kicks_have_the_sizes_asked_for_and_leave_the_pose():
    rng, state = np.random.default_rng(5), np.arange(12.0)
    kicks = Kicks(velocity_m_s=0.05, angular_velocity_rad_s=0.25)
    change = np.array([kicked(state, kicks, rng) - state for _ in range(4000)])
    np.testing.assert_array_equal(change[:, :6], 0)
    np.testing.assert_allclose(change[:, 6:9].std(axis=0), 0.05, rtol=0.05)
    np.testing.assert_allclose(change[:, 9:].std(axis=0), 0.25, rtol=0.05)


def test_the_same_generator_gives_the_same_trial():
    first, again, other = (
        run_trial(HOPPER, hops=20, rate_hz=100.0, rng=np.random.default_rng(seed))
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first.states, again.states)
    assert first.states.shape != other.states.shape or np.any(
        first.states != other.states
    )


def test_given_keys_replace_defaults_and_lists_become_tuples():
    markers = from_mapping(MarkerOptions, {"boom_m": [0.0, 0.0, 0.1]})
    assert markers.boom_m == (0.0, 0.0, 0.1)
    assert markers.retraction_s == MarkerOptions().retraction_s
    assert from_mapping(Kicks, None) == Kicks()


def test_a_misspelt_key_is_answered_with_the_nearest():
    with pytest.raises(
        ArgumentError, match=r"Kicks: .*'velocity_ms'; did you mean 'velocity_m_s'"
    ):
        from_mapping(Kicks, {"velocity_ms": 0.1})
