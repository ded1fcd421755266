"""Markers that share a name: one marker twice, or markers of both feet."""

import numpy as np
import pytest
from made_up_people import person

from hopdata.recordings.quality.every_foot import every_foot
from hopdata.recordings.quality.inspection import inspect_recording
from hopdata.recordings.quality.roles import guess_roles
from hopdata.recordings.quality.shared_names import repeated, sharing
from hopdata.recordings.quality.vocabulary import named_parts
from hopdata.recordings.raw import RawRecording

SETS = ["Plug-in Gait", "Rizzoli", "Qualisys"]
SEEDS = (11, 12)


def pair_on_feet(made):
    """Return the names of the first place that is marked on both feet."""
    for name in made.names:
        other = "R" + name[1:]
        if name.startswith("L") and name in made.feet and other in made.names:
            return name, other
    raise AssertionError


def sides(inspection, feet):
    """Return the sides on which feet are."""
    named = named_parts(tuple(inspection.markers))
    return {named.sides[inspection.markers.index(name)] for name in feet}


def read(made, names, positions):
    time = np.arange(len(positions)) / made.rate_hz
    raw = RawRecording(tuple(names), time, positions, made.rate_hz, "m")
    inspection = inspect_recording(raw, unit="m", up="z")
    return inspection, guess_roles(inspection)


@pytest.mark.parametrize("marker_set", SETS)
@pytest.mark.parametrize("posture", ["jump", "walk"])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_marker_of_the_other_foot_by_its_name_stays_on_its_foot(
    marker_set, posture, seed
):
    made = person(seed, posture, marker_set, seconds=4.0)
    left, right = pair_on_feet(made)
    renamed = {left: f"{right} 1", right: f"{right} 2"}
    back = {new: old for old, new in renamed.items()}
    sound = read(made, made.names, made.positions)
    _, joined_before = every_foot(*sound)
    names = [renamed.get(name, name) for name in made.names]
    _, joined = every_foot(*read(made, names, made.positions))
    assert set(joined) == set(joined_before)
    assert {side: [back.get(n, n) for n in own] for side, own in joined.items()} == (
        joined_before
    )


@pytest.mark.parametrize("marker_set", SETS)
@pytest.mark.parametrize("posture", ["jump", "run", "walk"])
@pytest.mark.parametrize("seed", [12])
def test_a_marker_that_occurs_twice_leaves_both_feet(marker_set, posture, seed):
    made = person(seed, posture, marker_set, seconds=4.0)
    before = read(made, made.names, made.positions)
    twice, _ = pair_on_feet(made)
    m = made.names.index(twice)
    noise = np.random.default_rng(seed).normal(0, 5e-4, (len(made.positions), 1, 3))
    positions = np.concatenate([made.positions, made.positions[:, [m]] + noise], axis=1)
    names = [f"{name} 1" if name == twice else name for name in made.names]
    inspection, after = read(made, [*names, f"{twice} 2"], positions)
    assert repeated(inspection) == {len(names)}
    feet, _ = every_foot(inspection, after)
    assert f"{twice} 2" not in feet
    assert sides(inspection, feet) == sides(before[0], every_foot(*before)[0])


def test_numbered_names_of_different_markers_are_kept():
    made = person(11, "walk", "Qualisys")
    names = [f"marker {m + 1}" for m in range(len(made.names))]
    assert sharing(names) == [list(range(len(names)))]
    inspection, _ = read(made, names, made.positions)
    assert repeated(inspection) == set()
