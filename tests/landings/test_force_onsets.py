"""Onsets of a force plate."""

import numpy as np
import pytest

from hopdata.landings.force_onsets import force_onsets

TIME = np.arange(3000) / 300


def stances(starts, length=0.25, peak=1200.0):
    since = TIME[:, None] - np.asarray(starts)
    inside = (since > 0) & (since < length)
    return np.where(inside, peak * np.sin(np.pi * since / length), 0.0).sum(axis=1)


def test_each_stance_has_one_onset_despite_noise():
    rng = np.random.default_rng(0)
    starts = 0.3 + 0.38 * np.arange(25) + rng.uniform(0, 1 / 300, 25)
    force = stances(starts) + rng.normal(0, 20, len(TIME))
    found = force_onsets(TIME, force, least_n=90.0)
    assert len(found) == 25
    assert np.std(found - starts) < 0.002
    clean = force_onsets(TIME, stances(starts), least_n=90.0)
    expected = starts + 0.25 / np.pi * np.arcsin(90 / 1200)
    np.testing.assert_allclose(clean, expected, atol=1e-4)


def test_a_stance_under_way_and_one_too_weak_have_none():
    assert len(force_onsets(TIME, stances([-0.1, 2.0]))) == 1
    assert len(force_onsets(TIME, stances([2.0], peak=300.0))) == 0
    assert len(force_onsets(TIME, np.full(len(TIME), np.nan))) == 0


def test_what_cannot_be_is_said():
    with pytest.raises(ValueError, match="3000"):
        force_onsets(TIME, np.zeros(5))
    with pytest.raises(ValueError, match="least_n below sure_n"):
        force_onsets(TIME, np.zeros(3000), least_n=500.0)
