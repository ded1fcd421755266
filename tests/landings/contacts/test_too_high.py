"""A contact at which the foot is still too high, by its speed there, is refuted."""

import os

import numpy as np
import pytest

from hopdata.landings.contacts.too_high import low_enough_from

RATE_HZ = 150.0
NOISE_M = 0.0003
CONTACT_S = 0.5
TIME = np.arange(120) / RATE_HZ
SEEDS = range(100 if "ALL" in os.environ else 10)


def seen(height_m, seed=0, noise_m=NOISE_M):
    return height_m + np.random.default_rng(seed).normal(0.0, noise_m, len(TIME))


def slowed_heel():
    """Return a heel that a leg slows from 1.3 to 0.35 m/s, 17 mm up, m."""
    until_s = np.maximum(CONTACT_S - TIME, 0.0)
    speeds_up = np.maximum(until_s - 0.05, 0.0)
    faster_m = 0.95 * (speeds_up - 0.02 * -np.expm1(-speeds_up / 0.02))
    return 0.35 * until_s + faster_m


def soft(softness_s, speed_m_s, creeps_m_s=0.02):
    before_s = np.minimum(TIME - CONTACT_S, 0.0)
    after_s = np.maximum(TIME - CONTACT_S, 0.0)
    left_m = speed_m_s * softness_s * np.exp(-after_s / softness_s)
    creeps_m = creeps_m_s * np.maximum(0.1 - after_s, 0.0)
    return left_m - speed_m_s * before_s + creeps_m


@pytest.mark.parametrize("seed", SEEDS)
def test_a_heel_that_a_leg_slows_above_the_floor_has_not_touched_there(seed):
    height = seen(slowed_heel(), seed)
    low_from_s = low_enough_from(TIME, height, CONTACT_S - 0.045, NOISE_M)
    assert low_from_s is not None
    assert CONTACT_S - 0.03 < low_from_s < CONTACT_S
    assert low_enough_from(TIME, height, CONTACT_S - 0.001, NOISE_M) is None


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("softness_s", [0.001, 0.005, 0.01])
@pytest.mark.parametrize("speed_m_s", [0.3, 1.0, 3.0])
def test_no_sound_contact_is_refuted_however_soft(softness_s, speed_m_s, seed):
    height = seen(soft(softness_s, speed_m_s), seed)
    assert low_enough_from(TIME, height, CONTACT_S, NOISE_M) is None


def test_a_toe_that_tilts_below_the_floor_has_touched():
    tilts_m = 0.2 * np.clip(TIME - CONTACT_S - 0.02, 0.0, 0.05)
    height = 0.003 + np.maximum(CONTACT_S - TIME, 0.0) - tilts_m
    stands_s = CONTACT_S + 0.012
    assert low_enough_from(TIME, height, stands_s, NOISE_M) is None
    assert low_enough_from(TIME, height + 0.01, stands_s, NOISE_M) is not None


def test_a_foot_that_bounces_has_touched():
    since_s = TIME - CONTACT_S
    bounces_m = 0.4 * since_s * (0.03 - since_s) / 0.03
    bounces_m[(since_s < 0) | (since_s > 0.03)] = 0.0
    height = np.maximum(-since_s, 0.0) + bounces_m
    assert low_enough_from(TIME, height + 0.001, CONTACT_S, NOISE_M) is None


def test_what_is_not_seen_refutes_no_contact():
    height = slowed_heel()
    height[TIME > CONTACT_S - 0.04] = np.nan
    assert low_enough_from(TIME, height, CONTACT_S - 0.045, NOISE_M) is None
