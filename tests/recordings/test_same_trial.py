"""Which files hold the same trial."""

from itertools import combinations

import numpy as np
import pytest
from made_up_hopper import MARKERS, hopping

import hopdata as hd
from hopdata.recordings.same_trial import OTHER, PROCESSED, THE_SAME, agreement


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


@pytest.fixture(scope="module")
def steps(external_recording):
    """Return single steps of a runner, which begin at the same phase, without gaps."""
    runner = hd.read(external_recording)
    frames = np.arange(len(runner.time))
    tracks = runner.positions.reshape(len(frames), -1)
    for track in tracks.T:
        seen = np.isfinite(track)
        track[~seen] = np.interp(frames[~seen], frames[seen], track[seen])
    tracks = tracks.reshape(runner.positions.shape)
    height = tracks[:, runner.markers.index("R_heel"), 2]
    lowest = [n for n in frames[75:-90] if height[n] == height[n - 40 : n + 40].min()]
    names = runner.markers
    return names, [tracks[n - 52 : n + 83] for n in lowest][:9]


def test_two_steps_of_a_runner_are_two_trials(steps):
    names, tracks = steps
    rates = (150.0, 150.0)
    assert len(tracks) == 9
    for one, other in combinations(tracks, 2):
        assert agreement((names, names), (one, other), rates) == OTHER


@pytest.mark.parametrize("cutoff_hz", [6, 12])
def test_a_filtered_step_of_a_runner_is_the_same_step(steps, cutoff_hz):
    from scipy.signal import butter, sosfiltfilt

    names, tracks = steps
    rates = (150.0, 150.0)
    low_pass = butter(2, cutoff_hz, fs=150, output="sos")
    for one in tracks:
        filtered = 1e3 * sosfiltfilt(low_pass, one, axis=0)
        found = agreement((names, names), (one, filtered), rates)
        assert found in (PROCESSED, THE_SAME)


@pytest.mark.parametrize("which", [0, 4, 8])
def test_a_step_that_was_processed_is_the_same_step(steps, which):
    from scipy.signal import butter, sosfiltfilt

    names, tracks = steps
    step = tracks[which]
    smooth = sosfiltfilt(butter(2, 6, fs=150, output="sos"), step, axis=0)
    turned = 1e-3 * smooth[..., [0, 2, 1]] * [1, 1, -1]
    with_gaps = step.copy()
    with_gaps[20:32, 3] = np.nan
    with_gaps[70:90, 8] = np.nan
    rates = (150.0, 150.0)
    assert agreement((names, names), (with_gaps, turned), rates) == PROCESSED
    assert agreement((names, names), (step, turned[15:-15]), rates) == PROCESSED
    few = names[::2]
    assert agreement((names, few), (step, smooth[:, ::2]), rates) == PROCESSED
    slower = (150.0, 75.0)
    assert agreement((names, names), (step, smooth[::2]), slower) == PROCESSED
    # At another rate, another step is another step.
    other = tracks[which - 1]
    assert agreement((names, names), (other, smooth[::2]), slower) == OTHER
