"""Recordings as tables and labelled arrays, and back without a changed bit."""

from dataclasses import fields, replace

import numpy as np
import pandas as pd
import pytest

import hopdata as hd
from hopdata.errors import ArgumentError, HopdataError
from hopdata.recording import Event


def recording():
    """Return 40 frames with gaps, a pause, odd names, and every part of a recording."""
    rng = np.random.default_rng(3)
    time = np.arange(40) / 119.88
    time[20:] += 240 / 119.88
    positions = rng.normal(size=(40, 5, 3))
    positions[3:7, 1] = np.nan
    filled = np.zeros((40, 5), bool)
    filled[8, 2] = True
    made = hd.Recording(
        name="monday",
        time=time,
        positions=positions,
        markers=("hip 1", "hip 2", "hüfte", "heel", "toe"),
        roles=("body", "body", "body", "foot", "foot"),
        rate_hz=119.88,
        source="a.c3d",
        source_sha256="ab",
        vertical_axis="y",
        events=(Event("strike", 0.1),),
        remarks=("a remark",),
        filled=filled,
        other_feet=("paw",),
    )
    return made.with_roles(feet={"left": ["heel", "toe"]})


def assert_same(found, expected, without=()):
    for one in fields(expected):
        value = getattr(expected, one.name)
        if one.name in without:
            continue
        if isinstance(value, np.ndarray):
            assert getattr(found, one.name).tobytes() == value.tobytes(), one.name
        else:
            assert getattr(found, one.name) == value, one.name


def test_a_table_brings_a_recording_back_bit_by_bit():
    made = recording()
    assert_same(hd.Recording.from_pandas(made.to_pandas("long")), made)
    wide = made.to_pandas()
    assert_same(hd.Recording.from_pandas(wide), made, without=["filled"])
    assert wide["heel"]["z"].to_numpy().tolist() == made["heel"][:, 2].tolist()
    assert wide.index.name == "time_s"
    shuffled = made.to_pandas("long").sample(frac=1.0, random_state=1)
    again = hd.Recording.from_pandas(shuffled)
    order = [again.markers.index(name) for name in made.markers]
    assert again.positions[:, order].tobytes() == made.positions.tobytes()
    # A changed copy is the user's own.
    wide.iloc[0, 0] = 99.0
    assert made.positions[0, 0, 0] != 99.0


def test_a_table_without_attributes_takes_names_and_roles_of_the_call():
    made = recording()
    plain = pd.DataFrame(made.to_pandas("long").drop(columns=["role", "filled"]))
    plain.attrs = {}
    seen = plain.dropna()
    again = hd.Recording.from_pandas(seen, feet=["toe"], name="friday")
    assert again.names("foot") == ("toe",)
    assert again.name == "friday"
    assert again.roles.count("other") == 4
    assert np.isnan(again["hip 2"][3:7]).all()
    assert again.rate_hz == pytest.approx(119.88, rel=1e-6)


def test_every_second_row_has_half_the_rate():
    made = recording()
    table = made.to_pandas().iloc[:20:2]
    assert hd.Recording.from_pandas(table).rate_hz == pytest.approx(59.94)


def test_a_dataset_of_movement_brings_a_recording_back_bit_by_bit():
    pytest.importorskip("xarray")
    made = recording()
    data = made.to_xarray()
    assert data["position"].dims == ("time", "space", "keypoints", "individuals")
    assert data["confidence"].dims == ("time", "keypoints", "individuals")
    assert data.attrs["ds_type"] == "poses"
    assert data.attrs["time_unit"] == "seconds"
    assert_same(hd.Recording.from_xarray(data), made)
    foot = data["position"].sel(keypoints="heel", space="z", individuals="id_0")
    np.testing.assert_array_equal(foot, made["heel"][:, 2])
    turned = data["position"].transpose("keypoints", "individuals", "time", "space")
    bare = hd.Recording.from_xarray(turned.isel(space=[2, 0, 1]))
    assert bare.positions.tobytes() == made.positions.tobytes()
    assert bare.roles == made.roles
    # Attributes of a file hold no objects.
    assert all(isinstance(one, str | float) for one in data.attrs.values())


def test_a_dataset_of_two_animals_in_frames():
    xarray = pytest.importorskip("xarray")
    positions = np.random.default_rng(0).normal(size=(6, 3, 2, 2))
    data = xarray.Dataset(
        {"position": (("time", "space", "keypoints", "individuals"), positions)},
        coords={
            "time": np.arange(6),
            "space": list("xyz"),
            "keypoints": ["toe", "hip"],
            "individuals": ["anna", "ben"],
        },
        attrs={"time_unit": "frames", "fps": 50.0},
    )
    found = hd.Recording.from_xarray(data, individual="ben", feet=["toe"])
    assert found.rate_hz == 50.0
    np.testing.assert_array_equal(found["toe"], positions[:, :, 0, 1])
    for wrong, told in (
        (data, "individual: expected one of anna, ben"),
        (data.isel(individuals=0, space=[0, 1]), "space: expected the axes x, y and z"),
        (data.drop_vars("position"), "data: expected a variable 'position'"),
        (
            data.isel(individuals=0).assign_attrs(fps=0),
            "time_unit: expected seconds, found frames without",
        ),
        (data["position"].isel(individuals=0, time=0), "data: expected the dimensions"),
        (positions, "data: expected an xarray.Dataset"),
    ):
        with pytest.raises(HopdataError, match=told):
            hd.Recording.from_xarray(wrong)


def test_wrong_tables_are_told():
    made = recording()
    long = made.to_pandas("long")
    for wrong, told in (
        (made.positions, "table: expected a DataFrame"),
        (long.drop(columns="z_m"), "none named z_m"),
        (pd.concat([long, long.iloc[[7]]]), "one row for each time and marker"),
        (made.to_pandas().iloc[:, 1:], "x, y and z of each marker once, found hip 1 x"),
        (made.to_pandas().iloc[::-1], "time: expected two frames or more"),
    ):
        with pytest.raises(HopdataError, match=told):
            hd.Recording.from_pandas(wrong)
    unsure = recording().to_pandas("long").astype({"filled": object})
    assert hd.Recording.from_pandas(unsure).filled.sum() == 1
    for unknown in (np.nan, "False"):
        unsure.loc[7, "filled"] = unknown
        with pytest.raises(HopdataError, match=f"filled: expected .*found {unknown}"):
            hd.Recording.from_pandas(unsure)
    with pytest.raises(HopdataError, match="layout: expected one of wide, long"):
        made.to_pandas("tall")


def test_markers_and_spans_of_a_recording():
    made = recording()
    assert made["toe"].base is not None  # its own memory, so it can be changed in place
    two = made[["toe", "hip 1"]]
    assert two.markers == ("toe", "hip 1")
    assert two.roles == ("foot", "body")
    assert two.filled.shape == (40, 2)
    assert two.joined == ()
    assert "toe" in made
    assert "nose" not in made
    assert made[:10].time.tolist() == made.time[:10].tolist()
    span = made.between(made.time[5], made.time[9])
    assert span.time.tolist() == made.time[5:10].tolist()
    assert len(made.between(end_s=0.05).time) == 6
    assert len(made.between(1.0).time) == 20
    for wrong, told in (
        (lambda: made["tow"], "did you mean 'toe'"),
        (lambda: made[3], "the name of a marker"),
        (lambda: made[["toe", "toe"]], "each name once"),
        (lambda: made.between(0.3, 2.0), "two frames or more; .* at 0 to 2.3"),
        (lambda: made.between("a"), "begin_s: expected a time in s"),
    ):
        with pytest.raises(HopdataError, match=told):
            wrong()
    with pytest.raises(ArgumentError):
        made.between(end_s=float("nan"))


def test_roles_are_given_one_by_one_or_together():
    bare = replace(recording(), roles=("other",) * 5, joined=(), filled=None)
    assert bare.with_roles(feet=["toe"]).roles == ("foot",) + 4 * ("other",)
    both = bare.with_roles(feet=["toe", "heel"], body=["hip 2", "hüfte", "hip 1"])
    assert both.markers == ("hip 2", "hüfte", "hip 1", "toe", "heel")
    np.testing.assert_array_equal(both["heel"], bare["heel"])
    # A role that is not given stays, but for a marker that is given another.
    other = both.with_roles(body=["heel", "hip 1", "hip 2"])
    assert other.names("foot") == ("toe",)
    assert other.names("other") == ("hüfte",)
    assert both.with_roles(feet=[]).names("foot") == ()
    for wrong, told in (
        ({"feet": "toe"}, "feet: expected a list of marker names"),
        ({"feet": ["to"]}, "did you mean 'toe'"),
        ({"feet": ["toe"], "body": ["toe"]}, "body and feet: expected each name once"),
        ({"feet": {"left": []}}, "feet.left: expected a marker or several"),
        ({"foot": ["toe"]}, "did you mean 'feet'"),
    ):
        with pytest.raises(HopdataError, match=told):
            bare.with_roles(**wrong)


def test_a_recording_is_drawn_where_the_user_wants():
    from matplotlib.figure import Figure

    made = recording()
    lines = made.plot().axes[0].lines
    assert len(lines) == 3  # two feet, and the mean of the body
    np.testing.assert_array_equal(lines[1].get_ydata(), made["heel"][:, 2])
    mine = Figure()
    left, right = mine.subplots(1, 2)
    assert made.plot(["toe"], ax=left) is left
    assert len(left.lines) == 1
    assert not right.lines
