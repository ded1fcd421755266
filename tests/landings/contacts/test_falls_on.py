"""A heel that slows as its toe touches, and falls on, is timed when it stops."""

import os

import numpy as np
import pytest

from hopdata.landings.contacts.descents import LANDED
from hopdata.landings.contacts.falls_on import later_contact
from hopdata.landings.contacts.timing import find_contacts
from hopdata.landings.contacts.where import whole_spans

RATE_HZ = 200.0
NOISE_M = 0.0003
SPEED_M_S = 3.3
FIRST_S = 0.5012
TIME = np.arange(200) / RATE_HZ
SEEDS = range(3 if "ALL" in os.environ else 1)


def seen(height_m, seed):
    noise = np.random.default_rng(seed).normal(0.0, NOISE_M, len(TIME))
    return height_m + noise


def heel(lag_s, *, slower=1.25, seed=0):
    """Return a heel that slows to a speed at the first kink, and stops after a lag."""
    left_s = np.maximum(FIRST_S + lag_s - TIME, 0.0)
    falls_m = slower * left_s
    return seen(falls_m + (SPEED_M_S - slower) * np.maximum(FIRST_S - TIME, 0.0), seed)


def soft(softness_s, *, creeps_m_s=0.0, seed=0):
    """Return a foot that yields within a time, and sinks on evenly."""
    before_s = np.minimum(TIME - FIRST_S, 0.0)
    after_s = np.maximum(TIME - FIRST_S, 0.0)
    yields_m = SPEED_M_S * softness_s * -np.expm1(-after_s / softness_s)
    return seen(-SPEED_M_S * before_s - yields_m - creeps_m_s * after_s, seed)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("lag_s", [0.018, 0.03])
def test_the_second_kink_is_found_with_an_honest_error(lag_s, seed):
    found = later_contact(TIME, heel(lag_s, seed=seed), FIRST_S, NOISE_M)
    assert found is not None
    instant_s, se_s = found
    assert abs(instant_s - FIRST_S - lag_s) < 3 * se_s
    assert 0.0002 < se_s < 0.003


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("softness_s", [0.001, 0.005, 0.01])
@pytest.mark.parametrize("creeps_m_s", [0.0, 0.05])
def test_a_foot_that_the_floor_stops_has_no_second_kink(softness_s, creeps_m_s, seed):
    height = soft(softness_s, creeps_m_s=creeps_m_s, seed=seed)
    assert later_contact(TIME, height, FIRST_S, NOISE_M) is None


def test_a_foot_that_rolls_down_slowly_keeps_its_contact():
    height = heel(0.04, slower=0.3)
    assert later_contact(TIME, height, FIRST_S, NOISE_M) is None


@pytest.mark.parametrize("lag_s", [0.0, 0.025])
def test_no_heel_is_timed_early_beyond_its_error(lag_s):
    n = 12
    heights = np.concatenate([heel(lag_s, seed=100 * one + 5) for one in range(n)])
    time = np.arange(len(heights)) / RATE_HZ
    begin_s = 0.2 + np.arange(n)
    spans = whole_spans(np.stack([begin_s, begin_s + 0.5], axis=1))
    found = find_contacts(time, heights[:, None], spans, down_height_m=0.02)
    assert (found.status == LANDED).all()
    error_s = found.instant[:, 0] - FIRST_S - lag_s - np.arange(n)
    assert np.abs(error_s / np.hypot(found.se[:, 0], found.common[0])).max() < 3
