"""Text exports of many programs: Motive, Vicon Nexus, keypoints, Qualisys and plain tables.

The suffix says little, so the first lines decide. Motive begins with its format
version, Nexus with the name of a section, DeepLabCut with three rows from its scorer
on, Anipose names columns of coordinates, and Kinetics Toolkit numbers them in brackets.
The reader of QTM's exports and plain tables handles the rest. Cells are separated by
commas, semicolons or tabs; with the last two, a comma is the decimal mark. Lines above
the table that begin with # are comments.
"""

import codecs
import re
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from pathlib import Path

import numpy as np

from hopdata.errors import RecordingError
from hopdata.recordings import raw
from hopdata.recordings.readers import bids, qtm, text
from hopdata.recordings.readers.keypoints import AXES, SCORES, Columns, keypoints

_KINDS = {"Marker", "Rigid Body", "Rigid Body Marker", "Bone", "Bone Marker"}
_TRAJECTORIES = "trajectories"
_SECTIONS = (
    "Devices",
    "Model Outputs",
    "Joints",
    "Segments",
    "Events",
)  # of Nexus; not read
_MOST_HEADER_LINES, _MOST_NAME_LINES = 40, 8
_KNOWN = (
    "an export of Motive (Format Version), Vicon Nexus (a section Trajectories), DeepLabCut "
    "(scorer), Anipose or Kinetics Toolkit (<name>[0] to [3]), or a table (columns <name>_x, "
    "_y, _z)"
)
_LONG = (
    "one for each marker; in pandas table.pivot(index='frame', columns='marker', "
    "values=['x', 'y', 'z']).swaplevel(axis=1) arranges them, with the table's own names"
)

Row = list[str]


@dataclass(frozen=True)
class _Sheet:
    """The first lines of a table, of which `n_above` lines (`offset` bytes) precede it."""

    path: Path
    lines: list[bytes]
    mark: str
    n_above: int = 0
    offset: int = 0

    @cached_property
    def rows(self) -> list[Row]:
        """Return the cells of these lines."""
        return [text.fields_of(text.decoded(line), self.mark) for line in self.lines]

    def line(self, index: int) -> str:
        """Return the place of a line, counted from 0, for messages."""
        return f"{self.path}, line {self.n_above + index + 1}"

    def below(self, index: int, *, is_section: bool = False) -> text.Rows:
        """Return the rows below a line, as wide as the first of them."""
        offset = self.offset + sum(map(len, self.lines[: index + 1]))
        if index + 1 >= len(self.rows):
            raise RecordingError.at(
                self.path, "rows of numbers after the header", "none"
            )
        width = len(self.rows[index + 1])
        return text.Rows(
            self.path,
            self.n_above + index + 1,
            offset,
            width,
            self.mark,
            is_section=is_section,
        )


def read_export(
    path: Path, *, rate_hz: float | None = None, least_score: float
) -> raw.RawRecording:
    """Read the markers of a text that a program exported.

    Parameters
    ----------
    path : path
        The file.
    rate_hz : float, optional
        Frame rate, for a file that states none, such as keypoints from video.
    least_score : float
        Keypoints with a lower likelihood or score count as unseen.

    Raises
    ------
    RecordingError
        If the file cannot be read; names the file, the line, what was expected and
        found.
    """
    if path.name.endswith(bids.ENDS):
        return bids.read_bids(path, rate_hz=rate_hz)
    with text.readable(path) as file:
        lines = text.first_lines(file, _MOST_HEADER_LINES)
    if any(b"\0" in line for line in lines):
        raise RecordingError.at(path, "text", "binary data")
    sheet = _Sheet(
        path, lines, text.mark_between([text.decoded(line) for line in lines[:5]])
    )
    rows = sheet.rows
    first = next((row for row in rows if not row[0].startswith("#")), [""])
    has_odd_clock = first[0].lower().startswith("time") and not qtm.counter(first[0])
    split: Columns = [qtm.coordinate(name) for name in first if not has_odd_clock]
    if first[0] == "Format Version":
        return _motive(sheet, rate_hz)
    if first[0].lower() in (_TRAJECTORIES, *map(str.lower, _SECTIONS)):
        return _nexus(sheet, rate_hz)
    if first[0] == "scorer":
        at = _row_of(sheet, "coords")
        places = [k for k in range(1, len(rows[at])) if rows[at][k]]
        columns: Columns = [
            tuple(_at(row, k) for row in rows[: at + 1]) for k in places
        ]
    elif _homogeneous_markers(first):
        return _kinetics_toolkit(sheet, rows.index(first), rate_hz)
    elif (found := _names_over_axes(rows)) is not None:
        at, columns = found
        places = list(range(len(columns)))
    elif qtm.columns_of(first)[1] is None and sum(len(name) > 1 for name in split) >= 3:
        at, places, columns = rows.index(first), list(range(len(first))), split
    elif {*AXES} <= {*map(str.lower, first)}:
        raise RecordingError.at(f"{path}, line 1", "a row for each frame", _LONG)
    elif path.suffix.lower() != ".csv" or qtm.is_known(first):
        return qtm.read_qtm_tsv(path, rate_hz=rate_hz)
    else:
        raise RecordingError.at(f"{path}, line 1", _KNOWN, f"'{','.join(first)[:40]}'")
    (numbers,) = sheet.below(at).numbers(places)
    return keypoints(path, columns, numbers, rate_hz, least_score, qtm.unit_of(first))


def _names_over_axes(rows: list[Row]) -> tuple[int, Columns] | None:
    """Find a row of axes below a row that names each three of them; return its index and columns.

    This is the form of JARVIS, Visual3D, and pandas, which may name the index in a
    further row.
    """
    for at, row in enumerate(rows[:_MOST_NAME_LINES]):
        axes = [cell.lower() for cell in row]
        start = axes.index("x") if "x" in axes else 0
        if axes.count("x") < 2 or not {*axes[start:]} <= {*AXES, *SCORES, ""}:
            continue
        for above in reversed(rows[:at]):
            names = [_at(above, k) for k in range(start, len(axes))]
            names = [
                name or next(filter(None, names[k::-1]), "")
                for k, name in enumerate(names)
            ]
            if len({*names}) == axes.count("x"):
                columns: Columns = [(_at(above, k) or row[k],) for k in range(start)]
                columns += [
                    ("", *both) for both in zip(names, axes[start:], strict=True)
                ]
                index = rows[at + 1] if at + 1 < len(rows) else ["0"]
                if any(index[start:]) or not index[0] or text.is_number(index[0]):
                    return at, columns
                return at + 1, [(_at(index, k),) for k in range(start)] + columns[
                    start:
                ]
    return None


_COMPONENT = re.compile(
    r"(.+)\[([0-3])\]"
)  # `toe[0]` to `toe[3]`, the last of which is 1


def _homogeneous_markers(columns: Row) -> dict[str, list[int]]:
    """Return the four columns of each marker in homogeneous coordinates, by its name."""
    places: dict[str, dict[int, int]] = {}
    for place, column in enumerate(columns):
        found = _COMPONENT.fullmatch(column)
        if found:
            places.setdefault(found[1], {})[int(found[2])] = place
    return {
        name: [at[k] for k in range(4)] for name, at in places.items() if len(at) == 4
    }


def _kinetics_toolkit(
    sheet: _Sheet, at: int, rate_hz: float | None
) -> raw.RawRecording:
    """Read a time series that Kinetics Toolkit saved: markers in m, each with a fourth number 1."""
    path, columns = sheet.path, sheet.rows[at]
    markers = _homogeneous_markers(columns)
    used = {place for places in markers.values() for place in places} | {0}
    others = [name for place, name in enumerate(columns) if place not in used and name]
    coordinates = [place for places in markers.values() for place in places]
    stamps, flat = sheet.below(at).numbers([0], coordinates)
    points = flat.reshape(len(flat), -1, 4)
    seen = np.isfinite(points).all(axis=2)
    wrong = np.argwhere(seen & (points[:, :, 3] != 1))
    if len(wrong):
        row, marker = wrong[0]
        name = list(markers)[marker]
        place = f"{sheet.line(at + 1 + row)}: {name}[3]"
        raise RecordingError.at(
            place, "1, as of a point", f"{points[row, marker, 3]:g}"
        )
    remarks: tuple[str, ...] = ()
    if others:
        remarks = (
            f"{path}: columns that are no markers are left out: {text.listed(others)}",
        )
    return raw.assembled(
        str(path),
        raw.distinct_names(str(path), list(markers)),
        points[:, :, :3].copy(),
        number=np.arange(1.0, len(points) + 1),
        stamps=stamps[:, 0].copy(),
        unit=(str(path), "m"),
        rates_hz=(None, rate_hz),
        remarks=remarks,
    )


def _motive(sheet: _Sheet, rate_hz: float | None) -> raw.RawRecording:
    """Read markers; those solved from a rigid body or skeleton only if there are no others."""
    path, rows = sheet.path, sheet.rows
    keys = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    axes_at = _row_of(sheet, "Frame", ", Time (Seconds), X, Y, Z")
    kinds = next((row for row in rows[1:axes_at] if _KINDS & {*row}), [])
    if not kinds:
        raise RecordingError.at(path, "a row of Marker or Rigid Body", "none")
    names = rows[rows.index(kinds) + 1]
    above, of_x = (
        rows[axes_at - 1],
        [k for k, axis in enumerate(rows[axes_at]) if axis == "X"],
    )
    starts = [place for place in of_x if _at(above, place) == "Position"]
    of_kind = {
        kind: [place for place in starts if _at(kinds, place) == kind]
        for kind in ("Marker", "Rigid Body Marker", "Bone Marker")
    }
    solved = of_kind["Rigid Body Marker"] or of_kind["Bone Marker"]
    places = of_kind["Marker"] or solved
    if solved and all(_at(names, p).lower().startswith("unlabel") for p in places):
        places = solved
    left = {_at(names, p) for p in solved} - {_at(names, p) for p in places}
    told = f"{len(left)} solved markers are left out ({', '.join(sorted(left)[:6])})"
    if places is solved:
        told = "markers are those of the solved bodies, no measured ones were exported"
    if not places:
        wanted = "positions of markers"
        raise RecordingError.at(path, wanted, "none; export them from Motive as well")
    place = sheet.line(0)
    rate = _stated(place, keys, "Export Frame Rate", "Capture Frame Rate")
    found = _recording(
        sheet, axes_at, axes_at, places, [_at(names, p) for p in places], (rate, rate_hz),
        unit=(f"{place}: Length Units", keys.get("Length Units", "")), counters=("frame", "time"),
        remarks=(f"{path}: {told}",) * bool(left or places is solved),
    )  # fmt: skip
    return replace(found, started=qtm.moment(keys.get("Capture Start Time")))


def _nexus(sheet: _Sheet, rate_hz: float | None) -> raw.RawRecording:
    """Read the section of trajectories; devices and model outputs have other sections."""
    path, others, n_above, offset = sheet.path, [], 0, 0
    with text.readable(path) as file:
        for line in file:
            begin = (
                line.removeprefix(codecs.BOM_UTF8)[:20].strip(b'"').decode("latin-1")
            )
            if begin.lower().startswith(_TRAJECTORIES):
                break
            others += [name for name in _SECTIONS if begin.startswith(name)]
            n_above, offset = n_above + 1, offset + len(line)
        else:
            found = f"{', '.join(others)}; export the trajectories as well"
            raise RecordingError.at(path, "a section Trajectories", found)
        sheet = _Sheet(path, [line, *islice(file, 6)], sheet.mark, n_above, offset)
        others += [
            name
            for line in file
            for name in _SECTIONS
            if line.startswith(name.encode())
        ]
    head = sheet.rows
    if len(head) < 5 or head[3][0] not in ("Frame", "Field #"):
        found = ",".join(head[3][:2]) if len(head) > 3 else "the end of the file"
        raise RecordingError.at(sheet.line(3), "Frame,Sub Frame", found)
    starts = [place for place, axis in enumerate(head[3]) if axis == "X"]
    names = raw.without_subject([_at(head[2], place) for place in starts])
    has_units = not text.is_number(head[4][0])
    return _recording(
        sheet, 3, 3 + has_units, starts, list(names),
        (_stated(sheet.line(1), {"rate": head[1][0]}, "rate"), rate_hz),
        unit=(sheet.line(4), _at(head[4], starts[0]) if has_units and starts else ""),
        remarks=(f"{path}: section {', '.join(others)} not read",) * bool(others),
    )  # fmt: skip


def _recording(
    sheet: _Sheet,
    axes_at: int,
    last_header: int,
    starts: list[int],
    names: list[str],
    rates_hz: tuple[float | None, float | None],
    *,
    unit: tuple[str, str],
    remarks: tuple[str, ...],
    counters: tuple[str, ...] = ("frame",),
) -> raw.RawRecording:
    """Read blocks of three columns that begin at `starts` in the rows below a header.

    The first columns are `counters`: the frame's number and possibly its time.
    `rates_hz` holds the stated and the given rate; the unit comes with its place for
    messages.
    """
    path = sheet.path
    kept, left_out = raw.labelled(str(path), names)
    starts, names = [starts[i] for i in kept], [names[i] for i in kept]
    if not starts:
        raise RecordingError.at(sheet.line(last_header), "markers", "none")
    for place, name in zip(starts, names, strict=True):
        axes = sheet.rows[axes_at][place : place + 3]
        if [axis[-1:].lower() for axis in axes] != list(AXES):
            raise RecordingError.at(
                sheet.line(axes_at), f"X, Y, Z of '{name}'", ", ".join(axes)
            )
    columns = [place + k for place in starts for k in range(3)]
    counted, positions = sheet.below(last_header, is_section=True).markers(
        counters, columns
    )
    return raw.assembled(
        str(path),
        raw.distinct_names(str(path), names, may_lack=True),
        positions,
        number=counted[:, 0].copy(),
        stamps=counted[:, 1].copy() if len(counters) > 1 else None,
        unit=unit,
        rates_hz=rates_hz,
        remarks=left_out + remarks,
    )


def _at(row: Row, place: int) -> str:
    return row[place] if place < len(row) else ""


def _row_of(sheet: _Sheet, first: str, others: str = "") -> int:
    found = next((i for i, row in enumerate(sheet.rows) if row[0] == first), None)
    if found is None:
        wanted = f"a row {first}{others} among the first {_MOST_HEADER_LINES}"
        raise RecordingError.at(sheet.path, wanted, "none")
    return found


def _stated(place: str, keys: dict[str, str], *names: str) -> float | None:
    """Return the first of several keys as a number; None if the file has none of them."""
    name = next((name for name in names if keys.get(name)), "")
    return text.stated_number(place, name, keys.get(name, ""))
