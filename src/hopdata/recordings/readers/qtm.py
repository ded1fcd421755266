"""QTM's motion-data exports (TSV), and plain tables with a column row.

The layout follows Qualisys' manual, "Motion data (.tsv)": one key per line, values
after tabs, keys in any order. ``EVENT`` and ``TRAJECTORY_TYPES`` are optional, and
``FILE_VERSION`` was added in
2.0.0. The column row (``Frame  Time  <name> X ...``) exists only if the export asked for it.
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
    *("FILE_VERSION", "NO_OF_FRAMES", "NO_OF_CAMERAS", "NO_OF_MARKERS", "FREQUENCY"),
    *("NO_OF_ANALOG", "ANALOG_FREQUENCY", "DESCRIPTION", "TIME_STAMP", "DATA_INCLUDED"),
    *("EVENT", "MARKER_NAMES", "TRAJECTORY_TYPES"),
)
_DECISIVE = {
    "NO_OF_FRAMES",
    "NO_OF_MARKERS",
    "FREQUENCY",
    "DATA_INCLUDED",
    "MARKER_NAMES",
}
_SECONDS, _LENGTHS = {"s", "sec", "#"}, {"mm", "cm", "m", "in"}
_IN_SECONDS = re.compile(r" ?[\[(](s|sec|seconds)[\])]$", re.IGNORECASE)
_PLAIN = re.compile(
    "(.*) ([xyz])", re.I
)  # `toe X`, as QTM writes it; any name may precede X
# `toe_x`, `toe (x)`, `toe.X [mm]`
_AXIS = re.compile(
    r"(.*[^ ._:/\[(-]|)[ ._:/-]*[ ._:/\[(-]([xyz])[\])]?\.?([ _]?[\[( _](mm|cm|m|in)[\])]?)?",
    re.I,
)
COUNTERS = ("Frame", "Time")  # columns that may precede the coordinates

_KEY = re.compile(r"[A-Z][A-Z0-9]*(_[A-Z0-9]+)*")


@dataclass
class QtmHeader:
    """Contents of the file before the first row of numbers.

    ``values`` maps a key to its fields and ``lines`` to its line number. ``columns`` is
    the column row, empty if there is none. The numbers start at byte ``offset``, after
    ``n_lines`` lines, with the fields ``first_row``.
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

    def place(self, key: str) -> str:
        """Return the file and line of `key`, for messages."""
        return (
            f"{self.path}, line {self.lines[key]}"
            if key in self.lines
            else str(self.path)
        )

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
        return (self.values.get(key) or [otherwise])[0]


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
        header.mark = text.mark_between(
            [text.decoded(line) for line in islice(file, 5)]
        )
        file.seek(0)
        for line in file:
            fields = text.split_line(path, line, header.mark)
            if _starts_the_numbers(header, fields):
                header.first_row = fields
                return header
            header.n_lines += 1
            header.offset += len(line)
            _take(header, fields)
    if not header.offset:
        raise RecordingError.at(path, "a QTM motion-data export", "an empty file")
    raise RecordingError.at(path, "rows of numbers after the header", "none")


def _starts_the_numbers(header: QtmHeader, fields: list[str]) -> bool:
    """Tell whether this row is the first row of numbers."""
    if fields == [""] or fields[0].startswith("#"):
        return False
    first = next((f for f in fields if f not in text.TEXT_TABLE_MISSING), None)
    if first is None or text.is_number(text.pointed(first)):
        return first is not None or len(fields) > 1
    if header.columns and _units(fields):
        return False
    is_key = _KEY.fullmatch(fields[0]) and fields[0] not in text.TEXT_TABLE_MISSING
    if is_key or is_column_row(fields):
        return False
    place = f"{header.path}, line {header.n_lines + 1}"
    if coordinate_stems(fields[1:4]):
        wanted = "Frame or Time (in s) before the coordinates"
        raise RecordingError.at(place, wanted, f"'{first[:40]}'")
    near, key = (
        did_you_mean(first.upper(), KEYS),
        re.split(r"[;, ]", first, maxsplit=1)[0],
    )
    if key != first and key.upper() in KEYS:
        near = "; separate the fields by tabs"
    raise RecordingError.at(place, "a header key or numbers", f"'{first[:40]}'{near}")


def _units(fields: list[str]) -> set[str]:
    """Return the units in a row below column names: a length, possibly seconds; else none."""
    found = {field.strip("[]()").lower() for field in fields} - {"", "-"}
    return (
        found if found <= _SECONDS | _LENGTHS and len(found & _LENGTHS) == 1 else set()
    )


def _take(header: QtmHeader, fields: list[str]) -> None:
    """Add a line that is not numbers to the header."""
    key = fields[0]
    if header.columns and _units(fields):
        header.unit = (_units(fields) - _SECONDS).pop()
    elif is_column_row(fields):
        header.columns = [counter(name) or name for name in text.trimmed(fields)]
        header.unit = unit_of(header.columns)
    elif key == "EVENT":
        header.events.append(_event(header, fields[1:]))
    elif key in header.values and header.values[key] != fields[1:]:
        place, first = f"{header.path}, line {header.n_lines}", header.lines[key]
        told = mismatch(place, f"{key} once", f"it with another value in line {first}")
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


def columns_of(fields: list[str]) -> tuple[list[str], list[str] | None]:
    """Return counters and marker names of a column row; None if others are not coordinates."""
    counters = list(filter(None, map(counter, fields[: len(COUNTERS)])))
    return counters, coordinate_stems(text.trimmed(fields)[len(counters) :])


def is_known(fields: list[str]) -> bool:
    """Tell whether a first row is from a QTM export: a key, column names or numbers."""
    first = fields[0]
    columns = is_column_row(fields) or coordinate_stems(fields[1:4])
    return first in KEYS or bool(columns) or text.is_number(text.pointed(first))


def is_column_row(fields: list[str]) -> bool:
    """Tell whether a row names counters or coordinates."""
    return bool(counter(fields[0])) or coordinate_stems(fields[:3]) is not None


def counter(column: str) -> str:
    """Return Frame or Time if a column is a counter, such as ``t`` or ``Time [s]``; else empty."""
    name = _IN_SECONDS.sub("", column)
    return "Time" if name == "t" else name.title() if name.title() in COUNTERS else ""


def coordinate(column: str) -> tuple[str, ...]:
    """Split a column's name into marker and axis if they are apart; else return it unsplit."""
    found = _PLAIN.fullmatch(column) or _AXIS.fullmatch(column)
    return ("", found[1].strip(), found[2].lower()) if found else (column,)


def unit_of(columns: list[str]) -> str:
    """Return the unit of length in column names; several are joined, which is not a unit."""
    units = {
        found[4].lower()
        for found in map(_AXIS.fullmatch, columns)
        if found and found[4]
    }
    return ", ".join(sorted(units))


def coordinate_stems(columns: list[str]) -> list[str] | None:
    """Return marker names of columns in threes ``<name> X``, ``Y``, ``Z``; else None.

    Axes may be in lower case. Between name and axis there may be a separator as in
    `coordinate`, or nothing.
    """
    stems, names = [], [" ".join(coordinate(column)[-2:]) for column in columns]
    for i in range(0, len(names) - 2, 3):
        x, y, z = names[i : i + 3]
        if (
            x[-1:] + y[-1:] + z[-1:] not in ("XYZ", "xyz")
            or not x[:-1] == y[:-1] == z[:-1]
        ):
            return None
        stems.append(x[:-1].strip())
    return stems if stems and len(columns) % 3 == 0 else None


# Meaning of each column of a QTM export.


def layout(header: QtmHeader) -> tuple[str, list[str], list[str], tuple[str, ...]]:
    """Return the place of the marker names, the names, the counters, and remarks.

    Names come from ``MARKER_NAMES`` or the column row. A file of only numbers gets
    ``marker1``, ``marker2`` and so on.

    Raises
    ------
    RecordingError
        If there are none, or they do not fit the columns or one another.
    """
    here, width = f"{header.path}, line {header.n_lines}", len(header.first_row)
    counters, stems = columns_of(header.columns) if header.columns else ([], None)
    if header.columns and stems is None:
        rest = header.columns[len(counters) :]
        odd = next(
            (
                i
                for i in range(0, len(rest), 3)
                if not coordinate_stems(rest[i : i + 3])
            ),
            0,
        )
        place = f"{here}, column {1 + len(counters) + odd}"
        found = ", ".join(repr(c) for c in rest[odd : odd + 3]) or "none"
        raise RecordingError.at(place, "the columns X, Y, Z of a marker", found)
    place, names = here, stems or []
    if "MARKER_NAMES" in header.values:
        place, names = (
            header.place("MARKER_NAMES"),
            text.trimmed(header.values["MARKER_NAMES"]),
        )
    elif not (header.columns or header.values):
        place, names = f"{header.path}, line 1", _numbered_names(header)
    if not names:
        hint = did_you_mean("MARKER_NAMES", set(header.values) - set(KEYS))
        raise RecordingError.at(
            header.path, "MARKER_NAMES or a column row", f"neither{hint}"
        )
    stated = header.number("NO_OF_MARKERS")
    remarks: tuple[str, ...] = ()
    if stated not in (None, len(names)):
        told = f"{place}: expected {stated:g} marker names (NO_OF_MARKERS), found {len(names)}"
        if (
            width in (3 * stated, 3 * stated + 2) and len(names) < stated
        ):  # the last have no name
            names += [""] * int(stated - len(names))
        elif width not in (3 * len(names), 3 * len(names) + 2):
            raise RecordingError(told)
        remarks = (f"{told}; the columns are those of {len(names)} markers",)
    for stem, name in zip(stems or (), names, strict=False):
        if stem != name:
            raise RecordingError.at(f"{here}: columns", f"'{name} X'", f"'{stem} X'")
    spare = width - 3 * len(names) - len(counters)
    if stems is None:
        counters = [*COUNTERS] if spare >= len(COUNTERS) else []
        spare -= len(counters)
    if (
        (stems and len(stems) != len(names))
        or spare < 0
        or any(header.first_row[width - spare :])
    ):
        wanted = f"{3 * len(names)} columns (X, Y, Z of {len(names)} markers), or two more for "
        below = f"{header.path}, line {header.n_lines + 1}"
        raise RecordingError.at(below, f"{wanted}Frame and Time", width)
    return place, names, counters, remarks


def _numbered_names(header: QtmHeader) -> list[str]:
    """Return names for the markers of a file with neither header nor column row."""
    n_columns = len(header.first_row)
    if n_columns % 3 == 0 and not header.first_row[-1] and all(header.first_row[:2]):
        since = f"since {n_columns} columns of which the last is empty can be read in two ways"
        found = "none; export with the column row"
        raise RecordingError.at(
            f"{header.path}, line 1", f"a column row, {since}", found
        )
    return [f"marker{i + 1}" for i in range(n_columns // 3)]


# Date and time in QTM's exports.

_FORMS = ("%Y-%m-%d, %H:%M:%S.%f", "%Y-%m-%d, %H:%M:%S")


def moment(stated: Any) -> datetime | None:
    """Return the start of the measurement; None unless it is a date in a known form."""
    for form in _FORMS if isinstance(stated, str) else ():
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
    if (kind := header.stated("DATA_INCLUDED", "3D")) != "3D":
        place = f"{header.place('DATA_INCLUDED')}: DATA_INCLUDED"
        told = f"'{kind}'; export the trajectories as 3D data"
        raise RecordingError.at(place, "'3D'", told)
    place, names, counters, wrong = layout(header)
    rows = text.Rows(
        header.path, header.n_lines, header.offset, len(header.first_row), header.mark
    )
    columns = range(len(counters), len(counters) + 3 * len(names))
    counted, positions = rows.markers(counters, columns)
    key, by_name = "NO_OF_FRAMES", dict(zip(counters, counted.T, strict=True))
    wrong += raw.frame_count(header.place(key), key, header.number(key), len(positions))
    stamps = by_name.get("Time")
    stopped = (
        stamps is not None and _is_triggered(header) and not np.all(np.diff(stamps) > 0)
    )
    told = "FREQUENCY is EXT and the time stamps do not increase; time counted from the frames"
    wrong += (f"{header.path}: {told}",) * bool(stopped)
    found = raw.assembled(
        str(header.path),
        raw.distinct_names(place, names, may_lack=True),
        positions,
        number=by_name.get("Frame", np.arange(1.0, len(positions) + 1)).copy(),
        stamps=None if stamps is None or stopped else stamps.copy(),
        unit=(str(header.path), header.unit),
        rates_hz=(_stated_rate(header, rate_hz), rate_hz),
        rate_place=header.place("FREQUENCY"),
        remarks=header.remarks + wrong,
        # Exports are in mm; a bare table states no unit.
        unit_is_stated=bool(header.unit) or not header.values.keys().isdisjoint(KEYS),
        events=tuple(event for event, _ in header.events),
        started=moment(header.stated("TIME_STAMP")),
    )
    return replace(found, remarks=found.remarks + _event_remarks(header, found.rate_hz))


def _is_triggered(header: QtmHeader) -> bool:
    return header.stated("FREQUENCY").upper() == "EXT"


def _stated_rate(header: QtmHeader, given_hz: float | None) -> float | None:
    """Return the header's frame rate, Hz, or None; with an external trigger the given one."""
    near = did_you_mean("FREQUENCY", set(header.values) - set(KEYS))
    if near and "FREQUENCY" not in header.values:
        raise RecordingError.at(
            f"{header.path}: header", "the key FREQUENCY", f"none{near}"
        )
    if _is_triggered(header):
        return raw.resolve_rate(header.place("FREQUENCY"), stated=None, given=given_hz)
    return header.number("FREQUENCY")


def _event_remarks(header: QtmHeader, rate_hz: float) -> tuple[str, ...]:
    """Return a remark on events whose time does not match their frame, from 1."""
    off = sum(
        abs(event.time_s * rate_hz - (frame - 1)) > 1 for event, frame in header.events
    )
    told = f"in {off} of {len(header.events)} events the time is not that of the frame"
    return (f"{header.path}: EVENT: {told}; the time is used",) * bool(off)
