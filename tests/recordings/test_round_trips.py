"""What a writer writes, its reader reads: properties over recordings of any shape."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from raw_strategies import assert_same, raw_recordings

from hopdata.errors import RecordingError
from hopdata.recordings.c3d_writing import write_c3d
from hopdata.recordings.formats import read_raw
from hopdata.recordings.hdf5 import write_recording
from hopdata.recordings.qtm_tsv_writing import write_qtm_tsv
from hopdata.recordings.raw import Event, RawRecording
from hopdata.recordings.recording import Recording

many = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
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
def test_trajectory_types_and_metres(tmp_path, write):
    raw = plain(unit="m", trajectory_types=("Measured", "Virtual"))
    path = tmp_path / {"write_c3d": "a.c3d"}.get(write.__name__, "a.tsv")
    write(path, raw)
    again = read_raw(path)
    metres = again.positions * {"mm": 1e-3, "m": 1.0}[again.unit]
    np.testing.assert_allclose(metres, raw.positions, rtol=1e-7)
    assert again.trajectory_types in ((), raw.trajectory_types)


@pytest.mark.parametrize(
    ("write", "changes", "parts"),
    [
        (write_qtm_tsv, {"markers": ("a\tb", "c")}, ["marker name", r"'a\tb'"]),
        (write_qtm_tsv, {"events": (Event("", 0.01),)}, ["event label", "''"]),
        (write_qtm_tsv, {"positions": np.zeros((5, 2, 3))}, ["frame 1, marker 1", "(0, 0, 0)"]),
        (write_c3d, {"positions": np.zeros((5, 2, 3))}, ["frame 1, marker 1", "(0, 0, 0)"]),
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
