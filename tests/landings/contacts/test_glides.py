"""A foot that glides above the floor has not landed, and is timed when it comes down."""

from dataclasses import replace

import numpy as np
import pytest
from dipping_heels import dipping
from falling_feet import falls
from gliding_heels import walk

import hopdata as hd
from hopdata.landings import exclusion
from hopdata.landings.contacts import timing
from hopdata.landings.contacts.descents import GLIDES, LANDED
from hopdata.landings.contacts.glides import (
    DOWN_S,
    doubts,
    glides,
    is_slowed_by_leg,
    is_stopped_hard,
    last_descents,
    sinks,
)
from hopdata.landings.contacts.timing import find_contacts
from hopdata.landings.contacts.where import whole_spans
from hopdata.landings.touchdowns import exclusion_reasons
from hopdata.messages import Message

RATE_HZ = 200.0
CONTACT_S = 0.5
TIME = np.arange(200) / RATE_HZ


def foot_at(height_m):
    """Return a foot (N, 1) that falls until its contact, and is then at this height."""
    fall = np.maximum(CONTACT_S - TIME, 0.0)
    return (fall + height_m(TIME - CONTACT_S))[:, None]


def glide(height_m, *, lasts_s=0.15):
    return foot_at(lambda after: height_m * np.clip(1.0 - after / lasts_s, 0.0, 1.0))


def told(heights):
    instant = np.array([[CONTACT_S]])
    return bool(glides(TIME, heights, instant, (0,))[0, 0])


@pytest.mark.parametrize("glide_m", [0.0, 0.012, 0.03])
def test_a_foot_that_sinks_on_after_its_kink_glides(glide_m):
    assert told(glide(glide_m)) == (glide_m > 0.0)


@pytest.mark.parametrize("yields_m", [0.005, 0.03])
def test_soles_that_yield_at_once_do_not_glide(yields_m):
    assert not told(glide(yields_m, lasts_s=0.03))


def test_a_foot_that_bounces_has_landed():
    def height_m(after):
        return np.maximum(0.0, 0.5 * after - 0.5 * 9.81 * after**2)

    assert not told(foot_at(height_m))


def test_a_foot_that_is_hidden_afterwards_tells_nothing():
    def height_m(after):
        return np.where(after > 0.0, np.nan, 0.0)

    heights = foot_at(height_m)
    assert not told(heights)
    assert sinks(TIME, heights[:, 0], np.array([CONTACT_S, np.nan])).tolist() == [0, 0]


def test_of_a_foot_the_markers_that_sink_are_marked():
    stands = foot_at(np.zeros_like)
    heights = np.hstack([glide(0.02), 0.03 + stands])
    instant = np.array([[CONTACT_S, CONTACT_S]])
    assert glides(TIME, heights, instant, (0, 0)).tolist() == [[True, False]]
    # While another marker stands on the floor, the foot does not glide.
    heights = np.hstack([glide(0.02), stands])
    assert not glides(TIME, heights, instant, (0, 0)).any()
    assert glides(TIME, heights, instant, (0, 1)).tolist() == [[True, False]]


def test_the_end_of_a_glide_is_near_where_the_foot_comes_to_rest():
    def height_m(after):
        return np.clip(0.02 - 0.2 * (after - 0.05), 0.0, 0.02)

    heights = foot_at(height_m)
    instant = np.array([[CONTACT_S]])
    asked = np.array([[True]])
    near, earliest = last_descents(TIME, heights, instant, asked, noise_m=1e-4)
    down_s = CONTACT_S + 0.15
    assert near[0, 0] == pytest.approx(down_s, abs=0.01)
    assert CONTACT_S + 0.05 < earliest[0, 0] < down_s
    near, earliest = last_descents(TIME, heights, instant, ~asked, noise_m=1e-4)
    assert np.isnan(near).all()
    assert np.isnan(earliest).all()


@pytest.mark.parametrize("glide_m", [0.006, 0.01])
@pytest.mark.parametrize(("seed", "rate_hz"), [(3, 100.0), (4, 200.0)])
def test_a_gliding_heel_is_timed_when_it_comes_down(glide_m, seed, rate_hz):
    recording, truth = walk(seed, glide_m=glide_m, rate_hz=rate_hz)
    found = hd.contacts(recording).found
    assert len(found) >= len(truth) - 1  # one may stay untrusted
    away_s = found["contact_s"].to_numpy()[:, None] - truth
    off_s = np.abs(away_s).min(axis=1)
    assert np.abs(off_s).max() < 0.025  # the glide lasts 0.1 s
    stated_s = np.hypot(found["se_s"], found["common_s"])
    assert (np.abs(off_s) < 2.5 * stated_s).all()


def errors_of_low_glides(seed):
    """Return errors and stated errors of heels that glide 4 mm above the floor, s."""
    recording, truth = walk(seed, glide_m=0.004)
    found = hd.contacts(recording).found
    away_s = found["contact_s"].to_numpy()[:, None] - truth
    nearest = np.abs(away_s).argmin(axis=1)
    off_s = away_s[np.arange(len(found)), nearest]
    return off_s, np.hypot(found["se_s"], found["common_s"]).to_numpy()


@pytest.mark.parametrize("seed", [1, 2, 4])
def test_a_glide_too_low_to_tell_from_yielding_widens_the_error(seed, monkeypatch):
    off_s, stated_s = errors_of_low_glides(seed)
    is_early = off_s < -0.04
    assert is_early.any()
    assert (np.abs(off_s) < 3 * stated_s).all()
    assert (stated_s[~is_early] < 0.025).any()
    # Feet whose contacts no law describes sink on as they roll: nothing is widened.
    monkeypatch.setattr(timing, "ROLLS", 0.0)
    off_s, stated_s = errors_of_low_glides(seed)
    assert (np.abs(off_s[is_early]) > 3 * stated_s[is_early]).all()


def test_a_foot_without_a_later_kink_may_come_down_until_the_search_ends():
    first = np.array([[1.0, 2.0]])
    later = np.array([[1.09, np.nan]])
    expected_s = np.array([[0.09, DOWN_S]]) / np.sqrt(3.0)
    np.testing.assert_allclose(doubts(first, later), expected_s)


def test_a_foot_that_has_left_the_floor_does_not_glide():
    def height_m(after):
        stands = np.where(after < 0.1, 0.012, 0.012 + 2.0 * (after - 0.1))
        return np.where(after < 0.15, stands, 0.0)

    assert not told(foot_at(height_m))


def test_a_study_does_not_trust_a_glide_whose_end_it_does_not_see():
    recording, truth = walk(5, glide_m=0.02)
    positions = recording.positions.copy()
    for contact_s in truth:
        # Heel and floor are seen again long after.
        since = recording.time - contact_s
        positions[(since > -0.03) & (since < 0.1), 3] = np.nan
    hidden = replace(recording, positions=positions)
    trial_of_heel = (hidden.time, hidden.feet[:, :, 2])
    spans = np.stack([truth - 0.2, truth + 0.05], axis=1)
    contacts = find_contacts(*trial_of_heel, whole_spans(spans), down_height_m=0.03)
    is_early = contacts.instant[:, 0] < truth - 0.05
    assert is_early.any()
    assert (contacts.status[is_early, 0] == GLIDES).all()
    reasons = exclusion_reasons(whole_spans(spans), contacts, longest_gap_s=0.1)
    told = Message(exclusion.FOOT_GLIDES, {"foot": 1}).text()
    assert {reasons[row] for row in np.flatnonzero(is_early)} == {told}


def test_a_toe_that_tilts_below_the_floor_does_not_glide():
    def height_m(after):
        return np.where((after > 0.06) & (after < 0.2), -0.006, 0.0)

    assert not told(foot_at(height_m))
    assert told(0.006 + foot_at(height_m))


def test_a_foot_that_creeps_evenly_has_landed():
    noise_m = 3e-4
    noise = np.random.default_rng(8).normal(0, noise_m, (len(TIME), 1))
    creeps = foot_at(lambda after: 0.01 - 0.04 * np.maximum(after, 0.0)) + noise
    comes_down = foot_at(lambda after: np.where(after < 0.12, 0.008, 0.0)) + noise
    instant = np.array([[CONTACT_S]])
    for heights, has_glided in ((creeps, False), (comes_down, True)):
        given = (TIME, heights, instant, (0,))
        assert glides(*given, noise_m=noise_m)[0, 0] == has_glided
        assert glides(*given)[0, 0]  # both sink by 8 mm


@pytest.mark.parametrize("noise_m", [1e-4, 3e-4])
def test_contacts_of_feet_that_creep_are_kept(noise_m):
    made = falls(60, seed=12, creep_m_s=-0.04, noise_m=noise_m)
    found = find_contacts(made.time, made.heights, made.transitions, down_height_m=0.02)
    assert (found.status == LANDED).all()
    assert np.abs(found.instant - made.contacts).max() < 0.003
    assert found.se.max() < 0.003


def test_contacts_of_feet_that_fall_freely_are_not_sought_again():
    made = falls(40, seed=7)
    found = find_contacts(made.time, made.heights, made.transitions, down_height_m=0.02)
    assert (found.status == LANDED).all()
    assert not (found.status == GLIDES).any()
    assert found.se.max() < 0.005  # one sought again has 5.8 ms or more


def slowed_in(lasts_s):
    """Return heights (N,) of a foot that is slowed evenly until it stands, m."""
    until = np.maximum(CONTACT_S - TIME, 0.0)
    slows = np.minimum(until, lasts_s)
    return 0.5 * slows**2 / lasts_s + (until - slows)


@pytest.mark.parametrize("noise_m", [0.0, 2e-4])
def test_a_leg_slows_a_foot_in_a_tenth_of_a_second_and_the_floor_at_once(noise_m):
    noise = np.random.default_rng(5).normal(0, noise_m, len(TIME))
    for lasts_s, by_leg in ((0.1, True), (0.02, False), (0.005, False)):
        height = slowed_in(lasts_s) + noise
        found = is_slowed_by_leg(TIME, height, CONTACT_S, noise_m)
        assert found == by_leg
        height[TIME > CONTACT_S] = np.nan
        assert not is_slowed_by_leg(TIME, height, CONTACT_S, noise_m)


def test_frames_that_are_hidden_before_the_foot_is_slowed_do_not_matter():
    height = slowed_in(0.1)
    height[TIME < CONTACT_S - 0.12] = np.nan
    assert is_slowed_by_leg(TIME, height, CONTACT_S, 0.0)
    height[TIME < CONTACT_S - 0.03] = np.nan
    assert not is_slowed_by_leg(TIME, height, CONTACT_S, 0.0)


def test_a_foot_that_a_leg_slowed_comes_down_below_where_it_stands():
    since = TIME - CONTACT_S
    dip_m = np.where((since > 0.06) & (since < 0.2), -0.006, 0.0)
    for lasts_s, sunk_m in ((0.1, 0.006), (0.005, 0.0)):
        height = slowed_in(lasts_s) + dip_m
        found = sinks(TIME, height, np.array([CONTACT_S]), noise_m=1e-5)
        assert found[0] == pytest.approx(sunk_m, abs=5e-5)


def errors_of(recording, truth):
    found = hd.contacts(recording).found
    away_s = found["contact_s"].to_numpy()[:, None] - truth
    off_s = away_s[np.arange(len(found)), np.abs(away_s).argmin(axis=1)]
    return off_s, np.hypot(found["se_s"], found["common_s"]).to_numpy()


@pytest.mark.parametrize("rate_hz", [100.0, 200.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_heel_that_dips_is_timed_when_it_comes_down(seed, rate_hz):
    off_s, stated_s = errors_of(*dipping(seed, rate_hz=rate_hz))
    assert len(off_s) >= 4
    assert np.abs(off_s).max() < 0.03  # the glide begins 0.1 s before
    assert (np.abs(off_s) < 3 * stated_s).all()


@pytest.mark.parametrize("seed", [1, 2])
def test_a_toe_that_tilts_as_deep_is_timed_where_the_floor_stops_it(seed):
    off_s, _ = errors_of(*dipping(seed, is_toe=True))
    assert len(off_s) >= 4
    assert np.abs(off_s).max() < 0.01


@pytest.mark.parametrize(
    ("speed_m_s", "lasts_s", "is_hard"),
    [(2.5, 0.002, True), (1.5, 0.001, True), (1.2, 0.03, False), (0.5, 0.002, False)],
)
def test_a_floor_stops_a_fast_foot_harder_than_any_leg(speed_m_s, lasts_s, is_hard):
    until = np.maximum(CONTACT_S - TIME, 0.0)
    after = np.maximum(TIME - CONTACT_S, 0.0)
    height = speed_m_s * (until + lasts_s * np.exp(-after / lasts_s))
    assert is_stopped_hard(TIME, height, CONTACT_S) == is_hard
    assert not is_stopped_hard(TIME, np.full(len(TIME), np.nan), CONTACT_S)


def test_a_toe_that_sinks_as_its_heel_comes_down_has_an_error_that_says_so():
    n = 12
    rng = np.random.default_rng(4)
    time = np.arange(round((n + 1) * RATE_HZ)) / RATE_HZ
    heights = np.zeros(len(time))
    toes_s = 0.5 + np.arange(n) + rng.uniform(0.0, 1 / RATE_HZ, n)
    for toe_s in toes_s:
        since = time - toe_s
        sinks_m = 0.008 * np.clip(1.0 - since / 0.065, 0.0, 1.0) ** 1.2
        falls_m = np.clip(-2.5 * since, 0.0, 0.2)
        own = (since > -0.4) & (since < 0.5)
        heights[own] = (falls_m + sinks_m)[own]
    heights += rng.normal(0, 3e-4, len(time))
    spans = whole_spans(np.stack([toes_s - 0.2, toes_s + 0.15], axis=1))
    found = find_contacts(time, heights[:, None], spans, down_height_m=0.03)
    timed = found.status[:, 0] == LANDED
    assert timed.sum() >= n - 2
    off = (found.instant[:, 0] - toes_s) / np.hypot(found.se[:, 0], found.common[0])
    assert np.abs(off[timed]).max() < 3
