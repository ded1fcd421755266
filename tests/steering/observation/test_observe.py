from dataclasses import replace

import numpy as np
import pytest
from steered_hopper import as_landings, heights, rms, steered, true_pairs

from hopdata.rigid import wrapped
from hopdata.scenes.body import rotation_matrices
from hopdata.steering.observation.calibration import calibrate
from hopdata.steering.observation.observe import (
    observe_recordings,
    observe_stances,
    phasor_poses,
    printed_boom_angles,
    printed_stance_pairs,
    stance_states,
)
from hopdata.steering.observation.stances import find_stances
from hopdata.steering.observation.tracking import hopper_motion
from hopdata.synthesis.trial import MarkerOptions


@pytest.fixture(scope="module")
def hopper():
    return steered()


@pytest.fixture(scope="module")
def geometry(hopper):
    return calibrate(hopper.recording)


@pytest.fixture(scope="module")
def motion(hopper, geometry):
    return hopper_motion(hopper.recording, geometry)


@pytest.fixture(scope="module")
def stances(motion, geometry):
    return find_stances(motion.time, motion.height, geometry)


def truth(hopper, at):
    yaw = np.interp(at, hopper.recording.time, np.unwrap(hopper.yaw))
    return np.interp(at, hopper.recording.time, hopper.middle[:, 0]), yaw


def test_poses_at_stances_are_better_than_those_of_single_frames(
    hopper, motion, stances
):
    states = stance_states(motion, stances)
    x, yaw = truth(hopper, stances.time_s)
    assert rms(states.pose[:, 0] - x) < 0.0003
    assert rms(wrapped(states.pose[:, 2] - yaw)) < 0.0018


def test_the_boom_angle_is_the_median_of_the_frames_that_follow(
    hopper, motion, stances
):
    states = stance_states(motion, stances)
    for k in (0, 7, 30):
        following = motion.boom_angle_rad[stances.frame[k] + 1 : stances.frame[k] + 12]
        assert states.boom_angle_rad[k] == np.median(following)
    true = hopper.boom_angle[stances.frame]
    assert rms(wrapped(states.boom_angle_rad - true)) < 0.002


def test_swings_between_stances_are_those_commanded(motion, stances):
    states = stance_states(motion, stances)
    first, last = states.pairs.T
    swing = states.boom_angle_rad[last] - states.boom_angle_rad[first]
    np.testing.assert_allclose(np.abs(swing), np.deg2rad(67.5), atol=0.008)


def test_a_boom_that_is_hidden_has_no_angle(motion, stances):
    angle = motion.boom_angle_rad.copy()
    begin = stances.frame[4]
    angle[begin + 1 : begin + 10] = np.nan
    states = stance_states(replace(motion, boom_angle_rad=angle), stances)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(states.boom_angle_rad)), [4])


def test_one_call_does_it_all(hopper, motion, stances):
    states = observe_stances(hopper.recording, calibrate(hopper.recording))
    np.testing.assert_allclose(states.time_s, stances.time_s, atol=1e-9)
    np.testing.assert_array_equal(states.pairs, stances.pairs)


# Printed observation.

BODY = np.array(MarkerOptions().body_m)


def turning(yaw, pitch=0.0):
    angles = np.column_stack([yaw, np.full(len(yaw), pitch), np.zeros(len(yaw))])
    return np.array([1.0, 2.0, 0.5]) + np.einsum(
        "nij,bj->nbi", rotation_matrices(angles), BODY
    )


def test_a_level_body_is_followed_over_several_turns():
    yaw = np.linspace(0, 15, 300)
    poses = phasor_poses(turning(yaw))
    np.testing.assert_allclose(np.diff(poses[:, 2]), np.diff(yaw), atol=1e-12)


def test_the_pose_is_the_mean_marker():
    body = turning(np.linspace(0, 1, 10))
    np.testing.assert_allclose(
        phasor_poses(body)[:, :2], body[:, :, :2].mean(axis=1), atol=1e-15
    )


def test_zero_is_the_direction_to_the_first_marker():
    toward = BODY[0, :2] - BODY[:, :2].mean(axis=0)
    expected = np.arctan2(toward[1], toward[0])
    np.testing.assert_allclose(
        phasor_poses(turning(np.zeros(3)))[:, 2], expected, atol=1e-12
    )


def test_frames_with_unseen_markers_are_unknown_and_do_not_disturb_the_others():
    body = turning(np.linspace(0, 15, 300))
    whole = phasor_poses(body)
    body[100:110, 1] = np.nan
    holed = phasor_poses(body)
    assert np.isnan(holed[100:110]).all()
    np.testing.assert_allclose(
        np.delete(holed, slice(100, 110), 0)[:, :2],
        np.delete(whole, slice(100, 110), 0)[:, :2],
    )
    turn = holed[[99, 110], 2] - holed[0, 2]
    np.testing.assert_allclose(turn, whole[[99, 110], 2] - whole[0, 2], atol=1e-9)


def test_noise_without_tilt_is_that_of_the_arms():
    rng = np.random.default_rng(np.random.SeedSequence(1))
    yaw = rng.uniform(-3, 3, 20000)
    body = turning(yaw)
    noisy = body + 0.0006 * rng.standard_normal(body.shape)
    error = wrapped(phasor_poses(noisy)[:, 2] - phasor_poses(body)[:, 2])
    arms = np.linalg.norm((BODY - BODY.mean(axis=0))[:, :2], axis=1)
    expected = 0.0006 * np.sqrt(np.sum(arms**-2.0)) / 3
    assert abs(rms(error) / expected - 1) < 0.03


def test_a_tilt_turns_the_heading_as_a_known_flaw():
    yaw = np.zeros(8)
    level, leaning = phasor_poses(turning(yaw)), phasor_poses(turning(yaw, pitch=0.15))
    assert 0.001 < abs(leaning[0, 2] - level[0, 2]) < 0.02


def test_poses_of_the_hopper_follow_the_truth():
    hopper = steered()
    poses = phasor_poses(hopper.recording.body)
    error = wrapped(poses[:, 2] - hopper.yaw)
    assert rms(error - np.median(error)) < 0.01
    assert rms(poses[:, :2] - hopper.middle[:, :2]) < 0.0006


def about_constant(error):
    return wrapped(error - np.angle(np.mean(np.exp(1j * error))))


def test_the_printed_boom_angle_is_right_up_to_zero_and_sense():
    hopper = steered()
    recording = hopper.recording
    still = np.repeat(recording.positions[:1], 40, axis=0)
    positions = np.concatenate([still, recording.positions])
    printed = printed_boom_angles(positions[:, :3], positions[:, -1])[40:]
    errors = [
        rms(about_constant(sign * printed - hopper.boom_angle)) for sign in (1, -1)
    ]
    assert min(errors) < 0.02
    assert max(errors) > 0.2


def test_the_printed_pairs_are_true_ones_but_not_all():
    hopper = steered()
    z = heights(hopper)
    instants = hopper.recording.time[printed_stance_pairs(z)]
    pairs = as_landings(instants, hopper)
    true = {tuple(pair) for pair in true_pairs(hopper).tolist()}
    assert {tuple(pair) for pair in pairs.tolist()} <= true
    assert len(pairs) > 0.5 * len(true)


def test_taken_literally_the_printed_algorithm_finds_none():
    assert printed_stance_pairs(heights(steered()), derivative=2).shape == (0, 2)


def test_printed_and_corrected_tell_nearly_the_same_hops(hopper):
    options = {"swing_limit_rad": np.pi / 2}
    seen, printed = (
        observe_recordings(
            [hopper.recording], observation=one, **options
        ).changes.used()
        for one in ("corrected", "printed")
    )
    assert len(printed) > 0.5 * len(seen)
    gaps = np.abs(seen.time_s - printed.time_s[:, None])
    like = seen.rows(gaps.argmin(axis=1))
    assert gaps.min(axis=1).max() < 0.05
    apart = printed.change - like.change
    assert np.median(np.abs(apart[:, :2])) < 0.01
    assert np.median(np.abs(apart[:, 2])) < 0.03
    assert (
        np.median(np.abs(wrapped(printed.boom_angle_rad - like.boom_angle_rad))) < 0.02
    )
    assert (apart != 0).all()
