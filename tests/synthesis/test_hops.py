"""Single hops: the drop test, and what a hop reports about its contacts."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from hopdata.errors import AnalysisError
from hopdata.recordings.readers.hdf5 import write_recording
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.scene import Control
from hopdata.synthesis import simulate_recording
from hopdata.synthesis.hops import (
    control_hop,
    fly_hop,
    led_to,
    level_state,
    pose_rate,
    rebound,
    rest_foot,
)
from hopdata.synthesis.trial import Kicks, Operator, run_trial

HOPPER = HopperParameters()
HOP_HEIGHT_M = 0.24


def test_a_dropped_hopper_keeps_its_energy_through_the_landing():
    """This is the dissertation's drop test (section 2.2.1): preloaded legs, no energy added."""
    passive = replace(HOPPER, release_extension_m=0.0)
    assert rebound(passive, HOP_HEIGHT_M) > 0.40
    assert rebound(passive, HOP_HEIGHT_M) == pytest.approx(0.489, abs=0.002)
    deadbeat = replace(passive, damping_n_s_m=30.0)
    assert rebound(deadbeat, HOP_HEIGHT_M) < 0.40


def test_a_drop_that_ends_in_no_apex_is_refused():
    soft = replace(HOPPER, stiffness_n_m=1.0, preload_n=0.0)
    with pytest.raises(AnalysisError, match=r"drop from 0.24 m: .* no apex in time"):
        rebound(soft, HOP_HEIGHT_M)


def test_a_scene_whose_guards_have_other_names_is_told_them(monkeypatch):
    named = SimpleNamespace(guard_names=("leg1", "apex", "fallen"))
    monkeypatch.setattr(HopperParameters, "system", lambda *_: named)
    with pytest.raises(
        AnalysisError, match=r"expected foot1, foot2, .* found .*'leg1'"
    ):
        fly_hop(HOPPER, level_state(HOPPER, HOP_HEIGHT_M))


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
    gaps = [
        rest_foot(HOPPER, hop.event_state[k], leg)[2] for leg, k in enumerate(first)
    ]
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
    hop = fly_hop(
        weak, level_state(weak, 0.01), frame_times_s=np.arange(100) / 100, limit_s=1.0
    )
    assert hop.ending == "no apex in time"
    assert hop.fell
    assert hop.end_time_s == 1.0
    assert len(hop.states) == 100


def test_a_hopper_set_down_on_its_preload_is_stuck_and_one_let_go_above_is_not():
    unreleased = replace(HOPPER, release_extension_m=0.0)
    assert fly_hop(unreleased, level_state(unreleased, 0.0)).ending == "stuck"
    assert fly_hop(unreleased, level_state(unreleased, 1e-6)).ending == "apex"


# Hops of a control stay within the hopper's gait, and the recording stays continuous.

CONTROL_HOPS_HOPPER = HopperParameters()
FINE = np.arange(20_000) / 10_000
KINDS = {"coupling": 0.4, "impulse": 0.3, "delay_s": 0.005}
CLEAN = {
    "noise_m": 0.0,
    "resolution_m": 0.0,
    "floor": {"bowl_depth_m": 0.0, "waves": 0},
}


def gait_and_control(**strength):
    start = level_state(CONTROL_HOPS_HOPPER, 0.24)
    start[3:6], start[6:12] = [0.5, 0.02, -0.03], [0.1, -0.05, 0.0, 0.2, -0.3, 0.1]
    gait = fly_hop(
        CONTROL_HOPS_HOPPER, start, limit_s=2.0
    )  # steps follow from the whole span
    control = Control(**strength)
    hop = control_hop(
        CONTROL_HOPS_HOPPER, control, gait, frame_times_s=FINE, limit_s=2.0
    )
    return (
        gait,
        hop,
        fly_hop(
            CONTROL_HOPS_HOPPER, start, variant=control, frame_times_s=FINE, limit_s=2.0
        ),
    )


@pytest.mark.parametrize("kind", KINDS)
def test_a_control_is_led_into_the_next_apex_of_the_gait_and_lands_as_it_does(kind):
    gait, hop, free = gait_and_control(**{kind: KINDS[kind]})
    assert np.abs(free.end_state - gait.end_state).max() > 1e-3
    np.testing.assert_array_equal(hop.end_state, gait.end_state)
    np.testing.assert_array_equal(hop.event_state, free.event_state)
    assert (hop.end_time_s, hop.ending) == (free.end_time_s, "apex")
    landed = FINE[: len(hop.states)] <= hop.event_time[-1]
    np.testing.assert_array_equal(hop.states[landed], free.states[landed])
    left = hop.end_time_s - FINE[len(hop.states) - 1]
    arrived = hop.states[-1, :6] + left * pose_rate(gait.end_state)
    np.testing.assert_allclose(arrived, gait.end_state[:6], rtol=0, atol=1e-7)


def test_the_way_there_has_no_jump_in_place_speed_or_acceleration():
    gait, hop, free = gait_and_control(coupling=0.4)
    flying = FINE[: len(hop.states)] >= hop.event_time[-1]
    pose, dt = hop.states[flying][:, :6], FINE[1]
    added = pose - free.states[flying][:, :6]
    assert np.abs(added[0]).max() < 1e-9
    bend = np.abs(np.diff(added, 2, axis=0))
    assert np.all(bend[[0, -1]] < 0.02 * bend.max(axis=0))
    np.testing.assert_allclose(
        np.gradient(pose[:, :3], dt, axis=0)[1:-1],
        hop.states[flying][1:-1, 6:9],
        atol=2e-6,
    )
    rate = (3 * pose[-1] - 4 * pose[-2] + pose[-3]) / (2 * dt)
    np.testing.assert_allclose(rate, pose_rate(gait.end_state), atol=3e-3)


def test_a_hop_that_ends_where_the_gait_does_is_left_alone():
    gait, hop, _ = gait_and_control()
    times = FINE[: len(hop.states)]
    np.testing.assert_allclose(
        hop.states, led_to(hop, hop.end_state, times).states, atol=1e-15
    )
    np.testing.assert_array_equal(hop.event_time, gait.event_time)


@pytest.mark.parametrize("kind", KINDS)
def test_every_landing_begins_in_the_apex_of_the_same_hop_of_the_hopper(kind):
    plain, truth = (
        simulate_recording({"hops": 60, "control": control}, seed=5)[1]
        for control in ({}, {kind: KINDS[kind]})
    )
    np.testing.assert_array_equal(truth.apex_states, plain.apex_states)
    np.testing.assert_array_equal(truth.preloads_n, plain.preloads_n)
    assert truth.complete.all()
    before = plain.contact_times.min(axis=1) - plain.apex_times
    found = truth.contact_times.min(axis=1) - truth.apex_times
    runs_ahead = KINDS["delay_s"] if kind == "delay_s" else 0.0
    np.testing.assert_allclose(
        found, before - runs_ahead, rtol=0, atol=1e-3 if runs_ahead else 1e-12
    )
    assert (
        np.abs(np.diff(truth.contact_times - plain.contact_times, axis=1)).max() > 1e-4
    )


@pytest.mark.parametrize("kind", KINDS)
def test_the_recording_of_a_control_is_continuous(kind):
    camera = {**CLEAN, "rate_hz": 1000.0}
    recording, truth = simulate_recording(
        {"hops": 40, "control": {kind: KINDS[kind]}}, camera, seed=5
    )
    assert np.abs(np.diff(recording.body, axis=0)).max() < 0.0045, "4.5 m/s"
    assert np.abs(np.diff(recording.feet[..., 2], axis=0)).max() < 0.005
    down = truth.foot_down
    assert np.abs(recording.feet[..., 2][down]).max() < 1e-12
    assert recording.feet[..., 2][~down].min() > -1e-6


def test_with_a_delay_the_foot_meets_the_floor_where_the_guard_says():
    camera = {**CLEAN, "rate_hz": 2000.0}
    recording, truth = simulate_recording(
        {"hops": 12, "control": {"delay_s": 0.005}}, camera, seed=5
    )
    for landing in truth.contact_times:
        foot = landing.argmin()
        k = np.searchsorted(recording.time, landing[foot])
        height, time = recording.feet[k - 40 : k, foot, 2], recording.time[k - 40 : k]
        fall = np.polynomial.Polynomial.fit(time - landing[foot], height, 3)
        assert abs(fall(0.0)) < 1e-6


def test_a_control_that_falls_is_carried_to_the_next_apex_of_the_gait():
    wild = Kicks(angular_velocity_rad_s=0.6)
    plain, trial = (
        run_trial(
            CONTROL_HOPS_HOPPER, hops=150, rate_hz=100.0, rng=np.random.default_rng(3), kicks=wild,
            operator=Operator(), control=control,
        )
        for control in (None, Control(coupling=0.6))
    )  # fmt: skip
    lost = [
        k for k, hop in enumerate(trial.hops) if hop.fell and not plain.hops[k].fell
    ]
    assert 0 < len(lost) < 100
    assert trial.n_carries >= max(plain.n_carries, len(lost))
    for mine, its in zip(trial.hops, plain.hops, strict=True):
        np.testing.assert_array_equal(mine.start_state, its.start_state)
    assert np.abs(np.diff(trial.states[:, :3], axis=0)).max() < 0.045
    assert np.all(np.diff(trial.event_time) >= 0)


def test_at_strength_zero_a_recording_has_the_same_bytes_and_does_not_name_a_control(
    tmp_path,
):
    files = [tmp_path / "plain.h5", tmp_path / "zero.h5"]
    for file, control in zip(files, ({}, dict.fromkeys(KINDS, 0.0)), strict=True):
        recording, truth = simulate_recording({"hops": 5, "control": control}, seed=5)
        write_recording(file, recording, truth=truth)
        assert "control" not in json.loads(truth.parameters_json)["simulation"]
    assert files[0].read_bytes() == files[1].read_bytes()
