from dataclasses import replace

import numpy as np
import pytest
from steered_hopper import rms, steered

from hopdata.rigid import wrapped
from hopdata.steering.observation.calibration import calibrate
from hopdata.steering.observation.observe import observe_stances, stance_states
from hopdata.steering.observation.stances import find_stances
from hopdata.steering.observation.tracking import hopper_motion


@pytest.fixture(scope="module")
def hopper():
    return steered()


@pytest.fixture(scope="module")
def motion(hopper):
    return hopper_motion(hopper.recording, calibrate(hopper.recording))


@pytest.fixture(scope="module")
def stances(motion):
    return find_stances(motion.time, motion.height)


def truth(hopper, at):
    yaw = np.interp(at, hopper.recording.time, np.unwrap(hopper.yaw))
    return np.interp(at, hopper.recording.time, hopper.middle[:, 0]), yaw


def test_poses_at_stances_are_better_than_those_of_single_frames(hopper, motion, stances):
    states = stance_states(motion, stances)
    x, yaw = truth(hopper, stances.time_s)
    assert rms(states.pose[:, 0] - x) < 0.0003
    assert rms(wrapped(states.pose[:, 2] - yaw)) < 0.0018


def test_the_boom_angle_is_the_median_of_the_frames_that_follow(hopper, motion, stances):
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
