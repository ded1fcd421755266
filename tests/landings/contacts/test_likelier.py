"""Contacts at another top of the likelihood: after a gap that hides most of the flight."""

from dataclasses import replace

import falling_feet
import numpy as np
import pytest
from falling_feet import falls

from hopdata.landings.contacts.descents import LANDED
from hopdata.landings.contacts.kink_law import FALLS, weak_priors
from hopdata.landings.contacts.law import FootHeights, Law, Trials
from hopdata.landings.contacts.likelier import _share_of_other, likelier_fits
from hopdata.landings.contacts.timing import Trial, find_all_contacts

RATE_HZ = 200.0
LANDINGS = 24
QUIET_M = 3e-4
SOFT_S = 0.009


@pytest.fixture(autouse=True)
def at_200_hz(monkeypatch):
    monkeypatch.setattr(falling_feet, "RATE_HZ", RATE_HZ)
    monkeypatch.setattr(falling_feet, "FRAMES", 100)


def soft_landings(seed):
    return falls(
        LANDINGS, seed=seed, compliance_s=SOFT_S, push_m_s2=8.0, noise_m=QUIET_M
    )


def with_gaps(made, *, seed, share=0.4, hidden=14):
    """Hide frames at some contacts, of which three to six remain before it."""
    rng = np.random.default_rng(seed)
    heights = made.heights.copy()
    after_gap = rng.random(made.contacts.shape) < share
    for landing, foot in np.argwhere(after_gap):
        touch = int(np.ceil(made.contacts[landing, foot] * RATE_HZ))
        end = touch - int(rng.integers(3, 7))
        heights[end - hidden : end, foot] = np.nan
    return heights, after_gap


def found(made, heights):
    trial = Trial(made.time, heights, made.transitions, down_height_m=0.02)
    return find_all_contacts(
        [trial],
        gravity="learned",
        window_before_s=[None],
        window_after_s=[None],
        maximum_misfit=5.0,
    )[0]


# Without the second search they err by 15 to 20 ms, 4 to 10 stated errors.
@pytest.mark.parametrize("seed", [1, 3, 6])
def test_soft_contacts_after_a_gap_err_by_no_more_than_stated(seed):
    made = soft_landings(seed)
    heights, after_gap = with_gaps(made, seed=seed)
    contacts = found(made, heights)
    assert (contacts.status == LANDED).all()
    off = contacts.instant - made.contacts
    stated = np.hypot(contacts.se, contacts.common)
    assert np.abs(off).max() < 3e-3
    assert np.abs(off / stated).max() < 3.5
    rms = np.sqrt(np.mean((off / stated)[after_gap] ** 2))
    assert 0.4 < rms < 1.2


def trials_of(made, heights):
    earliest = made.contacts - 0.012
    feet = FootHeights(made.time, heights, (0.08, 0.05), earliest)
    return Trials.of([feet], [LANDINGS])


def known_law():
    return (Law(weak_priors(3, FALLS), QUIET_M, SOFT_S, pushes=False),)


def free_falls():
    return falls(LANDINGS, seed=7, compliance_s=SOFT_S, noise_m=QUIET_M)


def test_a_contact_at_a_lower_top_is_moved_and_others_stay():
    made = free_falls()
    trials = trials_of(made, made.heights)
    right = trials.fits(made.contacts, known_law())
    start = made.contacts.copy()
    start[5, 1] += 0.02
    wrong = trials.fits(start, known_law())
    assert abs(wrong.instant[5, 1] - made.contacts[5, 1]) > 0.01
    mended = likelier_fits(trials, wrong, known_law())
    np.testing.assert_allclose(mended.instant, right.instant, atol=1e-4)
    np.testing.assert_allclose(mended.unit_se, right.unit_se, rtol=0.05)


def test_lawful_contacts_without_gaps_are_not_touched():
    made = free_falls()
    trials = trials_of(made, made.heights)
    fits = trials.fits(made.contacts, known_law())
    assert likelier_fits(trials, fits, known_law()) is fits


def test_a_gap_alone_moves_nothing_where_there_is_one_top():
    made = free_falls()
    heights, after_gap = with_gaps(made, seed=2)
    assert after_gap.sum() > 10
    trials = trials_of(made, heights)
    fits = trials.fits(made.contacts, known_law())
    again = likelier_fits(trials, fits, known_law())
    np.testing.assert_allclose(again.instant, fits.instant, atol=1e-4)
    np.testing.assert_allclose(again.unit_se, fits.unit_se, rtol=0.05)


def test_of_two_tops_the_likelier_and_wider_one_weighs_more():
    made = free_falls()
    trials = trials_of(made, made.heights)
    first = trials.fits(made.contacts, known_law())
    likelier = replace(first, evidence=first.evidence - 8 * QUIET_M**2)
    wider = replace(first, unit_se=3 * first.unit_se)
    share = _share_of_other(trials, first, first, known_law())
    np.testing.assert_allclose(share, 0.5)
    share = _share_of_other(trials, first, likelier, known_law())
    np.testing.assert_allclose(share, np.exp(4) / (1 + np.exp(4)))
    share = _share_of_other(trials, first, wider, known_law())
    np.testing.assert_allclose(share, 0.75)
