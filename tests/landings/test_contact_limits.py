"""Contact instants against the Cramer-Rao bound, on feet whose contacts are known exactly."""

import numpy as np
import pytest
from falling_feet import NOISE_M, RATE_HZ, SPEED_M_S, falls

from hopdata.landings.approach import LANDED
from hopdata.landings.contacts import LONG_WINDOWS_S, find_contacts
from hopdata.landings.kink_bound import mean_kink_bound
from hopdata.landings.kink_recording import FootHeights, Law, learned_law, weak_priors
from hopdata.landings.schedules import order_probability

FIRST_MEASURED_MS = {"known": 0.49, "learned": 0.49, "free": 0.84}


def found(feet, gravity="learned", **options):
    return find_contacts(
        feet.time, feet.heights, feet.transitions, down_height_m=0.015, gravity=gravity, **options
    )


def errors_ms(feet, contacts):
    assert (contacts.status == LANDED).mean() > 0.999
    error = 1e3 * (contacts.instant - feet.contacts)
    return error[np.isfinite(error).all(axis=1)]


def right(feet, contacts):
    order, truth = (np.argsort(x, axis=1) for x in (contacts.instant, feet.contacts))
    return (order == truth).all(axis=1)


def covered(feet, contacts):
    error = contacts.instant - feet.contacts
    return np.nanmean(np.abs(error - np.nanmean(error)) < contacts.se)


def bound_ms(gravity, **options):
    return 1e3 * mean_kink_bound(
        rate_hz=RATE_HZ,
        windows_s=LONG_WINDOWS_S,
        noise_m=NOISE_M,
        velocity_m_s=-SPEED_M_S,
        known_gravity=gravity != "free",
        **options,
    )


@pytest.fixture(scope="module")
def hard():
    return falls(2000, seed=21)


@pytest.mark.parametrize(("gravity", "share"), [("known", 0.95), ("learned", 0.95), ("free", 0.91)])
def test_hard_contacts(hard, gravity, share):
    contacts = found(hard, gravity)
    error = errors_ms(hard, contacts)
    assert error.std() <= 1.1 * FIRST_MEASURED_MS[gravity]
    assert error.std() <= 1.1 * bound_ms(gravity)
    assert abs(error.mean()) < 0.1
    assert 0.63 < covered(hard, contacts) < 0.73
    chance = np.sqrt(share * (1 - share) / len(hard.contacts))
    assert right(hard, contacts).mean() > share - 2 * chance
    sure = order_probability(contacts.instant, contacts.se) >= 0.9
    assert sure.mean() > 0.75
    chance = np.sqrt(0.99 * 0.01 / sure.sum())
    assert right(hard, contacts)[sure].mean() > 0.99 - 2 * chance


def test_contacts_5_ms_apart_are_told_apart():
    feet = falls(500, seed=22, apart_s=0.005)
    for gravity in ("known", "free"):
        assert right(feet, found(feet, gravity)).mean() > 0.99


@pytest.mark.parametrize("gravity", ["known", "learned"])
def test_three_frames_missing_at_each_contact(gravity):
    feet = falls(1200, seed=23, missing=3)
    contacts = found(feet, gravity)
    assert errors_ms(feet, contacts).std() < 0.77  # 0.75 in the mean; sampling error 0.01
    assert 0.63 < covered(feet, contacts) < 0.75


@pytest.mark.parametrize(
    "law",
    [{"compliance_s": 0.005}, {"creep_m_s": -0.02}, {"compliance_s": 0.005, "creep_m_s": 0.02}],
)
@pytest.mark.parametrize("gravity", ["known", "free"])
def test_soft_contacts_and_creep(law, gravity):
    feet = falls(800, seed=24, **law)
    contacts = found(feet, gravity)
    error = errors_ms(feet, contacts)
    assert error.std() < 1.1 * bound_ms(gravity, **law)
    assert abs(error.mean()) < 0.5  # ignored, a compliance of 5 ms delays by more than 5 ms
    assert 0.63 < covered(feet, contacts) < 0.75


def law_of(feet):
    near = feet.contacts + 0.002
    heights = FootHeights(feet.time, feet.heights, LONG_WINDOWS_S)
    start = Law(weak_priors(3, "learned"), NOISE_M)
    return learned_law(heights, heights.first_fits(near, start).instant, start, own=True)


def test_the_law_has_the_parts_that_the_feet_have():
    hard = law_of(falls(300, seed=25))
    assert (hard.compliance_s, hard.creeps, hard.pushes) == (0.0, False, False)
    assert hard.priors.mean[:, 0] == pytest.approx([-9.81] * 3, abs=0.3)
    soft = law_of(falls(300, seed=26, compliance_s=0.005))
    assert soft.compliance_s == pytest.approx(0.005, abs=0.001)
    assert not soft.creeps
    creeping = law_of(falls(300, seed=27, creep_m_s=-0.02))
    assert creeping.compliance_s == 0.0
    assert creeping.creeps
    assert creeping.priors.mean[:, -1] == pytest.approx([-0.02] * 3, abs=0.005)


def test_the_printed_method_is_far_from_the_limit(hard):
    whole, parabola = (
        found(hard, method=f"velocity_minimum{kind}").instant - hard.contacts
        for kind in ("", "_parabola")
    )
    assert 1e3 * np.std(whole) > 3.0
    assert 1e3 * np.std(parabola) > 1.1
