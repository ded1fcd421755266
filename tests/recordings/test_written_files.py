"""Deliberate mistakes in files of every format, and the messages that a user gets.

Each entry makes a file with a single mistake, and names what the message must contain
besides the file, `expected` and `found`: the place, both values, and the nearest name
if there is one. The files are processed fully, as in `hopdata check`.
"""

from dataclasses import replace

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mat_files import qtm_struct, write_mat5
from qtm_files import NAMES, data_rows, qtm_text, standing
from raw_strategies import assert_same, raw_recordings
from trc_files import trc_text
from written_files import write_c3d, write_qtm_tsv

from hopdata.errors import RecordingError
from hopdata.recording import Event, Recording
from hopdata.recordings.importing import import_recording
from hopdata.recordings.plausibility import check_plausible
from hopdata.recordings.raw import RawRecording
from hopdata.recordings.readers.formats import read_raw
from hopdata.recordings.readers.hdf5 import write_recording

MARKERS = {"body": list(NAMES[:3]), "feet": list(NAMES[3:])}
RAW = RawRecording(NAMES, np.arange(40) / 100, standing(), 100.0, "mm")
LINES = qtm_text().split("\r\n")  # 11 lines of header, the column row, 40 frames


def tsv(text):
    return lambda path: path.write_bytes(
        text if isinstance(text, bytes) else text.encode()
    )


def tsv_row(row, column, text):
    rows = [line.split("\t") for line in data_rows(standing())]
    rows[row][column] = text
    return tsv(qtm_text(rows=["\t".join(fields) for fields in rows]))


def c3d(edit=None, **changes):
    """A C3D file; `edit` changes the bytes afterwards."""

    def make(path):
        write_c3d(path, replace(RAW, **changes))
        if edit:
            path.write_bytes(edit(bytearray(path.read_bytes())))

    return make


def put(at, data):
    return lambda content: content[:at] + data + content[at + len(data) :]


def renamed(old, new):
    return lambda content: bytes(content).replace(old, new, 1)


def hdf5(edit):
    def make(path):
        roles = ("body",) * 3 + ("foot",) * 2
        write_recording(
            path, Recording("a", RAW.time, standing() / 1000, NAMES, roles, 100.0)
        )
        with h5py.File(path, "a") as file:
            edit(file)

    return make


def mat(**changes):
    return lambda path: write_mat5(path, {**qtm_struct(standing(), NAMES), **changes})


def frozen():
    positions = standing()
    positions[:, 4] = positions[0, 4]
    return positions


MISTAKES = {
    "decimal comma.tsv": (
        tsv_row(5, 6, "12,5"),
        ["line 18, column 7", "a number", "'12,5'", "point"],
    ),
    "key misspelt.tsv": (
        tsv(qtm_text(header={"FREQUENCY": None, "FREQUENCE": "100"})),
        ["the key FREQUENCY", "did you mean 'FREQUENCE'"],
    ),
    "marker renamed.tsv": (
        tsv(qtm_text(names=("hip left", "hip right", "back", "heal", "toe"))),
        ["markers.feet", "'heel'", "did you mean 'heal'"],
    ),
    "name twice.tsv": (
        tsv(qtm_text(names=("hip left", "hip right", "back", "heel", "heel"))),
        [
            "markers.feet",
            "line 10",
            "each marker name once",
            "'heel' twice",
            "'heel 1', 'heel 2'",
        ],
    ),
    "no rate.tsv": (
        tsv(qtm_text(frequency="EXT", counters=False)),
        ["line 4: frame rate", "input.rate_hz", "neither"],
    ),
    "6D.tsv": (
        tsv(qtm_text(header={"DATA_INCLUDED": "6D"})),
        ["line 9", "'3D'", "'6D'"],
    ),
    "a number for missing.tsv": (
        tsv_row(4, 3, "9.99e+37"),
        ["frame 5, marker hip left, y", "below 1e+09 mm", "found 9.99e+37"],
    ),
    "a count for a rate.tsv": (
        tsv(qtm_text(frequency="4294967295", counters=False)),
        ["line 4: frame rate", "at most 100000 Hz", "4.29497e+09 Hz"],
    ),
    "time twice.tsv": (
        tsv_row(9, 1, "0.08000"),
        ["frame 10", "after 0.08 s", "found 0.08 s"],
    ),
    "rate halved.tsv": (
        tsv(qtm_text(frequency="50")),
        ["time stamps", "0.02 s", "(50 Hz)", "0.01 s (100 Hz)"],
    ),
    "a marker that froze.tsv": (
        tsv(qtm_text(frozen())),
        ["'toe'", "to move", "40 frames"],
    ),
    "a text document.txt": (
        tsv("To whom it may concern\n"),
        ["line 1", "header key", "'To whom"],
    ),
    "inches.trc": (
        tsv(trc_text(standing(), NAMES, unit="inch")),
        ["scale", "15.3 m", "set input.unit: mm"],
    ),
    "a column lost.trc": (
        tsv(trc_text(standing(), NAMES).replace("\tX3\tY3", "\tX3")),
        ["line 5", "'Y3'", "'Z3'"],
    ),
    "cut short.c3d": (
        c3d(lambda content: content[:-1024]),
        ["frames", "40 (header) of 80 bytes", "room for", "cut short"],
    ),
    "rates that differ.c3d": (
        c3d(put(20, np.array([120], "<f4").tobytes())),
        ["POINT:RATE", "expected 120 Hz", "found 100 Hz"],
    ),
    "labels renamed.c3d": (
        c3d(renamed(b"LABELS", b"LABELZ")),
        ["markers.body", "unnamed 1", "found 'hip left'"],
    ),
    "unit.c3d": (c3d(renamed(b"mm", b"kg")), ["POINT:UNITS", "mm", "'kg'"]),
    "a picture.c3d": (
        tsv(b"\xff\xd8\xff\xe0" * 200),
        ["byte 1", "0x50", "0x50 in a header"],
    ),
    "other frames.mat": (mat(Frames=41.0), ["trial.Frames", "expected 41", "found 40"]),
    "no trajectories.mat": (
        mat(Trajectories={"Label": {}}),
        ["trial.Trajectories", "the field Labeled", "did you mean 'Label'"],
    ),
    "metres for mm.mat": (
        lambda path: write_mat5(path, qtm_struct(standing(scale=1e6), NAMES)),
        ["scale", "0.003 to 12 m", "603"],
    ),
    "markers lost.h5": (
        hdf5(lambda file: file.attrs.__delitem__("markers")),
        ["attribute 'markers'", "a list of texts", "none"],
    ),
    "frames that differ.h5": (
        hdf5(
            lambda file: (
                file.__delitem__("time"),
                file.__setitem__("time", np.arange(39.0)),
            )
        ),
        ["positions", "(39, 5, 3)", "(40, 5, 3)"],
    ),
    "y up.c3d": (
        c3d(positions=standing()[..., [1, 2, 0]], stated_up="y"),
        ["vertical axis z", "the body above the feet", "input.vertical_axis: y"],
    ),
}


def checked(path):
    recording, _ = import_recording(path, name="trial", markers=MARKERS)
    check_plausible(recording)
    return recording


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_in_a_file_is_told_with_place_expected_and_found(tmp_path, mistake):
    make, parts = MISTAKES[mistake]
    path = tmp_path / mistake
    make(path)
    with pytest.raises(RecordingError) as caught:
        checked(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    for part in ("expected", "found", *parts):
        assert part in message


TOLD = {
    "cut short.tsv": (
        tsv("\r\n".join(LINES[:30])),
        ["line 1: NO_OF_FRAMES", "expected 40", "found 18 rows", "cut short"],
    ),
    "key misspelt.trc": (
        tsv(trc_text(standing(), NAMES).replace("DataRate", "DataRat", 1)),
        ["line 2", "'DataRat'", "did you mean 'DataRate'"],
    ),
}


@pytest.mark.parametrize("mistake", TOLD)
def test_a_count_or_a_key_that_does_not_hold_is_told_beside_what_is_there(
    tmp_path, mistake
):
    make, parts = TOLD[mistake]
    make(tmp_path / mistake)
    (remark,) = checked(tmp_path / mistake).remarks
    for part in (str(tmp_path / mistake), "expected", "found", *parts):
        assert part in remark


def test_the_files_are_sound_but_for_the_mistake(tmp_path):
    sound = {
        "a.tsv": tsv(qtm_text()),
        "a.trc": tsv(trc_text(standing(), NAMES)),
        "a.c3d": c3d(),
        "a.mat": mat(),
        "a.h5": hdf5(lambda _: None),
    }
    for name, make in sound.items():
        make(tmp_path / name)
        recording = checked(tmp_path / name)
        np.testing.assert_allclose(recording.positions * 1000, standing(), atol=6e-4)


# Readers read what writers write: properties over recordings of any shape.

many = settings(
    max_examples=60,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


@many
@given(raw_recordings(), st.sampled_from(["", "NULL", "NaN", "nan", "-nan(ind)", "0"]))
def test_tsv(tmp_path, raw, missing):
    write_qtm_tsv(tmp_path / "a.tsv", raw, missing=missing)
    again = read_raw(tmp_path / "a.tsv")
    assert_same(again, raw, atol=1e-5)
    assert again.started == raw.started


@many
@given(raw_recordings(), st.sampled_from(["Intel", "DEC", "MIPS"]))
def test_c3d_of_floats(tmp_path, raw, processor):
    write_c3d(tmp_path / "a.c3d", raw, processor=processor)
    again = read_raw(tmp_path / "a.c3d")
    assert_same(again, raw, atol=3e-4, event_atol=4e-6)
    assert again.stated_up == raw.stated_up
    assert not again.remarks


@many
@given(raw_recordings(), st.sampled_from(["Intel", "DEC", "MIPS"]))
def test_c3d_of_whole_numbers(tmp_path, raw, processor):
    step = np.nanmax(np.abs(raw.positions)) / 32000
    write_c3d(tmp_path / "a.c3d", raw, processor=processor, whole_numbers=True)
    assert_same(read_raw(tmp_path / "a.c3d"), raw, atol=0.51 * step, event_atol=4e-6)


@many
@given(raw_recordings(largest=5.0, unit="m"))
def test_hdf5(tmp_path, raw):
    roles = ("other",) * len(raw.markers)
    recording = Recording(
        "a", raw.time, raw.positions, raw.markers, roles, raw.rate_hz, events=raw.events
    )
    write_recording(tmp_path / "a.h5", recording)
    assert_same(read_raw(tmp_path / "a.h5"), raw, atol=3e-7)


def plain(**changes):
    fields = {
        "markers": ("a", "b"),
        "time": np.arange(5) / 100,
        "positions": np.random.default_rng(3).uniform(1, 500, (5, 2, 3)),
        "rate_hz": 100.0,
        "unit": "mm",
    }
    return RawRecording(**{**fields, **changes})


@pytest.mark.parametrize("write", [write_qtm_tsv, write_c3d])
def test_metres(tmp_path, write):
    raw = plain(unit="m")
    path = tmp_path / {"write_c3d": "a.c3d"}.get(write.__name__, "a.tsv")
    write(path, raw)
    again = read_raw(path)
    metres = again.positions * {"mm": 1e-3, "m": 1.0}[again.unit]
    np.testing.assert_allclose(metres, raw.positions, rtol=1e-7)


@pytest.mark.parametrize(
    ("write", "changes", "parts"),
    [
        (write_qtm_tsv, {"markers": ("a\tb", "c")}, ["marker name", r"'a\tb'"]),
        (write_qtm_tsv, {"events": (Event("", 0.01),)}, ["event label", "''"]),
        (
            write_qtm_tsv,
            {"positions": np.zeros((5, 2, 3))},
            ["frame 1, marker 1", "(0, 0, 0)"],
        ),
        (
            write_c3d,
            {"positions": np.zeros((5, 2, 3))},
            ["frame 1, marker 1", "(0, 0, 0)"],
        ),
        (write_c3d, {"time": np.arange(5) / 90}, ["frame 5", "1/100 s", "0.0444444"]),
        (write_c3d, {"markers": ("a" * 256, "b")}, ["LABELS", "255 bytes", "of 256"]),
        (write_c3d, {"time": np.arange(5) / 100 - 1}, ["frame", "from 0 on", "-1"]),
    ],
)
def test_what_a_format_cannot_hold_is_refused(tmp_path, write, changes, parts):
    with pytest.raises(RecordingError) as caught:
        write(tmp_path / "file", plain(**changes))
    for part in (str(tmp_path / "file"), "expected", "found", *parts):
        assert part in str(caught.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".tsv", ".c3d", ".mat", ".trc", ".h5"])
def test_what_programs_write_for_an_unseen_marker_is_so_in_every_format(
    tmp_path, suffix
):
    positions = standing()
    positions[4, 3, 2] = 0.0
    positions[6, 2] = -9999.0
    positions[7, 2] = 9999.0
    positions[8, 0, 1:] = 9999.0
    path = tmp_path / f"file{suffix}"
    writers = {
        ".tsv": lambda: path.write_text(qtm_text(positions)),
        ".c3d": lambda: write_c3d(path, replace(RAW, positions=positions)),
        ".mat": lambda: write_mat5(path, qtm_struct(positions, NAMES)),
        ".trc": lambda: path.write_text(trc_text(positions, NAMES)),
        ".h5": lambda: write_recording(
            path,
            Recording(
                "one", RAW.time, positions, NAMES, ("other",) * len(NAMES), 100.0
            ),
        ),
    }
    writers[suffix]()
    read = read_raw(path).positions
    assert np.argwhere(np.isnan(read).all(axis=2)).tolist() == [[6, 2], [7, 2]]
    assert np.isnan(read).sum() == 6
    assert read[4, 3, 2] == 0
