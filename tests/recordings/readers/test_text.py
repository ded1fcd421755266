"""Columns of text tables: every delimiter, and mistakes with their places."""

import os
import time

import numpy as np
import pytest

from hopdata.errors import RecordingError
from hopdata.recordings.readers import text
from hopdata.recordings.readers.text import open_table


@pytest.mark.parametrize("delimiter", ["\t", ";", ","])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_numbers_by_name_in_any_delimiter(tmp_path, delimiter, end):
    rows = [["Time", "F z"], ["0", "1.5"], ["0.01", ""], ["0.02", "-3e2"]]
    path = tmp_path / "a.txt"
    path.write_bytes(
        ("\ufeff" + end.join(delimiter.join(r) for r in rows) + end).encode()
    )
    table = open_table(path)
    assert table.names == ("Time", "F z")
    np.testing.assert_array_equal(table.numbers("F z"), [1.5, np.nan, -300])
    np.testing.assert_array_equal(table.numbers("Time"), [0, 0.01, 0.02])
    assert table.texts("F z") == ["1.5", "", "-3e2"]


def test_quotes_and_blanks_about_cells(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text('"foot 1", "foot 2"\n"1.0", 2\n , "NaN"\n')
    table = open_table(path)
    assert table.names == ("foot 1", "foot 2")
    np.testing.assert_array_equal(table.numbers("foot 1"), [1.0, np.nan])
    np.testing.assert_array_equal(table.numbers("foot 2"), [2.0, np.nan])


def test_a_delimiter_between_quotes_belongs_to_its_cell(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text('t,"what, where",z\n0.1,"Strike, left",3\n0.2, "Off, right",4\n')
    table = open_table(path)
    assert table.names == ("t", "what, where", "z")
    assert table.texts("what, where") == ["Strike, left", "Off, right"]
    assert table.texts("z") == ["3", "4"]


def test_quotes_in_a_cell_are_doubled(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text('t,"back ""lower""","5"" pin"\n0.1,1,2\n')
    assert open_table(path).names == ("t", 'back "lower"', '5" pin')


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_empty_lines_at_the_end_are_no_rows(tmp_path, end):
    path = tmp_path / "a.csv"
    path.write_bytes((end.join(["t,label", "1,a", "", "2,b", "", ""]) + end).encode())
    table = open_table(path)
    np.testing.assert_array_equal(table.numbers("t"), [1, np.nan, 2])
    assert table.texts("label") == ["a", "", "b"]


def test_decimals_are_those_of_the_first_row(tmp_path):
    path = tmp_path / "plate.csv"
    path.write_text("t;Fz\n0;1,5\n1;-2\n2;\n")
    np.testing.assert_array_equal(open_table(path).numbers("Fz"), [1.5, -2, np.nan])


def test_short_rows_end_in_empty_cells(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("a,b\n1,2\n3\n")
    np.testing.assert_array_equal(open_table(path).numbers("b"), [2, np.nan])


MISTAKES = {
    "unknown column": (
        "Fx,Fy\n1,2\n",
        "Fz",
        ["line 1", "'Fz' once among Fx, Fy", "did you mean"],
    ),
    "column twice": (
        "Fz,Fz\n1,2\n",
        "Fz",
        ["expected 'Fz' once", "found 2 of that name"],
    ),
    "text": (
        "Fz\n1\nhigh\n",
        "Fz",
        ["line 3, column 1: expected a number, found 'high'"],
    ),
    "infinity": ("Fz\n1\ninf\n", "Fz", ["line 3", "found 'inf'"]),
    "a comma among points": (
        "t;Fz\n0;1.5\n0;1,5\n",
        "Fz",
        ["line 3", "found '1,5'; write dec"],
    ),
    "no names": (
        "1,2\n3,4\n",
        "Fz",
        ["line 1: expected names of columns, found '1,2'"],
    ),
    "nothing": ("", "Fz", ["line 1: expected names of columns"]),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_name_place_expectation_and_finding(tmp_path, mistake):
    content, column, parts = MISTAKES[mistake]
    path = tmp_path / "plate.csv"
    path.write_text(content)
    with pytest.raises(RecordingError) as caught:
        open_table(path).numbers(column)
    for part in (str(path), "expected", "found", *parts):
        assert part in str(caught.value)


def test_bytes_that_are_no_text(tmp_path):
    path = tmp_path / "plate.csv"
    path.write_bytes(b"Fz\n\xff\xfe\x00\n")
    with pytest.raises(
        RecordingError, match="line 2, column 1: expected a number, found"
    ):
        open_table(path).numbers("Fz")


def test_a_missing_file_is_told_with_the_nearest_name(tmp_path):
    (tmp_path / "forces.txt").write_text("Fz\n1\n")
    with pytest.raises(RecordingError, match=r"found none; did you mean 'forces.txt'"):
        open_table(tmp_path / "force.txt")


def test_rows_of_blanks_that_lack_a_field_are_no_traceback(tmp_path):
    path = tmp_path / "a.mot"
    head = "forces\nversion=1\nendheader\ntime force name\n"
    path.write_text(head + "0.0 1.5 a\n0.1\n0.2 2.5 b\n")
    table = open_table(path)
    np.testing.assert_array_equal(table.numbers("force"), [1.5, np.nan, 2.5])
    assert table.texts("name") == ["a", "", "b"]
    path.write_text(head + "0.0 1.5 a\n0.1\n0.2 two b\n")
    with pytest.raises(
        RecordingError, match=r"a\.mot, line 7, column 2: expected a number"
    ):
        open_table(path).numbers("force")


def test_a_header_without_an_end_is_not_collected_for_ever(tmp_path):
    path = tmp_path / "a.sto"
    path.write_text("version=1\n" * 400_000)
    begin = time.process_time()
    with pytest.raises(RecordingError, match="expected a line endheader, found none"):
        open_table(path)
    assert time.process_time() - begin < 2.0


@pytest.mark.parametrize("rows_at_a_time", [2, 3, 4, 100])
def test_the_line_of_a_mistake_counts_empty_lines_before_it(
    tmp_path, monkeypatch, rows_at_a_time
):
    """Empty lines at the end of a block of rows wait for the next block."""
    monkeypatch.setattr(text, "ROWS", rows_at_a_time)
    path = tmp_path / "a.csv"
    lines = ["t,x", "1,1", "2,2", "", "", "3,3", "", "4,4", "5,wrong"]
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(RecordingError, match=r"a\.csv, line 9"):
        open_table(path).numbers("x")


@pytest.mark.parametrize("kind", ["a folder", "a pipe"])
def test_what_is_no_plain_file_is_named(tmp_path, kind):
    path = tmp_path / "a.tsv"
    if kind == "a folder":
        path.mkdir()
    elif hasattr(os, "mkfifo"):
        os.mkfifo(path)
    else:
        pytest.skip("no pipes in folders here")
    with pytest.raises(
        RecordingError, match=rf"a\.tsv: expected a file, found {kind}$"
    ):
        text.require_file(path)
