"""Workbooks of Excel: one sheet is read as its CSV would be."""

import numpy as np
import pytest
from qtm_files import NAMES, standing
from vendor_files import table_of, xlsx, zipped

from hopdata.errors import RecordingError
from hopdata.foreign import budget
from hopdata.recordings.raw import RateUnknownError
from hopdata.recordings.readers import xlsx as reader
from hopdata.recordings.readers.formats import read_raw


def places():
    positions = np.round(standing(20), 4)
    positions[3:5, 1] = np.nan
    return positions


def written(tmp_path, content):
    path = tmp_path / "trial.xlsx"
    path.write_bytes(content if isinstance(content, bytes) else xlsx(content))
    return path


def test_the_first_sheet_of_markers_is_read_and_others_named(tmp_path):
    rows = table_of(places(), NAMES)
    sheets = {
        "notes": [["hop"]],
        "results": [["n", "m"], [1.0, 2.0, 3.0]] * 2,
        "data": rows,
    }
    found = read_raw(written(tmp_path, sheets))
    np.testing.assert_allclose(found.positions, places(), atol=1e-9)
    assert (found.markers, found.rate_hz) == (NAMES, 100.0)
    (remark,) = found.remarks
    assert (remark.values["sheet"], remark.values["others"]) == ("data", "results")


def test_a_sheet_named_for_positions_goes_before_others(tmp_path):
    rows = table_of(places(), NAMES)
    angles = [rows[0], *([row[0], *(2 * x for x in row[1:])] for row in rows[1:])]
    sheets = {"Orientation - Euler": angles, "Segment Position": rows}
    found = read_raw(written(tmp_path, sheets))
    np.testing.assert_allclose(found.positions, places(), atol=1e-9)


def test_a_sheet_of_angles_is_not_taken_for_positions(tmp_path):
    rows = table_of(places(), NAMES)
    path = written(tmp_path, {"Joint Angles": rows, "Segment Velocity": rows})
    with pytest.raises(RecordingError, match="expected a sheet with numbers"):
        read_raw(path)


def test_what_is_not_tidy_is_told_by_sheet_and_line_with_what_to_do(tmp_path):
    rows = table_of(places(), NAMES)
    rows[6][4] = "high"
    path = written(tmp_path, {"data": rows})
    with pytest.raises(RecordingError) as caught:
        read_raw(path)
    words = str(caught.value)
    assert words.startswith(
        f"{path}, sheet 'data', line 7, column 5: expected a number"
    )
    assert "leave one table on the first sheet" in words
    assert "/tmp/tmp" not in words


def test_a_table_without_a_clock_asks_for_the_rate(tmp_path):
    rows = [["frame", *row[1:]] if not k else [k, *row[1:]]
            for k, row in enumerate(table_of(places(), NAMES))]  # fmt: skip
    path = written(tmp_path, {"data": rows})
    with pytest.raises(RateUnknownError) as caught:
        read_raw(path)
    assert "leave one table" not in str(caught.value)
    assert read_raw(path, rate_hz=50.0).rate_hz == 50.0


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"hop", "expected a workbook of Excel (.xlsx), found: File is not a zip file"),
        (zipped({"a.txt": "b"}), "open it in Excel and save it anew"),
        ({"notes": [["hop", "a", "b"]]}, "expected a sheet with numbers, found none"),
    ],
)
def test_mistakes_are_told(tmp_path, content, words):
    path = written(tmp_path, content)
    with pytest.raises(RecordingError) as caught:
        read_raw(path)
    assert str(caught.value).startswith(str(path))
    assert words in str(caught.value)


def test_a_workbook_that_unpacks_to_too_much_is_refused_first(
    tmp_path, monkeypatch, read_here
):
    monkeypatch.setattr(budget, "LEAST_UNPACKED", 30_000_000)
    path = written(tmp_path, zipped({"xl/sheet.xml": " " * 60_000_000}))
    with pytest.raises(
        RecordingError, match="expected at most 90 MB once it is unpacked"
    ):
        read_raw(path)


def test_a_missing_package_is_named(tmp_path, monkeypatch, read_here):
    monkeypatch.setattr(reader, "find_spec", lambda _: None)
    path = written(tmp_path, {"data": table_of(places(), NAMES)})
    with pytest.raises(RecordingError, match="pip install openpyxl"):
        read_raw(path)
