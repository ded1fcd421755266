"""Which files hold the same trial."""

import itertools

import numpy as np
import pytest
from made_up_hopper import MARKERS, hopping

from hopdata.recordings.readers.formats import read_raw
from hopdata.recordings.same_trial import (
    OTHER,
    PROCESSED,
    THE_SAME,
    agreement,
    compared_markers,
)


def compared(one, other, names=MARKERS, rate_hz=100.0):
    return agreement((MARKERS, names), (one, other), (100.0, rate_hz))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_another_unit_other_axes_and_fewer_digits_are_the_same_trial(seed):
    positions = hopping(seed, n_frames=500)[1]
    turned = np.round(1e3 * positions[..., [1, 2, 0]], 1)
    assert compared(positions, turned) == THE_SAME
    assert compared(positions, turned[40:-100]) == THE_SAME
    assert compared(turned[40:-100], positions) == THE_SAME
    with_gap = turned.copy()
    with_gap[100:200, 3] = np.nan
    assert compared(positions, with_gap) == THE_SAME


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_filtered_trial_is_the_same_trial_processed(seed):
    from scipy.signal import butter, sosfiltfilt

    positions = hopping(seed, n_frames=500)[1]
    filtered = sosfiltfilt(butter(2, 12, fs=100, output="sos"), positions, axis=0)
    assert compared(positions, filtered) == PROCESSED


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_other_trials_of_the_same_subject_are_others(seed):
    positions = hopping(seed, n_frames=500)[1]
    other = hopping(seed + 10, n_frames=500)[1]
    assert compared(positions, other) == OTHER
    assert compared(positions, other[40:-100]) == OTHER
    # So are two ends of one recording, other rates and other markers.
    assert compared(positions[:250], positions[250:]) == OTHER
    assert compared(positions, positions, rate_hz=200.0) == OTHER
    assert compared(positions, positions, names=tuple("abcdefg")) == OTHER


def test_two_static_trials_are_two():
    rng = np.random.default_rng(1)
    standing = np.repeat(hopping(1, n_frames=2)[1][:1], 300, axis=0)
    one, other = standing + rng.normal(0, 5e-4, (2, 300, 7, 3))
    assert compared(one, other) == OTHER
    assert compared(one, np.round(1e3 * one, 4)) == THE_SAME


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(("start", "frames"), [(10, 60), (200, 100), (420, 80)])
def test_a_short_piece_of_a_trial_is_no_trial_of_its_own(seed, start, frames):
    positions = hopping(seed, n_frames=500)[1]
    piece = positions[start : start + frames]
    assert compared(positions, piece) == THE_SAME
    assert compared(piece, np.round(1e3 * positions[..., [1, 2, 0]], 1)) == THE_SAME
    other = hopping(seed + 10, n_frames=500)[1]
    assert compared(other, piece) == OTHER


def test_a_short_filtered_piece_is_not_told_from_other_strides():
    from scipy.signal import butter, sosfiltfilt

    positions = hopping(1, n_frames=500)[1]
    filtered = sosfiltfilt(butter(2, 12, fs=100, output="sos"), positions, axis=0)
    assert compared(positions, filtered[100:200]) == OTHER


# Steps of one runner: the same body and the same movement, 27 times.

RUNNER_HZ = 150.0


@pytest.fixture(scope="module")
def steps(external_recording):
    """Return names, and the positions of a runner's steps, 0.9 s each, m."""
    raw = read_raw(external_recording)
    kept = compared_markers(raw.markers)
    names = [raw.markers[m] for m in kept]
    positions = raw.positions[:, kept]
    # A stride begins where the markers are as in the first one, about 0.7 s apart.
    flat = np.nan_to_num(positions).reshape(len(positions), -1)
    flat = flat - flat.mean(axis=0)
    n_frames = 135
    apart = np.array(
        [
            np.sum((flat[k : k + n_frames] - flat[200 : 200 + n_frames]) ** 2)
            for k in range(len(flat) - n_frames)
        ]
    )
    begins = [
        k
        for k in range(40, len(apart) - 40)
        if apart[k] == apart[k - 40 : k + 40].min()
    ]
    return names, [positions[k : k + n_frames] for k in begins]


def test_two_steps_of_one_runner_are_two_trials(steps):
    names, tracks = steps
    assert len(tracks) > 25
    agree = [
        agreement((names, names), pair, (RUNNER_HZ, RUNNER_HZ))
        for pair in itertools.combinations(tracks[:16], 2)
    ]
    assert set(agree) == {OTHER}


@pytest.mark.parametrize("which", [0, 7, 14])
def test_a_step_that_was_processed_is_the_same_trial(steps, which):
    from scipy.signal import butter, sosfiltfilt

    names, tracks = steps
    step = tracks[which]
    at = np.arange(len(step))
    filled = step.copy()
    for m, axis in np.ndindex(step.shape[1:]):
        seen = np.isfinite(step[:, m, axis])
        filled[:, m, axis] = np.interp(at, at[seen], step[seen, m, axis])
    smooth = sosfiltfilt(butter(2, 6, fs=RUNNER_HZ, output="sos"), filled, axis=0)
    turned = 1e-3 * smooth[..., [0, 2, 1]] * [1, 1, -1]
    with_gaps = step.copy()
    with_gaps[20:32, 3] = np.nan
    with_gaps[70:90, 8] = np.nan
    at_rate = (RUNNER_HZ, RUNNER_HZ)
    assert agreement((names, names), (step, smooth), at_rate) == PROCESSED
    assert agreement((names, names), (with_gaps, turned), at_rate) == PROCESSED
    assert agreement((names, names), (step, turned[15:-15]), at_rate) == PROCESSED
    few = names[::2]
    assert agreement((names, few), (step, smooth[:, ::2]), at_rate) == PROCESSED
    halved = (RUNNER_HZ, RUNNER_HZ / 2)
    assert agreement((names, names), (step, smooth[::2]), halved) == PROCESSED
