"""The bodies on which the verdict is tested: their motion, and their true differences."""

import os
from dataclasses import fields, replace

import numpy as np
import pytest
from bodies import SATURATING, SESSIONS, Body, body_of_size
from body_motion import GRAVITY, LEGS, rotation
from body_seen import FAULTS, Seen, study

from hopdata.maps.coordinates import rigid_states, section_coordinates
from hopdata.maps.truth.maps import marker_motions, marker_states


def some(body, n=40, seed=1, session="steady"):
    return body.landings(n, np.random.default_rng(seed), SESSIONS[session])


#: One that slides compiles three bodies in 17 s: with `ALL=1`.
SOME_LEGS = LEGS if "ALL" in os.environ else LEGS[1:]


@pytest.mark.parametrize("leg", SOME_LEGS)
def test_a_body_without_a_mechanism_has_one_derivative(leg):
    body = Body(1, leg=leg, scatter_m=0.004)
    truth = body.truth(some(body))
    assert truth.kink < 1e-3
    assert truth.jump < 1e-5
    clutch = replace(body, mechanism="clutch", strength=0.3)
    truth = clutch.truth(some(clutch))
    assert truth.kink > 0.1
    assert truth.jump < 1e-4
    rank = replace(body, mechanism="rank", strength=0.5)
    assert rank.truth(some(rank)).jump > 0.01


def test_the_kink_of_a_clutch_is_that_of_second_differences():
    """Slopes on either side of the level landing, without a foot being displaced."""
    body = Body(2, "clutch", feet=2, leg="sliding", strength=0.4)
    landings = some(body, 400)
    h = 1e-5
    around = np.vstack([np.zeros(14), h * np.eye(14)[:8], -h * np.eye(14)[:8]])
    y, instants, _, whole = body.land(body.mean + around)
    assert whole.all()
    ahead, behind = y[1:9], y[9:]
    apart = instants[:, 0] - instants[:, 1]
    towards = np.sign(np.round(apart[1:9], 12))
    bends = (ahead + behind - 2.0 * y[0]) / h * towards[:, None]
    slopes = (ahead - behind) / (2 * h)

    motions = marker_motions(body.markers)
    covariance = np.cov(landings.inputs[:, :8].T)
    changes = np.diag(motions @ bends.T @ covariance @ bends @ motions.T)
    common = np.diag(motions @ slopes.T @ covariance @ slopes @ motions.T)
    positions = changes[:5].sum() / common[:5].sum()
    velocities = changes[5:].sum() / common[5:].sum()
    expected = np.sqrt(0.5 * positions + 0.5 * velocities)
    assert expected > 0.1
    assert body.truth(landings).kink == pytest.approx(expected, rel=0.01)


def test_a_mechanism_that_saturates_differs_less_on_average():
    body = Body(1, "sated", strength=0.2)
    truth = body.truth(some(body), over=20)
    assert "sated" in SATURATING
    assert 0.0 < truth.averaged < 0.6 * truth.kink
    steady = Body(1, "clutch", strength=0.2)
    truth = steady.truth(some(steady), over=20)
    assert truth.averaged == pytest.approx(truth.kink, rel=0.2)


def test_a_body_has_the_size_that_is_asked_for():
    body = body_of_size(0.3, landings=100, seed=5, mechanism="clutch")
    assert body.truth(some(body, 300)).kink == pytest.approx(0.3, rel=0.15)
    assert body_of_size(0.3, seed=5, mechanism="c1").strength == 0.0


@pytest.mark.parametrize("leg", LEGS)
def test_the_motion_at_given_instants_is_that_of_the_landing(leg):
    """The outcome agrees with that of steps of other lengths, through known contacts."""
    body = Body(3, "clutch", leg=leg, strength=0.5, scatter_m=0.005)
    landings = some(body, 20)
    exact = marker_states(landings.outcomes, body.markers)
    near = study(body, landings, *quiet(blur_s=1e-7)).y - exact
    # The marker states are at height zero, and RK4 errs by some 1e-7 m/s.
    assert np.ptp(near, axis=0).max() < 1e-6
    filtered = study(body, landings, *quiet(blur_s=0.026)).y - exact
    assert np.ptp(filtered, axis=0).max() > 1e-3


def quiet(**seen):
    return np.random.default_rng(1), Seen(noise_m=0.0, **seen)


def test_contacts_and_feet_are_where_the_states_say():
    """Without noise a foot falls from where it is seen to the floor in its own time."""
    body = Body(4, scatter_m=0.004)
    landings = some(body)
    seen = study(body, landings, *quiet())
    markers = seen.x[:, :9].reshape(-1, 3, 3)
    np.testing.assert_allclose(markers.mean(axis=1), 0.0, atol=1e-12)
    first = seen.instants.argmin(axis=1)
    rows = np.arange(len(first))
    foot = seen.feet[rows, first]
    state = landings.inputs
    turns = [rotation(0.0, pitch, roll) for pitch, roll in state[:, :2]]
    spin = np.einsum("nij,nj->ni", turns, state[:, 5:8])
    falling = state[:, 4] + np.cross(spin, foot)[:, 2]
    t = seen.instants[rows, first]
    fall = body.top_m + foot[:, 2] + falling * t - 0.5 * GRAVITY * t**2
    np.testing.assert_allclose(fall, 0.0, atol=3e-4)  # the body goes on turning
    # The verdict finds the very inputs and outcomes in the marker states.
    x, y = section_coordinates(
        rigid_states(seen.x, body.markers), rigid_states(seen.y, body.markers)
    )
    np.testing.assert_allclose(x[:, 5:], state[:, 5:8], atol=1e-6)
    np.testing.assert_allclose(y[:, :2], landings.outcomes[:, :2], atol=1e-2)


def test_spread_and_scatter_are_those_asked_for():
    for spread_s in (0.004, 0.015):
        body = Body(6, spread_s=spread_s)
        landings = some(body, 300)
        heights = study(body, landings, *quiet()).feet[:, :, 2]
        falling = (
            heights / body.mean[4]
        )  # landings that are far from level are not whole
        rms = np.sqrt(np.mean(np.var(falling, axis=1)))
        assert rms == pytest.approx(spread_s, rel=0.15)
        righted = np.sqrt(np.mean(np.var(landings.instants, axis=1)))
        assert 0.5 * rms < righted < rms
    scattered = some(Body(6, scatter_m=0.010), 300)
    assert scattered.inputs[:, 8:].std() == pytest.approx(0.010, rel=0.1)


def test_draws_repeat_and_depend_on_the_seed():
    body = Body(7, "rank", strength=0.3)
    one, again, other = some(body), some(body), some(body, seed=2)
    for column in fields(one):
        same = getattr(one, column.name), getattr(again, column.name)
        np.testing.assert_array_equal(*same)
    assert not np.array_equal(one.inputs, other.inputs)
    assert Body(8).build.mass != Body(7).build.mass


def test_sessions_change_the_legs_and_only_they():
    body = Body(9)
    steady = some(body, 100)
    for name in set(SESSIONS) - {"steady"}:
        changed = some(body, 100, session=name)
        np.testing.assert_array_equal(changed.inputs[:5], steady.inputs[:5])
        assert np.abs(changed.outcomes - steady.outcomes)[-5:].max() > 1e-3
        assert np.unique(changed.blocks).size == (1 if name == "softening" else 2)


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_in_a_few_landings(fault):
    body = Body(10)
    landings = some(body, 100)
    clean = study(body, landings, *quiet())
    bad = study(body, landings, *quiet(fault=fault))
    changed = np.zeros(100, bool)
    for name in ("x", "y", "instants"):
        changed |= (getattr(bad, name) != getattr(clean, name)).any(axis=1)
    assert 2 <= changed.sum() <= 3


def test_errors_are_as_large_as_stated_and_alike_if_asked():
    body = Body(11)
    landings = some(body, 400)
    clean = study(body, landings, *quiet())
    rng = np.random.default_rng(2)
    noisy = study(body, landings, rng, Seen(noise_m=0.001))
    for name in ("instants", "feet"):
        error = (getattr(noisy, name) - getattr(clean, name)).std()
        stated = np.mean(getattr(noisy, f"{name}_se"))
        assert error == pytest.approx(stated, rel=0.05)
    alike = study(body, landings, rng, Seen(noise_m=0.001, alike=0.9))
    for one, expected in ((noisy, 0.0), (alike, 0.9)):
        error = (one.x - clean.x)[:, 0]
        found = np.corrcoef(error[1:], error[:-1])[0, 1]
        assert found == pytest.approx(expected, abs=0.12)
