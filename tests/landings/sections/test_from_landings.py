"""Sections chosen by the heights of the body in landings."""

from dataclasses import replace

import numpy as np
import pytest
from section_fakes import GRAVITY, hopper

from hopdata.errors import AnalysisError
from hopdata.landings.contacts.find import find_landings
from hopdata.landings.sections.from_landings import (
    FIRST_CONTACT,
    LAST_CONTACT,
    LOWEST,
    TOP,
    fall_speed,
    heights_from_landings,
    heights_that_hold,
    holds,
    landing_heights,
)

#     top, first and last contact, lowest, and 2 ms before the first and after the last
#     contact
ONE = [1.00, 0.90, 0.80, 0.70, 0.904, 0.797]
OTHER = [0.95, 0.93, 0.60, 0.55, 0.932, 0.598]
MADE_UP = np.array([ONE] * 9 + [OTHER])


def landings_like(rng, number, contact_sd_m=0.008, turn_sd_m=0.006):
    """Return heights of landings that scatter normally, as those of the sample do."""
    top = 0.570 + turn_sd_m * rng.standard_normal(number)
    first = 0.335 + contact_sd_m * rng.standard_normal(number)
    last = 0.306 + contact_sd_m * rng.standard_normal(number)
    lowest = 0.244 + turn_sd_m * rng.standard_normal(number)
    return np.column_stack([top, first, last, lowest, first + 0.024, last - 0.003])


def test_heights_are_those_of_the_body_at_its_turns_and_contacts():
    fake = hopper(np.random.default_rng(1), hops=60)
    found = landing_heights(fake.recording, find_landings(fake.recording))
    assert 58 <= len(found) <= 60
    in_order = found[:, [TOP, 4, FIRST_CONTACT]], found[:, [LAST_CONTACT, 5, LOWEST]]
    for heights in in_order:
        assert (np.diff(heights, axis=1) <= 0).all()
    touches = np.flatnonzero(np.diff(fake.foot_down.any(axis=1).astype(int)) == 1)
    all_down = np.flatnonzero(np.diff(fake.foot_down.all(axis=1).astype(int)) == 1)
    frame_m = 0.02  # fall of the body per frame
    later = np.median(
        fake.body_height[touches + 1]
    )  # the flight is continued by one frame
    assert np.median(found[:, FIRST_CONTACT]) == pytest.approx(later, abs=frame_m)
    last = np.median(fake.body_height[all_down])
    assert np.median(found[:, LAST_CONTACT]) == pytest.approx(last, abs=frame_m)


def test_a_part_of_a_recording_has_the_landings_that_it_shows():
    recording = hopper(np.random.default_rng(1), hops=60).recording
    landings = find_landings(recording)
    whole = landing_heights(recording, landings)
    middle = len(recording.time) // 2
    halves = [
        landing_heights(recording.part(half), landings)
        for half in (slice(middle), slice(middle, None))
    ]
    assert len(whole) - 1 <= sum(map(len, halves)) <= len(whole)
    # The size of the animal is measured in each part anew, which moves instants by some
    # us.
    np.testing.assert_allclose(halves[0], whole[: len(halves[0])], rtol=0, atol=1e-5)
    unseen = recording.positions.copy()
    unseen[(recording.time > 5) & (recording.time < 6)] = np.nan
    fewer = landing_heights(replace(recording, positions=unseen), landings)
    assert 1 <= len(whole) - len(fewer) <= 3
    apart = np.abs(fewer[:, None] - whole).max(axis=2).min(axis=1)
    assert apart.max() < 1e-5


def test_landings_that_begin_after_hidden_frames_are_shown():
    recording = hopper(np.random.default_rng(1), hops=40).recording
    landings = find_landings(recording)
    whole = landing_heights(recording, landings)
    hidden = recording.positions.copy()
    for begin_s in landings["begin_s"]:
        rising = (recording.time < begin_s) & (recording.time > begin_s - 0.1)
        hidden[rising] = np.nan
    found = landing_heights(replace(recording, positions=hidden), landings)
    assert len(found) == len(whole)
    np.testing.assert_allclose(found, whole, rtol=0, atol=1e-5)


def test_a_recording_without_descents_has_no_landings():
    fake = hopper(np.random.default_rng(1), hops=20)
    still = fake.recording.positions * 0 + fake.recording.positions[:1]
    recording = replace(fake.recording, positions=still)
    assert len(find_landings(recording)) == 0
    assert landing_heights(recording, find_landings(recording)).shape == (0, 6)


def test_a_landing_is_held_between_its_turning_point_and_its_contact():
    assert holds(0.95, MADE_UP, "pre").all()
    assert holds(0.92, MADE_UP, "pre").sum() == 9
    assert holds(0.96, MADE_UP, "pre").sum() == 9
    assert holds(0.75, MADE_UP, "post").sum() == 9
    assert holds(0.58, MADE_UP, "post").sum() == 1


def test_the_post_section_loses_one_in_fifty_of_many_landings():
    heights = landings_like(np.random.default_rng(1), 2000)
    held = heights_from_landings(heights)
    post_m, bandwidth_m = held.shallow_m, held.bandwidth_m
    assert 0.001 < bandwidth_m < 0.003
    after = heights[:, 5] >= post_m
    assert 0.98 <= after.mean() < 0.984, "no shallower height loses as few"
    assert post_m == pytest.approx(np.quantile(heights[:, 5], 0.02), abs=5e-4)


def test_of_few_landings_none_is_lost():
    for seed in range(20):
        heights = landings_like(np.random.default_rng(seed), 39)
        held = heights_from_landings(heights)
        pre_m, post_m = held.pre_m, held.shallow_m
        assert holds(pre_m, heights, "pre").all()
        assert holds(post_m, heights, "post").all()


def test_one_deep_contact_of_few_is_held():
    """The tail of its density alone may be lost: it is one landing, and one in 39 is not 2 %."""
    heights = landings_like(np.random.default_rng(1), 39, contact_sd_m=5e-4)
    heights[0, [LAST_CONTACT, 5]] = 0.295
    post_m = heights_from_landings(heights, 2e-3).shallow_m
    assert 0.293 < post_m <= 0.295
    many = np.concatenate([heights, landings_like(np.random.default_rng(2), 200, 5e-4)])
    assert heights_from_landings(many, 2e-3).shallow_m > 0.2955, (
        "of 239 landings, it may be lost"
    )


def test_the_pre_section_lies_half_way_in_the_time_of_the_flight():
    heights = np.tile([1.0, 0.78, 0.7, 0.6, 0.8, 0.69], (100, 1))
    heights += 1e-4 * np.random.default_rng(1).standard_normal((100, 1))
    assert heights_from_landings(heights).pre_m == pytest.approx(0.95, abs=1e-3)
    # Where a third of the landings begin lower, it lies below a tenth of their falls.
    heights[:33, TOP] = 0.92
    expected = 0.92 - 0.1 * (0.92 - 0.78)
    assert heights_from_landings(heights).pre_m == pytest.approx(expected, abs=1e-3)


def test_flights_are_continued_only_where_they_must_be():
    """A tenth of the flights end high, 3 mm below the others' tops."""
    heights = np.tile([1.0, 0.78, 0.7, 0.6, 0.8, 0.69], (100, 1))
    heights += 1e-4 * np.random.default_rng(1).standard_normal((100, 1))
    heights[:10, FIRST_CONTACT] = 0.955
    heights[:10, 4] = 0.965
    heights[10:, TOP] = 0.99
    pre_m = heights_from_landings(heights).pre_m
    assert 0.965 <= pre_m < 0.97
    heights[:10, 4] = 0.985  # no height is above these contacts and below the tops
    pre_m = heights_from_landings(heights).pre_m
    assert 0.955 <= pre_m < 0.97
    assert holds(pre_m, heights, "pre").all()


def test_no_section_lies_where_the_body_nearly_stands():
    contact, lowest = np.full(200, 0.8), np.full(200, 0.7)
    heights = np.column_stack(
        [contact + 0.2, contact, contact, lowest, contact, contact]
    )
    # Every other last contact lies at the lowest point: such landings are held nowhere
    # else.
    heights[::2, [2, 5]] = 0.705
    held = heights_from_landings(heights)
    assert 0.724 < held.deep_m <= held.shallow_m <= 0.801
    assert held.pre_m < 0.98


@pytest.mark.parametrize("share", [0.002, 0.01, 0.05, 0.2, 0.45])
def test_odd_landings_hardly_move_the_sections(share):
    """A step lies under some landings, and in others the last foot comes when the body stands."""
    rng = np.random.default_rng(1)
    heights = landings_like(rng, 500)
    odd = heights.copy()
    few = rng.permutation(500)[: int(share * 500)]
    on_a_step, late = few[::2], few[1::2]
    odd[on_a_step, 1:] += 0.06
    odd[late, LAST_CONTACT] = odd[late, LOWEST] + 0.001
    odd[late, 5] = odd[late, LOWEST]
    usual, found = heights_from_landings(heights), heights_from_landings(odd)
    assert found.pre_m == pytest.approx(usual.pre_m, abs=1e-3 + 0.02 * share)
    assert found.shallow_m == pytest.approx(usual.shallow_m, abs=1e-3 + 0.012 * share)


def test_when_most_landings_are_lower_so_are_the_sections():
    rng = np.random.default_rng(1)
    heights = landings_like(rng, 500)
    lower = heights.copy()
    lower[:300] -= 0.05
    found, usual = heights_from_landings(lower), heights_from_landings(heights)
    assert found.pre_m < usual.pre_m - 0.02
    assert found.shallow_m < usual.shallow_m - 0.02
    assert found.deep_m < usual.deep_m - 0.02


def test_the_bandwidth_decides():
    heights = landings_like(np.random.default_rng(1), 500, contact_sd_m=0.004)
    fine = heights_from_landings(heights, 1e-4)
    wide = heights_from_landings(heights, 8e-3)
    assert fine.bandwidth_m == 1e-4
    assert fine.shallow_m - wide.shallow_m > 2e-3, (
        "a wider density of contacts reaches further down"
    )


def test_a_bandwidth_that_does_not_suit_the_heights_is_refused():
    heights = landings_like(np.random.default_rng(1), 500)
    with pytest.raises(
        AnalysisError, match=r"sections\.bandwidth_m: expected at least .* 1e-07 m"
    ):
        heights_from_landings(heights, 1e-7)
    with pytest.raises(
        AnalysisError, match=r"sections\.bandwidth_m: expected at most 0\.0\d+ m"
    ):
        heights_from_landings(heights, 0.1)


@pytest.mark.parametrize("number", [1, 2, 5])
def test_a_few_equal_landings_have_sections(number):
    held = heights_from_landings(np.array([ONE] * number))
    assert 0.904 < held.pre_m < 1.0
    assert held.shallow_m == pytest.approx(0.797, abs=1e-3)
    # A quarter of the way to the lowest point is left out.
    assert held.deep_m == pytest.approx(0.70 + 0.25 * 0.097, abs=1e-3)


def test_a_landing_that_no_height_holds_does_not_count_against_one():
    contact = np.array([0.5] * 8 + [0.9, 0.9])
    turn = np.array([0.7] * 8 + [0.6, 0.6])
    held = heights_that_hold(contact, turn, 1e-3)
    assert held[0] == pytest.approx(0.5, abs=3e-3)
    assert held[-1] == pytest.approx(0.7, abs=3e-3)


def test_the_speed_of_a_fall_is_that_of_gravity():
    recording = hopper(np.random.default_rng(1), hops=20, noise_m=0.0).recording
    landings = find_landings(recording)
    top = landing_heights(recording, landings)[:, TOP]
    height_m = float(np.median(top)) - 0.05
    speeds = fall_speed(recording, landings, height_m)
    known = speeds[np.isfinite(speeds)]
    assert len(known) > 15
    expected = np.sqrt(2 * GRAVITY * 0.05)
    assert np.median(known) == pytest.approx(expected, rel=0.03)
    assert np.isnan(fall_speed(recording, landings, height_m + 1.0)).all()
