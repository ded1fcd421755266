"""Rigid feet that bounce off at once: what they hide is stated."""

import numpy as np
import pytest
from falling_feet import GRAVITY_M_S2, NOISE_M, SPEED_M_S, falls

from hopdata.landings.contacts.bounces import bounce_errors, bounces, rises
from hopdata.landings.contacts.timing import find_contacts


def standing(made):
    """Return the heights without the first frames, in which feet rise from the floor."""
    heights = made.heights.reshape(len(made.contacts), -1, 3).copy()
    heights[:, :6] = np.nan
    return heights.reshape(-1, 3)


def bouncing(landings, high_m, *, seed):
    """Let feet bounce after their contacts, each time 0.4 times as fast."""
    made = falls(landings, seed=seed)
    since = made.time.reshape(landings, -1, 1) - made.contacts[:, None]
    speed = np.sqrt(2 * GRAVITY_M_S2 * high_m)
    above = np.zeros_like(since)
    begin = 0.0
    for _ in range(6):
        s = since - begin
        height = speed * s - GRAVITY_M_S2 * s**2 / 2
        above += np.where(s > 0, np.maximum(height, 0.0), 0.0)
        begin += 2 * speed / GRAVITY_M_S2
        speed *= 0.4
    return made, standing(made) + above.reshape(-1, 3)


def sinking_on(landings, share, constant_s, *, seed):
    """Let feet keep a share of their speed at contacts, and lose it exponentially."""
    made = falls(landings, seed=seed)
    since = made.time.reshape(landings, -1, 1) - made.contacts[:, None]
    slowed = 1 - np.exp(-np.maximum(since, 0.0) / constant_s)
    sunk_m = share * SPEED_M_S * constant_s * slowed
    return made, standing(made) - sunk_m.reshape(-1, 3)


def found_contacts(made, heights):
    """Return the contacts (L, 3), s, as they are found, which are not the true ones."""
    found = find_contacts(made.time, heights, made.transitions, down_height_m=0.02)
    return found.instant


@pytest.mark.parametrize("high_m", [0.0, 0.003, 0.006, 0.015])
def test_errors_are_no_larger_than_stated(high_m):
    ratios = []
    for seed in range(3):
        made, heights = bouncing(40, high_m, seed=seed)
        found = find_contacts(made.time, heights, made.transitions, down_height_m=0.02)
        stated = np.hypot(found.se, found.common)
        ratios.append(np.nanmean(((found.instant - made.contacts) / stated) ** 2))
    assert np.sqrt(np.mean(ratios)) < 1.25


@pytest.mark.parametrize("high_m", [0.003, 0.01])
def test_feet_that_bounce_share_an_error_and_those_that_stand_do_not(high_m):
    velocity = np.full((40, 3), -1.0)
    taken_for_bouncing = []
    for seed in range(5):
        made, heights = bouncing(40, high_m, seed=seed)
        args = made.contacts, velocity, NOISE_M
        assert (bounce_errors(made.time, heights, *args) > 1e-3).all()
        still = bounce_errors(made.time, standing(made), *args)
        assert (still < 1e-3).all()
        taken_for_bouncing.append((still > 0).mean())
        soft = falls(40, seed=seed, compliance_s=0.003)
        args = soft.contacts, velocity, NOISE_M
        assert (bounce_errors(soft.time, standing(soft), *args) < 1e-3).all()
    assert np.mean(taken_for_bouncing) < 0.2


def test_a_foot_that_is_never_seen_after_a_contact_tells_nothing():
    made, heights = bouncing(5, 0.01, seed=1)
    velocity = np.full((5, 3), -1.0)
    late = made.contacts.max() + np.zeros((5, 3)) + 10.0
    assert not bounce_errors(made.time, heights, late, velocity, NOISE_M).any()
    nowhere = np.full((5, 3), np.nan)
    assert not bounce_errors(made.time, heights, nowhere, velocity, NOISE_M).any()


@pytest.mark.parametrize("high_m", [0.003, 0.006, 0.015])
def test_feet_that_bounce_rise_and_come_down(high_m):
    for seed in range(2):
        made, heights = bouncing(40, high_m, seed=seed)
        at = found_contacts(made, heights)
        assert rises(made.time, heights, at, NOISE_M).all()


@pytest.mark.parametrize("constant_s", [0.004, 0.008, 0.015])
@pytest.mark.parametrize("share", [0.4, 1.0])
def test_feet_that_sink_on_never_rise(share, constant_s):
    for seed in range(3):
        made, heights = sinking_on(40, share, constant_s, seed=seed)
        at = found_contacts(made, heights)
        assert not rises(made.time, heights, at, NOISE_M).any()
        assert not rises(made.time, heights, made.contacts, NOISE_M).any()


@pytest.mark.parametrize("share", [0.4, 1.0])
def test_feet_that_sink_for_long_are_higher_at_first(share):
    higher_m = []
    for seed in range(3):
        made, heights = sinking_on(40, share, 0.015, seed=seed)
        higher_m.append(bounces(made.time, heights, made.contacts, NOISE_M))
    # The mean of the exponential from 15 to 50 ms.
    begin, end = np.exp(-np.array([0.015, 0.05]) / 0.015)
    expected_m = share * SPEED_M_S * 0.015**2 * (begin - end) / 0.035
    assert (np.array(higher_m) > 0).all()
    np.testing.assert_allclose(np.mean(higher_m), expected_m, rtol=0.3)


def test_feet_that_stand_or_dip_and_come_back_do_not_rise():
    found = []
    for seed in range(5):
        made = falls(40, seed=seed)
        heights = standing(made)
        found.append(rises(made.time, heights, made.contacts, NOISE_M))
        since = made.time.reshape(40, -1, 1) - made.contacts[:, None]
        after = np.maximum(since, 0.0) / 0.015
        dip_m = 0.004 * after * np.exp(1 - after)
        dipped = heights - dip_m.reshape(-1, 3)
        found.append(rises(made.time, dipped, made.contacts, NOISE_M))
    assert np.sum(found) <= 1  # of 30


def test_feet_that_waver_after_they_sank_do_not_bounce():
    """As on a soft floor, where a leg pushes them, by less than they sank before."""
    made, heights = sinking_on(40, 1.0, 0.008, seed=1)
    since = made.time.reshape(40, -1, 1) - made.contacts[:, None]
    hill_m = 0.003 * np.exp(-(((since - 0.045) / 0.012) ** 2))
    wavering = heights + hill_m.reshape(-1, 3)
    assert not rises(made.time, wavering, made.contacts, NOISE_M).any()
    rigid = falls(40, seed=1)
    leaving = standing(rigid) + hill_m.reshape(-1, 3)
    assert rises(rigid.time, leaving, rigid.contacts, NOISE_M).all()


def test_a_foot_without_contacts_does_not_rise():
    made, heights = bouncing(5, 0.01, seed=1)
    nowhere = np.full((5, 3), np.nan)
    assert not rises(made.time, heights, nowhere, NOISE_M).any()
