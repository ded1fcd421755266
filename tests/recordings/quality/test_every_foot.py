"""All feet of a recording, and which markers belong to one foot."""

from dataclasses import replace

import numpy as np
import pytest
from made_up_hopper import MARKERS, hopping
from made_up_people import person

from hopdata.recordings.quality.every_foot import every_foot
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
