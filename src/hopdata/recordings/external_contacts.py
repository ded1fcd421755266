"""Contact instants from elsewhere: a table, or the events that stand in a recording's file."""

from __future__ import annotations

import codecs
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hopdata.errors import RecordingError, chosen, did_you_mean
from hopdata.recordings.columns import FloatArray, listed, open_table
from hopdata.recordings.external import Column, ContactTimes, columns_of
from hopdata.recordings.qtm_header import KEYS

SECONDS_PER_UNIT = {"s": 1.0, "ms": 1e-3}
WITH_EVENTS = (".c3d", ".mat")  # a text file is looked into


def read_contact_times(
    options: Mapping[str, Any], *, feet: Sequence[str], rate_hz: float | None = None
) -> list[ContactTimes]:
    """Read the contact instants that a recording's block ``contacts`` names.

    Parameters
    ----------
    options : mapping
        ``recordings[].contacts`` of the configuration: file, columns, label_column, time_column,
        unit, offset_s.
    feet : sequence of str
        Feet of the recording.
    rate_hz : float, optional
        ``input.rate_hz``, for files of recordings that state no rate.

    Returns
    -------
    list of ContactTimes
        One a column, on the recording's clock, in s.

    Raises
    ------
    RecordingError
        Naming the file, the column, what was expected and what was found.
    """
    path, unit = Path(options["file"]), chosen("contacts.unit", options["unit"], SECONDS_PER_UNIT)
    columns = columns_of(options["columns"], feet)
    if _is_recording(path):
        found = _events(path, columns, rate_hz)
    elif options["label_column"] is not None:
        found = _labelled(path, columns, options["label_column"], options["time_column"])
    else:
        table = open_table(path)
        found = {column.name: table.numbers(column.name) for column in columns}
    return [
        _contact_times(path, column, found[column.name] * unit + options["offset_s"])
        for column in columns
    ]


def _contact_times(path: Path, column: Column, instants: FloatArray) -> ContactTimes:
    instants = np.sort(instants[~np.isnan(instants)])
    if not len(instants):
        raise RecordingError(
            f"{path}: column '{column.name}': expected at least one contact instant, found none"
        )
    span = (float(instants[0]), float(instants[-1]))
    return ContactTimes(column, instants, "contacts", span)


def _labelled(
    path: Path, columns: Sequence[Column], label_column: str, time_column: str | None
) -> dict[str, FloatArray]:
    """Instants by label, from a table with one row a contact."""
    table = open_table(path)
    if time_column is None:
        raise RecordingError(
            f"{path}: contacts.time_column: expected the column of the instants beside "
            f"contacts.label_column, found null; the columns are {listed(table.names)}"
        )
    labels, times = np.array(table.texts(label_column)), table.numbers(time_column)
    return _by_label(f"{path}, column '{label_column}'", columns, labels, times)


def _events(path: Path, columns: Sequence[Column], rate_hz: float | None) -> dict[str, FloatArray]:
    """Instants by label, from the events of a file of motion capture."""
    from hopdata.recordings.formats import read_raw

    events = read_raw(path, rate_hz=rate_hz).events
    labels = np.array([event.label for event in events])
    times = np.array([event.time_s for event in events], dtype=np.float64)
    return _by_label(f"{path}: events", columns, labels, times)


def _by_label(
    place: str, columns: Sequence[Column], labels: np.ndarray[Any, Any], times: FloatArray
) -> dict[str, FloatArray]:
    present = tuple(dict.fromkeys(labels.tolist()))
    for column in columns:
        if column.name not in present:
            raise RecordingError(
                f"{place}: label: expected '{column.name}' among {listed(present) or 'no events'}, "
                f"found none{did_you_mean(column.name, present)}"
            )
    return {column.name: times[labels == column.name] for column in columns}


def _is_recording(path: Path) -> bool:
    """Whether a file is motion capture with events in it, rather than a table of instants."""
    if path.suffix.lower() not in (".tsv", ".txt") or not path.is_file():
        return path.suffix.lower() in WITH_EVENTS
    with path.open("rb") as file:
        first = file.readline().removeprefix(codecs.BOM_UTF8)
    return first.split(b"\t")[0].strip() in [key.encode() for key in KEYS]
