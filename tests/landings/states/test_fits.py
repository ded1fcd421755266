"""Degree and window of the fits at the sections, chosen by their residuals."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_landings import POST_HEIGHT_M, PRE_HEIGHT_M, simulate, transitions_of

from hopdata.errors import ConfigError
from hopdata.landings.states.fits import (
    WINDOWS_S,
    Tracks,
    alone,
    filtered,
    section_states,
    together,
    widest,
)
from hopdata.landings.states.tracks import turned

LANDINGS, NOISE_M, APART_S = 150, 0.0006, 1.0


def falls(bend=None, *, rate_hz=100.0, noise_m=NOISE_M, landings=LANDINGS, seed=1):
    """Return falls of three markers, each with its own velocity, and deviations that bend them."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    tau = np.arange(-0.3, 0.08, 1 / rate_hz) + rng.uniform(
        0, 1 / rate_hz, (landings, 1)
    )
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
    [(sums, fit)] = together(tracks, None)()
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


def test_a_stance_that_changes_soon_gets_a_short_window():
    tracks, _ = falls(
        lambda tau, _: 500 * np.maximum(tau - 0.045, 0) ** 2, rate_hz=500.0
    )
    stance = replace(tracks, contact=tracks.near - 0.006, flight=False)
    assert all(window <= 0.05 for _, window in widest(stance, (3, 5)))
    assert [degree for degree, _ in widest(stance, (3, 5))] == [3, 5]


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
    [(sums, fit)] = alone(tracks, None)()
    one = float(np.sqrt(np.nanmean(fit.covariance[..., 1, 1]))) / sums.scale
    assert rms_error(tracks, speed) < one


def test_a_given_window_is_kept():
    tracks, _ = falls()
    assert next(together(tracks, 0.09)())[0].scale == 0.09


def test_few_landings_are_fitted_alone():
    tracks, _ = falls(landings=10)
    ours, theirs = next(together(tracks, None)()), next(alone(tracks, None)())
    np.testing.assert_array_equal(ours[1].mean, theirs[1].mean)


def test_a_marker_unseen_at_the_crossing_has_no_state():
    tracks, _ = falls()
    body = tracks.body.copy()
    body[np.abs(tracks.time - tracks.near[4]) < 0.07, 2] = np.nan
    body[np.abs(tracks.time - tracks.near[7]) < 0.015, 2] = np.nan
    [(_, fit)] = together(replace(tracks, body=body), None)()
    assert np.isnan(fit.mean[4, 2]).all()
    assert np.isfinite(fit.mean[4, :2]).all()
    assert np.isfinite(fit.mean[7]).all()
    assert fit.covariance[7, 2, 0, 0, 0] > 1.2 * fit.covariance[7, 1, 0, 0, 0]


def test_the_filter_is_that_of_savitzky_and_golay():
    from scipy.signal import savgol_filter

    tracks, _ = falls(landings=5)
    middle = [int(np.argmin(np.abs(tracks.time - at))) for at in tracks.near]
    on_frames = replace(tracks, near=tracks.time[middle])
    [(sums, fit)] = filtered(on_frames)()
    for row, frame in enumerate(middle):
        piece = tracks.body[frame - 3 : frame + 4, :, 2]
        expected = savgol_filter(piece, 7, 3, deriv=1, delta=0.01, axis=0)[3]
        np.testing.assert_allclose(
            fit.mean[row, :, 2, 1] / sums.scale, expected, atol=1e-8
        )


def test_frames_after_the_contacts_begin_at_a_lead_common_to_all_landings():
    """The start of a landing's frames does not show which foot was last, nor when."""
    time = np.arange(0, 41, 0.001)
    near, gap = np.arange(1.0, 41.0), np.linspace(0.004, 0.043, 40)
    tracks = Tracks(time, np.zeros((len(time), 3, 3)), near, near - gap, flight=False)
    assert tracks.lead_s == pytest.approx(np.quantile(gap, 0.1), abs=1e-9)
    begin = near - time[tracks.windows(0.1).start]
    late = gap < tracks.lead_s
    assert late.sum() == 4
    assert np.all(np.abs(begin[~late] - tracks.lead_s) < 0.002)
    assert np.all(
        begin[late] <= gap[late] + 1e-9
    )  # none goes beyond its own last contact
    assert np.all(near - time[tracks.windows(0.002).start] <= 0.002 + 1e-9)


@pytest.mark.parametrize("contact", [[], [np.nan, np.nan], [0.98, np.nan]], ids=str)
@pytest.mark.filterwarnings("error")
def test_landings_without_a_last_contact_have_no_states_and_raise_no_warning(contact):
    time = np.arange(0, 5, 0.01)
    near = np.arange(1.0, 1.0 + len(contact))
    tracks = Tracks(
        time, np.zeros((len(time), 3, 3)), near, np.array(contact), flight=False
    )
    assert tracks.lead_s == pytest.approx(0.02 if 0.98 in contact else 0.0)
    [(_, fit)] = alone(tracks, None)()
    assert np.isnan(fit.mean[np.isnan(tracks.contact)]).all()


# States at the sections against the truth.


@pytest.fixture(scope="module")
def scene():
    return simulate(300, seed=7)


def states(scene, side, body=None, **options):
    recording = scene.recording
    transitions = transitions_of(scene)
    before = side == "before"
    return section_states(
        recording.time,
        recording.body if body is None else body,
        transitions.t_pre if before else transitions.t_post,
        height_m=PRE_HEIGHT_M if before else POST_HEIGHT_M,
        side=side,
        contact=scene.contact_times.min(axis=1)
        if before
        else scene.contact_times.max(axis=1),
        **options,
    )


def velocity_error(scene, found):
    """Return the root mean square error, m/s; the truth is linear between frames to 2 mm/s."""
    body = scene.velocities.shape[1]
    truth = np.empty_like(found.velocity)
    for b, k in np.ndindex(body, 3):
        truth[:, b, k] = np.interp(
            found.time, scene.recording.time, scene.velocities[:, b, k]
        )
    return float(np.sqrt(np.mean((found.velocity - truth) ** 2)))


@pytest.mark.parametrize("method", ["split_fit", "savitzky_golay"])
@pytest.mark.parametrize(
    ("side", "height"), [("before", PRE_HEIGHT_M), ("after", POST_HEIGHT_M)]
)
def test_the_mean_height_is_the_sections_and_sinks(scene, method, side, height):
    found = states(scene, side, method=method)
    assert np.isfinite(found.velocity).all()
    np.testing.assert_allclose(found.position[:, :, 2].mean(axis=1), height, atol=1e-12)
    assert (found.velocity[:, :, 2].mean(axis=1) < 0).all()


def test_flight_is_four_times_better_than_the_filter(scene):
    split = velocity_error(scene, states(scene, "before"))
    smoothed = velocity_error(scene, states(scene, "before", method="savitzky_golay"))
    assert smoothed == pytest.approx(0.0306, abs=0.003)  # FACTS: 30.7 mm/s
    assert split < smoothed / 4


def test_stance_is_four_times_better_than_the_filter(scene):
    split = velocity_error(scene, states(scene, "after"))
    assert (
        split
        < velocity_error(scene, states(scene, "after", method="savitzky_golay")) / 4
    )


def test_gravity_is_learned_where_flight_is_ballistic(scene):
    known = velocity_error(scene, states(scene, "before", gravity="known"))
    free = velocity_error(scene, states(scene, "before", gravity="free"))
    found = velocity_error(scene, states(scene, "before", gravity="auto"))
    assert known < 0.5 * free
    assert found <= known


def test_gravity_is_given_up_where_flight_is_not_ballistic(scene):
    body, rng = scene.recording.body.copy(), np.random.default_rng(2)
    cycle = 0.64
    hop = np.floor(scene.recording.time / cycle).astype(int)
    push = (rng.normal(0, 3.0, (hop.max() + 1, 3)) * [1, 1, 0])[
        hop
    ]  # m/s^2, drawn for each hop
    s = scene.recording.time - hop * cycle
    bent = body + (0.5 * push * s[:, None] ** 2)[:, None]
    truth = replace(scene, velocities=scene.velocities + (push * s[:, None])[:, None])
    error = {
        gravity: velocity_error(truth, states(scene, "before", bent, gravity=gravity))
        for gravity in ("auto", "known", "free")
    }
    assert error["auto"] <= error["free"]
    assert error["auto"] < 0.5 * error["known"]


@pytest.mark.parametrize("side", ["before", "after"])
@pytest.mark.parametrize("rate_hz", [100.0, 250.0])
def test_standard_errors_are_as_large_as_the_errors(side, rate_hz):
    scene = simulate(200, seed=5, rate_hz=rate_hz)
    quiet = replace(scene, recording=scene.clean)
    noisy, clean = (states(one, side, gravity="auto") for one in (scene, quiet))
    for found, truth, covariance in (
        (noisy.position, clean.position, noisy.position_covariance),
        (noisy.velocity, clean.velocity, noisy.velocity_covariance),
    ):
        score = (found - truth) / np.sqrt(np.einsum("lbkk->lbk", covariance))
        assert np.mean(score**2) == pytest.approx(1.0, abs=0.25)
        assert 0.63 < np.mean(np.abs(score) < 1) < 0.75


def test_the_error_of_the_instant_is_in_the_standard_errors(scene):
    found = states(scene, "before")
    up = found.position_covariance[..., 2, 2]
    # Three markers with equal errors: the instant removes a third of each height.
    along = found.position_covariance[..., 0, 0] + found.position_covariance[..., 1, 1]
    np.testing.assert_allclose(up.mean() / (along.mean() / 2), 2 / 3, rtol=0.1)


def test_few_landings_are_fitted_one_by_one():
    few = simulate(5, seed=3)
    for side in ("before", "after"):
        found = states(few, side)
        assert np.isfinite(found.velocity_covariance).all()
        assert velocity_error(few, found) < 0.03
    known = states(few, "before", gravity="known")
    np.testing.assert_array_equal(states(few, "before").velocity, known.velocity)


def test_exact_on_motions_within_the_model():
    time = np.arange(100) / 100
    fall = 1.0 - 0.5 * 9.80665 * (time - 0.2) ** 2
    body = np.stack(
        [
            np.column_stack([0.3 * time + b, b - 0.1 * time, fall + 0.1 * b])
            for b in (-1, 0, 1)
        ],
        axis=1,
    )
    drop = 0.4
    t = 0.2 + np.sqrt(2 * drop / 9.80665)
    for gravity in ("known", "free", "auto"):
        found = section_states(
            time,
            body,
            np.array([t + 0.004]),
            height_m=1 - drop,
            side="before",
            contact=np.array([t + 0.02]),
            gravity=gravity,
        )
        np.testing.assert_allclose(found.time, t, atol=1e-10)
        expected = np.tile([0.3, -0.1, -9.80665 * (t - 0.2)], (3, 1))
        np.testing.assert_allclose(found.velocity[0], expected, atol=1e-9)
        np.testing.assert_allclose(
            found.position[0, :, 0], 0.3 * t + np.array([-1, 0, 1])
        )


def test_frames_beyond_the_contacts_are_not_used(scene):
    recording = scene.recording
    spoiled = recording.body.copy()
    after = recording.time[:, None] >= scene.contact_times.min(axis=1)
    before = (
        recording.time[:, None] < np.roll(scene.contact_times.min(axis=1), -1) - 0.3
    )
    spoiled[(after & before).any(axis=1)] += 1.0
    clean = states(scene, "before")
    np.testing.assert_array_equal(
        states(scene, "before", spoiled).velocity, clean.velocity
    )
    filtered = states(scene, "before", spoiled, method="savitzky_golay")
    assert not np.allclose(
        filtered.velocity,
        states(scene, "before", method="savitzky_golay").velocity,
        equal_nan=True,
    )


def test_few_missing_frames_are_bridged_and_many_are_not(scene):
    body = scene.recording.body.copy()
    at = np.searchsorted(scene.recording.time, states(scene, "before").time)
    body[at[0] - 3, 1] = np.nan
    body[at[1] - 40 : at[1] + 40, 1] = np.nan
    found = states(scene, "before", body)
    assert np.isfinite(found.velocity[0]).all()
    assert np.isnan(found.velocity[1]).all()
    assert np.isfinite(found.velocity[2:]).all()


def test_unknown_choices_are_named(scene):
    with pytest.raises(ConfigError, match="did you mean 'split_fit'"):
        states(scene, "before", method="split_fits")
    with pytest.raises(ConfigError, match=r"states\.gravity"):
        states(scene, "before", gravity="moon")
