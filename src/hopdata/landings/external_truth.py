"""Contacts known from elsewhere, compared with those that hopdata found in a study.

They come from the blocks ``contacts`` and ``forces`` of the configuration, and, without
any configuration, from the force plates and events in a recording's own file.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hopdata.arrays import pd
from hopdata.errors import AnalysisError, RecordingError
from hopdata.landings.forces import (
    EXAMPLE_COLUMNS,
    THRESHOLD_COLUMNS,
    Signals,
    contact_times_of,
    example_landing,
    threshold_rows,
)
from hopdata.landings.marked_events import contacts_marked, written_by_hopdata
from hopdata.landings.overlay import COLUMNS, compare_contacts, summarise_overlay
from hopdata.landings.plate_contacts import contacts_on_plates
from hopdata.messages import Message
from hopdata.recording import Event, Recording
from hopdata.recordings import external
from hopdata.recordings.force_plates import plates_of_recording

NOTE_COLUMNS = ("recording", "code", "note")


@dataclass(frozen=True)
class ExternalTruth:
    """Tables of the overlay.

    Parameters
    ----------
    contacts : pandas.DataFrame
        One row for each contact, see `compare_contacts`.
    summary : pandas.DataFrame
        One row for each column, see `summarise_overlay`.
    thresholds : pandas.DataFrame
        See `threshold_rows`; empty if there are no forces.
    example : pandas.DataFrame
        See `example_landing`.
    notes : pandas.DataFrame
        What is worth knowing of the plates and events in a recording's own file:
        recording, code, note.
    """

    contacts: pd.DataFrame
    summary: pd.DataFrame
    thresholds: pd.DataFrame
    example: pd.DataFrame
    notes: pd.DataFrame


@dataclass
class _Known:
    """What is known of a recording, gathered from its sources.

    `optional` holds the contacts of its own file, which nobody asked to compare: if
    they cannot be compared, that is a note and no error.
    """

    asked: list[external.ExternalContacts]
    optional: list[external.ExternalContacts]
    signals: Signals
    plate_signals: Signals
    notes: list[Message]


def overlay_external_truth(
    recordings: Sequence[Recording],
    touchdowns: pd.DataFrame,
    configured: Mapping[str, Mapping[str, Any]],
    *,
    window_s: float,
    rate_hz: float | None = None,
    unit: str = "auto",
) -> ExternalTruth:
    """Read the external data of a study and compare them with the contacts found.

    Parameters
    ----------
    recordings : sequence of Recording
        Levelled recordings that have external data.
    touchdowns : pandas.DataFrame
        Touchdowns of the study.
    configured : mapping
        The blocks ``contacts`` and ``forces`` of the configuration, by recording name;
        and ``own``, with the ``file`` whose force plates and events are compared.
    window_s : float
        ``external.window_s``.
    rate_hz : float, optional
        ``input.rate_hz``.
    unit : {"auto", "m", "mm"}
        ``input.unit``.
    """
    contacts: list[pd.DataFrame] = []
    thresholds: list[Any] = []
    examples = []
    notes: list[tuple[str, str, str]] = []
    for recording in recordings:
        is_own = touchdowns["recording"] == recording.name
        own = touchdowns[is_own].reset_index(drop=True)
        blocks = configured[recording.name]
        known = _known(recording, blocks, rate_hz=rate_hz, unit=unit)
        asked = [
            compare_contacts(recording, own, one, window_s=window_s)
            for one in known.asked
        ]
        by_plates, by_events = _compare_own(recording, own, known, window_s=window_s)
        compared = asked + by_plates + by_events
        contacts += compared
        thresholds += threshold_rows(recording, own, known.signals, window_s=window_s)
        notes += [(recording.name, note.code, str(note)) for note in known.notes]
        if not compared:
            continue
        # The columns of forces if there are any, else all. They are the last asked for.
        of_forces = asked[len(asked) - len(known.signals) :]
        shown = of_forces + by_plates or compared
        signals = [*known.signals, *known.plate_signals]
        examples.append(example_landing(recording, pd.concat(shown), signals))
    table = pd.DataFrame(columns=list(COLUMNS))
    if contacts:
        table = pd.concat(contacts, ignore_index=True)
    example = pd.DataFrame(columns=list(EXAMPLE_COLUMNS))
    if examples:
        example = next((one for one in examples if len(one)), examples[0])
    return ExternalTruth(
        table,
        summarise_overlay(table),
        pd.DataFrame(thresholds, columns=list(THRESHOLD_COLUMNS)),
        example,
        pd.DataFrame(notes, columns=list(NOTE_COLUMNS)),
    )


def _compare_own(
    recording: Recording, touchdowns: pd.DataFrame, known: _Known, *, window_s: float
) -> tuple[list[pd.DataFrame], list[pd.DataFrame]]:
    """Compare the contacts in a recording's own file: by its plates, and by its events.

    For contacts that cannot be compared, a note is added to `known`.
    """
    by_plates = []
    by_events = []
    for one in known.optional:
        try:
            table = compare_contacts(recording, touchdowns, one, window_s=window_s)
        except AnalysisError as error:
            values = {"name": one.column.name, "why": str(error)}
            known.notes.append(Message("landings.own_not_compared", values))
            continue
        if one.source == "plates":
            by_plates.append(table)
        else:
            by_events.append(table)
    return by_plates, by_events


def _known(
    recording: Recording,
    blocks: Mapping[str, Any],
    *,
    rate_hz: float | None,
    unit: str,
) -> _Known:
    """Read what the blocks of a recording name, and its own file."""
    feet = recording.names("foot")
    asked: list[external.ExternalContacts] = []
    signals: Signals = ()
    if blocks["contacts"]["file"] is not None:
        asked += external.read_contact_times(
            blocks["contacts"], feet=feet, rate_hz=rate_hz
        )
    if blocks["forces"]["file"] is not None:
        signals = external.read_force_signals(blocks["forces"], feet=feet)
        asked += [contact_times_of(signal) for signal in signals]
    known = _Known(asked, [], signals, (), [])
    own_file = (blocks.get("own") or {}).get("file")
    if own_file is None:
        return known
    ours: Collection[Event] = ()
    try:
        found = plates_of_recording(recording, Path(own_file), unit=unit)
        ours = written_by_hopdata(Path(own_file))
    except RecordingError as error:
        values = {"why": str(error)}
        known.notes.append(Message("landings.plates_not_read", values))
    else:
        of_plates = contacts_on_plates(recording, found.plates)
        known.optional += of_plates.contacts
        known.plate_signals = of_plates.signals
        known.notes += [*found.refused, *of_plates.notes]
    if blocks["contacts"]["file"] is None:
        known.optional += contacts_marked(recording, besides=ours)
    return known
