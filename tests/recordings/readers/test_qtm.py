"""Both kinds of QTM's MAT exports, written by scipy and h5py."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mat_files import qtm_struct, write_mat5, write_mat73
from qtm_files import NAMES, columns, data_rows, qtm_text, standing, write

from hopdata.errors import RecordingError
from hopdata.recordings.readers.formats import read_raw
from hopdata.recordings.readers.qtm import coordinate_stems, read_qtm_tsv
from hopdata.recordings.readers.text import TEXT_TABLE_MISSING

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
    expected = positions()
    expected[4, 2] = np.nan
    np.testing.assert_array_equal(raw.positions, expected)
    assert "2 of 2 events lie outside" in raw.remarks[0] or raw.remarks == (), (
        raw.remarks
    )


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
    assert "'b' twice" in str(raw.remarks[0])


def without(key):
    struct = qtm_struct(positions(), NAMES)
    del struct[key]
    return struct


def labelled(**changes):
    struct = qtm_struct(positions(), NAMES)
    struct["Trajectories"]["Labeled"].update(changes)
    return struct


FAULTS = {
    "no trajectories": (
        without("Trajectories"),
        ["the field Trajectories", "variables trial"],
    ),
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
    "flat data": (
        labelled(Data=np.ones((5, 7, 15))),
        ["markers x 4 x frames", "5 x 7 x 15"],
    ),
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


@pytest.mark.parametrize(
    "data", [b"", b"MATLAB", b"MATLAB 5.0".ljust(126) + b"??" + b"\0" * 50]
)
def test_what_is_no_mat_file_is_told(tmp_path, data):
    path = tmp_path / "a.mat"
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=r"a.mat: expected a MAT file.*found"):
        read_raw(path)


CLAIMS = {  # text in the file, its replacement, and the message about it
    "cells without end": (
        np.array([1, 0, 5, 8, 1, 5], "<u4"), np.array([1, 0, 5, 8, 1, 2**31 - 1], "<u4"),
        "expected a size for",
    ),
    "text of no known type": (
        np.array([16, 9], "<u4"), np.array([255, 9], "<u4"), "expected a matrix of numbers, text",
    ),
    "text that is not there": (
        np.array([1, 0, 16, 9], "<u4"), np.array([1, 16, 16, 9], "<u4"),
        "expected a matrix of numbers, text",
    ),
}  # fmt: skip


@pytest.mark.parametrize("claim", CLAIMS)
def test_what_scipy_would_believe_or_crash_on_is_refused(tmp_path, claim):
    old, new, told = CLAIMS[claim]
    path = write_mat5(tmp_path / "a.mat", qtm_struct(positions(), NAMES))
    data = path.read_bytes()
    assert old.tobytes() in data
    path.write_bytes(data.replace(old.tobytes(), new.tobytes(), 1))
    with pytest.raises(
        RecordingError, match=rf"a.mat: expected a MAT file.*{told}.*found"
    ):
        read_raw(path)


POSITIONS = standing(12)
ROUNDED = np.round(POSITIONS, 3)


def read(folder, text, **options):
    return read_qtm_tsv(write(folder, text), **options)


def changed(row, column, text):
    """Return rows of `POSITIONS` with one field replaced (columns include Frame and Time)."""
    rows = [line.split("\t") for line in data_rows(POSITIONS)]
    rows[row][column] = text
    return ["\t".join(fields) for fields in rows]


@pytest.mark.parametrize("line_end", ["\r\n", "\n"])
@pytest.mark.parametrize("column_row", [True, False])
@pytest.mark.parametrize("counters", [True, False])
def test_every_layout_gives_the_same_numbers(tmp_path, line_end, column_row, counters):
    text = qtm_text(
        POSITIONS, line_end=line_end, column_row=column_row, counters=counters
    )
    raw = read(tmp_path, text)
    assert raw.markers == NAMES
    assert raw.unit == "mm"
    assert raw.rate_hz == 100
    np.testing.assert_allclose(raw.positions, ROUNDED, atol=1e-9)
    np.testing.assert_allclose(raw.time, np.arange(12) / 100, atol=1e-12)


def test_header_keys_may_come_in_any_order_with_others_between(tmp_path):
    lines = qtm_text(POSITIONS).split("\r\n")
    shuffled = [
        "FILE_VERSION\t2.0.0",
        *lines[10::-1],
        "SOMETHING_NEW\t1",
        "",
        *lines[11:],
    ]
    raw = read(tmp_path, "\r\n".join(shuffled))
    np.testing.assert_allclose(raw.positions, ROUNDED, atol=1e-9)


def test_events_are_kept(tmp_path):
    header = {"EVENT": "heel strike\t5\t0.04000\r\nEVENT\ttoe off\t9\t0.08000"}
    raw = read(tmp_path, qtm_text(POSITIONS, header=header))
    assert [(e.label, e.time_s) for e in raw.events] == [
        ("heel strike", 0.04),
        ("toe off", 0.08),
    ]


def test_without_a_header_the_column_row_and_the_time_stamps_serve(tmp_path):
    rows = ["\t".join(["Frame", "Time", *columns()]), *data_rows(POSITIONS, rate=120.0)]
    raw = read(tmp_path, "\n".join(rows))
    assert raw.markers == NAMES
    assert raw.rate_hz == 120


@pytest.mark.parametrize("missing", ["", "NULL", "NaN"])
@pytest.mark.parametrize("coordinate", [0, 1, 2])
def test_a_missing_coordinate_means_the_marker_was_not_seen(
    tmp_path, missing, coordinate
):
    for marker in (0, 2, 4):
        rows = changed(3, 2 + 3 * marker + coordinate, missing)
        raw = read(tmp_path, qtm_text(POSITIONS, rows=rows))
        unseen = np.isnan(raw.positions)
        assert unseen[3, marker].all()
        assert unseen.sum() == 3


def test_three_zeros_are_missing_and_one_zero_is_a_coordinate(tmp_path):
    positions = POSITIONS.copy()
    positions[2, 1] = 0.0
    positions[4, 3, 2] = 0.0
    positions[5, 0, :2] = 0.0
    positions[6, 2] = -9999.0  # as other programs write
    positions[7, 2, 1:] = 9999.99
    raw = read(tmp_path, qtm_text(positions))
    assert np.isnan(raw.positions[2, 1]).all()
    assert np.isnan(raw.positions[6, 2]).all()
    assert np.isnan(raw.positions).sum() == 6
    assert raw.positions[4, 3, 2] == 0
    assert (raw.positions[5, 0, :2] == 0).all()


def test_a_first_frame_without_any_marker_is_still_a_frame(tmp_path):
    rows = data_rows(POSITIONS, counters=False)
    rows[0] = "\t".join([""] * 15)
    raw = read(
        tmp_path, qtm_text(POSITIONS, rows=rows, counters=False, column_row=False)
    )
    assert len(raw.positions) == 12
    assert np.isnan(raw.positions[0]).all()


def test_a_tab_at_the_end_of_each_line_is_not_a_column(tmp_path):
    for options in ({}, {"column_row": False}, {"counters": False}):
        lines = [line + "\t" for line in qtm_text(POSITIONS, **options).splitlines()]
        raw = read(tmp_path, "\n".join(lines) + "\n")
        np.testing.assert_allclose(raw.positions, ROUNDED, atol=1e-9)


def test_byte_order_mark_and_latin_names(tmp_path):
    names = ("Hüfte", *NAMES[1:])
    assert (
        read(tmp_path, b"\xef\xbb\xbf" + qtm_text(names=names).encode()).markers
        == names
    )
    assert read(tmp_path, qtm_text(names=names).encode("latin-1")).markers == names


def test_rounded_time_stamps_go_back_to_the_grid_and_others_stay(tmp_path):
    rows = data_rows(POSITIONS, rate=150.0)
    raw = read(tmp_path, qtm_text(POSITIONS, rows=rows, frequency="150"))
    np.testing.assert_allclose(raw.time, np.arange(12) / 150, atol=1e-12)
    raw = read(tmp_path, qtm_text(POSITIONS, rows=changed(7, 1, "0.07200")))
    assert raw.time[7] == 0.072


def test_dropped_frames_leave_a_gap_in_time(tmp_path):
    rows = data_rows(POSITIONS)
    kept = rows[:4] + rows[7:]
    raw = read(tmp_path, qtm_text(POSITIONS, rows=kept, header={"NO_OF_FRAMES": "9"}))
    np.testing.assert_allclose(np.diff(raw.time)[3], 0.04, atol=1e-12)


def test_an_external_time_base_needs_a_rate(tmp_path):
    text = qtm_text(POSITIONS, frequency="EXT")
    with pytest.raises(
        RecordingError, match=r"trial.tsv, line 4: frame rate: .*input.rate_hz"
    ):
        read(tmp_path, text)
    assert read(tmp_path, text, rate_hz=100.0).rate_hz == 100
    bare = qtm_text(POSITIONS, frequency="EXT", counters=False)
    np.testing.assert_allclose(
        read(tmp_path, bare, rate_hz=50.0).time, np.arange(12) / 50
    )


def test_a_rate_that_contradicts_the_time_stamps_is_refused(tmp_path):
    file = write(tmp_path, qtm_text(POSITIONS))
    with pytest.raises(
        RecordingError, match=r"expected 100 Hz .* found input.rate_hz: 200"
    ):
        read_raw(file, rate_hz=200.0)
    assert read_raw(file, rate_hz=100.0).remarks == ()


def test_a_rate_that_the_time_stamps_bear_out_overrules_the_header(tmp_path):
    raw = read_raw(write(tmp_path, qtm_text(POSITIONS, frequency="50", rows=data_rows(POSITIONS))),
                   rate_hz=100.0)  # fmt: skip
    assert raw.rate_hz == 100
    np.testing.assert_allclose(raw.time, np.arange(12) / 100)
    assert raw.remarks[-1].endswith("100 Hz as in input.rate_hz; the file states 50")


def test_without_time_stamps_the_configuration_overrules_the_rate_with_a_remark(
    tmp_path,
):
    text = write(tmp_path, qtm_text(POSITIONS, counters=False))
    struct = qtm_struct(POSITIONS, NAMES, events=EVENTS)
    for file in (text, write_mat5(tmp_path / "trial.mat", struct)):
        raw = read_raw(file, rate_hz=200.0)
        assert raw.rate_hz == 200
        np.testing.assert_allclose(raw.time, np.arange(12) / 200)
        told = f"{file}: frame rate: 200 Hz as in input.rate_hz; the file states 100"
        assert raw.remarks[-1] == told
        assert read_raw(file, rate_hz=100.0).remarks == read_raw(file).remarks
    assert [event.time_s for event in raw.events] == [
        0.02,
        0.04,
    ]  # the times of their frames


LINES = qtm_text(POSITIONS).split("\r\n")  # 11 header lines, column row, 12 frames
QTM_TSV_FAULTS = {
    "empty file": (b"", ["empty file"]),
    "binary": (b"HDF\0\1\2", ["binary data"]),
    "prose": (
        "Dear colleague,\nhere it is\n",
        ["line 1", "header key or numbers", "'Dear coll"],
    ),
    "name over two lines": (
        'Time,"toe\nleft_x",left_y,left_z\n0,1,2,3\n',
        [
            "line 2",
            "each name of a column within one line",
            "a quote that is not closed",
        ],
    ),
    "spaces": (
        qtm_text(POSITIONS).replace("\t", "  "),
        ["line 1", "the fields by tabs"],
    ),
    "header only": ("\r\n".join(LINES[:12]), ["rows of numbers", "none"]),
    "rate 0": (
        qtm_text(POSITIONS, frequency="0"),
        ["line 4", "more than 0 Hz", "found 0 Hz"],
    ),
    "rate of no camera": (
        qtm_text(POSITIONS, frequency="1e-320"),
        ["line 4", "at least 1e-06 and at most 100000 Hz"],
    ),
    "rate in words": (
        qtm_text(POSITIONS, frequency="fast"),
        ["line 4", "a number", "'fast'"],
    ),
    "no rate": (
        qtm_text(POSITIONS, header={"FREQUENCY": None}, counters=False),
        ["input.rate_hz", "neither"],
    ),
    "misspelt key": (
        qtm_text(POSITIONS, header={"FREQUENCY": None, "FREQENCY": "100"}),
        ["key FREQUENCY", "did you mean 'FREQENCY'"],
    ),
    "key in lower case": (
        qtm_text(POSITIONS, header={"FREQUENCY": None, "Frequency": "100"}),
        ["line 11", "'Frequency'", "did you mean 'FREQUENCY'"],
    ),
    "6D export": (
        qtm_text(POSITIONS, header={"DATA_INCLUDED": "6D"}),
        ["line 9", "expected '3D'", "found '6D'"],
    ),
    "no names": (
        qtm_text(POSITIONS, header={"MARKER_NAMES": None}, column_row=False),
        ["MARKER_NAMES or a column row", "neither"],
    ),
    "too few names": (
        qtm_text(
            POSITIONS,
            header={"MARKER_NAMES": "\t".join(NAMES[:3]), "NO_OF_MARKERS": "4"},
        ),
        ["line 10", "expected 4 marker names", "found 3"],
    ),
    "column row of other markers": (
        qtm_text(POSITIONS, header={"MARKER_NAMES": "\t".join(("hip", *NAMES[1:]))}),
        ["line 12", "columns", "expected 'hip X'", "found 'hip left X'"],
    ),
    "columns that do not come out even": (
        qtm_text(POSITIONS[:, :4], header={"NO_OF_MARKERS": "5"}, column_row=False),
        ["line 12", "expected 15 columns", "found 14"],
    ),
    "cut within a row": (
        qtm_text(POSITIONS)[:-40],
        ["line 24", "expected 17 columns", "found", "cut short"],
    ),
    "a short row": (
        "\r\n".join([*LINES[:15], LINES[15].rsplit("\t", 2)[0], *LINES[16:]]),
        ["line 16", "expected 17 columns", "found 15"],
    ),
    "a short row and a long one": (
        "\r\n".join(
            [*LINES[:15], LINES[15].rsplit("\t", 1)[0], LINES[16] + "\t1", *LINES[17:]]
        ),
        ["line 16", "expected 17 columns", "found 16"],
    ),
    "a long row": (
        "\r\n".join([*LINES[:15], LINES[15] + "\t1.0", *LINES[16:]]),
        ["line 16", "expected 17 columns", "found 18"],
    ),
    "words for numbers": (
        qtm_text(POSITIONS, rows=changed(5, 6, "abc")),
        ["line 18, column 7", "expected a number", "found 'abc'"],
    ),
    "decimal comma": (
        qtm_text(POSITIONS, rows=changed(5, 6, "1,5")),
        ["line 18, column 7", "found '1,5'", "point"],
    ),
    "infinite": (
        qtm_text(POSITIONS, rows=changed(5, 6, "inf")),
        ["line 18, column 7", "found 'inf'"],
    ),
    "zeros of a full disk": (
        qtm_text(POSITIONS, rows=changed(5, 6, "12\0\0\0")),
        ["line 18, column 7", "expected a number"],
    ),
    "no time": (
        qtm_text(POSITIONS, rows=changed(5, 1, "")),
        ["line 18", "Time", "missing value"],
    ),
    "a key twice": (
        qtm_text(POSITIONS, header={"FREQUENCY": "100\r\nFREQUENCY\t200"}),
        ["line 5", "expected FREQUENCY once", "another value in line 4"],
    ),
    "columns that are no threes": (
        "\n".join(["Frame\tTime\ta X\ta Y\ta Z\tb X\tb Z", "1\t0\t1\t2\t3\t4\t5"]),
        ["line 1, column 6", "the columns X, Y, Z of a marker", "'b X', 'b Z'"],
    ),
    "numbers that read two ways": (
        "1\t0.00\t1\t2\t3\t4\t5\t6\t\n" * 3,
        ["line 1", "a column row", "two ways"],
    ),
    "broken event": (
        qtm_text(POSITIONS, header={"EVENT": "strike"}),
        ["line 12", "EVENT", "a label, a frame and a time"],
    ),
}


WRONG_CLAIMS = {  # text in a file with sound rows, and the message about it
    "fewer frames than stated": (
        "\r\n".join(LINES[:-4]),
        ["line 1", "expected 12 frames", "found 9 rows", "cut short"],
    ),
    "more frames than stated": (
        qtm_text(POSITIONS, header={"NO_OF_FRAMES": "10"}),
        ["line 1", "expected 10 frames", "found 12 rows, which are used"],
    ),
    "another number of markers": (
        qtm_text(POSITIONS, header={"NO_OF_MARKERS": "4"}),
        ["line 10", "expected 4 marker names", "found 5; the columns are those of 5"],
    ),
    "no name of the last": (
        qtm_text(POSITIONS, header={"MARKER_NAMES": "a\tb\tc\td"}, column_row=False),
        ["line 10", "expected 5 marker names", "found 4", "called 'unnamed <number>'"],
    ),
}


@pytest.mark.parametrize("claim", WRONG_CLAIMS)
def test_claims_that_do_not_hold_are_said_and_the_rows_read(tmp_path, claim):
    text, parts = WRONG_CLAIMS[claim]
    raw = read(tmp_path, text)
    np.testing.assert_allclose(raw.positions, ROUNDED[: len(raw.time)], atol=1e-9)
    for part in parts:
        assert part in " ".join(raw.remarks)


@pytest.mark.parametrize("fault", QTM_TSV_FAULTS)
def test_faults_are_told_with_file_place_expectation_and_finding(tmp_path, fault):
    text, parts = QTM_TSV_FAULTS[fault]
    with pytest.raises(RecordingError) as caught:
        read(tmp_path, text)
    message = str(caught.value)
    assert message.startswith(str(tmp_path / "trial.tsv"))
    assert "expected" in message
    assert "\n" not in message
    for part in parts:
        assert part in message


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(RecordingError, match=r"absent.tsv: expected a readable file"):
        read_qtm_tsv(tmp_path / "absent.tsv")


@settings(
    max_examples=300,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    st.lists(
        st.tuples(st.integers(0, 2000), st.integers(0, 5), st.binary(max_size=4)),
        max_size=6,
    )
)
def test_a_damaged_file_gives_a_recording_or_a_recording_error(tmp_path, edits):
    data = qtm_text(POSITIONS).encode()
    for start, length, replacement in edits:
        data = data[:start] + replacement + data[start + length :]
    try:
        raw = read(tmp_path, data)
    except RecordingError:
        return  # refused; any other exception would fail the test
    assert raw.positions.shape == (len(raw.time), len(raw.markers), 3)
    assert not np.isinf(raw.positions).any()


def test_the_real_recording(external_recording):
    raw = read_qtm_tsv(external_recording)
    assert raw.positions.shape == (4500, 9, 3)
    assert raw.rate_hz == 150
    assert raw.markers[3] == "R_heel"
    table = pd.read_csv(external_recording, sep="\t", skiprows=11)
    np.testing.assert_allclose(
        raw.positions.reshape(4500, 27), table.iloc[:, 2:].to_numpy(), atol=1e-9
    )
    np.testing.assert_allclose(raw.time, table["Time"], atol=1e-5)


@pytest.mark.parametrize("separator", ["", " ", ".", "_"])
def test_a_table_may_spell_its_columns_in_its_own_way(tmp_path, separator):
    title = ["Time", *(f"{name}{separator}{axis}" for name in NAMES for axis in "XYZ")]
    rows = [row.split("\t", 1)[1] for row in data_rows(POSITIONS)]
    path = write(tmp_path, "\n".join(["\t".join(title), *rows]), "table.txt")
    raw = read_raw(path)
    assert raw.markers == NAMES
    assert raw.rate_hz == 100
    np.testing.assert_allclose(raw.positions, ROUNDED, atol=1e-9)


@pytest.mark.parametrize("name", ["table.txt", "table.csv"])
@pytest.mark.parametrize(
    ("column", "factor", "told"),
    [
        ("Time [s]", 1, ""),
        ("time_s", 1, ""),
        ("time (sec)", 1, ""),
        ("t", 1, ""),
        ("t [s]", 1, ""),
        (
            "Time",
            1000,
            "time: expected s, at most 0.5 from frame to frame, found 10; if these are",
        ),
        (
            "Time (ms)",
            1000,
            r"line 1: expected Frame or Time \(in s\) .*, found 'Time \(ms\)'",
        ),
    ],
)
def test_times_are_in_seconds(tmp_path, name, column, factor, told):
    title = [column, *(f"{name} {axis}" for name in NAMES for axis in "XYZ")]
    rows = [row.split("\t", 2)[1:] for row in data_rows(POSITIONS)]
    rows = [f"{float(time) * factor}\t{rest}" for time, rest in rows]
    path = write(tmp_path, "\n".join(["\t".join(title), *rows]), name)
    if told:
        with pytest.raises(RecordingError, match=told):
            read_raw(path)
    else:
        assert read_raw(path).rate_hz == 100


@pytest.mark.parametrize("axes", ["XYZ", "xyz"])
def test_axes_may_be_small_letters(tmp_path, axes):
    title = ["Time", *(f"{name} {axis}" for name in NAMES for axis in axes)]
    rows = [row.split("\t", 1)[1] for row in data_rows(POSITIONS)]
    path = write(tmp_path, "\n".join(["\t".join(title), *rows]), "table.txt")
    assert read_raw(path).markers == NAMES


def test_a_space_behind_a_name_is_none_of_its_letters(tmp_path):
    names = ("hip left ", *NAMES[1:])
    raw = read(tmp_path, qtm_text(POSITIONS, names=names))
    assert raw.markers == NAMES
    np.testing.assert_allclose(raw.positions, ROUNDED, atol=1e-9)


@pytest.mark.parametrize("counters", [True, False])
def test_nothing_but_numbers_gives_numbered_markers(tmp_path, counters):
    text = "\n".join(data_rows(POSITIONS, counters=counters))
    raw = read(tmp_path, text, rate_hz=None if counters else 100.0)
    assert raw.markers == ("marker1", "marker2", "marker3", "marker4", "marker5")
    np.testing.assert_allclose(raw.positions, ROUNDED, atol=1e-9)
    np.testing.assert_allclose(raw.time, np.arange(12) / 100, atol=1e-12)


@pytest.mark.parametrize("missing", TEXT_TABLE_MISSING)
def test_every_spelling_of_missing(tmp_path, missing):
    raw = read(tmp_path, qtm_text(POSITIONS, rows=changed(3, 6, missing)))
    assert np.argwhere(np.isnan(raw.positions).all(axis=2)).tolist() == [[3, 1]]


def test_the_start_is_kept(tmp_path):
    raw = read(tmp_path, qtm_text(POSITIONS))
    assert raw.started.isoformat() == "2021-01-01T12:00:00"
    assert read(tmp_path, qtm_text(header={"TIME_STAMP": "yesterday"})).started is None


def remarks(folder, text, **options):
    return read_raw(write(folder, text), **options).remarks


@pytest.mark.parametrize("column_row", [True, False])
def test_markers_of_one_name_are_numbered_and_said_qtm_tsv(tmp_path, column_row):
    text = qtm_text(POSITIONS, names=("a", "b", "c", "b", "e"), column_row=column_row)
    assert read(tmp_path, text).markers == ("a", "b 1", "c", "b 2", "e")
    (said,) = remarks(tmp_path, text)
    assert "line 10: expected each marker name once, found 'b' twice" in str(said)


def test_a_sound_file_gives_no_remark(tmp_path):
    assert remarks(tmp_path, qtm_text(POSITIONS)) == ()


def test_what_does_not_hold_but_can_be_put_right_is_counted(tmp_path):
    event = qtm_text(POSITIONS, header={"EVENT": "strike\t9\t0.04000"})
    assert (
        "in 1 of 1 events the time is not that of the frame"
        in remarks(tmp_path, event)[0]
    )
    late = qtm_text(POSITIONS, header={"EVENT": "strike\t501\t5.00000"})
    assert "1 of 1 events lie outside the recording" in remarks(tmp_path, late)[0]
    stopped = qtm_text(POSITIONS, frequency="EXT", rows=changed(7, 1, "0.05000"))
    assert "do not increase" in remarks(tmp_path, stopped, rate_hz=100.0)[0]


def test_time_stamps_spread_over_one_step_too_many_go_back_to_the_rate(tmp_path):
    positions = standing(1500)
    rows = data_rows(positions, rate=100 * 1499 / 1500)
    raw = read(tmp_path, qtm_text(positions, rows=rows))
    np.testing.assert_allclose(raw.time, np.arange(1500) / 100, atol=1e-12)
    assert "run evenly at 99.93" in raw.remarks[0]


def test_time_stamps_rounded_to_a_millisecond_go_back_to_the_grid(tmp_path):
    rows = [row.split("\t") for row in data_rows(POSITIONS)]
    rows = ["\t".join([r[0], f"{i / 150:.3f}", *r[2:]]) for i, r in enumerate(rows)]
    raw = read(tmp_path, qtm_text(POSITIONS, rows=rows, frequency="150"))
    np.testing.assert_allclose(raw.time, np.arange(12) / 150, atol=1e-12)


@pytest.mark.parametrize("name", ["/", "a/", "b-", "to (e", "a_x", "L:toe"])
def test_columns_as_qtm_names_them_keep_the_name(name):
    assert coordinate_stems([f"{name} {axis}" for axis in "XYZ"]) == [name]
