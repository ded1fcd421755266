"""Contacts marked in a file: which labels are contacts, of which side."""

import numpy as np
import pytest
from written_files import write_c3d

from hopdata.landings.marked_events import (
    contacts_marked,
    side_of_contact,
    written_by_hopdata,
)
from hopdata.recording import Event, Recording
from hopdata.recordings.importing import import_recording
from hopdata.recordings.raw import RawRecording
from hopdata.recordings.writers.c3d import write_c3d_events
from hopdata.recordings.writers.contact_events import ContactEvent

LABELS = {
    "Right Foot Strike": "r",
    "Left Foot Strike": "l",
    "RHS": "r",
    "lic": "l",
    "L_TD": "l",
    "Left Heel Strike": "l",
    "Right initial contact": "r",
    "Foot Strike": "",
    "General Foot Strike": "",
    "Right Foot Off": None,
    "RTO": None,
    "Left Toe Off": None,
    "STRT": None,
    "Event": None,
    "": None,
}


@pytest.mark.parametrize("label", LABELS)
def test_side_of_a_label(label):
    assert side_of_contact(Event(label, 1.0)) == LABELS[label]


def recording(feet, events):
    names = (*feet, "hip1", "hip2", "hip3")
    time = np.arange(100) / 100
    positions = np.random.default_rng(2).uniform(0, 1, (100, len(names), 3))
    made = Recording.from_arrays(
        time, positions, names, feet=feet, body=names[len(feet) :]
    )
    object.__setattr__(made, "events", tuple(events))
    return made


def test_events_go_to_the_feet_of_their_side():
    events = [
        Event("Right Foot Strike", 0.5),
        Event("Left Foot Strike", 0.3),
        Event("Right Foot Off", 0.6),
        Event("Right Foot Strike", 0.2),
        Event("Foot Strike", 0.1),
    ]
    left, right = contacts_marked(recording(("L_heel", "L_toe", "R_heel"), events))
    assert left.column.feet == ("L_heel", "L_toe")
    np.testing.assert_array_equal(left.instant, [0.3])
    assert right.column.name == "Right Foot Strike"
    assert right.column.feet == ("R_heel",)
    np.testing.assert_array_equal(right.instant, [0.2, 0.5])
    assert right.source == "events"


def test_a_side_without_feet_and_feet_without_a_side_have_none():
    events = [Event("Right Foot Strike", 0.5)]
    assert contacts_marked(recording(("L_heel", "L_toe"), events)) == []
    assert contacts_marked(recording(("foot1", "foot2"), events)) == []


def test_events_that_hopdata_wrote_are_not_compared_with_it(tmp_path):
    marked = (Event("Left Foot Strike", 0.25), Event("Right Foot Strike", 0.5))
    time = np.arange(100) / 100
    positions = np.random.default_rng(2).uniform(100, 900, (100, 5, 3))
    names = ("L_toe", "R_toe", "hip1", "hip2", "hip3")
    raw = RawRecording(names, time, positions, 100.0, "mm", events=marked)
    write_c3d(tmp_path / "marked.c3d", raw)
    found = [
        ContactEvent(0.75, "L_toe", "left", 0.001, 1),
        ContactEvent(0.8, "R_toe", "right", 0.001, 1),
    ]
    copy = tmp_path / "copy.c3d"
    write_c3d_events(tmp_path / "marked.c3d", copy, found)
    markers = {"feet": names[:2], "body": names[2:]}
    read, _ = import_recording(copy, name="copy", markers=markers)
    assert len(read.events) == 4
    ours = written_by_hopdata(copy)
    assert sorted(event.time_s for event in ours) == pytest.approx([0.75, 0.8])
    left, right = contacts_marked(read, besides=ours)
    np.testing.assert_allclose(left.instant, [0.25])
    np.testing.assert_allclose(right.instant, [0.5])
    assert written_by_hopdata(tmp_path / "marked.c3d") == set()
    assert written_by_hopdata(tmp_path / "table.csv") == set()
