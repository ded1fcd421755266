"""Landings with a small rise before them, or a small fall, told from shudders by the feet."""

import numpy as np
import pytest

from hopdata.landings.contacts.descents import descents
from hopdata.landings.contacts.shallow import with_shallow_falls
from hopdata.landings.contacts.steps import find_steps
from hopdata.landings.contacts.where import descents_of
from hopdata.landings.touchdowns import touchdown_table
from hopdata.recording import Recording

RATE_HZ = 200.0
CYCLE_S = 1.0
NOISE_M = 2e-4
TOP_M, USUAL_NADIR_M = 1.0, 0.2

# After the third drop the body sinks to here alone, so that it rises by 0.2 m to the
# next one, and not by 30 % of 0.8 m.
HARDLY_SUNK_M = 0.8
EXPECTED = 8


def heights_of(nadirs, *, n_feet=2, seed=0):
    """Return time (N,), body (N,) and feet (N, n): a drop from 1 m to each nadir.

    Feet fall freely from 0.15 m in the last 0.17 s, stand, and are lifted slowly.
    """
    local = np.arange(round(CYCLE_S * RATE_HZ)) / RATE_HZ
    turns = np.array([0.0, 0.5, 1.0]) * CYCLE_S
    body = []
    for nadir in nadirs:
        phase = np.interp(local, turns, [0.0, 1.0, 2.0])
        body.append(nadir + (TOP_M - nadir) * (1 + np.cos(np.pi * phase)) / 2)
    fallen = 0.15 - 9.80665 / 2 * np.maximum(local - 0.1, 0) ** 2
    lifted = 0.15 * np.clip((local - 0.6) / 0.3, 0, 1)
    foot = np.maximum(np.maximum(fallen, 0), lifted)
    rng = np.random.default_rng(seed)
    n_frames = len(nadirs) * len(local)
    feet = np.tile(foot, len(nadirs))[:, None] + np.zeros(n_feet)
    feet += rng.normal(0, NOISE_M, feet.shape)
    heights = np.concatenate(body) + rng.normal(0, NOISE_M, n_frames)
    return np.arange(n_frames) / RATE_HZ, heights, feet


def shallow_rise():
    nadirs = np.full(EXPECTED, USUAL_NADIR_M)
    nadirs[2] = HARDLY_SUNK_M
    return heights_of(nadirs)


def both(time, body, feet):
    """Return the descents of the body alone, and with those that its feet tell."""
    of_body = descents(body, time, longest=0.1)
    steps, _ = find_steps(time, feet, noise_m=NOISE_M)
    return of_body, with_shallow_falls(time, feet, body, of_body, steps)


def held(time, falls):
    """Return in how many of the descents each contact lies."""
    contacts = 0.1 + np.sqrt(2 * 0.15 / 9.80665) + CYCLE_S * np.arange(EXPECTED)
    spans = time[np.array(falls)]
    within = (spans[:, :1] <= contacts) & (contacts <= spans[:, 1:])
    return within.sum(axis=0).tolist()


@pytest.mark.parametrize("shallow", [[2], [0], [EXPECTED - 1], [2, 3], [1, 4, 6]])
def test_each_landing_has_one_descent(shallow):
    nadirs = np.full(EXPECTED, USUAL_NADIR_M)
    nadirs[shallow] = HARDLY_SUNK_M
    time, body, feet = heights_of(nadirs)
    of_body, found = both(time, body, feet)
    assert len(of_body) < EXPECTED
    assert held(time, found) == [1] * EXPECTED
    assert len(found) == EXPECTED


def test_a_descent_in_which_another_begins_is_divided_where_the_body_was_lowest():
    """The second drop sinks to 0.8 m; the third begins higher than the second did."""
    time, body, feet = heights_of(np.full(EXPECTED, USUAL_NADIR_M))
    # The second drop begins at the top, so that one descent would hold it and the third.
    is_after = (time >= 1.5) & (time < 2.0)
    is_before = (time >= 1.0) & (time < 1.5)
    body[is_before | is_after] = 0.9 + 0.1 * np.cos(
        2 * np.pi * time[is_before | is_after]
    )
    of_body, found = both(time, body, feet)
    assert len(of_body) == EXPECTED - 1
    assert held(time, found) == [1] * EXPECTED
    spans = time[np.array(found)]
    assert spans[1, 1] == pytest.approx(1.5, abs=0.05)
    assert spans[2, 0] == pytest.approx(2.0, abs=0.05)


def test_a_swing_in_which_no_foot_comes_down_is_a_shudder():
    time, body, feet = shallow_rise()
    feet[(time >= 2.0) & (time < 3.0)] = 0.0
    of_body, found = both(time, body, feet)
    assert found == of_body


def test_a_swing_in_which_one_foot_stays_down_is_no_landing_of_all():
    time, body, feet = shallow_rise()
    feet[(time >= 2.0) & (time < 3.0), 1] = 0.0
    of_body, found = both(time, body, feet)
    assert found == of_body


def test_feet_that_land_while_the_body_does_not_turn_add_nothing():
    time, body, feet = heights_of(np.full(EXPECTED, USUAL_NADIR_M))
    body[:] = TOP_M + USUAL_NADIR_M - np.linspace(0, 1, len(time))
    of_body, found = both(time, body, feet)
    assert len(of_body) == 1
    assert found == of_body


def test_a_shudder_of_the_body_within_each_landing_adds_nothing():
    time, body, feet = heights_of(np.full(EXPECTED, USUAL_NADIR_M))
    body += 0.12 * np.sin(2 * np.pi * 6 * time)
    of_body, found = both(time, body, feet)
    assert len(of_body) == EXPECTED
    assert found == of_body


def test_of_a_hidden_foot_nothing_is_known_and_one_must_be_seen():
    time, body, feet = shallow_rise()
    is_about = (time >= 1.7) & (time < 2.6)
    feet[is_about, 1] = np.nan
    _, found = both(time, body, feet)
    assert held(time, found) == [1] * EXPECTED
    feet[is_about] = np.nan
    of_body, found = both(time, body, feet)
    assert found == of_body


def recording_of(time, body, feet):
    """Return a recording of a body of three markers and these feet."""
    n_frames = len(time)
    around = np.array([[0.1, 0.0, 0.0], [-0.1, 0.1, 0.0], [-0.1, -0.1, 0.0]])
    positions = np.zeros((n_frames, 5, 3))
    positions[:, :3] = around
    positions[:, :3, 2] += body[:, None]
    positions[:, 3:, 0] = [0.2, -0.2]
    positions[:, 3:, 2] = feet
    return Recording(
        "made",
        time,
        positions,
        ("a", "b", "c", "left", "right"),
        ("body", "body", "body", "foot", "foot"),
        RATE_HZ,
    )


@pytest.mark.parametrize("of_feet", [False, True])
def test_studies_and_contacts_look_in_each_of_them(of_feet):
    time, body, feet = shallow_rise()
    found = descents_of(recording_of(time, body, feet), None, of_feet=of_feet)
    assert len(found.spans) == EXPECTED
    assert not found.hidden.any()


def test_a_landing_that_ends_above_the_post_section_has_its_row_and_reason():
    time, body, feet = shallow_rise()
    recording = recording_of(time, body, feet)
    table = touchdown_table(recording, pre_height_m=0.9, post_height_m=0.5)
    assert len(table) == EXPECTED
    assert table["excluded"].tolist() == [number == 2 for number in range(EXPECTED)]
    assert "post section" in table["reason"][2]
