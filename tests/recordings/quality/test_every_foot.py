"""All feet of a recording, and which markers belong to one foot."""

from dataclasses import replace

import numpy as np
import pytest
from made_up_hopper import MARKERS, hopping
from made_up_people import person

from hopdata.recordings.quality.every_foot import (
    GuessedFeet,
    every_foot,
    shared_feet,
)
from hopdata.recordings.quality.inspection import inspect_recording
from hopdata.recordings.quality.roles import guess_roles
from hopdata.recordings.raw import RawRecording

SETS = ["Plug-in Gait", "Rizzoli", "Qualisys", "OpenSim"]


def runner(marker_set, *, without=""):
    """Return a runner, without the feet of one side, and the names of the others."""
    made = person(4, "run", marker_set, seconds=4.0)
    right = {name for name in made.feet if "r" in name.lower().split("foot")[0][:1]}
    away = {"right": right, "left": set(made.feet) - right, "": set()}[without]
    kept = [m for m, name in enumerate(made.names) if name not in away]
    names = tuple(made.names[m] for m in kept)
    time = np.arange(len(made.positions)) / made.rate_hz
    positions = made.positions[:, kept]
    return RawRecording(names, time, positions, made.rate_hz, "m")


def found(raw):
    inspection = inspect_recording(raw, unit="m", up="z")
    roles = guess_roles(inspection)
    return roles, *every_foot(inspection, roles)


@pytest.mark.parametrize("marker_set", SETS)
def test_the_markers_of_the_only_foot_are_one_foot(marker_set):
    for away, side in (("left", "right"), ("right", "left")):
        roles, feet, joined = found(runner(marker_set, without=away))
        assert len(feet) > 1
        assert list(joined) == [side]
        assert sorted(joined[side]) == sorted(feet)
        # The markers of a single foot are the feet of a study.
        assert roles.joined == {}


@pytest.mark.parametrize("marker_set", SETS)
def test_both_feet_are_apart(marker_set):
    _, feet, joined = found(runner(marker_set))
    assert sorted(joined) == ["left", "right"]
    assert sorted(joined["left"] + joined["right"]) == sorted(feet)


def test_heel_and_toe_without_a_side_are_one_foot():
    raw = runner("Qualisys", without="left")
    for of_foot in (["mt1", "heel"], ["mt1", "toe"]):
        plain = dict(zip(["R_FM1", "R_FM5"], of_foot, strict=True))
        named = tuple(plain.get(name, name) for name in raw.markers)
        _, feet, joined = found(replace(raw, markers=named))
        assert sorted(feet) == sorted(of_foot)
        assert list(joined.values()) == ([feet] if "heel" in of_foot else [])


def test_feet_that_jump_together_are_no_single_foot():
    time, positions = hopping(1)
    raw = RawRecording(MARKERS, time, positions, 100.0, "m")
    _, feet, joined = found(raw)
    assert feet == ["toe1", "toe2", "toe3"]
    assert joined == {}


def trot(limbs, *, seconds=8.0, rate_hz=200.0, stride_s=0.7, stance_s=0.3):
    """Return an animal at the trot: limbs 0 and 3 land, half a stride later 1 and 2.

    Each hoof has a toe and a heel; the trunk sinks in each stance.
    """
    rng = np.random.default_rng(7)
    time = np.arange(round(seconds * rate_hz)) / rate_hz
    names = []
    tracks = []
    for number, limb in enumerate(limbs):
        late_s = 0.0 if number in (0, 3) else stride_s / 2
        share = ((time - late_s) % stride_s - stance_s) / (stride_s - stance_s)
        height = 0.1 * np.sin(np.pi * np.clip(share, 0.0, 1.0))
        ahead = 0.6 - 0.8 * (number // 2)
        aside = 0.2 if number % 2 == 0 else -0.2
        for place, further in (("Hoof_toe", 0.06), ("Hoof_heel", -0.06)):
            names.append(f"{limb}_{place}")
            level = np.full_like(time, aside)
            tracks.append([np.full_like(time, ahead + further), level, 0.02 + height])
    sway = -0.03 * np.cos(4 * np.pi * (time - stance_s / 2) / stride_s)
    for name, ahead, aside in (
        ("Withers", 0.5, 0.0),
        ("Croup", -0.2, 0.0),
        ("Hip_L", -0.1, 0.2),
        ("Hip_R", -0.1, -0.2),
    ):
        names.append(name)
        level = np.full_like(time, aside)
        tracks.append([np.full_like(time, ahead), level, 1.2 - sway])
    positions = np.array(tracks).transpose(2, 0, 1)
    positions = positions + rng.normal(0, 5e-4, positions.shape)
    return RawRecording(tuple(names), time, positions, rate_hz, "m")


@pytest.mark.parametrize("limbs", [("LF", "RF", "LH", "RH"), ("FL", "FR", "HL", "HR")])
def test_all_hooves_of_a_trot_are_feet_of_two_markers(limbs):
    """A study would take one diagonal, whose hooves land together."""
    roles, feet, joined = found(trot(limbs))
    assert {name.split("_")[0] for name in roles.feet} < set(limbs)
    assert len(feet) == 8
    assert joined == {
        limb: [f"{limb}_Hoof_toe", f"{limb}_Hoof_heel"] for limb in sorted(limbs)
    }


def test_what_most_files_show_of_their_feet_holds_for_all():
    markers = ("LHEE", "LTOE", "RHEE", "RTOE", "SACR")
    joined = {"left": ["LHEE", "LTOE"], "right": ["RHEE", "RTOE"]}
    whole = GuessedFeet.of(markers, markers[:4], joined)
    odd = GuessedFeet.of(markers, ("LHEE", "LTOE", "RTOE"), {"left": joined["left"]})
    other = GuessedFeet.of(("hoof", "withers"), ("hoof",), {})
    assert shared_feet([odd, whole, other, whole]) == [whole, whole, other, whole]
    # Of two as frequent, the one with more markers.
    assert shared_feet([odd, whole]) == [whole, whole]
    assert shared_feet([odd, odd, whole]) == [odd, odd, odd]
    assert shared_feet([]) == []


LEGS = ("LF", "LM", "LH", "RF", "RM", "RH")


def tripods(names, *, seconds=8.0, rate_hz=200.0, step_s=0.5):
    """Return a walk on six feet: 0, 2 and 4 stand while 1, 3 and 5 swing."""
    time = np.arange(round(seconds * rate_hz)) / rate_hz
    rng = np.random.default_rng(11)
    tracks = []
    for k in range(6):
        share = (time / step_s + k % 2) % 2
        height = 0.03 * np.sin(np.pi * np.clip(share - 1, 0.0, 1.0)) ** 2
        # A leg swings a little further or less far in each step, as no robot's feet do.
        ahead = 0.2 * (1 - k % 3) + 0.02 * np.sin(2 * np.pi * (0.3 + 0.1 * k) * time)
        aside = np.full_like(time, 0.15 if k < 3 else -0.15)
        tracks.append([ahead, aside, height])
    for x, y in ((0.1, 0.05), (-0.1, 0.05), (0.0, -0.07)):
        bob = 0.17 + 0.01 * np.cos(2 * np.pi * time / step_s)
        tracks.append([np.full_like(time, x), np.full_like(time, y), bob])
    positions = np.array(tracks).transpose(2, 0, 1)
    positions = positions + rng.normal(0, 2e-4, positions.shape)
    return RawRecording((*names, "B1", "B2", "B3"), time, positions, rate_hz, "m")


@pytest.mark.parametrize(
    "names",
    [
        [f"foot_{leg}" for leg in LEGS],
        [f"foot_{leg}".replace("M", "C") for leg in LEGS],
        [*LEGS],
        [f"pad{letter}" for letter in "ABCDEF"],
        [f"foot_{letter}" for letter in "ABCDEF"],
    ],
    ids=lambda names: names[1],
)
def test_all_six_feet_are_timed_whatever_their_names(names):
    _, feet, joined = found(tripods(names))
    assert feet == names
    assert joined == {}
