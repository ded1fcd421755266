"""Rough instants, and which feet did not come down."""

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt
from synthetic_landings import simulate, transitions_of

from hopdata.errors import AnalysisError
from hopdata.landings.contacts.descents import (
    ALREADY_DOWN,
    LANDED,
    LEAST_NOISE_M,
    MISSING,
    NOT_LANDED,
    Transitions,
    approaches,
    descents,
    find_transitions,
    height_noise,
    noise_correlation,
    widening,
)


@pytest.fixture(scope="module")
def landings():
    scene = simulate(60, seed=5)
    return scene, transitions_of(scene), scene.recording.feet[:, :, 2]


def find(landings, heights):
    scene, transitions, _ = landings
    return approaches(
        scene.recording.time,
        heights,
        transitions,
        noise_m=6e-4,
        down_height_m=0.02,
        lead_s=0.04,
        trail_s=0.03,
    )


def test_rough_instants_are_within_a_frame(landings):
    near, *_, status = find(landings, landings[2])
    assert (status == LANDED).all()
    assert np.abs(near - landings[0].contact_times).max() < 0.01


def test_a_foot_touches_later_than_it_is_too_high(landings):
    """It is higher above its rest than skin and compliance let it sink, which no contact is."""
    scene, transitions, heights = landings
    _, earliest, *_ = find(landings, heights)
    ahead = scene.contact_times - earliest
    assert ahead.min() > 0.0
    assert np.quantile(ahead, 0.9) < 0.02
    raised = heights + 0.015 * (transitions.t_pre[0] < scene.recording.time)[:, None]
    np.testing.assert_allclose(find(landings, raised)[1][1:], earliest[1:], atol=1e-9)


@pytest.mark.parametrize(
    ("foot", "expected"),
    [
        (lambda z: z + 0.05, NOT_LANDED),
        (lambda z: 0.0003 * np.sin(np.arange(len(z))), ALREADY_DOWN),
        (
            lambda z: 0.0048 * np.sin(0.11 * np.arange(len(z))),
            ALREADY_DOWN,
        ),  # the foot settles
        (lambda z: z * np.nan, MISSING),
    ],
)
def test_feet_that_do_not_land(landings, foot, expected):
    heights = landings[2].copy()
    heights[:, 1] = foot(heights[:, 1])
    near, *_, status = find(landings, heights)
    assert (status[:, 1] == expected).all()
    assert np.isnan(near[:, 1]).all()
    assert (status[:, [0, 2]] == LANDED).all()


@pytest.mark.parametrize("side", ["low", "high"])
def test_a_foot_that_is_hidden_is_not_said_to_be_up_or_down(landings, side):
    heights = landings[2].copy()
    z = heights[:, 1]
    hidden = (
        (z < 0.04) if side == "low" else (z > 0.004)
    )  # near its contact, or all of its descent
    heights[hidden, 1] = np.nan
    *_, status = find(landings, heights)
    assert (status[:, 1] == MISSING).mean() > 0.9
    assert not np.isin(status[:, 1], [ALREADY_DOWN, NOT_LANDED]).any()
    assert (status[:, [0, 2]] == LANDED).all()


@pytest.mark.parametrize("share", [0.02, 0.2])
def test_lost_frames_do_not_bring_a_foot_down(landings, share):
    heights = landings[2].copy()
    rng = np.random.default_rng(3)
    heights[:, 1] += 0.3
    heights[rng.random(len(heights)) < share, 1] = np.nan
    assert (find(landings, heights)[-1][:, 1] == NOT_LANDED).mean() > 0.99


def test_a_foot_that_hovers_and_is_hidden_then_may_have_landed(landings):
    scene, transitions, heights = landings[0], landings[1], landings[2].copy()
    rng = np.random.default_rng(4)
    heights[:, 1] = 0.06 + 6e-4 * rng.standard_normal(len(heights))
    for t_pre, t_post in zip(transitions.t_pre, transitions.t_post, strict=True):
        time = scene.recording.time
        heights[(time > t_pre) & (time < t_post + 0.1), 1] = np.nan
    assert (find(landings, heights)[-1][:, 1] == MISSING).mean() > 0.9


@pytest.mark.parametrize("seed", range(5))
def test_a_foot_that_hangs_low_before_it_falls_is_timed_by_its_fall(seed):
    """An example is a robot that is released just above the floor."""
    time, released, hung_m = np.arange(200) / 200.0, 0.5 + 1e-3 * seed, 0.034
    lowered = np.interp(time, [0.3, 0.4], [0.15, hung_m])
    falls = lowered - 0.5 * 9.81 * np.maximum(time - released, 0.0) ** 2
    heights = np.maximum(falls, 0.0) + 6e-4 * np.random.default_rng(
        seed
    ).standard_normal(200)
    ends, gap = np.array([[0.32], [0.7]]), np.array([0.005])
    options = {"noise_m": 6e-4, "down_height_m": 0.02, "lead_s": 0.04, "trail_s": 0.03}
    near, *_ = approaches(
        time, heights[:, None], Transitions(*ends, gap, gap), **options
    )
    assert abs(near[0, 0] - released - np.sqrt(2 * hung_m / 9.81)) < 0.02


@pytest.mark.parametrize("noise_m", [2e-4, 6e-4])
def test_noise_of_a_moving_foot(noise_m):
    scene = simulate(60, seed=6, noise_m=noise_m, rate_hz=200)
    heights = scene.recording.feet[:, :, 2].copy()
    heights[::17] = np.nan
    assert height_noise(heights) == pytest.approx(noise_m, rel=0.15)
    assert np.isnan(height_noise(heights * np.nan))


def test_noise_where_every_third_frame_is_seen_and_where_there_is_none():
    scene = simulate(60, seed=6, rate_hz=600)
    heights = scene.recording.feet[:, :, 2].copy()
    heights[np.arange(len(heights)) % 3 > 0] = np.nan
    assert height_noise(heights) == pytest.approx(6e-4, rel=0.15)
    assert height_noise(np.zeros((50, 2))) == LEAST_NOISE_M
    rare = np.full((100, 2), np.nan)
    rare[[1, 50, 99]] = 0.1
    assert np.isnan(height_noise(rare))


# Descents through the two sections.

SECTIONS = {"pre_height_m": 0.3, "post_height_m": -0.3}


def wave(rate_hz=100.0, cycles=5):
    time = np.arange(int(cycles * rate_hz)) / rate_hz
    return time, np.cos(2 * np.pi * time)


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 2000.0])
def test_instants_of_a_cosine(rate_hz):
    time, height = wave(rate_hz)
    found = find_transitions(time, height, **SECTIONS)
    expected = np.arange(5)
    chord = (
        0.5 * 0.3 * (2 * np.pi) ** 2 / (8 * rate_hz**2)
    )  # about the sagitta over the speed
    assert len(found) == 5
    np.testing.assert_allclose(
        found.t_pre, expected + np.arccos(0.3) / (2 * np.pi), atol=chord / 5 + 1e-12
    )
    np.testing.assert_allclose(
        found.t_post, expected + np.arccos(-0.3) / (2 * np.pi), atol=chord / 5 + 1e-12
    )
    np.testing.assert_allclose(found.gap_pre, 1 / rate_hz)


def test_a_bounce_has_no_post_crossing():
    time, height = wave()
    shallow = np.where((time > 1) & (time < 2), 0.2 + 0.8 * np.abs(height), height)
    found = find_transitions(
        time, np.where((time > 1) & (time < 2), shallow, height), **SECTIONS
    )
    assert np.isnan(found.t_post).sum() == len(found) - 4
    assert found.complete.sum() == 4


def test_noise_about_a_section_makes_no_descents_of_its_own():
    time, height = wave(2000.0)
    noisy = height + np.random.default_rng(0).normal(0, 0.004, len(time))
    assert np.sum((noisy[:-1] >= 0.3) & (noisy[1:] < 0.3)) > 5
    assert len(find_transitions(time, noisy, **SECTIONS)) == 5


def test_missing_frames_widen_the_gap():
    time, height = wave()
    height[18:23] = np.nan  # around the first descent through 0.3
    found = find_transitions(time, height, **SECTIONS)
    assert len(found) == 5
    assert found.gap_pre[0] == pytest.approx(0.06)
    assert found.gap_pre[1] == pytest.approx(0.01)


def test_where_no_crossing_is_seen_the_gap_is_that_which_may_hide_it():
    time, height = wave()
    sound = find_transitions(time, height, **SECTIONS)
    height[25:90] = np.nan  # from between the sections to above them again
    hidden = find_transitions(time, height, **SECTIONS)
    assert np.isnan(hidden.t_post[0])
    assert hidden.gap_post[0] == pytest.approx(0.66)
    shallow = find_transitions(
        time, np.where(time < 1, np.maximum(height, 0), height), **SECTIONS
    )
    assert len(sound) == len(hidden) == len(shallow) == 5
    bounce = find_transitions(*wave(), pre_height_m=0.3, post_height_m=-1.5)
    assert np.isnan(bounce.t_post).all()
    np.testing.assert_allclose(bounce.gap_post, 0.01)


def test_a_hidden_top_is_told_by_its_gap():
    time, height = hops([1.0, 0.2, 1.0, 1.0])
    height[(time > 2.06) & (time < 2.46)] = np.nan  # around the third top
    found = find_transitions(time, height, **SECTIONS)
    gaps = found.gap_pre.round(3).tolist()
    assert gaps == [0.005, 0.005, pytest.approx(0.405, abs=0.006), 0.005]


def test_a_recording_that_starts_low_or_ends_in_descent():
    time, height = wave()
    found = find_transitions(
        time[22:440], height[22:440], **SECTIONS
    )  # between the sections
    assert len(found) == 5
    assert np.isinf(found.gap_pre).tolist() == [True] + 4 * [
        False
    ]  # its top is not recorded
    assert found.complete.all()
    found = find_transitions(time[:423], height[:423], **SECTIONS)
    assert len(found) == 5
    assert found.complete.tolist() == [True] * 4 + [False]


def test_every_landing_is_found():
    scene = simulate(50, seed=2)
    found = transitions_of(scene)
    assert len(found) == 50
    assert (found.t_pre < scene.contact_times.min(axis=1)).all()
    assert (found.t_post > scene.contact_times.max(axis=1)).all()


def test_mistakes_are_named():
    time, height = wave()
    with pytest.raises(AnalysisError, match="below the pre section"):
        find_transitions(time, height, pre_height_m=0.1, post_height_m=0.2)


def test_a_body_that_never_sinks_through_the_section_makes_no_transition():
    time, height = wave()
    assert np.isnan(
        find_transitions(time, height, pre_height_m=-2.0, post_height_m=-3.0).t_pre
    ).all()
    assert len(find_transitions(time, height * np.nan, **SECTIONS)) == 0


def hops(tops, rate_hz=200.0):
    """Return parabolas of 0.5 s from -0.6 to each top, separated by troughs of 0.5 s."""
    local = np.arange(round(rate_hz)) / rate_hz
    up = local < 0.5
    pieces = [
        np.where(
            up,
            -0.6 + (top + 0.6) * (1 - (4 * local - 1) ** 2),
            -0.6 - 0.2 * (local - 0.5),
        )
        for top in tops
    ]
    return np.arange(len(tops) * len(local)) / rate_hz, np.concatenate(pieces)


def test_a_hop_that_stays_below_the_pre_section_is_found_at_its_top():
    time, height = hops(
        [1.0, 0.2, 0.9, -0.4, 1.0]
    )  # a rise of less than 30 % is no hop
    found = find_transitions(time, height, **SECTIONS)
    assert len(found) == 4
    np.testing.assert_allclose(found.t_pre[1], 1.25)
    fall = np.sqrt(1 - (-0.3 + 0.6) / (0.2 + 0.6))
    np.testing.assert_allclose(found.t_post[1], 1.25 + 0.25 * fall, atol=1e-3)
    assert (np.diff(found.t_pre) > 0).all()


def test_the_descent_that_a_recording_ends_in_is_one_once_it_is_deep_enough():
    time, height = hops([1.0, 1.0])
    assert len(descents(height)) == 2
    for deep, count in ((0.2, 1), (0.6, 2)):  # 30 % of the range are 0.54
        stop = np.flatnonzero((time > 1.25) & (height > 1.0 - deep))[-1]
        assert len(descents(height[:stop])) == count


def autoregressive(rng, shape, correlation):
    """Return noise of unit variance that is autoregressive along the first axis."""
    noise = rng.standard_normal(shape)
    for k in range(1, len(noise)):
        noise[k] = correlation * noise[k - 1] + np.sqrt(1 - correlation**2) * noise[k]
    return noise


@pytest.mark.parametrize("correlation", [0.4, 0.6])
@pytest.mark.parametrize("seed", range(3))
def test_how_noise_is_correlated_is_seen_beside_the_motion(correlation, seed):
    motion = 0.3 * np.sin(2 * np.pi * 2 * np.arange(4000) / 200)[:, None, None]
    noise = 3e-4 * autoregressive(
        np.random.default_rng(seed), (4000, 3, 3), correlation
    )
    assert noise_correlation(motion + noise) == pytest.approx(correlation, abs=0.12)


@pytest.mark.parametrize("seed", range(5))
def test_white_noise_and_mere_motion_are_not_correlated(seed):
    white = 3e-4 * np.random.default_rng(seed).standard_normal((4000, 3, 3))
    motion = 0.3 * np.sin(2 * np.pi * 2 * np.arange(4000) / 200)[:, None, None]
    smoothed = sosfiltfilt(butter(2, 15, fs=200, output="sos"), white, axis=0)
    for body in (
        white + motion,
        motion + 0 * white,
        motion + smoothed,
        white[:6],
        np.nan * white,
    ):
        assert noise_correlation(body) == 0.0


@pytest.mark.parametrize("correlation", [0.0, 0.4, 0.8])
def test_errors_of_contacts_are_widened_by_what_correlated_noise_does(correlation):
    before, after = 16, 10
    frame = np.arange(-before, after) + 0.5
    law = np.stack(
        [frame < 0, (frame < 0) * frame, (frame < 0) * frame**2, frame > 0], axis=1
    )
    noise = autoregressive(np.random.default_rng(1), (len(frame), 20_000), correlation)
    fitted, squares, *_ = np.linalg.lstsq(law.astype(float), noise, rcond=None)
    of_contact = (
        np.linalg.inv(law.T.astype(float) @ law) @ [1, 0, 0, -1] @ [1, 0, 0, -1]
    )
    stated = np.sqrt(of_contact * squares.mean() / (len(frame) - 4))
    found = (fitted[0] - fitted[3]).std()
    assert widening(correlation, before, after) == pytest.approx(
        found / stated, rel=0.03
    )
