import numpy as np
import pytest

import hopdata as hd
from hopdata.landings.held_frames import without_held_frames


def moving(n_frames=400, noise_m=3e-4):
    """Return a recording of three body markers and a foot that swing."""
    rng = np.random.default_rng(7)
    time = np.arange(n_frames) / 100
    swing = 0.1 * np.sin(2 * np.pi * 1.5 * time)
    positions = np.zeros((n_frames, 4, 3))
    positions[:, :3, 2] = 0.5
    positions[:, :3, :2] = [[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]]
    positions[:, :, 2] += swing[:, None]
    positions += noise_m * rng.standard_normal(positions.shape)
    return hd.Recording.from_arrays(
        time, positions, ["a", "b", "c", "toe"], feet=["toe"], body=["a", "b", "c"]
    )


@pytest.mark.parametrize("held", [1, 3, 100])
def test_frames_that_repeat_the_last_one_are_unseen(held):
    recording = moving()
    recording.positions[150 : 150 + held] = recording.positions[149]
    found = without_held_frames(recording)
    unseen = np.isnan(found.positions).all(axis=(1, 2))
    assert np.flatnonzero(unseen).tolist() == [*range(150, 150 + held)]
    kept = ~unseen
    assert np.array_equal(found.positions[kept], recording.positions[kept])
    assert np.isfinite(recording.positions).all()  # that of the caller stays


def test_a_hidden_marker_does_not_hide_that_the_others_are_held():
    recording = moving()
    recording.positions[100:300, 0] = np.nan
    recording.positions[150:160] = recording.positions[149]
    unseen = np.isnan(without_held_frames(recording).positions).all(axis=(1, 2))
    assert np.flatnonzero(unseen).tolist() == [*range(150, 160)]


def test_measured_frames_stay():
    recording = moving()
    assert without_held_frames(recording) is recording
    # One marker that is held is no system that has lost its cameras.
    recording.positions[150:160, 0] = recording.positions[149, 0]
    assert without_held_frames(recording) is recording


def test_a_file_of_whole_millimetres_that_stands_still_stays():
    recording = moving(noise_m=0.0)
    recording.positions[100:300] = recording.positions[100]
    coarse = np.round(recording.positions + 2e-4, 3)
    coarse[99] = coarse[100]  # it comes to rest, as bodies do
    coarse[300] = coarse[299]
    recording.positions[:] = coarse
    assert without_held_frames(recording) is recording


def test_a_file_that_was_made_by_holding_stays():
    recording = moving()
    recording.positions[1::3] = recording.positions[0::3][
        : len(recording.positions[1::3])
    ]
    assert without_held_frames(recording) is recording
