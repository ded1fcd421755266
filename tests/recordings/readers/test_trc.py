"""TRC files: m and mm, missing values as empty fields or as zeros."""

import numpy as np
import pytest
from qtm_files import NAMES, standing, write
from trc_files import trc_text

from hopdata.errors import RecordingError
from hopdata.recordings.readers.formats import read_raw

POSITIONS = standing(12)


def read(folder, text, **options):
    return read_raw(write(folder, text, "trial.trc"), **options)


@pytest.mark.parametrize("unit", ["mm", "m"])
@pytest.mark.parametrize("options", [{}, {"blank": False}, {"tab": "\t"}])
def test_every_layout_gives_the_same_numbers(tmp_path, unit, options):
    scale = 1.0 if unit == "mm" else 1e-3
    raw = read(tmp_path, trc_text(POSITIONS * scale, NAMES, unit=unit, **options))
    assert (raw.markers, raw.unit, raw.rate_hz) == (NAMES, unit, 100.0)
    np.testing.assert_allclose(raw.positions, POSITIONS * scale, atol=1e-6)
    np.testing.assert_allclose(raw.time, np.arange(12) / 100, atol=1e-12)


def test_nothing_and_three_zeros_are_missing_and_one_zero_is_not(tmp_path):
    positions = POSITIONS.copy()
    positions[2, 1] = np.nan
    positions[3, 0] = 0.0
    positions[4, 2, 1] = 0.0
    raw = read(tmp_path, trc_text(positions, NAMES))
    assert np.argwhere(np.isnan(raw.positions).all(axis=2)).tolist() == [[2, 1], [3, 0]]
    assert raw.positions[4, 2, 1] == 0.0


def test_numbers_and_missing_values_may_be_padded_with_blanks(tmp_path):
    positions = POSITIONS.copy()
    positions[5, 1] = np.nan
    cells = [line.split("\t") for line in trc_text(positions, NAMES).splitlines()]
    padded = [["" if i < 6 else "   ", "       nan"][i % 2] for i in range(len(cells))]
    lines = [
        "\t".join(cell if i < 6 else f"{cell or padded[i]:>12}" for cell in row)
        for i, row in enumerate(cells)
    ]
    raw = read(tmp_path, "\n".join(lines) + "\n")
    assert np.argwhere(np.isnan(raw.positions).all(axis=2)).tolist() == [[5, 1]]
    np.testing.assert_allclose(raw.positions[6], positions[6], atol=1e-6)


def test_a_missing_unit_is_taken_for_the_usual_one(tmp_path):
    raw = read(tmp_path, trc_text(POSITIONS, NAMES, values={"Units": None}))
    assert (raw.unit, raw.unit_is_stated) == ("mm", False)
    assert read(tmp_path, trc_text(POSITIONS, NAMES)).unit_is_stated


def line(text, number, new):
    lines = text.split("\n")
    lines[number - 1] = new
    return "\n".join(lines)


TEXT = trc_text(POSITIONS, NAMES)
ROWS = TEXT.split("\n")
# Forms that other programs write and read, and a word of the remark about them.
FORMS = {
    "a space after the type": (TEXT.replace("PathFileType\t", "PathFileType \t"), ""),
    "spaces for tabs": (line(TEXT, 1, "PathFileType 4 (X/Y/Z) trial.trc"), ""),
    "blanks for tabs in the rows": (
        "\n".join([*ROWS[:6], *(row.replace("\t", "  ") for row in ROWS[6:])]),
        "",
    ),
    "blanks for tabs but among names": (
        "\n".join(
            row if k == 3 else row.replace("\t", "  ") for k, row in enumerate(ROWS)
        ),
        "",
    ),
    "commas for tabs": (line(TEXT, 1, "PathFileType,4,(X/Y/Z),trial.trc"), ""),
    "a tab at the end of the type": (line(TEXT, 1, ROWS[0] + "\t"), ""),
    "keys in other letters": (TEXT.replace("NumFrames", "numFrames"), ""),
    "counters by other names": (TEXT.replace("Frame#\tTime", "Frame\tTimes"), ""),
    "empty names at the end": (line(TEXT, 4, ROWS[3] + "\t\t\t \t"), ""),
    "names in every second column": (
        line(TEXT, 4, "Frame#\tTime\t\t" + "\t\t".join(NAMES)),
        "",
    ),
    "a line of tabs at the end": (TEXT + "\t\t\n\n", ""),
    "a number of frames that is too high": (
        TEXT.replace("\t12\t5", "\t13\t5"),
        "expected 13 frames as stated, found 12 rows, which are used; was the file cut short?",
    ),
    "a number of frames that is too low": (
        TEXT.replace("\t12\t5", "\t11\t5"),
        "expected 11",
    ),
    "a key that nobody knows": (
        TEXT.replace("NumFrames", "NumFrame", 1),
        "found 'NumFrame'; did you mean 'NumFrames'?; it is not read",
    ),
    "empty cells at the ends of rows, more in some": (
        "\n".join(
            row if k < 6 or not row else row + "\t" * (3 + 3 * (k % 2))
            for k, row in enumerate(ROWS)
        ),
        "",
    ),
    "columns beyond the markers that some rows lack": (
        "\n".join(
            row if k < 6 or not row else row + "\t7\t8\t9" * (k % 2 == 0)
            for k, row in enumerate(ROWS)
        ),
        "expected 15 columns of 5 markers, found 18; the others are not read",
    ),
    "names without columns, beyond those of the markers": (
        line(TEXT, 4, ROWS[3] + "\t\tV_mid\t\t\tV_hip\t\t"),
        "expected 5 marker names (NumMarkers), found V_mid, V_hip beyond them, without columns",
    ),
    "no line of axes": ("\n".join(ROWS[:4] + ROWS[5:]), ""),
    "neither a line of axes nor an empty one": ("\n".join(ROWS[:4] + ROWS[6:]), ""),
    "commas everywhere": (TEXT.replace("\t", ","), ""),
    "semicolons, and decimals with a comma": (
        TEXT.replace("\t", ";").replace(".", ",").replace("trial,trc", "trial.trc"),
        "",
    ),
    "another number of markers": (
        trc_text(POSITIONS, NAMES, values={"NumMarkers": "6"}),
        "expected 6 marker names (NumMarkers), found 5, which are used",
    ),
    "more columns than markers": (
        "\n".join([*ROWS[:6], *(row and row + "\t7\t8\t9" for row in ROWS[6:])]),
        "expected 15 columns of 5 markers, found 18; the others are not read",
    ),
}


@pytest.mark.parametrize("form", FORMS)
def test_forms_that_other_programs_write_are_read(tmp_path, form):
    text, remark = FORMS[form]
    assert text != TEXT
    raw = read(tmp_path, text)
    assert raw.markers == NAMES
    np.testing.assert_allclose(raw.positions, POSITIONS, atol=1e-6)
    assert len(raw.remarks) == bool(remark)
    assert remark in "".join(raw.remarks)


def test_a_first_row_with_many_empty_cells_costs_no_row(tmp_path):
    positions = POSITIONS.copy()
    positions[1:, 1:] = np.nan
    rows = trc_text(positions, NAMES).split("\n")
    rows[6] += "\t" * 900
    raw = read(tmp_path, "\n".join(rows))
    assert len(raw.time) == len(positions)
    np.testing.assert_allclose(raw.positions, positions, atol=1e-6)


@pytest.mark.parametrize("word", ["Nan", "NAN", "nAN", "-nan", "naN", " NaN"])
def test_nan_in_any_letters_is_missing(tmp_path, word):
    row = ROWS[8].split("\t")
    row[5:8] = [word] * 3
    raw = read(tmp_path, line(TEXT, 9, "\t".join(row)))
    assert np.argwhere(np.isnan(raw.positions).all(axis=2)).tolist() == [[2, 1]]


def test_markers_of_one_name_are_numbered_and_those_without_called_unnamed(tmp_path):
    raw = read(tmp_path, trc_text(POSITIONS, ("a", "b", "b 1", "b", "")))
    assert raw.markers == ("a", "b 2", "b 1", "b 3", "unnamed 5")
    assert "'b' twice or more; they are called 'b 2', 'b 3'" in str(raw.remarks[1])
    np.testing.assert_allclose(raw.positions, POSITIONS, atol=1e-6)


def plainly(path):
    """Return the names, and the numbers by frame, of a TRC file as a person reads it."""
    lines = path.read_text().splitlines()
    names = [name for name in lines[3].split("\t")[2:] if name.strip()]
    rows = [row.split("\t") for row in lines[5:] if row.strip()]
    cells = [(row[1:] + [""] * 3 * len(names))[: 1 + 3 * len(names)] for row in rows]
    return names, np.array(
        [[float(c) if c.strip() else np.nan for c in row] for row in cells]
    )


def test_files_of_other_programs_are_read_as_they_stand(opensim_files):
    for path in opensim_files:
        raw, (names, table) = read_raw(path), plainly(path)
        assert raw.markers == tuple(names)
        expected = table[:, 1:].reshape(len(table), -1, 3)
        expected[np.isnan(expected).any(axis=2) | (expected == 0).all(axis=2)] = np.nan
        np.testing.assert_array_equal(raw.positions, expected)
        np.testing.assert_allclose(np.diff(raw.time), np.diff(table[:, 0]), atol=1.1e-3)


FAULTS = {
    "empty": ("", ["line 1", "PathFileType", "empty file"]),
    "prose": ("Dear colleague\n" * 9, ["line 1", "PathFileType", "'Dear colleague'"]),
    "header only": ("\n".join(TEXT.split("\n")[:6]), ["rows of numbers", "none"]),
    "feet": (
        trc_text(POSITIONS, NAMES, unit="ft"),
        ["line 3", "mm, cm, m or inches", "'ft'"],
    ),
    "rate below 0": (
        trc_text(POSITIONS, NAMES, values={"DataRate": "-5"}),
        ["DataRate", "expected more than 0 Hz, found -5 Hz"],
    ),
    "rate in words": (
        trc_text(POSITIONS, NAMES, values={"DataRate": "fast"}),
        ["line 3", "DataRate", "'fast'"],
    ),
    "markers": (
        line(
            trc_text(POSITIONS, NAMES, values={"NumMarkers": "6"}),
            4,
            "Frame#\tTime\ta\t\t\tb",
        ),
        ["line 4", "expected 6 marker names", "found 2"],
    ),
    "shifted names": (
        line(TEXT, 4, "Frame#\tTime\ta\t\tb\t\t\tc"),
        ["line 4, column 5", "expected nothing, found 'b'"],
    ),
    "axes": (TEXT.replace("\tY2", "\tZ2"), ["line 5", "expected 'Y2', found 'Z2'"]),
    "a value too few": (
        line(TEXT, 3, "100\t100\t12"),
        ["line 3", "8 different keys", "found 3"],
    ),
    "short row": (
        line(TEXT, 9, TEXT.split("\n")[8].rsplit("\t", 1)[0]),
        ["line 9", "expected 17 columns, found 16"],
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_told_with_file_place_expectation_and_finding(tmp_path, fault):
    text, parts = FAULTS[fault]
    with pytest.raises(RecordingError) as caught:
        read(tmp_path, text)
    for part in (str(tmp_path / "trial.trc"), "expected", "found", *parts):
        assert part in str(caught.value)


def test_a_rate_of_0_is_none_and_comes_from_the_stamps(tmp_path):
    path = tmp_path / "a.trc"
    path.write_text(trc_text(POSITIONS, NAMES, values={"DataRate": "0"}))
    assert read_raw(path).rate_hz == 100.0


def test_rows_may_end_where_the_last_markers_are_unseen(tmp_path):
    gone = POSITIONS.copy()
    gone[2:4, -2:] = np.nan
    text = trc_text(gone, NAMES)
    path = tmp_path / "a.trc"
    path.write_text("\n".join(line.rstrip("\t") for line in text.split("\n")))
    np.testing.assert_allclose(read_raw(path).positions, gone, atol=1e-6)
    # A row that ends within a marker, or with the file, may have been cut.
    lines = text.split("\n")
    within = [*lines[:8], lines[8].rsplit("\t", 1)[0], *lines[9:]]
    path.write_text("\n".join(within))
    with pytest.raises(RecordingError, match=r"line 9: expected .* columns"):
        read_raw(path)
    path.write_text(text.rstrip("\n").rsplit("\t", 3)[0])
    with pytest.raises(RecordingError, match="was it cut short"):
        read_raw(path)
