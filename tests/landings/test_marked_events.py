"""Contacts marked in a file: which labels are contacts, of which side."""

import numpy as np
import pytest

from hopdata.landings.marked_events import contacts_marked, side_of_contact
from hopdata.recording import Event, Recording

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
