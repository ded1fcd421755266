"""Exports of Motive, Nexus, DeepLabCut and Anipose, written as those programs write them."""

from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from checkouts import ROOT
from csv_files import motive, nexus
from keypoint_files import (
    anipose,
    columns,
    deeplabcut,
    pandas_blocks,
    pandas_rows,
    table,
)

from hopdata.errors import RecordingError
from hopdata.recordings.readers.formats import read_raw

NAMES = ("hip", "knee", "toe")


def track(n=30, seed=0):
    """Return positions (n, 3, 3), mm, with the knee hidden for two frames."""
    positions = np.random.default_rng(seed).uniform(-500, 900, (n, 3, 3)).round(3)
    positions[4:6, 1] = np.nan
    return positions


def read(folder, text, **options):
    file = folder / "monday.csv"
    file.write_bytes(text.encode())
    return read_raw(file, **options)


@pytest.mark.parametrize("unit", ["Millimeters", "Centimeters", "Meters"])
@pytest.mark.parametrize("code", [False, True])
def test_motive_markers_in_the_file_s_unit(tmp_path, unit, code):
    found = read(tmp_path, motive(track(), NAMES, unit=unit, code=code))
    assert found.markers == NAMES
    assert found.rate_hz == 100.0
    millimetres = found.positions * (1e3 if found.unit == "m" else 1.0)
    np.testing.assert_allclose(millimetres, track(), atol=1e-3)
    np.testing.assert_allclose(found.time, np.arange(30) / 100, atol=1e-12)
    assert "1 unlabeled" in found.remarks[0]


def test_motive_solved_markers_only_where_there_are_no_others(tmp_path):
    text = motive(track(), NAMES, kind="Rigid Body Marker").replace(
        "Unlabeled 1042", ""
    )
    text = text.replace(",Marker,Marker,Marker\r\n", ",Bone,Bone,Bone\r\n")
    found = read(tmp_path, text)
    assert found.markers == ("pelvis:Marker1", *NAMES)
    assert any("solved" in remark for remark in found.remarks)


def test_motive_solved_markers_beside_others_are_said_to_be_left_out(tmp_path):
    found = read(tmp_path, motive(track(), NAMES))
    assert found.markers == NAMES
    assert any(
        "1 solved markers are left out (pelvis:Marker1)" in x for x in found.remarks
    )
    found = read(tmp_path, motive(track(), ("pelvis:Marker1", *NAMES[1:])))
    assert not any("solved markers" in remark for remark in found.remarks)


def test_motive_rate_of_the_configuration_must_agree(tmp_path):
    with pytest.raises(RecordingError, match=r"expected 100 Hz as in its time stamps"):
        read(tmp_path, motive(track(), NAMES), rate_hz=120.0)


@pytest.mark.parametrize("others", [False, True])
def test_nexus_trajectories_beside_other_sections(tmp_path, others):
    found = read(tmp_path, nexus(track(), NAMES, others=others))
    assert found.markers == NAMES
    np.testing.assert_allclose(found.positions, track())
    assert found.time[0] == 0.0
    told = " ".join(map(str, found.remarks))
    assert ("Devices" in told) == others
    assert told.count("without 'cat:'") == 1, "the names in the file are longer"


def test_nexus_two_animals_keep_their_names_apart(tmp_path):
    found = read(tmp_path, nexus(track(), NAMES, subjects=("cat", "dog")))
    assert "without" not in " ".join(map(str, found.remarks))
    assert found.markers[:1] + found.markers[3:4] == ("cat:hip", "dog:hip")


@pytest.mark.parametrize("write", [deeplabcut, anipose])
def test_keypoints_that_are_not_sure_count_as_unseen(tmp_path, write):
    scores = np.full((30, 3), 0.95)
    scores[10, 2] = 0.3
    found = read(tmp_path, write(track(), NAMES, scores), rate_hz=50.0)
    want = track()
    want[10, 2] = np.nan
    np.testing.assert_allclose(found.positions, want)
    assert found.markers == NAMES
    assert "1 of 90" in found.remarks[-1]
    lenient = read(
        tmp_path, write(track(), NAMES, scores), rate_hz=50.0, least_score=0.2
    )
    np.testing.assert_allclose(lenient.positions, track())


def test_keypoints_state_no_rate(tmp_path):
    with pytest.raises(RecordingError, match=r"input\.rate_hz"):
        read(tmp_path, anipose(track(), NAMES, np.ones((30, 3))))


@pytest.mark.parametrize("name", ["t_ms", "Time [ms]", "Timestamp"])
def test_a_clock_in_another_unit_is_named_where_no_rate_is_given(tmp_path, name):
    rows = anipose(track(), NAMES, np.ones((30, 3))).splitlines()
    clock = [name, *(f"{25 * k}" for k in range(30))]
    text = "\n".join(f",{c},{row}" for c, row in zip(clock, rows, strict=True))
    with pytest.raises(RecordingError, match=r"column Time \(in s\)") as caught:
        read(tmp_path, text)
    assert f"found '{name}', which is not read" in str(caught.value)
    np.testing.assert_allclose(read(tmp_path, text, rate_hz=40.0).positions, track())


def test_a_clock_among_further_columns_is_the_time(tmp_path):
    rows = anipose(track(), NAMES, np.ones((30, 3))).splitlines()
    clock = ["Time (s)", *(f"{7 + k / 40:.3f}" for k in range(30))]
    found = read(
        tmp_path, "\n".join(f",{c},{row}" for c, row in zip(clock, rows, strict=True))
    )
    np.testing.assert_allclose(found.time, 7 + np.arange(30) / 40)
    np.testing.assert_allclose(found.positions, track())


@pytest.mark.parametrize("clock", [False, True])
def test_comments_above_a_table_are_passed_over(tmp_path, clock):
    names = [f"{name}_{axis}" for name in NAMES for axis in "xyz"]
    rows = [names, *([f"{x:.6f}" for x in row] for row in track().reshape(30, 9))]
    first = ["time", *(f"{k / 50:.2f}" for k in range(30))]
    lines = [
        ",".join([f, *row] if clock else row)
        for f, row in zip(first, rows, strict=True)
    ]
    found = read(tmp_path, "\n".join(["# by Ada, at noon", *lines]), rate_hz=50.0)
    np.testing.assert_allclose(found.positions, track(), atol=1e-6)


def test_one_camera_s_plane_is_refused(tmp_path):
    lines = deeplabcut(track(), NAMES).splitlines()
    plane = [
        ",".join(c for k, c in enumerate(x.split(",")) if k % 3 or not k) for x in lines
    ]
    with pytest.raises(RecordingError, match=r"one camera's plane; triangulate"):
        read(tmp_path, "\n".join(plane), rate_hz=50.0)


@pytest.mark.parametrize("write", [pandas_rows, pandas_blocks])
def test_keypoints_in_pandas_tables_of_hdf5(tmp_path, write):
    scores = np.full((30, 3), 0.95)
    scores[10, 2] = 0.3
    file = write(tmp_path / "a.h5", columns(NAMES), table(track(), scores))
    found, want = read_raw(file, rate_hz=50.0), track()
    want[10, 2] = np.nan
    np.testing.assert_allclose(found.positions, want)
    assert found.markers == NAMES
    assert found.rate_hz == 50.0
    assert not found.unit_is_stated
    with pytest.raises(RecordingError, match=r"input\.rate_hz"):
        read_raw(file)


class _Harm:
    def __reduce__(self):
        return (Path.touch, (Path("harmed"),))


def test_a_pickle_that_is_more_than_names_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    heads = [*columns(NAMES, score=""), _Harm()]
    file = pandas_rows(tmp_path / "a.h5", heads, np.zeros((3, len(heads))))
    with pytest.raises(
        RecordingError, match=r"expected names of columns, found a pickle of"
    ):
        read_raw(file, rate_hz=50.0)
    assert not Path("harmed").exists()


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda _: "a,b,c\n1,2,3\n", "line 1: expected columns <name>_x"),
        (
            lambda t: t.replace("Millimeters", "Furlongs"),
            "Length Units: expected mm, cm, m or inches",
        ),
        (
            lambda t: t.replace("0.030000", "x"),
            "line 11, column 2: expected a number, found 'x'",
        ),
        (lambda t: t[:-40], "was it cut short"),
        (lambda t: t[: t.index("\r\n0,")] + "\r\n", "expected rows of numbers"),
        (lambda t: t.replace("Frame,Time", "Fame,Time"), "expected a row Frame"),
        (lambda t: "\ufeff" + t.replace("X,Y,Z,X", "X,Z,Y,X"), "expected X, Y, Z of"),
        (lambda t: t.replace("100.000000", "fast"), "expected a number, found 'fast'"),
    ],
)
def test_faults_are_named(tmp_path, spoil, said):
    with pytest.raises(RecordingError, match=said):
        read(tmp_path, spoil(motive(track(), NAMES)))


HEADS = (
    "{} ({})",
    "{}[{}]",
    "{} {}",
    "{}-{}",
    "{}.{}.",
    "{}:{}",
    "{}_{}_mm",
    "{} {} [mm]",
)


@pytest.mark.parametrize("head", HEADS)
@pytest.mark.parametrize("first", ["Time", "Frame", "", "other"])
@pytest.mark.parametrize("axes", ["xyz", "XYZ", "zyx"])
def test_columns_name_their_axes_in_many_ways(tmp_path, head, first, axes):
    counts = {"Time": np.arange(30) / 100, "Frame": np.arange(1, 31)}.get(
        first, np.full(30, 7)
    )
    places = ["xyz".index(axis) for axis in axes.lower()]
    rows = np.column_stack([counts, track()[:, :, places].reshape(30, -1)])
    names = [first, *(head.format(name, axis) for name in NAMES for axis in axes)]
    found = read(
        tmp_path, pd.DataFrame(rows, columns=names).to_csv(index=False), rate_hz=100.0
    )
    assert found.markers == NAMES
    np.testing.assert_array_equal(found.positions, track())
    np.testing.assert_allclose(found.time, np.arange(30) / 100, atol=1e-12)
    assert found.unit_is_stated == ("mm" in head)


def test_a_unit_behind_the_names_is_taken(tmp_path):
    head = [f"{name}_{axis} (m)" for name in NAMES for axis in "xyz"]
    rows = pd.DataFrame(track().reshape(30, -1) / 1e3, columns=head)
    found = read(tmp_path, rows.to_csv(index=False), rate_hz=100.0)
    assert (found.unit, found.unit_is_stated) == ("m", True)
    with pytest.raises(RecordingError, match="found 'm, mm'"):
        read(
            tmp_path,
            rows.rename(columns={head[0]: "hip_x (mm)"}).to_csv(),
            rate_hz=100.0,
        )


def wide(index="", axes="xyz", columns=(None, None)):
    by = pd.MultiIndex.from_product([NAMES, list(axes)], names=columns)
    return pd.DataFrame(
        track().reshape(30, -1),
        columns=by,
        index=pd.RangeIndex(5, 35, name=index or None),
    )


@pytest.mark.parametrize("index", ["", "frame"])
@pytest.mark.parametrize("columns", [(None, None), ("marker", "axis")])
@pytest.mark.parametrize("axes", ["xyz", "XYZ"])
def test_names_may_stand_above_axes(tmp_path, index, columns, axes):
    found = read(tmp_path, wide(index, axes, columns).to_csv(), rate_hz=100.0)
    assert found.markers == NAMES
    np.testing.assert_array_equal(found.positions, track())


def test_a_first_frame_that_shows_nothing_is_no_row_of_names(tmp_path):
    blind = wide("frame")
    blind.iloc[0] = np.nan
    for text in (blind.to_csv(), blind.rename_axis(None).to_csv()):
        assert len(read(tmp_path, text, rate_hz=100.0).positions) == 30


@pytest.mark.parametrize("step", [1, 2])
def test_rows_that_pandas_dropped_are_missing_frames(tmp_path, step):
    kept = wide()[::step].drop(index=[5 + 4 * step, 5 + 9 * step])
    found = read(tmp_path, kept.to_csv(), rate_hz=100.0)
    np.testing.assert_allclose(
        100 * found.time, np.delete(np.arange(30 // step), [4, 9])
    )


def test_names_may_stand_once_above_their_axes_after_frame_and_time(tmp_path):
    rows = np.column_stack(
        [np.arange(30) + 3, np.arange(30) / 50, track().reshape(30, -1)]
    )
    kept = np.delete(rows, 10, axis=0)
    text = pd.DataFrame(kept).to_csv(index=False, header=False)
    head = (
        "Frame,Time," + ",,,".join(NAMES) + ",,\n" + ",," + ",".join("XYZ" * 3) + "\n"
    )
    found = read(tmp_path, head + text)
    assert (found.markers, found.rate_hz) == (NAMES, 50.0)
    np.testing.assert_allclose(
        found.time, np.delete(np.arange(30) / 50, 10), atol=1e-12
    )
    found = read(tmp_path, head.replace("Time", "sync") + text, rate_hz=50.0)
    np.testing.assert_allclose(
        found.time, np.delete(np.arange(30) / 50, 10), atol=1e-12
    )


def test_an_empty_line_below_the_axes_moves_no_column(tmp_path):
    rows = np.column_stack([np.arange(30), np.arange(30) / 50, track().reshape(30, -1)])
    text = pd.DataFrame(rows).to_csv(index=False, header=False)
    head = (
        "Frame,Time," + ",,,".join(NAMES) + ",,\n" + ",," + ",".join("XYZ" * 3) + "\n"
    )
    for line in ("\n", "," * 10 + "\n", "frame" + "," * 10 + "\n"):
        try:
            found = read(tmp_path, head + line + text, rate_hz=50.0)
        except RecordingError:
            continue
        np.testing.assert_array_equal(found.positions, track())


def test_a_long_table_is_told_how_to_become_a_wide_one(tmp_path):
    frames, markers = np.repeat(np.arange(30), 3), np.tile(NAMES, 30)
    places = dict(zip("xyz", track().reshape(-1, 3).T, strict=True))
    table = pd.DataFrame({"frame": frames, "marker": markers} | places)
    with pytest.raises(
        RecordingError, match=r"found one for each marker \(docs/formats.md "
    ):
        read(tmp_path, table.to_csv(index=False))
    recipe = ".pivot(index='frame', columns='marker', values=['x', 'y', 'z']).swaplevel(axis=1)"
    assert recipe in (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    arranged = table.pivot(index="frame", columns="marker", values=["x", "y", "z"])  # noqa: PD010
    found = read(tmp_path, arranged.swaplevel(axis=1).to_csv(), rate_hz=100.0)
    assert found.markers == NAMES
    np.testing.assert_array_equal(found.positions, track())


@pytest.mark.parametrize(
    "content", ["hello world\n", "", "subject,time,marker,x,y,z\nA,0,L,1,2,3\n"]
)
def test_a_foreign_table_is_refused_in_one_short_line(tmp_path, content):
    """They were up to 300 characters long: the exports are listed in the documentation."""
    with pytest.raises(RecordingError) as refused:
        read(tmp_path, content)
    told = str(refused.value).replace(f"{tmp_path}", "")
    assert len(told) <= 160
    assert "expected" in told
    assert "found" in told
    assert "docs/formats.md" in told


def test_two_columns_of_one_name_are_refused(tmp_path):
    text = wide().to_csv().replace("knee", "hip")
    with pytest.raises(RecordingError, match="an export listed"):
        read(tmp_path, text, rate_hz=100.0)
    one = pd.DataFrame(
        track().reshape(30, -1), columns=[f"a_{axis}" for axis in "xyz" * 3]
    )
    with pytest.raises(
        RecordingError, match="distinct names of columns, found 'a' twice"
    ):
        read(tmp_path, one.to_csv(), rate_hz=100.0)


def kinetics_toolkit(positions, names, *, fourth=1.0):
    """Return what Kinetics Toolkit saves of a time series of markers, in m."""
    last = np.full((len(positions), len(names), 1), fourth)
    points = np.concatenate([positions, last], axis=2).reshape(len(positions), -1)
    head = ["Time", *(f"{name}[{k}]" for name in names for k in range(4)), "effort"]
    rows = np.column_stack(
        [np.arange(len(positions)) / 100, points, np.zeros(len(positions))]
    )
    return pd.DataFrame(rows, columns=head).to_csv(index=False)


def test_points_of_kinetics_toolkit(tmp_path):
    found = read(tmp_path, kinetics_toolkit(track() / 1000, NAMES))
    assert (found.markers, found.unit, found.rate_hz) == (NAMES, "m", 100.0)
    np.testing.assert_allclose(found.positions, track() / 1000, atol=1e-12)
    assert "no markers are left out: effort" in found.remarks[0]
    with pytest.raises(
        RecordingError, match=r"line 2: .*\[3\]: expected 1, as of a point, found 0"
    ):
        read(tmp_path, kinetics_toolkit(track() / 1000, NAMES, fourth=0.0))


def sleap(path, tracks, names=None):
    """Write what SLEAP's triangulation writes: frames, animals, nodes, coordinates."""
    with h5py.File(path, "w") as file:
        file["tracks"] = tracks
        if names is not None:
            file["node_names"] = [name.encode() for name in names]
    return path


def test_triangulated_points_of_sleap(tmp_path):
    tracks = track()[:, None].copy()
    tracks[3, 0, 1] = np.nan
    found = read_raw(sleap(tmp_path / "points3d.h5", tracks, NAMES), rate_hz=50.0)
    assert found.markers == NAMES
    np.testing.assert_array_equal(found.positions, tracks[:, 0])
    pair = np.concatenate([tracks, tracks + 1], axis=1)
    two = read_raw(sleap(tmp_path / "two.h5", pair), rate_hz=50.0)
    assert two.markers[0] == "animal 1 node 1"
    assert two.markers[-1] == f"animal 2 node {len(NAMES)}"
    np.testing.assert_array_equal(two.positions[:, len(NAMES) :], tracks[:, 0] + 1)


def test_one_camera_of_sleap_is_told_to_be_triangulated(tmp_path):
    plane = np.zeros((1, 2, 3, 30))
    with pytest.raises(
        RecordingError, match=r"frames x animals x nodes x 3, .* triangulate"
    ):
        read_raw(sleap(tmp_path / "one.analysis.h5", plane), rate_hz=50.0)
    with pytest.raises(RecordingError, match="node_names': expected 3 names, found 2"):
        read_raw(sleap(tmp_path / "a.h5", track()[:, None], ("a", "b")), rate_hz=50.0)
