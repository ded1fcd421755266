"""Rigid feet that bounce off at once: what they hide is stated."""

import numpy as np
import pytest
from falling_feet import GRAVITY_M_S2, NOISE_M, falls

from hopdata.landings.contacts.bounces import bounce_errors
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
