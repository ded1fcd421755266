"""QTM's MAT exports of both kinds, written by scipy and h5py."""

import numpy as np
import pytest
from mat_files import qtm_struct, write_mat5, write_mat73
from qtm_files import NAMES, standing

from hopdata.errors import RecordingError
from hopdata.recordings.formats import read_raw

EVENTS = (("heel strike", 0.04), ("Ferse auf ü", 0.08))


def positions():
    made = standing(15)
    made[3, 1] = np.nan
    made[4, 2] = 0.0
    made[5, 0, 1] = 0.0
    return made


WRITERS = {
    "version 5": write_mat5,
    "compressed": lambda path, struct: write_mat5(path, struct, compressed=True),
    "version 7.3": write_mat73,
}


@pytest.mark.parametrize("kind", WRITERS)
def test_what_an_export_holds(tmp_path, kind):
    types = np.ones((5, 15))
    types[1, 3], types[4] = 2, 3
    struct = qtm_struct(positions(), NAMES, events=EVENTS, start=11, types=types)
    raw = read_raw(WRITERS[kind](tmp_path / "trial.mat", struct))
    assert raw.markers == NAMES
    assert (raw.rate_hz, raw.unit) == (100.0, "mm")
    assert [(e.label, e.time_s) for e in raw.events] == list(EVENTS)
    assert raw.time[0] == pytest.approx(0.1)
    assert raw.started.isoformat() == "2021-01-01T12:00:00"
    assert raw.trajectory_types == ("Measured", "Mixed", "Measured", "Measured", "Virtual")
    expected = positions()
    expected[4, 2] = np.nan
    np.testing.assert_array_equal(raw.positions, expected)
    assert "2 of 2 events lie outside" in raw.remarks[0] or raw.remarks == (), raw.remarks


@pytest.mark.parametrize("kind", WRITERS)
def test_one_marker_and_one_frame(tmp_path, kind):
    one = standing(1)[:, :1]
    raw = read_raw(WRITERS[kind](tmp_path / "a.mat", qtm_struct(one, NAMES[:1])))
    np.testing.assert_array_equal(raw.positions, one)


@pytest.mark.parametrize("kind", ["version 5", "version 7.3"])
def test_markers_of_one_name_are_numbered_and_said(tmp_path, kind):
    labels = np.array([["a", "b", "c", "b", "e"]], object)
    raw = read_raw(WRITERS[kind](tmp_path / "trial.mat", labelled(Labels=labels)))
    assert raw.markers == ("a", "b 1", "c", "b 2", "e")
    assert "'b' twice" in raw.remarks[0]


def without(key):
    struct = qtm_struct(positions(), NAMES)
    del struct[key]
    return struct


def labelled(**changes):
    struct = qtm_struct(positions(), NAMES)
    struct["Trajectories"]["Labeled"].update(changes)
    return struct


FAULTS = {
    "no trajectories": (without("Trajectories"), ["the field Trajectories", "variables trial"]),
    "no rate": (without("FrameRate"), ["trial.FrameRate", "input.rate_hz"]),
    "other frames": (
        {**qtm_struct(positions(), NAMES), "Frames": 99.0},
        ["trial.Frames: expected 99", "found 15", "cut short"],
    ),
    "other count": (labelled(Count=4.0), ["Labeled.Count: expected 4", "found 5"]),
    "labels of others": (
        labelled(Labels=np.array([["a", "b"]], object)),
        ["Labels: expected 5 as in Data, found 2"],
    ),
    "flat data": (labelled(Data=np.ones((5, 7, 15))), ["markers x 4 x frames", "5 x 7 x 15"]),
    "data in words": (labelled(Data="many"), ["Data: expected numbers, found text"]),
    "misspelt": (
        {**qtm_struct(positions(), NAMES), "Trajectories": {"Labelled": {}}},
        ["the field Labeled", "did you mean 'Labelled'"],
    ),
}


@pytest.mark.parametrize("kind", ["version 5", "version 7.3"])
@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_told_with_file_field_expectation_and_finding(tmp_path, kind, fault):
    struct, parts = FAULTS[fault]
    path = WRITERS[kind](tmp_path / "trial.mat", struct)
    with pytest.raises(RecordingError) as caught:
        read_raw(path)
    for part in (str(path), "expected", "found", *parts):
        assert part in str(caught.value)


@pytest.mark.parametrize("data", [b"", b"MATLAB", b"MATLAB 5.0".ljust(126) + b"??" + b"\0" * 50])
def test_what_is_no_mat_file_is_told(tmp_path, data):
    path = tmp_path / "a.mat"
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=r"a.mat: expected a MAT file.*found"):
        read_raw(path)
