"""Degree and window of the fits at the sections, chosen by what they leave."""

from dataclasses import replace

import numpy as np
import pytest

from hopdata.landings.marker_tracks import turned
from hopdata.landings.section_fits import WINDOWS_S, Tracks, alone, filtered, together, widest

LANDINGS, NOISE_M, APART_S = 150, 0.0006, 1.0


def falls(bend=None, *, rate_hz=100.0, noise_m=NOISE_M, landings=LANDINGS, seed=1):
    """Falls of three markers, each with its own velocity, and what bends them from it."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    tau = np.arange(-0.3, 0.08, 1 / rate_hz) + rng.uniform(0, 1 / rate_hz, (landings, 1))
    speed = rng.normal([0, 0, -1.5], 0.3, (landings, 3, 3))
    tracks = speed[:, None] * tau[..., None, None]
    tracks[..., 2] -= 0.5 * 9.80665 * tau[..., None] ** 2
    tracks[..., 0] += [0.1, -0.05, -0.05]
    tracks[..., 1] += [0.0, 0.1, -0.1]
    if bend is not None:
        tracks += bend(tau, rng)[..., None, None]
    tracks += noise_m * rng.standard_normal(tracks.shape)
    begin = APART_S * np.arange(landings)
    time, contact = (begin[:, None] + tau).ravel(), begin + 0.06
    return Tracks(time, tracks.reshape(-1, 3, 3), begin, contact, True), speed


def rms_error(tracks, speed):
    sums, fit = together(tracks, None)
    found = fit.mean[..., 1] / sums.scale
    true = turned(speed, sums.direction)
    return float(np.sqrt(np.mean((found - true) ** 2)))


def test_a_fall_takes_the_widest_window():
    tracks, _ = falls()
    assert widest(tracks, (2, 3)) == [(2, WINDOWS_S[-1]), (3, WINDOWS_S[-1])]


@pytest.mark.parametrize("rate_hz", [100.0, 500.0])
def test_no_window_reaches_far_beyond_a_kick(rate_hz):
    def kick(tau, rng):
        return rng.normal(0, 0.3, (len(tau), 1)) * np.minimum(tau + 0.11, 0.0)

    tracks, speed = falls(kick, rate_hz=rate_hz)
    assert all(window <= 0.15 for _, window in widest(tracks, (2, 3)))
    assert rms_error(tracks, speed) < 0.004


def test_tracks_that_bend_get_a_narrower_window_or_a_higher_degree():
    def swing(tau, rng):
        return 0.003 * np.sin(14 * tau + rng.uniform(0, 6, (len(tau), 1)))

    tracks, _ = falls(swing)
    chosen = dict(widest(tracks, (2, 3)))
    assert chosen[2] < chosen[3] <= WINDOWS_S[-1]


def test_the_fit_of_all_landings_is_better_than_each_alone():
    def push(tau, rng):
        return 0.5 * rng.normal(0, 1.0, (len(tau), 1)) * tau**2

    tracks, speed = falls(push)
    sums, fit = alone(tracks, None)
    one = float(np.sqrt(np.nanmean(fit.covariance[..., 1, 1]))) / sums.scale
    assert rms_error(tracks, speed) < one


def test_a_given_window_is_kept():
    tracks, _ = falls()
    assert together(tracks, 0.09)[0].scale == 0.09


def test_few_landings_are_fitted_alone():
    tracks, _ = falls(landings=10)
    ours, theirs = together(tracks, None), alone(tracks, None)
    np.testing.assert_array_equal(ours[1].mean, theirs[1].mean)


def test_a_marker_unseen_at_the_crossing_has_no_state():
    tracks, _ = falls()
    body = tracks.body.copy()
    body[np.abs(tracks.time - tracks.near[4]) < 0.07, 2] = np.nan
    body[np.abs(tracks.time - tracks.near[7]) < 0.015, 2] = np.nan
    _, fit = together(replace(tracks, body=body), None)
    assert np.isnan(fit.mean[4, 2]).all()
    assert np.isfinite(fit.mean[4, :2]).all()
    assert np.isfinite(fit.mean[7]).all()
    assert fit.covariance[7, 2, 0, 0, 0] > 1.2 * fit.covariance[7, 1, 0, 0, 0]


def test_the_filter_is_that_of_savitzky_and_golay():
    from scipy.signal import savgol_filter

    tracks, _ = falls(landings=5)
    middle = [int(np.argmin(np.abs(tracks.time - at))) for at in tracks.near]
    on_frames = replace(tracks, near=tracks.time[middle])
    sums, fit = filtered(on_frames)
    for row, frame in enumerate(middle):
        piece = tracks.body[frame - 3 : frame + 4, :, 2]
        expected = savgol_filter(piece, 7, 3, deriv=1, delta=0.01, axis=0)[3]
        np.testing.assert_allclose(fit.mean[row, :, 2, 1] / sums.scale, expected, atol=1e-8)


def test_frames_after_the_contacts_begin_at_a_lead_common_to_all_landings():
    """Where a landing's frames begin does not tell which foot was last, and when."""
    time = np.arange(0, 41, 0.001)
    near, gap = np.arange(1.0, 41.0), np.linspace(0.004, 0.043, 40)
    tracks = Tracks(time, np.zeros((len(time), 3, 3)), near, near - gap, flight=False)
    assert tracks.lead_s == pytest.approx(np.quantile(gap, 0.1), abs=1e-9)
    begin = near - time[tracks.windows(0.1).start]
    late = gap < tracks.lead_s
    assert late.sum() == 4
    assert np.all(np.abs(begin[~late] - tracks.lead_s) < 0.002)
    assert np.all(begin[late] <= gap[late] + 1e-9)  # none goes beyond its own last contact
    assert np.all(near - time[tracks.windows(0.002).start] <= 0.002 + 1e-9)


@pytest.mark.parametrize("contact", [[], [np.nan, np.nan], [0.98, np.nan]], ids=str)
@pytest.mark.filterwarnings("error")
def test_landings_without_a_last_contact_have_no_states_and_raise_no_warning(contact):
    time = np.arange(0, 5, 0.01)
    near = np.arange(1.0, 1.0 + len(contact))
    tracks = Tracks(time, np.zeros((len(time), 3, 3)), near, np.array(contact), flight=False)
    assert tracks.lead_s == pytest.approx(0.02 if 0.98 in contact else 0.0)
    fit = alone(tracks, None)[1]
    assert np.isnan(fit.mean[np.isnan(tracks.contact)]).all()
