import numpy as np
from pose import about_constant, phasor_poses, printed_boom_angles, printed_stance_pairs, twists
from steered_hopper import as_landings, heights, rms, steered, true_pairs

from hopdata.rigid import wrapped
from hopdata.scenes.body import rotation_matrices
from hopdata.synthesis.trial import MarkerOptions

BODY = np.array(MarkerOptions().body_m)


def turning(yaw, pitch=0.0):
    angles = np.column_stack([yaw, np.full(len(yaw), pitch), np.zeros(len(yaw))])
    return np.array([1.0, 2.0, 0.5]) + np.einsum("nij,bj->nbi", rotation_matrices(angles), BODY)


def test_a_level_body_is_followed_over_several_turns():
    yaw = np.linspace(0, 15, 300)
    poses = phasor_poses(turning(yaw))
    np.testing.assert_allclose(np.diff(poses[:, 2]), np.diff(yaw), atol=1e-12)


def test_the_pose_is_the_mean_marker():
    body = turning(np.linspace(0, 1, 10))
    np.testing.assert_allclose(phasor_poses(body)[:, :2], body[:, :, :2].mean(axis=1), atol=1e-15)


def test_zero_is_the_direction_to_the_first_marker():
    toward = BODY[0, :2] - BODY[:, :2].mean(axis=0)
    expected = np.arctan2(toward[1], toward[0])
    np.testing.assert_allclose(phasor_poses(turning(np.zeros(3)))[:, 2], expected, atol=1e-12)


def test_frames_with_unseen_markers_are_unknown_and_do_not_disturb_the_others():
    body = turning(np.linspace(0, 15, 300))
    whole = phasor_poses(body)
    body[100:110, 1] = np.nan
    holed = phasor_poses(body)
    assert np.isnan(holed[100:110]).all()
    np.testing.assert_allclose(
        np.delete(holed, slice(100, 110), 0)[:, :2], np.delete(whole, slice(100, 110), 0)[:, :2]
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


def test_the_printed_boom_angle_is_right_up_to_zero_and_sense():
    hopper = steered()
    recording = hopper.recording
    still = np.repeat(recording.positions[:1], 40, axis=0)
    positions = np.concatenate([still, recording.positions])
    printed = printed_boom_angles(positions[:, :3], positions[:, -1])[40:]
    errors = [rms(about_constant(sign * printed - hopper.boom_angle)) for sign in (1, -1)]
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
    assert printed_stance_pairs(heights(steered()), extrema_of="speed").shape == (0, 2)


def test_the_twist_is_off_by_half_of_pitch_times_roll():
    angles = np.array([[0.7, 0.02, 0.03], [0.7, -0.02, 0.03]])
    error = twists(rotation_matrices(angles)) - 0.7
    np.testing.assert_allclose(error, -0.5 * angles[:, 1] * angles[:, 2], atol=1e-6)
