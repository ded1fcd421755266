"""Text exports of many programs: Motive, Nexus, keypoints, Qualisys, plain tables.

The suffix says little, so the first lines decide. Motive begins with its format
version, Nexus with the name of a section, DeepLabCut with three rows from its scorer
on, Anipose names columns of coordinates, Kinetics Toolkit numbers them in brackets,
D-Flow has columns `<name>.PosX`, and SLEAP a row for each animal in a frame.
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
from hopdata.recordings.readers import bids, dflow, qtm, sleap, text
from hopdata.recordings.readers.keypoints import AXES, SCORES, Columns, keypoints

# Rows of a sheet's head that are looked at, and rows of names above a row of axes.
_MOST_HEADER_LINES = 40
_MOST_NAME_LINES = 8

# Kinds of columns in a table of Motive.
_KINDS = {"Marker", "Rigid Body", "Rigid Body Marker", "Bone", "Bone Marker"}

# Sections of Nexus: the one that is read, and those that are not.
_TRAJECTORIES = "trajectories"
_SECTIONS = ("Devices", "Model Outputs", "Joints", "Segments", "Events")

_KNOWN = (
    "columns <name>_x, <name>_y, <name>_z, or an export listed in docs/formats.md "
    "(Motive, Nexus ...)"
)
_LONG = "one for each marker (docs/formats.md turns it, under CSV)"

Row = list[str]


@dataclass(frozen=True)
class _Sheet:
    """The first lines of a table.

    Parameters
    ----------
    path : Path
        The file.
    lines : list of bytes
        The lines.
    mark : str
        Separator of their cells.
    n_above, offset : int
        Lines and bytes of the file that precede them.
    """

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
        first = index + 1
        if first >= len(self.rows):
            wanted = "rows of numbers after the header"
            raise RecordingError.at(self.path, wanted, "none")
        return text.Rows(
            self.path,
            n_lines=self.n_above + first,
            offset=self.offset + sum(map(len, self.lines[:first])),
            width=len(self.rows[first]),
            mark=self.mark,
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
    sheet = _opened(path)
    rows = sheet.rows
    first = next((row for row in rows if not text.is_above_table(row)), [""])
    if first[0] == "Format Version":
        return _motive(sheet, rate_hz)
    if first[0].lower() in (_TRAJECTORIES, *map(str.lower, _SECTIONS)):
        return _nexus(sheet, rate_hz)
    if first[0] != "scorer" and _homogeneous_markers(first):
        return _kinetics_toolkit(sheet, rows.index(first), rate_hz)
    if dflow.is_dflow(first):
        return dflow.read_dflow(sheet.below(rows.index(first)), first, rate_hz)
    if sleap.is_analysis(first):
        table = sleap.analysis_table(sheet.below(rows.index(first)), first)
        return keypoints(path, *table, rate_hz, least_score)
    found = _keypoint_columns(sheet, first)
    if found is not None:
        (numbers,) = sheet.below(found.last_header).numbers(found.places)
        unit = qtm.unit_of(first)
        return keypoints(path, found.columns, numbers, rate_hz, least_score, unit)
    place = f"{path}, line 1"
    if set(AXES) <= {name.lower() for name in first}:
        raise RecordingError.at(place, "a row for each frame", _LONG)
    if path.suffix.lower() == ".csv" and not qtm.is_known(first):
        raise RecordingError.at(place, _KNOWN, f"'{','.join(first)[:40]}'")
    return qtm.read_qtm_tsv(path, rate_hz=rate_hz)


def _opened(path: Path) -> _Sheet:
    with text.readable(path) as file:
        lines = text.first_lines(file, _MOST_HEADER_LINES)
    if any(b"\0" in line for line in lines):
        raise RecordingError.at(path, "text", "binary data")
    mark = text.mark_between([text.decoded(line) for line in lines[:5]])
    return _Sheet(path, lines, mark)


# Keypoints from video: a column for each coordinate of each marker.


@dataclass(frozen=True)
class _Keypoints:
    """Columns of keypoints: their places, their names, and the last line above them."""

    last_header: int
    places: list[int]
    columns: Columns


def _keypoint_columns(sheet: _Sheet, first: Row) -> _Keypoints | None:
    """Return the columns of keypoints; None if the header is not of such a table."""
    if first[0] == "scorer":
        return _deeplabcut_columns(sheet)
    found = _names_over_axes(sheet.rows)
    if found is not None:
        return found
    # A time that is no counter of QTM's is not of a table of keypoints.
    if first[0].lower().startswith("time") and not qtm.counter(first[0]):
        return None
    columns: Columns = [qtm.coordinate(name) for name in first]
    n_coordinates = sum(len(name) > 1 for name in columns)
    if qtm.columns_of(first)[1] is None and n_coordinates >= len(AXES):
        places = list(range(len(first)))
        return _Keypoints(sheet.rows.index(first), places, columns)
    return None


def _deeplabcut_columns(sheet: _Sheet) -> _Keypoints:
    """Return the columns below rows from the scorer to the coordinates."""
    last = _row_of(sheet, "coords")
    head = sheet.rows[: last + 1]
    places = [place for place in range(1, len(head[last])) if head[last][place]]
    columns: Columns = [tuple(_at(row, place) for row in head) for place in places]
    return _Keypoints(last, places, columns)


def _names_over_axes(rows: list[Row]) -> _Keypoints | None:
    """Find a row of axes below a row that names each three of them.

    This is the form of JARVIS, Visual3D, and pandas, which may name the index in a
    further row.
    """
    for axes_at, row in enumerate(rows[:_MOST_NAME_LINES]):
        axes = [cell.lower() for cell in row]
        if axes.count("x") < 2:
            continue
        start = axes.index("x")
        if not set(axes[start:]) <= {*AXES, *SCORES, ""}:
            continue
        for above in reversed(rows[:axes_at]):
            names = _spread([_at(above, k) for k in range(start, len(axes))])
            if len(set(names)) == axes.count("x"):
                return _below_names(rows, axes_at, start, above, names)
    return None


def _spread(names: Row) -> Row:
    """Return names in which an empty one is that to its left."""
    spread = []
    last = ""
    for name in names:
        last = name or last
        spread.append(last)
    return spread


def _below_names(
    rows: list[Row], axes_at: int, start: int, above: Row, names: Row
) -> _Keypoints:
    """Return the columns of a row of axes, of which the first is at `start`."""
    row = rows[axes_at]
    places = list(range(len(row)))
    axes = [cell.lower() for cell in row[start:]]
    coordinates: Columns = [
        ("", name, axis) for name, axis in zip(names, axes, strict=True)
    ]
    counters: Columns = [(_at(above, k) or row[k],) for k in range(start)]
    index = rows[axes_at + 1] if axes_at + 1 < len(rows) else ["0"]
    is_named_index = bool(index[0]) and not text.is_number(index[0])
    if is_named_index and not any(index[start:]):
        counters = [(_at(index, k),) for k in range(start)]
        return _Keypoints(axes_at + 1, places, counters + coordinates)
    return _Keypoints(axes_at, places, counters + coordinates)


# Kinetics Toolkit: `toe[0]` to `toe[3]`, the last of which is 1.

_COMPONENT = re.compile(r"(.+)\[([0-3])\]")


def _homogeneous_markers(columns: Row) -> dict[str, list[int]]:
    """Return the four columns of each marker in homogeneous coordinates, by name."""
    places: dict[str, dict[int, int]] = {}
    for place, column in enumerate(columns):
        component = _COMPONENT.fullmatch(column)
        if component is not None:
            name, number = component.groups()
            places.setdefault(name, {})[int(number)] = place
    markers = {}
    for name, of_component in places.items():
        if len(of_component) == 4:
            markers[name] = [of_component[number] for number in range(4)]
    return markers


def _kinetics_toolkit(
    sheet: _Sheet, header_at: int, rate_hz: float | None
) -> raw.RawRecording:
    """Read a time series of Kinetics Toolkit: markers in m, each with a fourth 1."""
    path = sheet.path
    columns = sheet.rows[header_at]
    markers = _homogeneous_markers(columns)
    names = list(markers)
    coordinates = [place for places in markers.values() for place in places]
    stamps, flat = sheet.below(header_at).numbers([0], coordinates)
    points = flat.reshape(len(flat), -1, 4)
    fourth = points[:, :, 3]
    is_seen = np.isfinite(points).all(axis=2)
    wrong = np.argwhere(is_seen & (fourth != 1))
    if len(wrong):
        row, marker = wrong[0]
        place = f"{sheet.line(header_at + 1 + row)}: {names[marker]}[3]"
        raise RecordingError.at(place, "1, as of a point", f"{fourth[row, marker]:g}")
    used = {0, *coordinates}
    others = [name for place, name in enumerate(columns) if name and place not in used]
    remarks: tuple[str, ...] = ()
    if others:
        left_out = f"columns that are no markers are left out: {text.listed(others)}"
        remarks = (f"{path}: {left_out}",)
    return raw.assembled(
        str(path),
        raw.distinct_names(str(path), names),
        points[:, :, :3].copy(),
        number=np.arange(1.0, len(points) + 1),
        stamps=stamps[:, 0].copy(),
        unit=(str(path), "m"),
        rates_hz=(None, rate_hz),
        remarks=remarks,
    )


# Motive.


def _motive(sheet: _Sheet, rate_hz: float | None) -> raw.RawRecording:
    """Read markers; those solved from a body or skeleton if there are no others."""
    path = sheet.path
    rows = sheet.rows
    keys = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    axes_at = _row_of(sheet, "Frame", ", Time (Seconds), X, Y, Z")
    kinds = next((row for row in rows[1:axes_at] if _KINDS & {*row}), [])
    if not kinds:
        raise RecordingError.at(path, "a row of Marker or Rigid Body", "none")
    names = rows[rows.index(kinds) + 1]
    places, remarks = _motive_markers(
        path, kinds, names, rows[axes_at - 1 : axes_at + 1]
    )
    line = sheet.line(0)
    stated_hz = _stated(line, keys, "Export Frame Rate", "Capture Frame Rate")
    recording = _recording(
        sheet,
        _Blocks(
            axes_at=axes_at,
            last_header=axes_at,
            starts=places,
            names=[_at(names, place) for place in places],
            counters=("frame", "time"),
        ),
        rates_hz=(stated_hz, rate_hz),
        unit=(f"{line}: Length Units", keys.get("Length Units", "")),
        remarks=remarks,
    )
    return replace(recording, started=qtm.moment(keys.get("Capture Start Time")))


def _motive_markers(
    path: Path, kinds: Row, names: Row, quantity_and_axis: list[Row]
) -> tuple[list[int], tuple[str, ...]]:
    """Return the columns at which markers begin, and a remark on others."""
    quantity, axis = quantity_and_axis
    starts = [
        place
        for place, name in enumerate(axis)
        if name == "X" and _at(quantity, place) == "Position"
    ]
    measured = [place for place in starts if _at(kinds, place) == "Marker"]
    solved = [place for place in starts if _at(kinds, place) == "Rigid Body Marker"]
    if not solved:
        solved = [place for place in starts if _at(kinds, place) == "Bone Marker"]
    if not measured and not solved:
        found = "none; export them from Motive as well"
        raise RecordingError.at(path, "positions of markers", found)
    has_labels = any(
        not _at(names, place).lower().startswith("unlabel") for place in measured
    )
    if solved and not has_labels:
        only = "markers are those of the solved bodies, no measured ones were exported"
        return solved, (f"{path}: {only}",)
    of_measured = {_at(names, place) for place in measured}
    left_out = {_at(names, place) for place in solved} - of_measured
    if not left_out:
        return measured, ()
    some = ", ".join(sorted(left_out)[:6])
    remark = f"{path}: {len(left_out)} solved markers are left out ({some})"
    return measured, (remark,)


# Vicon Nexus.


def _nexus(sheet: _Sheet, rate_hz: float | None) -> raw.RawRecording:
    """Read the section of trajectories; devices and model outputs have others."""
    trajectories, others = _trajectories(sheet)
    head = trajectories.rows
    if len(head) < 5 or head[3][0] not in ("Frame", "Field #"):
        found = ",".join(head[3][:2]) if len(head) > 3 else "the end of the file"
        raise RecordingError.at(trajectories.line(3), "Frame,Sub Frame", found)
    starts = [place for place, axis in enumerate(head[3]) if axis == "X"]
    full_names = [_at(head[2], place) for place in starts]
    names = raw.without_subject(full_names)
    has_units = not text.is_number(head[4][0])
    unit = _at(head[4], starts[0]) if has_units and starts else ""
    stated_hz = _stated(trajectories.line(1), {"rate": head[1][0]}, "rate")
    remarks: tuple[raw.Remark, ...] = ()
    if others:
        remarks = (f"{sheet.path}: section {', '.join(others)} not read",)
    remarks += raw.subject_left_out(f"{sheet.path}", full_names)
    return _recording(
        trajectories,
        _Blocks(
            axes_at=3,
            last_header=4 if has_units else 3,
            starts=starts,
            names=list(names),
        ),
        rates_hz=(stated_hz, rate_hz),
        unit=(trajectories.line(4), unit),
        remarks=remarks,
    )


def _trajectories(sheet: _Sheet) -> tuple[_Sheet, list[str]]:
    """Return the head of the section of trajectories, and the names of the others."""
    others = []
    n_above = 0
    offset = 0
    with text.readable(sheet.path) as file:
        for line in file:
            begin = line.removeprefix(codecs.BOM_UTF8)[:20].strip(b'"')
            title = begin.decode("latin-1")
            if title.lower().startswith(_TRAJECTORIES):
                break
            others += [name for name in _SECTIONS if title.startswith(name)]
            n_above += 1
            offset += len(line)
        else:
            found = f"{', '.join(others)}; export the trajectories as well"
            raise RecordingError.at(sheet.path, "a section Trajectories", found)
        lines = [line, *islice(file, 6)]
        for line in file:
            others += [name for name in _SECTIONS if line.startswith(name.encode())]
    return _Sheet(sheet.path, lines, sheet.mark, n_above, offset), others


# Blocks of three columns below a header, as of Motive and Nexus.


@dataclass(frozen=True)
class _Blocks:
    """Place of the markers in a sheet.

    Parameters
    ----------
    axes_at, last_header : int
        Index of the row of axes, and of the last row above the numbers.
    starts : list of int
        First column of each marker.
    names : list of str
        Its name.
    counters : tuple of str
        First columns: the frame's number and possibly its time.
    """

    axes_at: int
    last_header: int
    starts: list[int]
    names: list[str]
    counters: tuple[str, ...] = ("frame",)


def _recording(
    sheet: _Sheet,
    blocks: _Blocks,
    *,
    rates_hz: tuple[float | None, float | None],
    unit: tuple[str, str],
    remarks: tuple[raw.Remark, ...],
) -> raw.RawRecording:
    """Read the markers of a sheet.

    `rates_hz` holds the stated and the given rate; the unit comes with its place for
    messages.
    """
    path = str(sheet.path)
    kept, left_out = raw.labelled(path, blocks.names)
    starts = [blocks.starts[i] for i in kept]
    names = [blocks.names[i] for i in kept]
    if not starts:
        raise RecordingError.at(sheet.line(blocks.last_header), "markers", "none")
    for start, name in zip(starts, names, strict=True):
        axes = sheet.rows[blocks.axes_at][start : start + 3]
        if [axis[-1:].lower() for axis in axes] != list(AXES):
            wanted = f"X, Y, Z of '{name}'"
            raise RecordingError.at(sheet.line(blocks.axes_at), wanted, ", ".join(axes))
    columns = [start + axis for start in starts for axis in range(3)]
    rows = sheet.below(blocks.last_header, is_section=True)
    counted, positions = rows.markers(blocks.counters, columns)
    has_time = len(blocks.counters) > 1
    return raw.assembled(
        path,
        raw.distinct_names(path, names, may_lack=True),
        positions,
        number=counted[:, 0].copy(),
        stamps=counted[:, 1].copy() if has_time else None,
        unit=unit,
        rates_hz=rates_hz,
        remarks=left_out + remarks,
    )


# Cells of a header.


def _at(row: Row, place: int) -> str:
    """Return a cell; rows may be shorter than others."""
    return row[place] if place < len(row) else ""


def _row_of(sheet: _Sheet, first: str, others: str = "") -> int:
    """Return the index of the row that begins with a word."""
    for index, row in enumerate(sheet.rows):
        if row[0] == first:
            return index
    wanted = f"a row {first}{others} among the first {_MOST_HEADER_LINES}"
    raise RecordingError.at(sheet.path, wanted, "none")


def _stated(place: str, keys: dict[str, str], *names: str) -> float | None:
    """Return the first of several keys as a number; None if there is none of them."""
    name = next((name for name in names if keys.get(name)), "")
    return text.stated_number(place, name, keys.get(name, ""))
