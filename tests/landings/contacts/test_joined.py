"""Feet of several markers: their position, and when the first marker touches."""

import numpy as np
import pandas as pd
import pytest
from synthetic_landings import POST_HEIGHT_M, PRE_HEIGHT_M, simulate

import hopdata as hd
from hopdata.landings.contacts.descents import (
    ALREADY_DOWN,
    LANDED,
    MISSING,
    NOT_LANDED,
    POOR_FIT,
    RISES,
)
from hopdata.landings.contacts.joined import first_of, join_feet, parts_of_feet
from hopdata.landings.touchdowns import touchdown_table

FEET = [{"name": "left", "markers": ["foot1", "foot3"]}]
SECTIONS = {"pre_height_m": PRE_HEIGHT_M, "post_height_m": POST_HEIGHT_M}


@pytest.fixture(scope="module")
def scene():
    return simulate(120, seed=9)


def test_a_foot_is_where_its_lowest_marker_is(scene):
    recording = join_feet(scene.recording, FEET)
    assert recording.names("foot") == ("left", "foot2")
    assert recording.names("part") == ("foot1", "foot3")
    assert [
        [recording.markers[m] for m in foot] for foot in parts_of_feet(recording)
    ] == [
        ["foot1", "foot3"],
        ["foot2"],
    ]
    both = scene.recording.feet[:, [0, 2], 2]
    np.testing.assert_array_equal(recording.feet[:, 0, 2], both.min(axis=1))
    np.testing.assert_array_equal(recording.body, scene.recording.body)
    assert join_feet(scene.recording, []).markers == scene.recording.markers


def test_its_contact_is_that_of_the_first_marker(scene):
    table = touchdown_table(join_feet(scene.recording, FEET), **SECTIONS)
    first = scene.contact_times[:, [0, 2]].min(axis=1)
    error = table["contact_left_s"] - first
    assert not table["excluded"].any()
    assert error.std() < 4e-4
    assert abs(error.mean()) < 1e-4
    assert 0.6 < (error.abs() < table["se_left_s"]).mean() < 0.78
    true = np.where(first < scene.contact_times[:, 1], "1>2", "2>1")
    assert (table["schedule"] == true).mean() > 0.95


def test_the_earliest_of_two_that_are_not_known_exactly():
    rng = np.random.default_rng(1)
    means, sds = (
        np.array([[0.0, 0.5], [0.0, 9.0], [0.3, 0.3]]),
        np.array([[1.0, 0.5]] * 3),
    )
    drawn = (means + sds * rng.standard_normal((200_000, 1, 2))).min(axis=2)
    mean, sd, _ = first_of(
        means, sds, np.full((3, 2), LANDED), np.full((3, 2), -np.inf)
    )
    np.testing.assert_allclose(mean, drawn.mean(axis=0), atol=0.01)
    np.testing.assert_allclose(sd, drawn.std(axis=0), atol=0.01)


@pytest.mark.parametrize(
    ("markers", "foot"),
    [
        ((LANDED, NOT_LANDED), LANDED),
        ((NOT_LANDED, NOT_LANDED), NOT_LANDED),
        ((LANDED, ALREADY_DOWN), ALREADY_DOWN),
        ((LANDED, MISSING), MISSING),
    ],
)
def test_a_marker_that_may_have_been_first_leaves_the_contact_open(markers, foot):
    instant, se, status = first_of(
        np.array([[1.0, 2.0]]),
        np.array([[0.1, 0.1]]),
        np.array([markers]),
        np.array([[0.8, 0.9]]),
    )
    assert status[0] == foot
    assert np.isfinite(instant[0]) == np.isfinite(se[0]) == (foot == LANDED)


@pytest.mark.parametrize("heel", [MISSING, POOR_FIT, RISES])
def test_a_marker_that_was_too_high_to_be_first_leaves_it_alone(heel):
    found = first_of(
        *(np.array([x]) for x in ([1.0, 2.0], [0.1, 0.1], [LANDED, heel], [0.8, 1.4]))
    )
    np.testing.assert_array_equal(found, [[1.0], [0.1], [LANDED]])


def test_contacts_do_not_depend_on_the_order_of_the_markers(opensim_files):
    (file,) = [one for one in opensim_files if one.name == "walk_free_01.trc"]
    walk = hd.read(file)
    places = ["Heel", "Toe.Tip", "Toe.Lat", "Toe.Med"]
    feet = {name: [f"{name[0]}.{one}" for one in places] for name in ("Right", "Left")}
    first = hd.contacts(walk, feet=feet).table
    assert len(first) == 2
    turned = {"Right": [feet["Right"][k] for k in (1, 3, 0, 2)], "Left": feet["Left"]}
    # Sums in another order round otherwise, which the learning enlarges.
    again = hd.contacts(walk, feet=turned).table
    pd.testing.assert_frame_equal(again, first, rtol=1e-4)
    other_file = walk[walk.markers[::-1]]
    again = hd.contacts(other_file, feet=feet).table
    pd.testing.assert_frame_equal(again, first, rtol=1e-4)
