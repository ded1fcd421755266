from dataclasses import replace

import numpy as np
import pytest
from steered_hopper import rms, steered

from hopdata.steering.observation.calibration import calibrate
from hopdata.steering.observation.motion import hopper_motion
from hopdata.steering.observation.printed_boom import printed_boom_angles
from hopdata.steering.observation.tracking import LEANED, MISFIT, SEEN, UNSEEN
from hopdata.steering.se2 import wrapped


def about_constant(error):
    return wrapped(error - np.angle(np.mean(np.exp(1j * error))))


@pytest.fixture(scope="module")
def hopper():
    return steered()


def gappy(recording, share, seed=1):
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    positions = recording.positions.copy()
    positions[rng.random(positions.shape[:2]) < share] = np.nan
    return replace(recording, positions=positions)


def test_every_frame_has_a_status_and_only_known_ones_a_pose(hopper):
    recording = gappy(hopper.recording, 0.1)
    positions = recording.positions.copy()
    positions[50, [0, 1]] = hopper.recording.positions[50, [1, 0]]
    recording = replace(recording, positions=positions)
    motion = hopper_motion(recording, calibrate(hopper.recording), hold_s=0.2)
    seen = np.isfinite(recording.body).all(axis=2).sum(axis=1)
    assert motion.counts[UNSEEN] == np.sum(seen < 2)
    assert motion.counts[MISFIT] == 1
    assert motion.counts[SEEN] == np.sum(seen == 3) - 1
    assert sum(motion.counts.values()) == len(recording.time)
    known = (motion.status == SEEN) | (motion.status == LEANED)
    np.testing.assert_array_equal(np.isfinite(motion.pose).all(axis=1), known)
    np.testing.assert_array_equal(np.isfinite(motion.height), known)


def test_hidden_markers_cost_little(hopper):
    geometry = calibrate(hopper.recording)
    motion = hopper_motion(gappy(hopper.recording, 0.05), geometry)
    leaned = motion.status == LEANED
    assert leaned.sum() > 100
    assert rms(wrapped(motion.pose[leaned, 2] - hopper.yaw[leaned])) < 0.005
    assert rms(motion.pose[leaned, :2] - hopper.middle[leaned, :2]) < 0.001


def test_a_frame_far_from_others_is_not_leaned_on(hopper):
    recording = hopper.recording.part(slice(0, 60))
    positions = recording.positions.copy()
    positions[10:, 0] = np.nan
    motion = hopper_motion(
        replace(recording, positions=positions), calibrate(hopper.recording), hold_s=0.1
    )
    np.testing.assert_array_equal(motion.status[:10], SEEN)
    np.testing.assert_array_equal(motion.status[10:20], LEANED)
    np.testing.assert_array_equal(motion.status[20:], UNSEEN)


def test_boom_angles_are_those_of_the_scene(hopper):
    motion = hopper_motion(hopper.recording, calibrate(hopper.recording))
    assert rms(wrapped(motion.boom_angle_rad - hopper.boom_angle)) < 0.004
    assert np.abs(np.diff(motion.boom_angle_rad)).max() < 0.2


def test_the_printed_boom_angle_is_right_up_to_zero_and_sense(hopper):
    recording = hopper.recording
    still = np.repeat(recording.positions[:1], 40, axis=0)
    positions = np.concatenate([still, recording.positions])
    printed = printed_boom_angles(positions[:, :3], positions[:, -1])[40:]
    errors = [rms(about_constant(sign * printed - hopper.boom_angle)) for sign in (1, -1)]
    assert min(errors) < 0.02
    assert max(errors) > 0.2
