"""Tables of gaps and faults: what was planted in a recording stands in them, and no more."""

from dataclasses import replace

import numpy as np
import pytest

from hopdata.recordings.hdf5 import read_recording, write_recording
from hopdata.recordings.quality.tables import (
    fault_table,
    gap_table,
    inspect,
    marker_table,
    recording_tables,
    remark_table,
)
from hopdata.recordings.recording import Recording


@pytest.fixture(scope="module")
def clean(sample_path):
    whole = read_recording(sample_path)
    n = 4000
    return Recording(
        "run", 5.0 + whole.time[:n], whole.positions[:n], whole.markers, whole.roles, whole.rate_hz
    )


@pytest.fixture(scope="module")
def faulty(clean):
    positions = clean.positions.copy()
    positions[100:130, 1] = np.nan
    positions[-10:, 4] = np.nan
    positions[2000, 0] += 0.05
    return Recording("faulty", clean.time, positions, clean.markers, clean.roles, clean.rate_hz)


def test_a_clean_recording_has_no_gaps_and_no_faults(clean):
    found = [(clean, inspect(clean))]
    assert gap_table(found).empty
    assert fault_table(found).empty
    table = marker_table(found)
    assert list(table["marker"]) == list(clean.markers)
    assert (table["missing"] == 0).all()
    assert np.allclose(table["noise_m"], 6e-4, rtol=0.15)
    assert np.allclose(table["duration_s"], 39.99)


def test_gaps_from_the_first_frame(faulty):
    gaps = gap_table([(faulty, inspect(faulty))])
    assert list(gaps["marker"]) == [faulty.markers[1], faulty.markers[4]]
    assert np.allclose(gaps["start_s"], [1.0, 39.9])
    assert np.allclose(gaps["stop_s"], [1.3, 40.0])
    assert list(gaps["frames"]) == [30, 10]
    markers = marker_table([(faulty, inspect(faulty))]).set_index("marker")
    assert markers.loc[faulty.markers[1], "longest_s"] == pytest.approx(0.3)
    assert markers["missing"].sum() == 40


def test_a_spike_is_a_row_with_its_size(clean, faulty):
    faults = fault_table([(clean, inspect(clean)), (faulty, inspect(faulty))])
    assert list(faults["kind"]) == ["spike"]
    row = faults.iloc[0]
    assert (row["recording"], row["marker"]) == ("faulty", faulty.markers[0])
    assert row["start_s"] == pytest.approx(20.0)
    assert float(row["remark"].split()[0]) == pytest.approx(50 * np.sqrt(3), abs=3)


def test_dropped_frames_stand_without_a_marker(clean):
    time = clean.time.copy()
    time[1000:] += 0.03
    late = Recording("late", time, clean.positions, clean.markers, clean.roles, clean.rate_hz)
    faults = fault_table([(late, inspect(late))])
    dropped = faults[faults["kind"] == "dropped"]
    assert list(dropped["marker"]) == [""]
    assert dropped["start_s"].iloc[0] == pytest.approx(9.99)
    assert dropped["remark"].iloc[0] == "3 frames"


def test_a_pause_is_no_fault(clean):
    time = clean.time.copy()
    time[1000:] += 1.0  # as between joined files
    paused = Recording("paused", time, clean.positions, clean.markers, clean.roles, clean.rate_hz)
    assert fault_table([(paused, inspect(paused))]).empty


def test_remarks_stand_with_their_recording(clean, tmp_path):
    guessed = replace(clean, name="guessed", remarks=("a.trc: unit: taken for mm",))
    table = remark_table([clean, guessed])
    assert list(table.itertuples(index=False, name=None)) == [("guessed", guessed.remarks[0])]
    path = tmp_path / "guessed.h5"
    write_recording(path, guessed)
    assert remark_table([read_recording(path)]).equals(table)
    assert list(remark_table([clean]).columns) == ["recording", "remark"]


def test_all_tables_of_some_recordings(clean, faulty):
    tables = recording_tables(iter([clean, faulty]))
    assert {name: set(table["recording"]) for name, table in tables.items()} == {
        "markers": {"run", "faulty"},
        "gaps": {"faulty"},
        "faults": {"faulty"},
        "remarks": set(),
    }
