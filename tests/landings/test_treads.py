"""Feet that rest at many heights, as on stairs: each tread is a floor of its own."""

import numpy as np
import pytest

import hopdata as hd
from hopdata.landings.floor import fit_floor, level
from hopdata.landings.treads import without_treads

RATE_HZ = 100.0
STEP_S = 0.5
SWING_S = 0.4
NOISE_M = 5e-4
SPEED_M_S = 0.8  # of a foot at its contact


def stairs(seed, *, rise_m, steps=10):
    """Return two feet that step on treads in turn, each a step farther up or down.

    With it come the contacts of both, s.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(round((steps + 3) * STEP_S * RATE_HZ)) / RATE_HZ
    tracks = np.zeros((len(time), 2, 3))
    contacts = [[], []]
    tread = [0, 0]
    for step in range(steps):
        foot = step % 2
        contact_s = 1.0 + step * STEP_S + rng.uniform(0, 0.02)
        rises_m = (step + 1 - tread[foot]) * rise_m
        begin_s = contact_s - SWING_S
        u = np.clip((time - begin_s) / SWING_S, 0, 1)
        # It rises, and falls onto the tread without slowing down before.
        swing = 0.5 * SPEED_M_S * SWING_S * (4 * u * (1 - u)) / 2
        swing += rises_m * (3 * u**2 - 2 * u**3)
        tracks[:, foot, 2] += swing
        tracks[:, foot, 0] += 0.3 * (step + 1 - tread[foot]) * (u > 0) * u
        tread[foot] = step + 1
        contacts[foot].append(contact_s)
    tracks += rng.normal(0, NOISE_M, tracks.shape)
    tracks[:, 1, 1] += 0.2
    recording = hd.Recording.from_arrays(
        time, tracks, ["left", "right"], feet=["left", "right"], name="stairs"
    )
    return recording, contacts


@pytest.mark.parametrize("rise_m", [-0.17, 0.15])
def test_each_tread_is_a_floor_and_all_its_contacts_are_found(rise_m):
    recording, contacts = stairs(1, rise_m=rise_m)
    levelled = level(recording, fit_floor(recording))
    on_one_floor, (message,) = without_treads(levelled)
    assert message.code == "landings.treads"
    np.testing.assert_allclose(on_one_floor.positions[-50:, :, 2], 0.0, atol=0.01)
    found = hd.contacts(recording)
    assert "landings.treads" in [one.code for one in found.messages]
    for foot, true_s in zip(("left", "right"), contacts, strict=True):
        own = found.found[found.found["foot"] == foot]
        apart_s = own["contact_s"].to_numpy()[:, None] - np.array(true_s)
        assert (np.abs(apart_s).min(axis=0) < 0.01).sum() >= len(true_s) - 1
        assert (np.abs(apart_s).min(axis=1) < 0.01).all()


def test_level_steps_have_no_treads():
    recording, _ = stairs(2, rise_m=0.0)
    levelled = level(recording, fit_floor(recording))
    same, messages = without_treads(levelled)
    assert same is levelled
    assert not messages


def test_a_box_is_no_stairs_but_its_rests_are_counted():
    recording, contacts = stairs(3, rise_m=0.0, steps=16)
    positions = recording.positions.copy()
    for contact_s in contacts[0][1:7:2]:  # every other contact of a foot
        since_s = recording.time - contact_s
        positions[(since_s > -0.2) & (since_s < 2 * STEP_S - 0.2), 0, 2] += 0.3
    on_box = hd.Recording.from_arrays(
        recording.time, positions, ["left", "right"], feet=["left", "right"]
    )
    floor = fit_floor(on_box)
    levelled = level(on_box, floor)
    same, (message,) = without_treads(levelled)
    assert same is levelled
    assert message in floor.messages
    assert message.code == "landings.rests_elsewhere"
    assert message.values["rests"] == "3 rests"
    assert message.values["low_m"] == pytest.approx(0.3, abs=0.01)
