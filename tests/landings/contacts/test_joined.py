"""Feet of several markers: their position, and when the first marker touches."""

from itertools import permutations

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
from hopdata.landings.contacts.joined import (
    _earlier,
    first_marker,
    first_of,
    join_feet,
    parts_of_feet,
)
from hopdata.landings.contacts.judged import NO_MARKER
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


def test_the_earliest_of_several_does_not_depend_on_their_order():
    rng = np.random.default_rng(2)
    means = rng.uniform(0.0, 4.0, (50, 4))
    sds = rng.uniform(0.3, 3.0, (50, 4))
    landed = np.full((50, 4), LANDED)
    too_high = np.full((50, 4), -np.inf)
    mean, sd, _ = first_of(means, sds, landed, too_high)
    for order in permutations(range(4)):
        turned = [values[:, order] for values in (means, sds, landed, too_high)]
        other_mean, other_sd, _ = first_of(*turned)
        np.testing.assert_array_equal(other_mean, mean)
        np.testing.assert_array_equal(other_sd, sd)
    # Clark's formula by itself does: taken from the latest on, it is far from the mark.
    drawn = (means + sds * rng.standard_normal((20_000, 50, 4))).min(axis=2)
    np.testing.assert_allclose(sd, drawn.std(axis=0), rtol=0.2)
    latest_first = np.argsort(-means, axis=1)
    ordered = [np.take_along_axis(one, latest_first, axis=1) for one in (means, sds)]
    found = ordered[0][:, 0], ordered[1][:, 0]
    for part in range(1, 4):
        found = _earlier(*found, ordered[0][:, part], ordered[1][:, part])
    assert np.abs(found[1] / sd - 1).max() > 0.05


@pytest.mark.parametrize(
    ("toe", "common", "probability"),
    [
        ((1.03, 0.001, LANDED, 0.9), (0.003, 0.004), 1.0),
        # What the markers share with their own other contacts only may part them.
        ((1.03, 0.001, LANDED, 0.9), (0.03, 0.04), 0.726),
        ((1.001, 0.001, LANDED, 0.9), (0.0, 0.0), 0.760),
        ((np.nan, np.nan, NOT_LANDED, 0.9), (0.03, 0.04), 1.0),
        # One that is lost from sight may have touched as soon as it was low enough.
        ((np.nan, np.nan, MISSING, 1.001), (0.0, 0.0), 0.760),
        ((np.nan, np.nan, MISSING, 1.02), (0.0, 0.0), 1.0),
    ],
)
def test_the_first_marker_is_as_sure_as_the_errors_allow(toe, common, probability):
    heel = (1.0, 0.001, LANDED, 0.9)
    for order in ([0, 1], [1, 0]):
        both = [heel, toe][order[0]], [heel, toe][order[1]]
        known = [np.array([column]) for column in zip(*both, strict=True)]
        marker, found = first_marker(*known, np.array(common)[order])
        assert marker.tolist() == [order.index(0)]
        np.testing.assert_allclose(found, probability, atol=5e-4)


def test_a_foot_of_which_no_marker_landed_has_no_first_and_one_has_no_other():
    nothing = np.full((1, 2), np.nan)
    common = np.full(2, 0.001)
    status = np.array([[NOT_LANDED, MISSING]])
    marker, probability = first_marker(nothing, nothing, status, nothing, common)
    assert marker.tolist() == [NO_MARKER]
    assert np.isnan(probability).all()
    one = np.ones((1, 1))
    marker, probability = first_marker(one, one, one.astype(int) * LANDED, one, one[0])
    assert marker.tolist() == [0]
    assert np.isnan(probability).all()


def test_contacts_do_not_depend_on_the_order_of_the_markers(opensim_files):
    (file,) = [one for one in opensim_files if one.name == "walk_free_01.trc"]
    walk = hd.read(file)
    places = ["Heel", "Toe.Tip", "Toe.Lat", "Toe.Med"]
    feet = {name: [f"{name[0]}.{one}" for one in places] for name in ("Right", "Left")}
    first = hd.contacts(walk, feet=feet).table
    assert len(first) == 2
    turned = {"Right": [feet["Right"][k] for k in (1, 3, 0, 2)], "Left": feet["Left"]}
    again = hd.contacts(walk, feet=turned).table
    pd.testing.assert_frame_equal(again, first, rtol=1e-12)
    other_file = walk[walk.markers[::-1]]
    again = hd.contacts(other_file, feet=feet).table
    pd.testing.assert_frame_equal(again, first, rtol=1e-12)
