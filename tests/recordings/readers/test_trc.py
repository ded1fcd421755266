"""TRC files: m and mm, missing as nothing or as zeros."""

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
FAULTS = {
    "empty": ("", ["line 1", "PathFileType", "empty file"]),
    "prose": ("Dear colleague\n" * 9, ["line 1", "PathFileType", "'Dear colleague'"]),
    "header only": ("\n".join(TEXT.split("\n")[:6]), ["rows of numbers", "none"]),
    "misspelt key": (
        TEXT.replace("NumFrames", "NumFrame", 1),
        ["line 2", "'NumFrame'", "did you mean 'NumFrames'"],
    ),
    "inches": (trc_text(POSITIONS, NAMES, unit="in"), ["line 3", "mm or m", "'in'"]),
    "rate 0": (trc_text(POSITIONS, NAMES, values={"DataRate": "0"}), ["DataRate", "0 Hz"]),
    "rate in words": (
        trc_text(POSITIONS, NAMES, values={"DataRate": "fast"}),
        ["line 3", "DataRate", "'fast'"],
    ),
    "frames": (
        trc_text(POSITIONS, NAMES, values={"NumFrames": "13"}),
        ["line 3", "expected 13 frames", "found 12 rows", "cut short"],
    ),
    "markers": (
        trc_text(POSITIONS, NAMES, values={"NumMarkers": "6"}),
        ["line 4", "expected 6 marker names", "found 5"],
    ),
    "twice": (trc_text(POSITIONS, ("a", "b", "c", "b", "e")), ["line 4", "'b' twice"]),
    "shifted names": (
        line(TEXT, 4, "Frame#\tTime\ta\t\tb\t\t\tc"),
        ["line 4, column 5", "expected nothing, found 'b'"],
    ),
    "axes": (TEXT.replace("\tY2", "\tZ2"), ["line 5", "expected 'Y2', found 'Z2'"]),
    "a value too few": (line(TEXT, 3, "100\t100\t12"), ["line 3", "8 different keys", "found 3"]),
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
