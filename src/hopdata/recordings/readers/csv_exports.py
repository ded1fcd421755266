"""Comma-separated exports: OptiTrack Motive, Vicon Nexus, keypoints from video, plain tables.

The suffix says nothing, so the first lines decide: Motive begins with its format version, Nexus has
a section of trajectories, DeepLabCut three rows from its scorer on, Anipose and plain tables name
columns of coordinates. All leave cells empty where a marker was not seen. What stands between the
cells may be a semicolon or a tab as well; then a comma is one of decimals.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import RecordingError
from hopdata.recordings import raw
from hopdata.recordings.readers import qtm_header, text
from hopdata.recordings.readers.keypoints import AXES, Columns, keypoints

_KINDS = {"Marker", "Rigid Body", "Rigid Body Marker", "Bone", "Bone Marker"}
_SECTIONS = ("Devices", "Model Outputs", "Joints", "Segments", "Events")  # of Nexus, not read
_MOST_HEADER_LINES = 40

Row = list[str]


@dataclass(frozen=True)
class _Sheet:
    """Lines of a file, with commas between the cells, and the rate that the user gave, Hz."""

    path: Path
    lines: list[str]
    rate_hz: float | None

    def rows(self, first: int = 0, stop: int = _MOST_HEADER_LINES) -> list[Row]:
        """Cells of some lines."""
        return [_cells(line) for line in self.lines[first:stop]]

    def line(self, index: int) -> str:
        """Place of a line, from 0, for messages."""
        return f"{self.path}, line {index + 1}"


def read_csv(
    path: str | Path, *, rate_hz: float | None = None, least_score: float
) -> raw.RawRecording:
    """Read the markers of a comma-separated export.

    Parameters
    ----------
    path : path
        The ``.csv`` file.
    rate_hz : float, optional
        Frame rate; must be the file's, if it states one. Keypoints from video state none.
    least_score : float
        Keypoints with a smaller likelihood or score count as unseen.

    Raises
    ------
    RecordingError
        Naming the file, the line, what was expected and what was found.
    """
    path = Path(path)
    with text.readable(path) as file:
        content = text.decoded(file.read())
    if "\0" in content:
        raise RecordingError(f"{path}: expected comma-separated text, found binary data")
    sheet = _Sheet(path, _by_commas(content.splitlines()), rate_hz)
    rows = sheet.rows()
    first = next(iter(rows), [""])
    if first[0] == "Format Version":
        return _motive(sheet, rows)
    if any(line.lower().startswith("trajectories") for line in sheet.lines):
        return _nexus(sheet)
    if first[0] == "scorer":
        return _deeplabcut(sheet, rows, least_score)
    if len(rows) > 1 and rows[1][:3] == list(AXES):  # JARVIS: names above, coordinates below
        columns: Columns = [("", _at(first, k), axis) for k, axis in enumerate(rows[1])]
        numbers = _numbers(sheet, 2, list(range(len(columns))))
        return keypoints(path, columns, numbers, rate_hz, least_score)
    counters = tuple(cell.lower() for cell in first[:2] if cell.lower() in ("frame", "time"))
    if names := qtm_header.coordinate_stems(text.trimmed(first)[len(counters) :]):
        places = [len(counters) + 3 * k for k in range(len(names))]
        return _recording(sheet, 0, places, names, None, counters=counters)
    if sum(name.endswith(("_x", "_y", "_z")) for name in first) >= 3:
        numbers = _numbers(sheet, 1, list(range(len(first))))
        return keypoints(path, [(c,) for c in first], numbers, rate_hz, least_score)
    raise RecordingError(
        f"{path}, line 1: expected an export of Motive (Format Version), Vicon Nexus (a section "
        f"Trajectories), DeepLabCut (scorer) or Anipose, or a table (columns <name>_x, _y, _z), "
        f"found '{','.join(first)[:40]}'"
    )


def _motive(sheet: _Sheet, rows: list[Row]) -> raw.RawRecording:
    """Read markers; those solved from a rigid body or skeleton only if there are no others."""
    path, keys = sheet.path, dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    axes_at = _row_that(path, rows, "Frame, Time (Seconds), X, Y, Z", lambda row: row[0] == "Frame")
    kinds = next((row for row in rows[1:axes_at] if _KINDS & {*row}), [])
    if not kinds:
        raise RecordingError(f"{path}: expected a row of Marker or Rigid Body, found none")
    names = rows[rows.index(kinds) + 1]
    starts = [
        place
        for place, axis in enumerate(rows[axes_at])
        if axis == "X" and _at(rows[axes_at - 1], place) == "Position"
    ]
    of_kind = {
        kind: [place for place in starts if _at(kinds, place) == kind]
        for kind in ("Marker", "Rigid Body Marker", "Bone Marker")
    }
    solved = of_kind["Rigid Body Marker"] or of_kind["Bone Marker"]
    places = of_kind["Marker"] or solved
    remarks: tuple[str, ...] = ()
    unnamed = [p for p in places if _at(names, p).lower().startswith("unlabel")]
    if solved and unnamed == places:
        places = solved
    if places is solved and places:
        remarks = (f"{path}: markers are those of the solved bodies, none was exported as seen",)
    if not places:
        raise RecordingError(
            f"{path}: expected positions of markers, found none; export them from Motive as well"
        )
    place, unit = sheet.line(0), keys.get("Length Units", "")
    rate = _stated(place, keys, "Export Frame Rate", "Capture Frame Rate")
    found = _recording(
        sheet, axes_at, places, [_at(names, p) for p in places], rate,
        unit=unit, unit_place=f"{place}: Length Units", remarks=remarks, counters=("frame", "time"),
    )  # fmt: skip
    return replace(found, started=qtm_header.moment(keys.get("Capture Start Time")))


def _nexus(sheet: _Sheet) -> raw.RawRecording:
    """Read the section of trajectories; devices and the outputs of models stand in others."""
    lines = sheet.lines
    at = next(i for i, line in enumerate(lines) if line.lower().startswith("trajectories"))
    head = sheet.rows(at, at + 5)
    if len(head) < 5 or head[3][0] not in ("Frame", "Field #"):
        found = ",".join(head[3][:2]) if len(head) > 3 else "the end of the file"
        raise RecordingError(f"{sheet.line(at + 3)}: expected Frame,Sub Frame, found {found}")
    starts = [place for place, axis in enumerate(head[3]) if axis == "X"]
    names = [_at(head[2], place) for place in starts]
    subjects = {name.split(":")[0] for name in names if ":" in name}
    if len(subjects) == 1:  # of several animals the names tell whose a marker is
        names = [name.split(":", 1)[-1] for name in names]
    has_units = not text.is_number(head[4][0])
    first = at + 4 + has_units
    end = next((i for i in range(first, len(lines)) if not lines[i].strip(" ,")), len(lines))
    others = [name for name in _SECTIONS if any(line.startswith(name) for line in lines)]
    remarks = (f"{sheet.path}: section {', '.join(others)} not read",) if others else ()
    return _recording(
        replace(sheet, lines=lines[:end]), first - 1, starts, names,
        _stated(sheet.line(at + 1), {"rate": head[1][0]}, "rate"),
        unit=_at(head[4], starts[0]) if has_units and starts else "",
        unit_place=sheet.line(at + 4), remarks=remarks, axes_at=at + 3,
    )  # fmt: skip


def _deeplabcut(sheet: _Sheet, rows: list[Row], least_score: float) -> raw.RawRecording:
    at = _row_that(sheet.path, rows, "coords", lambda row: row[0] == "coords")
    places = [k for k in range(1, len(rows[at])) if rows[at][k]]
    columns = [tuple(_at(row, k) for row in rows[: at + 1]) for k in places]
    numbers = _numbers(sheet, at + 1, places)
    return keypoints(sheet.path, columns, numbers, sheet.rate_hz, least_score)


def _recording(
    sheet: _Sheet,
    last_header: int,
    starts: list[int],
    names: list[str],
    stated_hz: float | None,
    *,
    unit: str = "",
    unit_place: str = "",
    remarks: tuple[str, ...] = (),
    counters: tuple[str, ...] = ("frame",),
    axes_at: int | None = None,
) -> raw.RawRecording:
    """Read the blocks of three columns that begin at `starts` in the rows below a header.

    The columns before them are `counters`: the frame's number and its time, or one of the two.
    """
    path, axes_at = sheet.path, last_header if axes_at is None else axes_at
    kept, left_out = raw.labelled(str(path), names)
    starts, names = [starts[i] for i in kept], [names[i] for i in kept]
    if not starts:
        raise RecordingError(f"{sheet.line(last_header)}: expected markers, found none")
    axes = _cells(sheet.lines[axes_at])
    for place, name in zip(starts, names, strict=True):
        if [axis[-1:].lower() for axis in axes[place : place + 3]] != list(AXES):
            raise RecordingError(
                f"{sheet.line(axes_at)}: expected X, Y, Z of '{name}', found "
                f"{', '.join(axes[place : place + 3])}"
            )
    columns = [place + k for place in starts for k in range(3)]
    n = len(counters)
    table = _numbers(sheet, last_header + 1, [*range(n), *columns])
    bad = np.argwhere(np.isnan(table[:, :n]))
    if len(bad):
        raise RecordingError(
            f"{sheet.line(last_header + 1 + bad[0, 0])}: expected a frame's number and time, "
            "found an empty cell"
        )
    of_unit, factor = raw.metric(unit_place, unit) if unit else (raw.USUAL_UNIT, 1.0)
    positions = factor * table[:, n:].reshape(len(table), len(starts), 3)
    text.blank_unseen(positions)
    counted = dict(zip(counters, table[:, :n].T.copy(), strict=True))
    number = counted.get("frame", np.arange(1.0, len(table) + 1))
    stamps = counted.get("time")
    late: tuple[str, ...] = ()
    if stated_hz is None and stamps is not None:
        stated_hz = raw.rate_of(stamps, number)
    rate = raw.resolve_rate(str(path), stated=stated_hz, given=sheet.rate_hz)
    time = (number - 1.0) / rate
    if stamps is not None:
        time, late = raw.settle(str(path), stamps, number, rate)
    markers, renamed = raw.distinct_names(str(path), names, may_lack=True)
    return raw.RawRecording(
        markers, time, positions, rate, unit=of_unit, unit_is_stated=bool(unit),
        remarks=remarks + left_out + renamed + late,
    )  # fmt: skip


def _numbers(sheet: _Sheet, first: int, columns: list[int]) -> FloatArray:
    """Read columns of numbers, (N, C), NaN where a cell is empty, of the rows from a line on."""
    import pandas as pd

    path, body = sheet.path, [line.replace('"', "") for line in sheet.lines[first:]]
    while body and not body[-1].strip(" ,"):
        body.pop()
    if not body:
        raise RecordingError(f"{path}: expected rows of numbers after the header, found none")
    width = body[0].count(",") + 1
    uneven = next((i for i, line in enumerate(body) if line.count(",") + 1 != width), None)
    if uneven is not None:
        end = "; the file ends here, was it cut short?" if uneven == len(body) - 1 else ""
        raise RecordingError(
            f"{sheet.line(first + uneven)}: expected {width} columns, found "
            f"{body[uneven].count(',') + 1}{end}"
        )
    if max(columns) >= width:
        raise RecordingError(
            f"{sheet.line(first)}: expected {max(columns) + 1} columns, found {width}"
        )
    wanted = list(dict.fromkeys(columns))
    try:
        table = pd.read_csv(
            StringIO("\n".join(body)), header=None, usecols=wanted, dtype=np.float64,
            na_values=list(text.TEXT_TABLE_MISSING), keep_default_na=False, skipinitialspace=True,
            skip_blank_lines=False, quoting=csv.QUOTE_NONE,
        )[columns].to_numpy()  # fmt: skip
    except (ValueError, OverflowError):  # pandas' own errors are ValueErrors
        table = np.full((1, 1), np.inf)
    if np.isinf(table).any():
        raise _bad_cell(sheet, body, first, columns)
    return np.asarray(table)


def _bad_cell(sheet: _Sheet, body: list[str], first: int, columns: list[int]) -> RecordingError:
    for row, line in enumerate(body):
        cells = line.split(",")
        for column in columns:
            cell = cells[column].strip()
            if cell not in text.TEXT_TABLE_MISSING and (fault := text.no_number(cell)):
                return RecordingError(f"{sheet.line(first + row)}, column {column + 1}: {fault}")
    return RecordingError(f"{sheet.path}: expected rows of numbers, found other text")


def _by_commas(lines: list[str]) -> list[str]:
    """Separate cells by commas, and decimals by points, whatever mark the program took."""
    header = next((line for line in lines[:5] if sum(map(line.count, ",;\t")) > 1), "")
    mark = max(",;\t", key=header.count)
    if mark == ",":
        return lines
    return [line.replace(",", ".").replace(mark, ",") for line in lines]


def _cells(line: str) -> Row:
    try:
        cells = next(csv.reader([line], skipinitialspace=True), [""])
    except csv.Error:  # a field of more than 131,072 characters
        cells = line.split(",")
    return [cell.strip() for cell in cells] or [""]


def _at(row: Row, place: int) -> str:
    return row[place] if place < len(row) else ""


def _row_that(path: Path, rows: list[Row], what: str, is_it: Callable[[Row], bool]) -> int:
    found = next((i for i, row in enumerate(rows) if is_it(row)), None)
    if found is None:
        raise RecordingError(
            f"{path}: expected a row {what} among the first {_MOST_HEADER_LINES}, found none"
        )
    return found


def _stated(place: str, keys: dict[str, str], *names: str) -> float | None:
    """Return the first of some keys as a number; None if the file has none of them."""
    for name in names:
        if value := keys.get(name, ""):
            if not text.is_number(value):
                raise RecordingError(f"{place}: {name}: expected a number, found '{value[:40]}'")
            return float(value)
    return None
