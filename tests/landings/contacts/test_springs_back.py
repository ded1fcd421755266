"""Feet that sink after their contacts and spring back: what they hide is stated."""

import numpy as np
import pytest
from falling_feet import NOISE_M, RATE_HZ, falls

from hopdata.landings.contacts.springs_back import springs_back, springs_back_errors
from hopdata.landings.contacts.timing import find_contacts

TURNS_S = 0.02


def sinking(depth_m, *, seed, landings=40, compliance_s=0.0):
    """Let feet that stopped sink by a depth, and spring back."""
    made = falls(landings, seed=seed, compliance_s=compliance_s)
    since = made.time.reshape(landings, -1, 1) - made.contacts[:, None]
    after = np.maximum(since, 0.0) / TURNS_S
    sunk = depth_m * after * np.exp(1 - after)
    return made, made.heights - sunk.reshape(-1, 3)


@pytest.mark.parametrize("depth_m", [0.001, 0.003])
def test_errors_are_no_larger_than_stated(depth_m):
    ratios = []
    for seed in range(3):
        made, heights = sinking(depth_m, seed=seed)
        found = find_contacts(made.time, heights, made.transitions, down_height_m=0.02)
        stated = np.hypot(found.se, found.common)
        ratios.append(np.nanmean(((found.instant - made.contacts) / stated) ** 2))
    assert np.sqrt(np.max(ratios)) < 1.25


def test_the_depth_is_told_and_feet_that_stand_have_none():
    false_alarms = 0
    for seed in range(5):
        made, heights = sinking(0.002, seed=seed)
        depth_m = springs_back(made.time, heights, made.contacts, NOISE_M)
        np.testing.assert_allclose(depth_m, 0.0018, atol=4e-4)
        for compliance_s in (0.0, 0.004):
            still = falls(40, seed=seed, compliance_s=compliance_s, creep_m_s=-0.01)
            found = springs_back(still.time, still.heights, still.contacts, NOISE_M)
            false_alarms += int((found > 0).sum())
    assert false_alarms <= 1  # of 30


def test_a_foot_that_leaves_the_floor_has_not_sprung_back_above_its_rest():
    made = falls(40, seed=1, stands_s=0.06)
    assert not springs_back(made.time, made.heights, made.contacts, NOISE_M).any()


def test_a_foot_that_sinks_and_stays_down_has_not_sprung_back():
    made = falls(40, seed=1)
    since = made.time.reshape(40, -1, 1) - made.contacts[:, None]
    sunk = 0.002 * (1 - np.exp(-np.maximum(since, 0.0) / 0.01))
    heights = made.heights - sunk.reshape(-1, 3)
    assert not springs_back(made.time, heights, made.contacts, NOISE_M).any()


def test_the_compliance_counts_only_as_far_as_the_depth_explains_it():
    error_s = springs_back_errors(
        np.array([0.0, 1e-4, 2e-3]), np.full(3, 2.0), np.array([5e-3, 5e-3, 2e-3])
    )
    expected_s = [0.0, np.hypot(2e-4, 5e-5), np.hypot(2e-3, 1e-3)]
    np.testing.assert_allclose(error_s, expected_s)


def test_a_foot_that_is_never_seen_after_a_contact_tells_nothing():
    made, heights = sinking(0.003, seed=1, landings=5)
    late = made.time[-1] + np.full((5, 3), 1 / RATE_HZ)
    assert not springs_back(made.time, heights, late, NOISE_M).any()
    nowhere = np.full((5, 3), np.nan)
    assert not springs_back(made.time, heights, nowhere, NOISE_M).any()
