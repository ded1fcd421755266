"""Contact events as tables: CSV, BIDS and OpenSim."""

import json

import pandas as pd
import pytest

from hopdata.recordings.writers.bids import events_name, write_bids_events
from hopdata.recordings.writers.contact_events import ContactEvent
from hopdata.recordings.writers.csv import write_csv_events
from hopdata.recordings.writers.opensim import write_opensim_events

EVENTS = [
    ContactEvent(10.5, "left", "left", 0.0007, 1),
    ContactEvent(10.5123, "right", "right", 0.0009, 1),
    ContactEvent(11.25, "left", "left", 0.0006, 2),
]


def test_csv_has_a_row_for_each_event(tmp_path):
    path = tmp_path / "new" / "events.csv"
    write_csv_events(path, EVENTS)
    table = pd.read_csv(path)
    assert list(table["time_s"]) == [10.5, 10.5123, 11.25]
    assert list(table["context"]) == ["Left", "Right", "Left"]
    assert list(table["foot"]) == ["left", "right", "left"]


def test_bids_counts_from_the_first_sample_and_explains_each_column(tmp_path):
    path = tmp_path / events_name("sub-01_task-jump_tracksys-omc_motion")
    assert path.name == "sub-01_task-jump_tracksys-omc_events.tsv"
    write_bids_events(path, EVENTS, begin_s=10.0, version="9.9")
    table = pd.read_csv(path, sep="\t")
    assert list(table.columns[:3]) == ["onset", "duration", "trial_type"]
    assert list(table["onset"]) == pytest.approx([0.5, 0.5123, 1.25])
    assert list(table["duration"]) == [0, 0, 0]
    kinds = ["left_foot_strike", "right_foot_strike", "left_foot_strike"]
    assert list(table["trial_type"]) == kinds
    sidecar = json.loads(path.with_suffix(".json").read_text("utf-8"))
    assert set(table.columns) <= set(sidecar)
    assert set(sidecar["trial_type"]["Levels"]) == set(kinds)
    assert sidecar["onset"]["Units"] == "s"


def test_a_file_without_bids_name_keeps_its_own():
    assert events_name("jump1") == "jump1_events.tsv"


def test_opensim_has_increasing_times_and_a_column_for_each_foot(tmp_path):
    path = tmp_path / "jump.sto"
    at_once = ContactEvent(11.25, "right", "right", 0.002, 2)
    write_opensim_events(path, [*EVENTS, at_once])
    lines = path.read_text().splitlines()
    end = lines.index("endheader")
    assert "nRows=3" in lines[:end]
    assert "nColumns=4" in lines[:end]
    head, *rows = (line.split("\t") for line in lines[end + 1 :])
    assert head == ["time", "left_contact", "right_contact", "contact_se_s"]
    values = [[float(cell) for cell in row] for row in rows]
    assert [row[1:3] for row in values] == [[1, 0], [0, 1], [1, 1]]
    times = [row[0] for row in values]
    assert times == sorted(set(times))
    assert values[2][3] == 0.002
