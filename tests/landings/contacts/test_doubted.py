"""Frames that no camera saw: filled gaps and exchanged names."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PchipInterpolator

from hopdata.landings.contacts import doubted as module
from hopdata.landings.contacts.doubted import filled, spikes

RATE_HZ = 200.0
NOISE_M = 5e-4


def doubted(tracks, **options):
    return module.doubted(tracks, rate_hz=RATE_HZ, **options)


def exchanged(tracks, **options):
    return module.exchanged(tracks, rate_hz=RATE_HZ, **options)


def walking(frames=600, *, seed=0, markers=2, noise_m=NOISE_M):
    """Return markers (N, n, 3), m, on two feet that swing by half a metre in turn."""
    rng = np.random.default_rng(seed)
    t = np.arange(frames) / RATE_HZ
    tracks = np.zeros((frames, markers, 3))
    for m in range(markers):
        phase = 2 * np.pi * t + np.pi * m
        tracks[:, m] = np.stack(
            [0.25 * np.sin(phase), np.full(frames, 0.2 * m), 0.1 * np.cos(phase) ** 2],
            axis=1,
        )
    return tracks + rng.normal(0, noise_m, tracks.shape)


def straight(t, z):
    return lambda at: np.stack([np.interp(at, t, own) for own in z.T], axis=1)


@pytest.mark.parametrize("curve", [CubicSpline, PchipInterpolator, straight])
@pytest.mark.parametrize("gap", [4, 9, 30])
def test_frames_that_a_curve_put_into_a_gap_are_found(curve, gap):
    track = walking(seed=gap)[:, 0]
    hidden = np.zeros(len(track), dtype=bool)
    hidden[200 : 200 + gap] = True
    t = np.arange(len(track)) / RATE_HZ
    track[hidden] = curve(t[~hidden], track[~hidden])(t[hidden])
    np.testing.assert_array_equal(filled(track), hidden)


def test_frames_that_were_seen_are_kept():
    for seed in range(20):
        track = walking(seed=seed)[:, 0]
        track[100:120] = np.nan
        assert not filled(track).any()


def test_a_track_without_noise_or_of_a_body_that_never_moves_tells_nothing():
    assert not filled(walking(noise_m=0.0)[:, 0]).any()
    assert not filled(np.zeros((300, 3))).any()
    smooth = CubicSpline(np.arange(0, 600, 20), walking()[::20, 0])(np.arange(600))
    assert not filled(smooth).any()
    assert not filled(walking(4)[:, 0]).any()


@pytest.mark.parametrize("seed", range(5))
def test_exchanged_names_are_found_until_they_are_restored(seed):
    tracks = walking(seed=seed)
    assert not exchanged(tracks).any()
    expected = np.zeros(tracks.shape[:2], dtype=bool)
    for begin, end in ((130, 170), (330, 420)):
        tracks[begin:end] = tracks[begin:end, ::-1]
        expected[begin:end] = True
    np.testing.assert_array_equal(exchanged(tracks), expected)
    np.testing.assert_array_equal(doubted(tracks), expected)


@pytest.mark.parametrize(("at", "shorter"), [(130, (0, 130)), (430, (430, 600))])
def test_of_an_exchange_that_is_never_undone_the_shorter_part_is_marked(at, shorter):
    tracks = walking(seed=3)
    tracks[at:] = tracks[at:, ::-1]
    expected = np.zeros(tracks.shape[:2], dtype=bool)
    expected[slice(*shorter)] = True
    np.testing.assert_array_equal(exchanged(tracks), expected)


def test_the_size_of_the_animal_does_not_matter():
    tracks = walking(seed=1)
    tracks[200:240] = tracks[200:240, ::-1]
    hidden = doubted(tracks)
    assert hidden.any()
    np.testing.assert_array_equal(doubted(0.01 * tracks, scale=0.01), hidden)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("gap", [1, 5, 20])
@pytest.mark.parametrize("ends", [(0,), (1,), (0, 1)])
def test_names_that_are_exchanged_in_a_gap_are_found_from_there_on(seed, gap, ends):
    tracks = walking(seed=seed)
    tracks[300:360] = tracks[300:360, ::-1]
    expected = np.zeros(tracks.shape[:2], dtype=bool)
    expected[300:360] = True
    for end in ends:
        first = (300, 360)[end] - gap // 2
        tracks[first : first + gap, end] = np.nan
        expected[first : first + gap] = True
    np.testing.assert_array_equal(exchanged(tracks), expected)


@pytest.mark.parametrize("gap", [1, 5, 20, 40])
def test_feet_that_keep_their_names_through_gaps_are_not_exchanged(gap):
    for seed in range(20):
        tracks = walking(seed=seed)
        for first in range(5, 500, 60):
            tracks[first : first + gap] = np.nan
        assert not exchanged(tracks).any()


@pytest.mark.parametrize("size_m", [0.01, 0.045])
@pytest.mark.parametrize("seed", range(3))
def test_spikes_are_found_to_the_frame_however_many_they_are(seed, size_m):
    track = walking(seed=seed)[:, 0]
    rng = np.random.default_rng(seed)
    expected = np.zeros(len(track), dtype=bool)
    expected[20:590:31] = True
    track[expected, 2] += rng.choice([-size_m, size_m], expected.sum())
    np.testing.assert_array_equal(spikes(track), expected)
    np.testing.assert_array_equal(doubted(track[:, None])[:, 0], expected)


@pytest.mark.parametrize("noise_m", [0.0, 1e-4, 6e-4])
@pytest.mark.parametrize("rebound", [0.0, 0.5])
def test_a_foot_that_is_stopped_or_thrown_back_has_no_spike(noise_m, rebound):
    rng = np.random.default_rng(1)
    for begin_s in np.linspace(0.3, 0.3 + 1 / RATE_HZ, 7):
        t = np.arange(200) / RATE_HZ - begin_s
        speed = np.where(t < 0, 2.5, -2.5 * rebound * np.exp(-np.abs(t) / 0.02))
        track = np.outer(-speed * t, [0.3, 0.0, 1.0])
        track += rng.normal(0, noise_m, track.shape)
        assert not spikes(track).any()


def test_frames_that_are_often_far_off_are_the_noise_of_the_track():
    rng = np.random.default_rng(2)
    track = walking(seed=2)[:, 0]
    often = rng.random(len(track)) < 0.25
    track[often] += rng.normal(0, 0.05, (often.sum(), 3))
    assert not spikes(track).any()
    assert not spikes(track[:4]).any()
