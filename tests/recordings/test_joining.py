"""Several files of one day as one recording."""

from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from qtm_files import NAMES, qtm_text, standing, write

from hopdata.errors import RecordingError
from hopdata.recordings.importing import import_recording
from hopdata.recordings.joining import PAUSE_S, join
from hopdata.recordings.plausibility import check_plausible
from hopdata.recordings.raw import Event, RawRecording

MARKERS = {"body": list(NAMES[:3]), "feet": list(NAMES[3:])}
NOON = datetime(2021, 1, 1, 12)
PATHS = [Path("a.tsv"), Path("b.tsv")]


def raw(start=0.0, **changes):
    made = RawRecording(
        NAMES, start + np.arange(50) / 100, standing(50), 100.0, "mm", events=(Event("e", start),)
    )
    return replace(made, **changes)


def test_files_that_state_their_date_are_placed_by_it():
    later = NOON + timedelta(seconds=90)
    joined = join(PATHS, [raw(started=NOON), raw(started=later)])
    assert joined.time[50] == pytest.approx(90.0)
    assert [e.time_s for e in joined.events] == pytest.approx([0.0, 90.0])
    assert joined.positions.shape == (100, 5, 3)
    assert not joined.remarks


def test_time_stamps_that_go_on_are_kept():
    joined = join(PATHS, [raw(), raw(start=0.9)])
    assert joined.time[50] == 0.9
    assert not joined.remarks


@pytest.mark.parametrize("started", [None, NOON])
def test_others_are_put_after_a_pause_and_said(started):
    joined = join(PATHS, [raw(started=started), raw(started=started)])
    assert joined.time[50] == pytest.approx(0.49 + PAUSE_S)
    assert np.all(np.diff(joined.time) > 0)
    assert "1 of them (b.tsv)" in joined.remarks[0]


@pytest.mark.parametrize(
    ("second", "parts"),
    [
        (raw(started=NOON - timedelta(1)), ["recorded after a.tsv", "order of time"]),
        (raw(rate_hz=120.0), ["frame rate", "expected 100.0", "found 120.0"]),
        (raw(unit="m"), ["unit", "expected mm", "found m"]),
        (raw(stated_up="y"), ["vertical axis", "found y"]),
        (raw(markers=tuple("abcde")), ["markers", "hip left", "('a', 'b'"]),
    ],
)
def test_files_that_do_not_belong_together_are_refused(second, parts):
    with pytest.raises(RecordingError) as caught:
        join(PATHS, [raw(started=NOON), second])
    for part in ("b.tsv", "expected", "found", *parts):
        assert part in str(caught.value)


def test_a_recording_of_two_files(tmp_path):
    halves = np.split(standing(80), [50])
    bare = {"TIME_STAMP": None}
    paths = [
        write(tmp_path, qtm_text(half, header=bare), f"part{i}.tsv")
        for i, half in enumerate(halves)
    ]
    recording, truth = import_recording(paths, name="day", markers=MARKERS)
    check_plausible(recording)
    np.testing.assert_allclose(recording.positions * 1000, standing(80), atol=6e-4)
    assert recording.source == ", ".join(path.as_posix() for path in paths)
    assert len(recording.source_sha256.split(", ")) == 2
    assert truth is None
    assert len(recording.remarks) == 1


def test_a_marker_that_one_file_lacks_is_told_with_that_file(tmp_path):
    first = write(tmp_path, qtm_text(), "a.tsv")
    second = write(
        tmp_path, qtm_text(names=("hip left", "hip right", "bak", "heel", "toe")), "b.tsv"
    )
    with pytest.raises(RecordingError, match=r"b.tsv: .*found 'back'; did you mean 'bak'"):
        import_recording([first, second], name="day", markers=MARKERS)


def test_no_file_at_all_is_refused():
    with pytest.raises(RecordingError, match="at least one file, found none"):
        import_recording([], name="day", markers=MARKERS)
