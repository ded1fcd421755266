"""D-Flow's tables: markers beside force plates, in m with y up, held where unseen."""

import numpy as np
import pytest
from qtm_files import NAMES, standing
from vendor_files import dflow

from hopdata.errors import RecordingError
from hopdata.recordings.readers.formats import read_raw


def places():
    positions = np.round(standing(20, scale=1.0), 6)
    positions[3:5, 1] = np.nan
    return positions


def written(tmp_path, data, name="trial.txt"):
    path = tmp_path / name
    path.write_bytes(data)
    return path


@pytest.mark.parametrize(("name", "mark"), [("a.txt", "\t"), ("a.csv", ",")])
def test_markers_are_read_beside_other_columns(tmp_path, name, mark):
    found = read_raw(written(tmp_path, dflow(places(), NAMES, mark=mark), name))
    np.testing.assert_allclose(found.positions, places(), atol=1e-6)
    assert (found.markers, found.rate_hz) == (NAMES, 100.0)
    assert (found.unit, found.unit_is_stated, found.stated_up) == ("m", True, "y")
    told = {remark.code: remark.values for remark in found.remarks}
    assert "FP1.ForY" in told["recordings.columns_left_out"]["columns"]
    assert told["recordings.held_positions"]["n_held"] == 2


def test_a_marker_that_rests_in_a_coarse_table_is_seen(tmp_path):
    coarse = np.round(places(), 2)
    found = read_raw(written(tmp_path, dflow(coarse, NAMES, forces=False)))
    seen = np.isfinite(found.positions).all(axis=2)
    assert seen.all()
    assert not found.remarks


def test_a_frame_that_repeats_as_a_whole_is_left_as_it_is(tmp_path):
    repeated = places()
    repeated[8] = repeated[7]
    found = read_raw(written(tmp_path, dflow(repeated, NAMES)))
    assert np.isfinite(found.positions[8]).all()


def test_rows_of_one_frame_are_left_out_and_said(tmp_path):
    lines = dflow(places(), NAMES).decode().splitlines()
    again = lines[10].split("\t", 1)
    lines.insert(11, "\t".join([f"{float(again[0]) + 0.003:.6f}", again[1]]))
    found = read_raw(written(tmp_path, ("\n".join(lines) + "\n").encode()))
    assert len(found.time) == 20
    assert "recordings.rows_of_one_frame" in [r.code for r in found.remarks]
    np.testing.assert_allclose(np.diff(found.time), 0.01, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda t: t.replace("heel.PosY", "heel.RotY"),
            "a column heel.PosY, found none",
        ),
        (lambda t: t.replace("toe.PosX", "heel.PosX"), "'heel.PosX' twice"),
        (
            lambda t: t.replace("0.050000\t6\t", "0.050000\t2\t"),
            "numbers that increase",
        ),
        (lambda t: t.replace("0.050000\t6\t", "\t6\t"), "TimeStamp: expected a number"),
    ],
)
def test_mistakes_are_told(tmp_path, change, words):
    path = written(tmp_path, change(dflow(places(), NAMES).decode()).encode())
    with pytest.raises(RecordingError) as caught:
        read_raw(path)
    assert str(caught.value).startswith(str(path))
    assert words in str(caught.value)


@pytest.mark.filterwarnings("error")
def test_a_place_that_no_camera_sees_is_told(tmp_path):
    lines = dflow(places(), NAMES).decode().splitlines()
    assert len(read_raw(written(tmp_path, "\n".join(lines).encode())).time) == 20
    cells = lines[9].split("\t")
    cells[2] = "1.7e+305"
    lines[9] = "\t".join(cells)
    with pytest.raises(RecordingError, match=r"below .* found 1\.7e\+305"):
        read_raw(written(tmp_path, "\n".join(lines).encode()))
