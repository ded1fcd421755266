from dataclasses import replace

import numpy as np
import pytest
from steered_hopper import rms, steered

from hopdata.errors import AnalysisError
from hopdata.rigid import wrapped
from hopdata.steering.observation import tracking
from hopdata.steering.observation.calibration import calibrate
from hopdata.steering.observation.tracking import (
    LEANED,
    MISFIT,
    SEEN,
    UNSEEN,
    HopperTracker,
    hopper_motion,
    observe_frame,
)


@pytest.fixture(scope="module")
def hopper():
    return steered()


@pytest.fixture(scope="module")
def geometry(hopper):
    return calibrate(hopper.recording)


def feed_all(tracker, recording):
    return [
        tracker.feed(t, frame)
        for t, frame in zip(recording.time, recording.positions, strict=True)
    ]


def test_frame_by_frame_is_what_the_whole_recording_gives(hopper, geometry):
    recording = hopper.recording
    motion = hopper_motion(recording, geometry)
    found = feed_all(HopperTracker(geometry, recording.markers), recording)
    np.testing.assert_allclose([f.pose for f in found], motion.pose, atol=1e-9)
    np.testing.assert_allclose([f.height_m for f in found], motion.height, atol=1e-12)
    np.testing.assert_allclose(
        [f.residual_m for f in found], motion.residual, atol=1e-12
    )
    angles = np.array([f.boom_angle_rad for f in found])
    np.testing.assert_allclose(wrapped(angles - motion.boom_angle_rad), 0, atol=1e-9)


def test_a_tracker_is_right_about_the_hopper(hopper, geometry):
    found = feed_all(
        HopperTracker(geometry, hopper.recording.markers), hopper.recording
    )
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
    straight = HopperTracker(geometry, recording.markers).feed(
        0.0, recording.positions[0]
    )
    mixed = HopperTracker(geometry, names).feed(0.0, recording.positions[0, order])
    np.testing.assert_array_equal(straight.pose, mixed.pose)
    assert straight.boom_angle_rad == mixed.boom_angle_rad


def test_a_stream_without_a_marker_is_refused(geometry):
    with pytest.raises(AnalysisError, match="body2"):
        HopperTracker(geometry, ["body1", "body3", "boom"])


def test_two_markers_lean_on_a_recent_frame_only(hopper, geometry, monkeypatch):
    monkeypatch.setattr(tracking, "HOLD_S", 0.05)
    recording = hopper.recording
    tracker = HopperTracker(geometry, recording.markers)
    tracker.feed(0.0, recording.positions[0])
    hidden = recording.positions[:10].copy()
    hidden[:, 1] = np.nan
    found = [tracker.feed(k / 100, hidden[k]) for k in range(1, 10)]
    assert [f.status for f in found] == [LEANED] * 5 + [UNSEEN] * 4
    error = [wrapped(f.pose[2] - hopper.yaw[k + 1]) for k, f in enumerate(found[:5])]
    assert np.abs(error).max() < 0.015
    assert np.isnan(found[-1].pose).all()


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


@pytest.fixture(scope="module")
def hopper_of_motion():
    return steered()


def gappy(recording, share, seed=1):
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    positions = recording.positions.copy()
    positions[rng.random(positions.shape[:2]) < share] = np.nan
    return replace(recording, positions=positions)


def test_every_frame_has_a_status_and_only_known_ones_a_pose(
    hopper_of_motion, monkeypatch
):
    monkeypatch.setattr(tracking, "HOLD_S", 0.2)
    recording = gappy(hopper_of_motion.recording, 0.1)
    positions = recording.positions.copy()
    positions[50, [0, 1]] = hopper_of_motion.recording.positions[50, [1, 0]]
    recording = replace(recording, positions=positions)
    motion = hopper_motion(recording, calibrate(hopper_of_motion.recording))
    seen = np.isfinite(recording.body).all(axis=2).sum(axis=1)
    assert motion.counts[UNSEEN] == np.sum(seen < 2)
    assert motion.counts[MISFIT] == 1
    assert motion.counts[SEEN] == np.sum(seen == 3) - 1
    assert sum(motion.counts.values()) == len(recording.time)
    known = (motion.status == SEEN) | (motion.status == LEANED)
    np.testing.assert_array_equal(np.isfinite(motion.pose).all(axis=1), known)
    np.testing.assert_array_equal(np.isfinite(motion.height), known)


def test_hidden_markers_cost_little(hopper_of_motion):
    geometry = calibrate(hopper_of_motion.recording)
    motion = hopper_motion(gappy(hopper_of_motion.recording, 0.05), geometry)
    leaned = motion.status == LEANED
    assert leaned.sum() > 100
    assert rms(wrapped(motion.pose[leaned, 2] - hopper_of_motion.yaw[leaned])) < 0.005
    assert rms(motion.pose[leaned, :2] - hopper_of_motion.middle[leaned, :2]) < 0.001


def test_a_frame_far_from_others_is_not_leaned_on(hopper_of_motion, monkeypatch):
    monkeypatch.setattr(tracking, "HOLD_S", 0.1)
    recording = hopper_of_motion.recording.part(slice(0, 60))
    positions = recording.positions.copy()
    positions[10:, 0] = np.nan
    motion = hopper_motion(
        replace(recording, positions=positions), calibrate(hopper_of_motion.recording)
    )
    np.testing.assert_array_equal(motion.status[:10], SEEN)
    np.testing.assert_array_equal(motion.status[10:20], LEANED)
    np.testing.assert_array_equal(motion.status[20:], UNSEEN)


def test_boom_angles_are_those_of_the_scene(hopper_of_motion):
    motion = hopper_motion(
        hopper_of_motion.recording, calibrate(hopper_of_motion.recording)
    )
    assert rms(wrapped(motion.boom_angle_rad - hopper_of_motion.boom_angle)) < 0.004
    assert np.abs(np.diff(motion.boom_angle_rad)).max() < 0.2
