"""Errors are lines that can be read, whatever they are about."""

import pytest

from hopdata.errors import LONGEST_LINE, RecordingError


@pytest.mark.parametrize("longer", [1, 1000, 1_000_000])
def test_of_a_very_long_line_the_middle_is_left_out(longer):
    name = "x" * (LONGEST_LINE + longer)
    error = RecordingError.at(
        "a.csv, line 1", "X, Y, Z", f"'{name}'; did you mean 'y'?"
    )
    told = str(error)
    assert told.startswith("a.csv, line 1: expected X, Y, Z, found 'xxx")
    assert told.endswith("xxx'; did you mean 'y'?")
    assert "characters left out" in told
    assert len(told) < LONGEST_LINE + 100
    # An error that is told within another one is not longer.
    assert len(str(RecordingError(f"study: {error}"))) < LONGEST_LINE + 100


def test_a_line_that_can_be_read_is_told_whole():
    line = "x" * LONGEST_LINE
    assert str(RecordingError(line)) == line
    assert str(RecordingError(line, line)) == f"{line}\n{line}"
