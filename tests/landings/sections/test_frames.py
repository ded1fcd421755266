import numpy as np
import pytest
from section_fakes import hopper

from hopdata.landings.sections.frames import (
    clear_of_ground,
    descents,
    heights_of,
    landing_frames,
    pool_frames,
)


def test_a_run_counts_as_up_only_if_it_rises_well_above_the_threshold():
    height = np.array([0, 2, 0, 2, 4, 2, 0, 2, 2, np.nan, 2, 5.0])
    up = clear_of_ground(height, threshold_m=1.0, ground_m=0.0)
    np.testing.assert_array_equal(np.flatnonzero(up), [3, 4, 5, 7, 8, 10, 11])
    raised = clear_of_ground(height + 7, threshold_m=8.0, ground_m=7.0)
    np.testing.assert_array_equal(raised, up)
    assert not clear_of_ground(height[:3], threshold_m=1.0, ground_m=0.0).any()
    assert clear_of_ground(np.empty(0), threshold_m=1.0, ground_m=0.0).shape == (0,)


def test_descents_of_a_wave_with_noise():
    time = np.arange(0, 10, 0.01)
    wave = np.cos(2 * np.pi * time) + 0.02 * np.random.default_rng(0).normal(
        size=len(time)
    )
    found = np.array(descents(wave))
    np.testing.assert_allclose(found[:, 0], 100 * np.arange(10), atol=8)
    np.testing.assert_allclose(found[:9, 1], 100 * np.arange(9) + 50, atol=8)


def test_descents_leap_over_gaps_and_end_with_the_recording():
    wave = np.cos(2 * np.pi * np.arange(0, 3.3, 0.01))
    whole = descents(wave)
    assert whole == [(0, 50), (100, 150), (200, 250), (300, 329)]
    wave[120:130] = np.nan
    assert descents(wave) == descents(wave, longest=11) == whole
    assert descents(wave[:120]) == [(0, 50), (100, 119)]
    assert descents(wave[:110]) == [(0, 50)]  # not yet deep enough


def test_a_long_gap_may_hide_turns():
    wave = np.cos(2 * np.pi * np.arange(0, 3.3, 0.01))
    wave[135:240] = np.nan
    assert (100, 250) in descents(wave)
    assert descents(wave, longest=10) == [(0, 50), (100, 134), (300, 329)]


def test_a_pause_is_no_descent():
    wave = np.cos(2 * np.pi * np.arange(0, 2.0, 0.01))
    time = 0.01 * np.arange(200) + np.where(np.arange(200) < 110, 0.0, 1.0)
    assert descents(wave, time) == [(0, 50), (100, 150)]
    assert descents(wave, time, longest=0.1) == [(0, 50), (110, 150)]


@pytest.mark.parametrize("body", [np.empty(0), np.full(9, np.nan), np.ones(9)])
def test_nothing_descends_in_nothing(body):
    assert descents(body) == []


def test_only_descents_from_all_up_to_all_down_are_landings():
    body = np.cos(2 * np.pi * np.arange(0, 3.2, 0.01))
    all_up, all_down = body > 0.5, body < -0.5
    all_down[100:200] = False  # the second descent ends on other feet
    all_up[190:205] = False  # the third starts with a foot on the ground
    inside, landed = landing_frames(body, all_up, all_down)
    np.testing.assert_array_equal(np.flatnonzero(inside), np.arange(51))
    np.testing.assert_array_equal(np.flatnonzero(landed), np.arange(34, 51))


def test_a_foot_that_rises_again_before_the_nadir_has_still_landed():
    body = np.cos(2 * np.pi * np.arange(0, 1.3, 0.01))
    all_up, all_down = body > 0.5, body < -0.5
    all_down[45:] = False
    inside, landed = landing_frames(body, all_up, all_down)
    assert landed[34:51].all()
    assert inside.sum() == 51


def test_states_agree_with_the_truth_off_the_moment_of_contact():
    fake = hopper(np.random.default_rng(1))
    frames = pool_frames(
        [heights_of(fake.recording)], min_foot_m=0.0012, max_foot_m=0.0018, ground_m=0.0
    )
    np.testing.assert_array_equal(frames.body, fake.recording.body_height)
    assert np.mean(frames.all_up != (~fake.foot_down).all(axis=1)) < 0.01
    assert np.mean(frames.all_down != fake.foot_down.all(axis=1)) < 0.01
    assert not (frames.all_up & frames.all_down).any()


def test_a_frame_without_one_foot_is_not_seen():
    recording = hopper(np.random.default_rng(1), hops=5).recording
    recording.positions[10:20, 4] = np.nan
    recording.positions[30, 0] = np.nan
    heights = heights_of(recording)
    expected = np.append(np.arange(10, 20), 30)
    np.testing.assert_array_equal(np.flatnonzero(~heights.seen), expected)
    assert np.isnan(heights.min_foot[30])
    assert np.isnan(heights.max_foot[10])
