"""Descents of the body, and where they cross the sections."""

import numpy as np
import pytest
from synthetic_landings import simulate, transitions_of

from hopdata.errors import AnalysisError
from hopdata.landings.contacts.descents import (
    descents,
    find_hidden_landings,
    find_transitions,
)

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


def jumps_and_then(end_m, *, apexes=12, seed=3):
    """Return the body's height in jumps of 0.3 to 0.45 m; it then lies at `end_m`."""
    rng = np.random.default_rng(seed)
    time = np.arange(100) / 100.0
    parts = [
        0.8 + depth * 0.5 * (1 - np.cos(2 * np.pi * time))
        for depth in rng.uniform(0.3, 0.45, apexes)
    ]
    return np.concatenate([*parts, np.full(100, end_m)])


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_a_body_that_lies_down_at_the_end_hides_no_landing(seed):
    # Range of the heights: 1.1 m. A third of it is more than the lowest jumps rise.
    upright = descents(jumps_and_then(0.8, seed=seed))
    fallen = descents(jumps_and_then(0.1, seed=seed))
    assert len(upright) == 12
    # The last landing ends where the body lies.
    assert [apex for apex, _ in fallen] == [apex for apex, _ in upright]


def test_the_range_of_the_heights_decides_among_jumps_of_any_height():
    # A shudder of 0.05 m between jumps of 0.4 m is no landing, one of 0.2 m is.
    time = np.arange(100) / 100.0
    shape = 0.5 * (1 - np.cos(2 * np.pi * time))
    jumps = [0.8 + 0.4 * shape] * 6
    for depth, expected in [(0.05, 6), (0.2, 7)]:
        height = np.concatenate([*jumps[:3], 0.8 + depth * shape, *jumps[3:]])
        assert len(descents(height)) == expected


@pytest.mark.parametrize(("gap_ends_s", "hidden"), [(0.40, 0), (1.2, 1)])
def test_a_descent_that_a_gap_cuts_has_one_row(gap_ends_s, hidden):
    """Feet are nearly down as the body is seen again, and touch later: one landing.

    If the body is seen again on its way to the next one, the landing is hidden.
    """
    time = np.arange(400) / 200
    body = 0.7 + 0.2 * np.cos(2 * np.pi * (time - 0.15))
    body[(time >= 0.1) & (time < gap_ends_s)] = np.nan
    # Up until 0.36 s, nearly down from 0.395 s on, and up again; the next one is seen.
    knots = [0.0, 0.355, 0.395, 0.42, 0.8, 0.85, 1.355, 1.395, 2.0]
    height = np.interp(time, knots, [0.2, 0.2, 0.01, 0.0, 0.0, 0.2, 0.2, 0.01, 0.0])
    spans = time[np.array(descents(body, time, longest=0.1))]
    found = find_hidden_landings(
        time, np.stack([height, height], axis=1), body, spans, down_height_m=0.02
    )
    assert len(found) == hidden
    if hidden:
        assert 0.3 < found[0, 0] < found[0, 1] < 0.42
