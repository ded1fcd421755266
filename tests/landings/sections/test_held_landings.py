"""Sections chosen by the landings that they keep."""

from dataclasses import replace

import numpy as np
import pytest
from section_fakes import hopper

from hopdata.landings.contacts.find import find_landings
from hopdata.landings.sections.select import (
    LEFT_LOSS,
    holds,
    landing_heights,
    nearest_holding,
)

#       apex, first, last contact, nadir
MADE_UP = np.array([[1.00, 0.90, 0.80, 0.70]] * 9 + [[0.95, 0.93, 0.60, 0.55]])


def test_heights_are_those_of_the_body_at_its_turns_and_contacts():
    fake = hopper(np.random.default_rng(1), hops=60)
    found = landing_heights(fake.recording, find_landings(fake.recording))
    assert 58 <= len(found) <= 60
    for contact in (1, 2):
        assert (np.diff(found[:, [0, contact, 3]], axis=1) <= 0).all()
    touches = np.flatnonzero(np.diff(fake.foot_down.any(axis=1).astype(int)) == 1)
    all_down = np.flatnonzero(np.diff(fake.foot_down.all(axis=1).astype(int)) == 1)
    frame_m = 0.02  # fall of the body per frame
    later = np.median(fake.body_height[touches + 1])  # the flight is continued by one frame
    assert np.median(found[:, 1]) == pytest.approx(later, abs=frame_m)
    assert np.median(found[:, 2]) == pytest.approx(
        np.median(fake.body_height[all_down]), abs=frame_m
    )


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
    np.testing.assert_array_equal(halves[0], whole[: len(halves[0])])
    unseen = recording.positions.copy()
    unseen[(recording.time > 5) & (recording.time < 6)] = np.nan
    fewer = landing_heights(replace(recording, positions=unseen), landings)
    assert 1 <= len(whole) - len(fewer) <= 3
    assert {*map(tuple, fewer)} < {*map(tuple, whole)}


def test_a_recording_without_descents_has_no_landings():
    fake = hopper(np.random.default_rng(1), hops=20)
    still = fake.recording.positions * 0 + fake.recording.positions[:1]
    recording = replace(fake.recording, positions=still)
    assert len(find_landings(recording)) == 0
    assert landing_heights(recording, find_landings(recording)).shape == (0, 4)


def test_a_landing_is_held_between_its_turning_point_and_its_contact():
    assert holds(0.95, MADE_UP, "pre").all()
    assert holds(0.92, MADE_UP, "pre").sum() == 9
    assert holds(0.96, MADE_UP, "pre").sum() == 9
    assert holds(0.75, MADE_UP, "post").sum() == 9
    assert holds(0.58, MADE_UP, "post").sum() == 1


@pytest.mark.parametrize(
    ("side", "start", "ends"), [("pre", 0.2, (0.90, 1.0)), ("post", 2.0, (0.7, 0.802))]
)
def test_a_section_that_loses_too_many_moves_no_farther_than_it_must(side, start, ends):
    many = np.repeat(MADE_UP[:1], 1000, axis=0)
    many[:, 1:3] += np.linspace(0, 1e-3, 1000)[:, None]
    moved = nearest_holding(start, many, side)
    assert ends[0] < moved < ends[1]
    assert holds(moved, many, side).mean() >= 1 - LEFT_LOSS
    edge = ends[0] if side == "pre" else ends[1]
    assert abs(moved - edge) < 3e-3


def test_where_no_height_holds_all_it_is_one_that_holds_most():
    rng = np.random.default_rng(1)
    apex = rng.uniform(0.9, 1.1, 400)
    landings = np.column_stack([apex, apex - 0.05, apex - 0.1, apex - 0.2])
    best = max(holds(h, landings, "pre").mean() for h in np.linspace(0.8, 1.1, 601))
    assert holds(nearest_holding(0.8, landings, "pre"), landings, "pre").mean() >= best - 0.01
