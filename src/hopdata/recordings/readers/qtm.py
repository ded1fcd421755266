"""QTM's motion-data exports (TSV), and plain tables with a column row.

The layout follows Qualisys' manual, "Motion data (.tsv)": one key per line, values
after tabs, keys in any order. ``EVENT`` and ``TRAJECTORY_TYPES`` are optional, and
``FILE_VERSION`` was added in 2.0.0. The column row (``Frame  Time  <name> X ...``)
exists only if the export asked for it.
"""

import re
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from itertools import islice
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from hopdata.errors import RecordingError, did_you_mean, mismatch
from hopdata.recording import Event
from hopdata.recordings import raw
from hopdata.recordings.readers import text

KEYS = (
    "FILE_VERSION",
    "NO_OF_FRAMES",
    "NO_OF_CAMERAS",
    "NO_OF_MARKERS",
    "FREQUENCY",
    "NO_OF_ANALOG",
    "ANALOG_FREQUENCY",
    "DESCRIPTION",
    "TIME_STAMP",
    "DATA_INCLUDED",
    "EVENT",
    "MARKER_NAMES",
    "TRAJECTORY_TYPES",
)

# Keys that may not be stated twice with different values.
_DECISIVE = {
    "NO_OF_FRAMES",
    "NO_OF_MARKERS",
    "FREQUENCY",
    "DATA_INCLUDED",
    "MARKER_NAMES",
}

# Columns that may precede the coordinates.
COUNTERS = ("Frame", "Time")

# Units in a row below the column names.
_SECONDS = {"s", "sec", "#"}
_LENGTHS = {"mm", "cm", "m", "in"}

_KEY = re.compile(r"[A-Z][A-Z0-9]*(_[A-Z0-9]+)*")
_IN_SECONDS = re.compile(
    r"( ?[\[(](s|sec|seconds)[\])]|_(s|sec|seconds))$", re.IGNORECASE
)

# A coordinate: `toe X`, as QTM writes it (any name may precede X), or in other forms
# such as `toe_x`, `toe (x)` and `toe.X [mm]`.
_PLAIN = re.compile("(.*) ([xyz])", re.I)
_AXIS = re.compile(
    r"(.*[^ ._:/\[(-]|)[ ._:/-]*[ ._:/\[(-]([xyz])[\])]?\.?"
    r"([ _]?[\[( _](mm|cm|m|in)[\])]?)?",
    re.I,
)


@dataclass
class QtmHeader:
    """Contents of the file before the first row of numbers.

    ``values`` maps a key to its fields and ``lines`` to its line number. ``columns`` is
    the column row, empty if there is none. The numbers start at byte ``offset``, after
    ``n_lines`` lines, with the fields ``first_row``. ``in_quotes`` tells whether a
    quote was opened in these lines and not closed.
    """

    path: Path
    values: dict[str, list[str]] = field(default_factory=dict)
    lines: dict[str, int] = field(default_factory=dict)
    events: list[tuple[Event, float]] = field(default_factory=list)
    columns: list[str] = field(default_factory=list)
    first_row: list[str] = field(default_factory=list)
    n_lines: int = 0
    offset: int = 0
    remarks: tuple[str, ...] = ()
    unit: str = ""
    mark: str = "\t"
    in_quotes: bool = False

    def place(self, key: str) -> str:
        """Return the file and line of `key`, for messages."""
        if key in self.lines:
            return f"{self.path}, line {self.lines[key]}"
        return str(self.path)

    def number(self, key: str) -> float | None:
        """Return the value of `key` as a number; None if the key is absent.

        Raises
        ------
        RecordingError
            If the value is not a number.
        """
        return text.stated_number(self.place(key), key, self.stated(key))

    def stated(self, key: str, otherwise: str = "") -> str:
        """Return the first field of `key`, or `otherwise` if the key is absent."""
        fields = self.values.get(key)
        return fields[0] if fields else otherwise


def read_header(path: Path) -> QtmHeader:
    """Read the header of a file up to the first row of numbers.

    Raises
    ------
    RecordingError
        If the file cannot be read, has no numbers, or has a line that is neither a key,
        a column row nor numbers.
    """
    header = QtmHeader(path)
    with text.readable(path) as file:
        first_lines = [text.decoded(line) for line in islice(file, 5)]
        header.mark = text.mark_between(first_lines)
        file.seek(0)
        for line in file:
            fields = text.split_line(path, line, header.mark)
            if _starts_the_numbers(header, fields):
                header.first_row = fields
                return header
            header.n_lines += 1
            header.offset += len(line)
            if line.count(b'"') % 2:
                header.in_quotes = not header.in_quotes
            _take(header, fields)
    if not header.offset:
        raise RecordingError.at(path, "a QTM motion-data export", "an empty file")
    raise RecordingError.at(path, "rows of numbers after the header", "none")


def _starts_the_numbers(header: QtmHeader, fields: list[str]) -> bool:
    """Tell whether this row is the first row of numbers."""
    if fields == [""] or text.is_above_table(fields):
        return False
    present = [one for one in fields if one not in text.TEXT_TABLE_MISSING]
    if not present:
        return len(fields) > 1
    first = present[0]
    if text.is_number(text.pointed(first)):
        return True
    if header.columns and _units(fields):
        return False
    is_key = _KEY.fullmatch(fields[0]) and fields[0] not in text.TEXT_TABLE_MISSING
    if is_key or is_column_row(fields):
        return False
    place = f"{header.path}, line {header.n_lines + 1}"
    if coordinate_stems(fields[1:4]):
        wanted = "Frame or Time (in s) before the coordinates"
        raise RecordingError.at(place, wanted, f"'{first[:40]}'")
    if header.in_quotes:
        found = f"'{first[:40]}' after a quote that is not closed in a line above"
        raise RecordingError.at(place, "each name of a column within one line", found)
    near = did_you_mean(first.upper(), KEYS)
    first_word = re.split(r"[;, ]", first, maxsplit=1)[0]
    if first_word != first and first_word.upper() in KEYS:
        near = "; separate the fields by tabs"
    raise RecordingError.at(place, "a header key or numbers", f"'{first[:40]}'{near}")


def _units(fields: list[str]) -> set[str]:
    """Return the units in a row below column names: a length and possibly seconds."""
    units = {field.strip("[]()").lower() for field in fields} - {"", "-"}
    if units <= _SECONDS | _LENGTHS and len(units & _LENGTHS) == 1:
        return units
    return set()


def _take(header: QtmHeader, fields: list[str]) -> None:
    """Add a line that is not numbers to the header."""
    key = fields[0]
    if header.columns and _units(fields):
        (header.unit,) = _units(fields) - _SECONDS
    elif is_column_row(fields):
        header.columns = [counter(name) or name for name in text.trimmed(fields)]
        header.unit = unit_of(header.columns)
    elif key == "EVENT":
        header.events.append(_event(header, fields[1:]))
    elif key in header.values and header.values[key] != fields[1:]:
        place = f"{header.path}, line {header.n_lines}"
        found = f"it with another value in line {header.lines[key]}"
        told = mismatch(place, f"{key} once", found)
        if key in _DECISIVE:
            raise RecordingError(told)
        header.remarks += (f"{told}; the first is taken",)
    elif key:
        header.values[key] = fields[1:]
        header.lines[key] = header.n_lines


def _event(header: QtmHeader, fields: list[str]) -> tuple[Event, float]:
    """Read the rest of an ``EVENT`` row: label, frame, time."""
    with suppress(ValueError):
        label, frame, seconds = text.trimmed(fields)
        if isfinite(float(seconds) + float(frame)):
            return Event(label, float(seconds)), float(frame)
    place = f"{header.path}, line {header.n_lines}: EVENT"
    raise RecordingError.at(place, "a label, a frame and a time", fields)


# Names of columns.


def columns_of(fields: list[str]) -> tuple[list[str], list[str] | None]:
    """Return counters and marker names of a column row.

    The names are None if the other columns are not coordinates.
    """
    counters = [counter(name) for name in fields[: len(COUNTERS)]]
    counters = [name for name in counters if name]
    return counters, coordinate_stems(text.trimmed(fields)[len(counters) :])


def is_known(fields: list[str]) -> bool:
    """Tell whether a first row is from a QTM export: a key, column names or numbers."""
    first = fields[0]
    if first in KEYS or is_column_row(fields) or coordinate_stems(fields[1:4]):
        return True
    return text.is_number(text.pointed(first))


def is_column_row(fields: list[str]) -> bool:
    """Tell whether a row names counters or coordinates."""
    return bool(counter(fields[0])) or coordinate_stems(fields[:3]) is not None


def counter(column: str) -> str:
    """Return Frame or Time if a column is a counter, such as ``t``, ``Time [s]``.

    Else the name is empty.
    """
    name = _IN_SECONDS.sub("", column)
    if name == "t":
        return "Time"
    if name.title() in COUNTERS:
        return name.title()
    return ""


def coordinate(column: str) -> tuple[str, ...]:
    """Split the name of a coordinate into marker and axis; return others unsplit.

    Returns
    -------
    tuple of str
        Nothing, the marker and the axis; or the name alone.
    """
    found = _PLAIN.fullmatch(column) or _AXIS.fullmatch(column)
    if found is None:
        return (column,)
    return ("", found[1].strip(), found[2].lower())


def unit_of(columns: list[str]) -> str:
    """Return the unit of length in column names.

    Several are joined, which is not a unit.
    """
    units = set()
    for column in columns:
        found = _AXIS.fullmatch(column)
        if found is not None and found[4]:
            units.add(found[4].lower())
    return ", ".join(sorted(units))


def coordinate_stems(columns: list[str]) -> list[str] | None:
    """Return marker names of columns in threes ``<name> X``, ``Y``, ``Z``; else None.

    Axes may be in lower case. Between name and axis there may be a separator as in
    `coordinate`, or nothing.
    """
    names = [" ".join(coordinate(column)[-2:]) for column in columns]
    stems = []
    for i in range(0, len(names) - 2, 3):
        x, y, z = names[i : i + 3]
        axes = x[-1:] + y[-1:] + z[-1:]
        is_one_marker = x[:-1] == y[:-1] == z[:-1]
        if axes not in ("XYZ", "xyz") or not is_one_marker:
            return None
        stems.append(x[:-1].strip())
    if not stems or len(columns) % 3:
        return None
    return stems


# Meaning of each column of a QTM export.


@dataclass(frozen=True)
class Layout:
    """Columns of an export.

    Parameters
    ----------
    place : str
        Place of the marker names, for messages.
    names : list of str
        The markers.
    counters : list of str
        Columns before the coordinates.
    remarks : tuple of str
        What the file states otherwise.
    """

    place: str
    names: list[str]
    counters: list[str]
    remarks: tuple[str, ...]


def layout(header: QtmHeader) -> Layout:
    """Return the meaning of the columns.

    Names come from ``MARKER_NAMES`` or the column row. A file of only numbers gets
    ``marker1``, ``marker2`` and so on.

    Raises
    ------
    RecordingError
        If there are none, or they do not fit the columns or one another.
    """
    here = f"{header.path}, line {header.n_lines}"
    width = len(header.first_row)
    counters: list[str] = []
    stems: list[str] | None = None
    if header.columns:
        counters, stems = columns_of(header.columns)
        if stems is None:
            raise _no_coordinates(header, counters)
    place, names = _names(header, stems)
    is_named_by_columns = names is stems
    names, remarks = _as_many_as_stated(header, place, names)
    if is_named_by_columns:
        stems = names
    for stem, name in zip(stems or (), names, strict=False):
        if stem != name:
            raise RecordingError.at(f"{here}: columns", f"'{name} X'", f"'{stem} X'")
    spare = width - 3 * len(names) - len(counters)
    if stems is None:
        # Without a column row, two more columns are frame and time.
        counters = [*COUNTERS] if spare >= len(COUNTERS) else []
        spare -= len(counters)
    is_other_number = bool(stems) and len(stems or ()) != len(names)
    if is_other_number or spare < 0 or any(header.first_row[width - spare :]):
        columns = f"{3 * len(names)} columns (X, Y, Z of {len(names)} markers)"
        below = f"{header.path}, line {header.n_lines + 1}"
        wanted = f"{columns}, or two more for Frame and Time"
        raise RecordingError.at(below, wanted, width)
    return Layout(place, names, counters, remarks)


def _no_coordinates(header: QtmHeader, counters: list[str]) -> RecordingError:
    """Return the error that names the first columns which are not those of a marker."""
    others = header.columns[len(counters) :]
    odd = 0
    for i in range(0, len(others), 3):
        if not coordinate_stems(others[i : i + 3]):
            odd = i
            break
    line = f"{header.path}, line {header.n_lines}"
    place = f"{line}, column {1 + len(counters) + odd}"
    found = ", ".join(repr(name) for name in others[odd : odd + 3]) or "none"
    return RecordingError.at(place, "the columns X, Y, Z of a marker", found)


def _names(header: QtmHeader, stems: list[str] | None) -> tuple[str, list[str]]:
    """Return the place of the marker names, for messages, and the names."""
    place = f"{header.path}, line {header.n_lines}"
    names = stems or []
    if "MARKER_NAMES" in header.values:
        place = header.place("MARKER_NAMES")
        names = text.trimmed(header.values["MARKER_NAMES"])
    elif not (header.columns or header.values):
        place = f"{header.path}, line 1"
        names = _numbered_names(header)
    if not names:
        hint = did_you_mean("MARKER_NAMES", set(header.values) - set(KEYS))
        wanted = "MARKER_NAMES or a column row"
        raise RecordingError.at(header.path, wanted, f"neither{hint}")
    return place, names


def _as_many_as_stated(
    header: QtmHeader, place: str, names: list[str]
) -> tuple[list[str], tuple[str, ...]]:
    """Return as many names as there are markers; a remark if others are stated."""
    stated = header.number("NO_OF_MARKERS")
    if stated is None or stated == len(names):
        return names, ()
    width = len(header.first_row)
    wanted = f"expected {stated:g} marker names (NO_OF_MARKERS)"
    told = f"{place}: {wanted}, found {len(names)}"
    if len(names) < stated and width in (3 * stated, 3 * stated + 2):
        # The last markers have no name.
        names = names + [""] * int(stated - len(names))
    elif width not in (3 * len(names), 3 * len(names) + 2):
        raise RecordingError(told)
    return names, (f"{told}; the columns are those of {len(names)} markers",)


def _numbered_names(header: QtmHeader) -> list[str]:
    """Return names for the markers of a file with neither header nor column row."""
    n_columns = len(header.first_row)
    is_last_empty = not header.first_row[-1]
    # With the last column these are markers, without it frame, time and markers.
    if n_columns % 3 == 0 and is_last_empty and all(header.first_row[:2]):
        two_ways = "of which the last is empty can be read in two ways"
        wanted = f"a column row, since {n_columns} columns {two_ways}"
        found = "none; export with the column row"
        raise RecordingError.at(f"{header.path}, line 1", wanted, found)
    return [f"marker{i + 1}" for i in range(n_columns // 3)]


# Date and time in QTM's exports.

_FORMS = ("%Y-%m-%d, %H:%M:%S.%f", "%Y-%m-%d, %H:%M:%S")


def moment(stated: Any) -> datetime | None:
    """Return the start of the measurement; None unless it is a date in a known form."""
    if not isinstance(stated, str):
        return None
    for form in _FORMS:
        with suppress(ValueError):
            return datetime.strptime(stated.split("\t")[0].strip(), form)
    return None


# Reader of QTM motion-data exports (TSV) and of plain tables with a column row: mm.


def read_qtm_tsv(path: Path, *, rate_hz: float | None = None) -> raw.RawRecording:
    """Read a 3-D motion-data export of Qualisys Track Manager.

    A marker counts as unseen if a coordinate is missing (empty, ``NULL``, ``NaN``), or
    if all three are 0. A single 0 is a valid coordinate.

    Parameters
    ----------
    path : path
        The ``.tsv`` file, with or without header, column row, Frame and Time columns.
    rate_hz : float, optional
        Frame rate, needed if the file states none (``FREQUENCY`` is ``EXT``).

    Returns
    -------
    RawRecording
        Positions in mm along the file's axes.

    Raises
    ------
    RecordingError
        If the file cannot be read; names the file, the line, what was expected and
        found.
    """
    header = read_header(path)
    _require_3d(header)
    columns = layout(header)
    n_counters = len(columns.counters)
    rows = text.Rows(
        header.path,
        n_lines=header.n_lines,
        offset=header.offset,
        width=len(header.first_row),
        mark=header.mark,
    )
    coordinates = range(n_counters, n_counters + 3 * len(columns.names))
    counted, positions = rows.markers(columns.counters, coordinates)
    by_name = dict(zip(columns.counters, counted.T, strict=True))
    key = "NO_OF_FRAMES"
    stated_frames = header.number(key)
    miscounted = raw.frame_count(header.place(key), key, stated_frames, len(positions))
    number = by_name.get("Frame")
    if number is None:
        number = np.arange(1.0, len(positions) + 1)
    stamps = by_name.get("Time")
    stopped: tuple[str, ...] = ()
    increases = stamps is None or bool(np.all(np.diff(stamps) > 0))
    if _is_triggered(header) and not increases:
        why = "FREQUENCY is EXT and the time stamps do not increase"
        stopped = (f"{header.path}: {why}; time counted from the frames",)
        stamps = None
    # Exports are in mm; a bare table states no unit.
    is_export = not header.values.keys().isdisjoint(KEYS)
    found = raw.assembled(
        str(header.path),
        raw.distinct_names(columns.place, columns.names, may_lack=True),
        positions,
        number=number.copy(),
        stamps=None if stamps is None else stamps.copy(),
        unit=(str(header.path), header.unit),
        rates_hz=(_stated_rate(header, rate_hz), rate_hz),
        rate_place=header.place("FREQUENCY"),
        remarks=header.remarks + columns.remarks + miscounted + stopped,
        unit_is_stated=bool(header.unit) or is_export,
        events=tuple(event for event, _ in header.events),
        started=moment(header.stated("TIME_STAMP")),
    )
    return replace(found, remarks=found.remarks + _event_remarks(header, found.rate_hz))


def _require_3d(header: QtmHeader) -> None:
    kind = header.stated("DATA_INCLUDED", "3D")
    if kind != "3D":
        place = f"{header.place('DATA_INCLUDED')}: DATA_INCLUDED"
        found = f"'{kind}'; export the trajectories as 3D data"
        raise RecordingError.at(place, "'3D'", found)


def _is_triggered(header: QtmHeader) -> bool:
    """Tell whether the frames are triggered from outside, at a rate that is unknown."""
    return header.stated("FREQUENCY").upper() == "EXT"


def _stated_rate(header: QtmHeader, given_hz: float | None) -> float | None:
    """Return the header's frame rate, Hz, if any; the given one if triggered."""
    near = did_you_mean("FREQUENCY", set(header.values) - set(KEYS))
    if near and "FREQUENCY" not in header.values:
        place = f"{header.path}: header"
        raise RecordingError.at(place, "the key FREQUENCY", f"none{near}")
    if _is_triggered(header):
        return raw.resolve_rate(header.place("FREQUENCY"), stated=None, given=given_hz)
    return header.number("FREQUENCY")


def _event_remarks(header: QtmHeader, rate_hz: float) -> tuple[str, ...]:
    """Return a remark on events whose time does not match their frame, from 1."""
    off = 0
    for event, frame in header.events:
        if abs(event.time_s * rate_hz - (frame - 1)) > 1:
            off += 1
    if not off:
        return ()
    odd = f"in {off} of {len(header.events)} events the time is not that of the frame"
    return (f"{header.path}: EVENT: {odd}; the time is used",)
