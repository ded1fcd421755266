"""What is told of feet that bounce, of doubted frames and of another rate."""

import os
import tomllib
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from checkouts import ROOT
from scipy.interpolate import CubicSpline

import hopdata as hd
from hopdata.arrays import GRAVITY_M_S2
from hopdata.landings.contacts.find import find_landings
from hopdata.landings.contacts.remarks import (
    BOUNCES,
    EXCHANGED,
    FILLED,
    LEAST_DEPTH_M,
    OF_FEET,
    SINKS_ON,
    SPIKES,
    SPRINGS_BACK,
    contact_remarks,
    one_for_all_feet,
)
from hopdata.landings.floor import fit_floor, level
from hopdata.messages import ENGLISH, Message, _templates

HOPS = 14
FEW_LANDINGS = [2, 5, 9]
STANDS_S = 0.2
GAP = 3  # frames on either side of a contact


@cache
def hopping(seed):
    """Return a recording whose feet are stiff and stand, and its true contacts."""
    recording, truth = hd.synthesize("quadruped", simulation={"hops": HOPS}, seed=seed)
    return recording, truth.contact_times


def moved(recording, foot, change):
    """Return the recording with other positions of a foot."""
    marker = recording.markers.index(foot)
    positions = recording.positions.copy()
    positions[:, marker] = change(positions[:, marker])
    return replace(recording, positions=positions)


def bouncing(recording, foot, instants, high_m):
    """Let a foot bounce after each contact, each time 0.4 times as fast."""
    above = np.zeros(len(recording.time))
    for instant in instants:
        begin_s = instant
        speed = np.sqrt(2 * GRAVITY_M_S2 * high_m)
        for _ in range(5):
            s = recording.time - begin_s
            height = speed * s - GRAVITY_M_S2 * s**2 / 2
            above += np.where(s > 0, np.maximum(height, 0.0), 0.0)
            begin_s += 2 * speed / GRAVITY_M_S2
            speed *= 0.4
    return moved(recording, foot, lambda track: track + np.outer(above, [0, 0, 1]))


def sinking_on(recording, foot, instants, *, depth_m, constant_s):
    """Let a foot sink exponentially after its contacts, until it is off the floor."""
    since = np.maximum(recording.time[:, None] - instants, 0.0)
    back = np.clip((since - STANDS_S) / STANDS_S, 0.0, 1.0)
    sunk = depth_m * (1 - np.exp(-since / constant_s)) * (1 - back)
    sunk_m = sunk.sum(axis=1)
    return moved(recording, foot, lambda track: track - np.outer(sunk_m, [0, 0, 1]))


def dipping(recording, foot, instants, depth_m):
    """Let a foot sink after its contacts and come back, deepest after 20 ms."""
    after = np.maximum(recording.time[:, None] - instants, 0.0) / 0.02
    sunk = (depth_m * after * np.exp(1 - after)).sum(axis=1)
    return moved(recording, foot, lambda track: track - np.outer(sunk, [0, 0, 1]))


def about(recording, instant):
    """Return the frames about an instant."""
    frame = int(np.searchsorted(recording.time, instant))
    return slice(frame - GAP, frame + GAP)


def with_filled_gaps(recording, foot, instants):
    """Hide a foot at its contacts, and fill the gaps with a spline."""
    hidden = np.zeros(len(recording.time), dtype=bool)
    for instant in instants:
        hidden[about(recording, instant)] = True

    def fill(track):
        time = recording.time
        spline = CubicSpline(time[~hidden], track[~hidden])
        return np.where(hidden[:, None], spline(time), track)

    return moved(recording, foot, fill)


def with_exchanged_names(recording, feet, instants):
    positions = recording.positions.copy()
    one, other = (recording.markers.index(foot) for foot in feet)
    for instant in instants:
        frames = about(recording, instant)
        positions[frames, one] = recording.positions[frames, other]
        positions[frames, other] = recording.positions[frames, one]
    return replace(recording, positions=positions)


def with_spikes(recording, foot, instants, *, after_s, size_m=0.03, seed=0):
    """Move a foot in one frame about each of its contacts, by so much, anywhere."""
    rng = np.random.default_rng(seed)

    def move(track):
        track = track.copy()
        for instant in instants:
            frame = int(np.searchsorted(recording.time, instant + after_s))
            way = rng.normal(size=3)
            track[frame] += size_m * way / np.linalg.norm(way)
        return track

    return moved(recording, foot, move)


def at_another_rate(recording, rate_hz):
    """Bring positions to another rate by straight lines."""
    count = int((recording.time[-1] - recording.time[0]) * rate_hz)
    time = recording.time[0] + np.arange(count) / rate_hz
    positions = np.empty((count, *recording.positions.shape[1:]))
    for at in np.ndindex(positions.shape[1:]):
        track = recording.positions[(slice(None), *at)]
        positions[(slice(None), *at)] = np.interp(time, recording.time, track)
    return hd.Recording.from_arrays(
        time,
        positions,
        list(recording.markers),
        feet=list(recording.names("foot")),
        body=list(recording.names("body")),
        name=recording.name,
    )


def told(*recordings):
    """Return the remarks on recordings that are timed together, with their tables."""
    found = hd.contacts(list(recordings))
    return list(found.messages), found


def test_of_feet_that_stand_and_were_seen_nothing_is_told():
    for seed in range(3):
        remarks, _ = told(hopping(seed)[0])
        assert not remarks


def test_a_foot_that_bounces_is_told_with_the_error_of_its_contacts():
    recording, contact_s = hopping(1)
    foot = recording.names("foot")[1]
    remarks, found = told(bouncing(recording, foot, contact_s[:, 1], 0.01))
    (remark,) = remarks
    own = found.table[found.table["foot"] == foot]
    assert remark.code == BOUNCES
    assert remark.values["foot"] == foot
    assert remark.values["landings"] == own["found"].sum() > HOPS / 2
    assert remark.values["ms"] == 1e3 * own["common_s"].iloc[0] > 1.0
    assert f"{foot} bounces" in str(remark)


def test_a_foot_that_sinks_on_is_not_said_to_bounce():
    recording, contact_s = hopping(1)
    foot = recording.names("foot")[1]
    sunk = sinking_on(recording, foot, contact_s[:, 1], depth_m=0.01, constant_s=0.015)
    remarks, found = told(sunk)
    (remark,) = remarks
    own = found.table[found.table["foot"] == foot]
    assert remark.code == SINKS_ON
    assert remark.values["foot"] == foot
    assert remark.values["ms"] == 1e3 * own["common_s"].iloc[0]
    # An exponential of 10 mm is 2 mm above its end in the mean from 15 to 50 ms.
    assert 0.5 < remark.values["mm"] < 2.0
    assert f"{foot} sinks on after its contacts" in str(remark)


@pytest.mark.parametrize(
    ("depth_m", "codes"), [(0.0, []), (0.0003, []), (0.001, [SPRINGS_BACK])]
)
def test_a_dip_is_told_where_it_can_be_seen(depth_m, codes):
    recording, truth = hd.synthesize(
        "quadruped",
        simulation={"hops": HOPS},
        motion_capture={"noise_m": 1e-4},
        seed=1,
    )
    foot = recording.names("foot")[1]
    remarks, _ = told(dipping(recording, foot, truth.contact_times[:, 1], depth_m))
    assert [one.code for one in remarks] == codes
    assert all(one.values["mm"] > 1e3 * LEAST_DEPTH_M for one in remarks)


@pytest.mark.parametrize("code", [BOUNCES, SINKS_ON, SPRINGS_BACK])
def test_an_error_below_a_millisecond_is_not_told_as_none(code):
    values = {"foot": "a", "landings": 7, "often": "7 landings", "ms": 0.32, "mm": 1.0}
    one = Message(code, values)
    (several,) = one_for_all_feet([one, one])
    for remark in (one, several):
        assert "0.32 ms" in str(remark)


#: Spikes before, at and after the contact; each takes 14 s, so the last two with `ALL=1`.
SPIKES_S = [-0.025, 0.0, 0.02] if "ALL" in os.environ else [-0.025]


@pytest.mark.parametrize("after_s", SPIKES_S)
def test_spikes_in_one_foot_are_told_and_spoil_no_contact(after_s):
    recording, contact_s = hopping(1)
    foot = recording.names("foot")[1]
    clean = hd.contacts(recording).table
    spoilt = with_spikes(recording, foot, contact_s[:, 1], after_s=after_s)
    remarks, found = told(spoilt)
    (remark,) = remarks
    assert remark.code == SPIKES
    assert remark.values["foot"] == foot
    assert remark.values["landings"] == len(contact_s)
    both = clean.merge(found.table, on=["landing", "foot"], suffixes=("", "_spoilt"))
    assert len(both) == len(clean) == both["found_spoilt"].sum()
    moved_by = (both["contact_s_spoilt"] - both["contact_s"]).abs() / both["se_s"]
    # The foot itself has one frame less of some tens.
    assert moved_by[both["foot"] != foot].max() < 0.5
    assert moved_by[both["foot"] == foot].max() < 3.0


def test_several_feet_that_bounce_are_told_in_one_remark():
    recording, contact_s = hopping(1)
    feet = recording.names("foot")[:3]
    for k, foot in enumerate(feet):
        recording = bouncing(recording, foot, contact_s[:, k], 0.01)
    remarks, _ = told(recording)
    assert [one.code for one in remarks] == 3 * [BOUNCES]
    (remark,) = one_for_all_feet(remarks)
    assert remark.code == OF_FEET[BOUNCES]
    for one in remarks:
        assert "{foot} ({landings} landings,".format_map(one.values) in str(remark)
    # What concerns one foot, or no foot, is told as it is.
    other = Message("landings.no_landing", {"recording": "a"})
    assert one_for_all_feet([remarks[0], other]) == [remarks[0], other]


def test_frames_that_were_filled_in_are_told_with_their_landings():
    recording, contact_s = hopping(1)
    foot = recording.names("foot")[0]
    instants = contact_s[FEW_LANDINGS, 0]
    remarks, _ = told(with_filled_gaps(recording, foot, instants))
    (remark,) = remarks
    assert (remark.code, remark.values["foot"]) == (FILLED, foot)
    assert remark.values["landings"] == len(FEW_LANDINGS)
    gap_ms = 1e3 * 2 * GAP / recording.rate_hz
    assert abs(remark.values["ms"] - gap_ms) < 1e-6


def test_exchanged_feet_are_told_with_their_landings():
    recording, contact_s = hopping(1)
    feet = recording.names("foot")[:2]
    instants = contact_s[FEW_LANDINGS, :2].mean(axis=1)
    remarks, _ = told(with_exchanged_names(recording, feet, instants))
    assert [one.code for one in remarks] == [EXCHANGED, EXCHANGED]
    assert [one.values["foot"] for one in remarks] == list(feet)
    assert {one.values["landings"] for one in remarks} == {len(FEW_LANDINGS)}


def test_landings_of_several_recordings_are_added():
    recording, contact_s = hopping(1)
    foot = recording.names("foot")[0]
    one = with_filled_gaps(recording, foot, contact_s[[3], 0])
    other = with_filled_gaps(recording, foot, contact_s[[4, 7], 0])
    remarks, _ = told(one, hopping(2)[0], replace(other, name="other"))
    (remark,) = remarks
    assert (remark.code, remark.values["landings"]) == (FILLED, 3)


def test_another_rate_is_told_with_the_error_of_all_contacts():
    recording, _ = hopping(1)
    resampled = at_another_rate(recording, 1.3 * recording.rate_hz)
    remarks, found = told(resampled)
    (remark,) = [one for one in remarks if one.code == "landings.contacts_resampled"]
    assert remark.values["recordings"] == 1
    assert remark.values["ms"] > 0.5
    assert (1e3 * found.table["common_s"] >= remark.values["ms"] - 1e-9).all()


def test_of_contacts_by_another_method_nothing_is_told():
    recording, contact_s = hopping(1)
    foot = recording.names("foot")[0]
    filled = with_filled_gaps(recording, foot, contact_s[FEW_LANDINGS, 0])
    standing = level(filled, fit_floor(filled))
    by_kink = find_landings(standing)
    assert contact_remarks([standing], [by_kink])
    printed = find_landings(standing, method="velocity_minimum")
    assert not contact_remarks([standing], [printed])


def test_a_common_error_is_told_in_the_same_words_as_what_to_do_about_it():
    """One said early or late, the other that all are early."""
    advice = (ROOT / "packaging" / "what_to_do.toml").read_text(encoding="utf-8")
    of_landings = tomllib.loads(advice)["landings"]
    for name in ("foot_springs_back", "feet_spring_back"):
        told = _templates("landings", ENGLISH)[name]
        assert "err alike, all early or all late" in told
        assert "err alike" in of_landings[name]
        assert "early" not in of_landings[name]
