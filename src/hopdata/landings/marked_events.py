"""Contacts that somebody or something marked in a recording's file, by their labels.

Laboratories mark a foot strike on each side, as ``Right Foot Strike``, ``RHS`` or
``RIC``. Such an event is of the feet whose names have the same side.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path

import numpy as np

from hopdata.recording import Event, Recording
from hopdata.recordings.external import Column, ExternalContacts
from hopdata.recordings.quality.part_names import SIDE_NAMES, sides_of_feet, words_of
from hopdata.recordings.readers.c3d import open_c3d, read_events
from hopdata.recordings.writers.c3d import OURS

# Words of a contact beside a side, and abbreviations that hold both, in small letters.
_STRIKES = (
    ("foot", "strike"),
    ("heel", "strike"),
    ("initial", "contact"),
    ("foot", "contact"),
    ("touch", "down"),
    ("touchdown",),
    ("foot", "on"),
    ("footstrike",),
    ("heelstrike",),
)
_ABBREVIATED = re.compile(r"([lr])[ _-]?(hs|ic|fs|fc|td|on)")


def side_of_contact(event: Event) -> str | None:
    """Return the side of an event that is a contact: ``"l"``, ``"r"``, or empty.

    None if it is no contact, by its label.
    """
    plain = event.label.strip().lower()
    short = _ABBREVIATED.fullmatch(plain)
    if short:
        return short[1]
    words = words_of(event.label, r"[a-z]+")
    if not any(set(strike) <= set(words) for strike in _STRIKES):
        return None
    for letter, name in SIDE_NAMES.items():
        if letter in words or name in words:
            return letter
    return ""


def written_by_hopdata(file: Path) -> set[Event]:
    """Return the events that `hopdata contacts` has written into a C3D file.

    They are no other device's, so that nothing is to be compared with them.
    """
    if file.suffix.lower() != ".c3d":
        return set()
    _, parameters, _ = open_c3d(file)
    events, _ = read_events(parameters)
    descriptions = parameters.texts("EVENT", "DESCRIPTIONS")
    own = zip(events, descriptions, strict=False)
    return {event for event, description in own if description.startswith(OURS)}


def contacts_marked(
    recording: Recording, *, besides: Collection[Event] = ()
) -> list[ExternalContacts]:
    """Return the contacts marked in a recording's file, with the feet of their side.

    An event without a side, or of a side without feet, is of no known foot, and is left
    out.

    Parameters
    ----------
    recording : Recording
        With the events of its file.
    besides : collection of Event
        Events that are left out.
    """
    sides: dict[str, list[Event]] = {}
    for event in recording.events:
        side = side_of_contact(event)
        if side and event not in besides:
            sides.setdefault(side, []).append(event)
    found = []
    for side, events in sorted(sides.items()):
        feet = feet_of_side(recording.names("foot"), side)
        if not feet:
            continue
        instant = np.sort([event.time_s for event in events])
        span_s = (float(instant[0]), float(instant[-1]))
        name = max(events, key=lambda event: len(event.label)).label
        found.append(ExternalContacts(Column(name, feet), instant, "events", span_s))
    return found


def feet_of_side(feet: tuple[str, ...], side: str) -> tuple[str, ...]:
    """Return the feet of a side, ``"l"`` or ``"r"``, by their names."""
    sides = sides_of_feet(feet)
    return tuple(foot for foot, of in zip(feet, sides, strict=True) if of == side)
