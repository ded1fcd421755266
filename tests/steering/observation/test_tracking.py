import numpy as np
import pytest
from steered_hopper import rms, steered

from hopdata.errors import AnalysisError
from hopdata.steering.observation.calibration import calibrate
from hopdata.steering.observation.motion import hopper_motion
from hopdata.steering.observation.tracking import (
    LEANED,
    MISFIT,
    SEEN,
    UNSEEN,
    HopperTracker,
    observe_frame,
)
from hopdata.steering.se2 import wrapped


@pytest.fixture(scope="module")
def hopper():
    return steered()


@pytest.fixture(scope="module")
def geometry(hopper):
    return calibrate(hopper.recording)


def feed_all(tracker, recording):
    return [
        tracker.feed(t, frame) for t, frame in zip(recording.time, recording.positions, strict=True)
    ]


def test_frame_by_frame_is_what_the_whole_recording_gives(hopper, geometry):
    recording = hopper.recording
    motion = hopper_motion(recording, geometry)
    found = feed_all(HopperTracker(geometry, recording.markers), recording)
    np.testing.assert_allclose([f.pose for f in found], motion.pose, atol=1e-9)
    np.testing.assert_allclose([f.height_m for f in found], motion.height, atol=1e-12)
    np.testing.assert_allclose([f.residual_m for f in found], motion.residual, atol=1e-12)
    angles = np.array([f.boom_angle_rad for f in found])
    np.testing.assert_allclose(wrapped(angles - motion.boom_angle_rad), 0, atol=1e-9)


def test_a_tracker_is_right_about_the_hopper(hopper, geometry):
    found = feed_all(HopperTracker(geometry, hopper.recording.markers), hopper.recording)
    assert {f.status for f in found} == {SEEN}
    heading = np.array([f.pose[2] for f in found])
    assert rms(wrapped(heading - hopper.yaw)) < 0.00264
    boom = np.array([f.boom_angle_rad for f in found])
    assert rms(wrapped(boom - hopper.boom_angle)) < 0.005
    assert np.abs(np.diff(heading)).max() < 0.5


def test_markers_may_come_in_any_order(hopper, geometry):
    recording = hopper.recording
    order = np.arange(len(recording.markers))[::-1]
    names = [recording.markers[k] for k in order]
    straight = HopperTracker(geometry, recording.markers).feed(0.0, recording.positions[0])
    mixed = HopperTracker(geometry, names).feed(0.0, recording.positions[0, order])
    np.testing.assert_array_equal(straight.pose, mixed.pose)
    assert straight.boom_angle_rad == mixed.boom_angle_rad


def test_a_stream_without_a_marker_is_refused(geometry):
    with pytest.raises(AnalysisError, match="body2"):
        HopperTracker(geometry, ["body1", "body3", "boom"])


def test_two_markers_lean_on_a_recent_frame_only(hopper, geometry):
    recording = hopper.recording
    tracker = HopperTracker(geometry, recording.markers, hold_s=0.05)
    tracker.feed(0.0, recording.positions[0])
    hidden = recording.positions[:10].copy()
    hidden[:, 1] = np.nan
    found = [tracker.feed(k / 100, hidden[k]) for k in range(1, 10)]
    assert [f.status for f in found] == [LEANED] * 5 + [UNSEEN] * 4
    error = [wrapped(f.pose[2] - hopper.yaw[k + 1]) for k, f in enumerate(found[:5])]
    assert np.abs(error).max() < 0.015
    assert np.isnan(found[-1].pose).all()
    assert tracker.counts == {SEEN: 1, LEANED: 5, MISFIT: 0, UNSEEN: 4}


def test_exchanged_markers_are_a_misfit_and_give_no_pose(hopper, geometry):
    body = hopper.recording.body[5]
    found = observe_frame(geometry, body[[1, 0, 2]])
    assert found.status == MISFIT
    assert found.residual_m > 0.005
    assert not found.known
    assert np.isnan(found.pose).all()
    assert np.isnan(found.height_m)


def test_one_marker_is_nothing(hopper, geometry):
    body = np.full((3, 3), np.nan)
    body[0] = hopper.recording.body[5, 0]
    found = observe_frame(geometry, body, earlier=np.eye(3))
    assert found.status == UNSEEN
    assert np.isnan(found.residual_m)


@pytest.mark.parametrize("boom", [np.full(3, np.nan), np.array([1.0, 1.0, 1.0]), None])
def test_a_boom_marker_that_is_hidden_or_elsewhere_has_no_angle(hopper, geometry, boom):
    found = observe_frame(geometry, hopper.recording.body[5], boom)
    assert found.known
    assert np.isnan(found.boom_angle_rad)


def test_headings_count_turns(hopper, geometry):
    tracker = HopperTracker(geometry, hopper.recording.markers)
    start = hopper.recording.positions[0]
    total = [
        tracker.feed(k / 100, start @ turn(angle).T).pose[2]
        for k, angle in enumerate(np.arange(0, 20, 0.5))
    ]
    np.testing.assert_allclose(np.diff(total), 0.5, atol=1e-9)


def turn(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
