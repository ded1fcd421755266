"""Reader of TRC files, the format of OpenSim and Cortex: often y up, in m or mm."""

import re
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from hopdata.errors import RecordingError, did_you_mean, mismatch
from hopdata.recordings import raw
from hopdata.recordings.readers import text

KEYS = (
    "DataRate",
    "CameraRate",
    "NumFrames",
    "NumMarkers",
    "Units",
    "OrigDataRate",
    "OrigDataStartFrame",
    "OrigNumFrames",
)

# Columns before the coordinates, and how else they are written.
COUNTERS = ["Frame#", "Time"]
_COUNTERS = (r"frames? ?#?", r"times?( ?\(s(ec)?\))?")

# Lines with file type, keys, values and marker names; axes and empty lines may follow.
_NAMED_LINES = 4


def read_trc(path: Path, *, rate_hz: float | None = None) -> raw.RawRecording:
    """Read the markers of a TRC file.

    Parameters
    ----------
    path : path
        The ``.trc`` file.
    rate_hz : float, optional
        Frame rate, for a file that states none.

    Raises
    ------
    RecordingError
        If the file cannot be read; names the file, the line, what was expected and
        found.
    """
    header = _read_header(path)
    values = header.values
    place = f"{path}, line 3"
    columns = range(2, 2 + 3 * len(header.markers))
    counted, positions = header.rows.markers(COUNTERS, columns)
    number, stamps = counted.T.copy()
    n_frames = _stated(path, values, "NumFrames")
    rate_stated_hz = _stated(path, values, "DataRate")
    if rate_stated_hz == 0:  # some programs write 0 where they do not know it
        rate_stated_hz = None
    return raw.assembled(
        str(path),
        (header.markers, header.remarks),
        positions,
        number=number,
        stamps=stamps,
        unit=(f"{place}: Units", values.get("Units", "")),
        rates_hz=(rate_stated_hz, rate_hz),
        rate_place=f"{place}: DataRate",
        remarks=raw.frame_count(place, "NumFrames", n_frames, len(number)),
    )


def _stated(path: Path, values: dict[str, str], key: str) -> float | None:
    """Return the value of a key as a finite number; None if the key is absent."""
    return text.stated_number(f"{path}, line 3", key, values.get(key, ""))


@dataclass(frozen=True)
class _Lines:
    """The lines of a file above its first row of numbers, and that row.

    Parameters
    ----------
    path : Path
        The file.
    named : list of list of str
        Fields of the lines with file type, keys, values and marker names.
    axes : list of str or None
        Fields of the line X1, Y1, Z1 and so on; None if the file has no such line.
    first : list of str
        Fields of the first row of numbers.
    n_above, offset : int
        Lines and bytes above that row.
    mark : str
        Field separator of the rows of numbers.
    """

    path: Path
    named: list[list[str]]
    axes: list[str] | None
    first: list[str]
    n_above: int
    offset: int
    mark: str


@dataclass(frozen=True)
class _Header:
    """Values by key, marker names, the location of the numbers, and remarks."""

    values: dict[str, str]
    markers: tuple[str, ...]
    rows: text.Rows
    remarks: tuple[raw.Remark, ...]


def _read_header(path: Path) -> _Header:
    lines = _lines_above(path)
    values, unknown = _values(path, lines.named[1], lines.named[2])
    stated = _stated(path, values, "NumMarkers")
    if lines.axes is None:
        n_axes = _count_columns(lines, stated)
    else:
        n_axes = _count_axes(path, lines.axes)
    n_with_columns = n_axes // 3
    names, without_columns = _with_columns(lines, n_axes, stated)
    if stated == n_with_columns:
        # The last markers may have no name.
        names += [""] * (n_with_columns - len(names))
    of_count = _compare_count(path, names, n_axes, stated)
    markers, remarks = raw.distinct_names(f"{path}, line 4", names, may_lack=True)
    remarks += unknown + without_columns + of_count
    needed = 2 + 3 * len(markers)
    if any(lines.first[needed:]) or n_axes > 3 * len(markers):
        n_columns = max(n_axes, len(text.trimmed(lines.first)) - 2)
        wanted = f"{3 * len(markers)} columns of {len(markers)} markers"
        remarks += (mismatch(path, wanted, f"{n_columns}; the others are not read"),)
    rows = text.Rows(
        path,
        n_lines=lines.n_above,
        offset=lines.offset,
        width=max(len(lines.first), needed),
        mark=lines.mark,
        needed=needed,
        group=3,
    )
    return _Header(values, markers, rows, remarks)


def _lines_above(path: Path) -> _Lines:
    """Split a file at its first row of numbers.

    Raises
    ------
    RecordingError
        If it does not begin as a TRC file, or has no such row.
    """
    named: list[list[str]] = []
    with text.readable(path) as file:
        for line in islice(file, _NAMED_LINES):
            mark = _mark(line) if named else "\t"
            named.append(text.split_line(path, line, mark))
        _require_type(path, named)
        n_above = len(named)
        axes: list[str] | None = None
        while first := file.readline():
            fields = text.split_line(path, first, _mark(first))
            if any(fields):
                is_number = text.is_number(text.pointed(fields[0]))
                if is_number or axes is not None:
                    break
                axes = fields
            n_above += 1
        offset = file.tell() - len(first)
    if not first:
        raise RecordingError.at(path, "rows of numbers after the header", "none")
    return _Lines(path, named, axes, fields, n_above, offset, _mark(first))


def _require_type(path: Path, named: list[list[str]]) -> None:
    """Require a file to begin with PathFileType, and to have all lines of its head."""
    if not named:
        raise RecordingError.at(f"{path}, line 1", "PathFileType", "an empty file")
    first = named[0][0]
    if re.split(r"[\s,;]", first)[0].lower() != "pathfiletype":
        raise RecordingError.at(f"{path}, line 1", "PathFileType", f"'{first[:40]}'")
    if len(named) < _NAMED_LINES:
        raise RecordingError.at(path, "rows of numbers after the header", "none")


def _mark(line: bytes) -> str:
    """Return the field separator of a line: a tab, a comma or semicolon, or a blank."""
    inner = line.strip()
    for mark in ("\t", ";", ","):
        if mark.encode() in inner:
            return mark
    return " "


def _count_columns(lines: _Lines, stated: float | None) -> int:
    """Return the number of coordinates where no line of axes tells it."""
    n_columns = len(text.trimmed(lines.first)) - 2
    if stated is not None and stated == stated // 1:
        n_columns = max(n_columns, 3 * int(stated))  # markers at the end may be unseen
    if n_columns % 3:
        place = f"{lines.path}, line {lines.n_above + 1}"
        found = f"{n_columns} numbers after {' and '.join(COUNTERS)}"
        raise RecordingError.at(place, "X, Y, Z of each marker", found)
    return n_columns


def _count_axes(path: Path, fields: list[str]) -> int:
    """Require the fifth line to be X1, Y1, Z1, X2 and so on."""
    axes = [field for field in fields if field]
    for i, axis in enumerate(axes):
        letter = "XYZ"[i % 3]
        # Some count from 0, skip numbers or do not count.
        if not re.fullmatch(rf"{letter}\d*", axis.upper()):
            wanted = f"'{letter}{i // 3 + 1}'"
            raise RecordingError.at(f"{path}, line 5", wanted, f"'{axis[:40]}'")
    if len(axes) % 3:
        wanted = "X, Y, Z of each marker"
        raise RecordingError.at(f"{path}, line 5", wanted, f"{axes[-1]} last")
    return len(axes)


def _compare_count(
    path: Path, names: list[str], n_axes: int, stated: float | None
) -> tuple[str, ...]:
    """Return a remark if `NumMarkers` states another number than that of the names.

    Raises
    ------
    RecordingError
        If names, columns and `NumMarkers` give three different numbers of markers.
    """
    if stated is None or stated == len(names):
        return ()
    wanted = f"expected {stated:g} marker names (NumMarkers)"
    told = f"{path}, line 4: {wanted}, found {len(names)}"
    if stated != n_axes // 3 and n_axes != 3 * len(names):
        raise RecordingError(told)
    return (f"{told}, which are used",)


def _with_columns(
    lines: _Lines, n_axes: int, stated: float | None
) -> tuple[list[str], tuple[str, ...]]:
    """Return the names of the markers that have columns, and a remark on the others.

    Cortex names its virtual markers behind the measured ones, also where it exports no
    columns for them. They are left out if `NumMarkers` agrees with the columns.
    """
    fields = lines.named[3]
    n_markers = n_axes // 3
    named = [k for k, name in enumerate(fields) if k >= 2 and name]
    has_more_names = stated == n_markers and len(named) > n_markers
    if not has_more_names:
        return _names(lines.path, fields, n_axes), ()
    # Each name may stand above all three of its columns: then there are no others.
    if fields[2:].count(fields[2]) == 3:
        return _names(lines.path, fields, n_axes), ()
    last = named[n_markers - 1]
    beyond = [fields[k] for k in named[n_markers:]]
    place = f"{lines.path}, line 4"
    wanted = f"{stated:g} marker names (NumMarkers)"
    found = f"{text.listed(beyond)} beyond them, without columns; they are left out"
    names = _names(lines.path, fields[: last + 1], n_axes)
    return names, (mismatch(place, wanted, found),)


def _values(
    path: Path, key_fields: list[str], value_fields: list[str]
) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return values by key, and remarks on unknown keys, which are ignored."""
    known = {key.lower(): key for key in KEYS}
    # Some use blanks for tabs.
    keys = [known.get(key.lower(), key) for key in " ".join(key_fields).split()]
    values = " ".join(value_fields).split()
    if len(keys) != len(values) or len(set(keys)) != len(keys):
        wanted = f"a value for each of {len(keys)} different keys"
        raise RecordingError.at(f"{path}, line 3", wanted, f"{len(values)} values")
    remarks = []
    for key in keys:
        if key not in KEYS:
            wanted = f"keys such as {', '.join(KEYS[:5])}"
            found = f"'{key[:40]}'{did_you_mean(key, KEYS)}; it is not read"
            remarks.append(mismatch(f"{path}, line 2", wanted, found))
    return dict(zip(keys, values, strict=True)), tuple(remarks)


def _names(path: Path, fields: list[str], n_axes: int) -> list[str]:
    """Return marker names, each from the first of its three columns.

    A name may also stand above all three. Names may stand anywhere if there is one for
    each three axes.
    """
    place = f"{path}, line 4"
    if not _are_counters(fields[:2]):
        raise RecordingError.at(place, " and ".join(COUNTERS), fields[:2])
    cells = text.trimmed(fields[2:])
    is_thrice = all(cell == cells[k - k % 3] for k, cell in enumerate(cells))
    if is_thrice and len(cells) == n_axes:
        cells = [name if k % 3 == 0 else "" for k, name in enumerate(cells)]
    astray = [k for k, name in enumerate(cells) if name and k % 3]
    if astray:
        names = [name for name in cells if name]
        if 3 * len(names) != n_axes:
            found = f"'{cells[astray[0]][:40]}'"
            column = f"{place}, column {astray[0] + 3}"
            raise RecordingError.at(column, "nothing", found)
    else:
        names = cells[::3]
    if not names:
        raise RecordingError.at(place, "marker names", "none")
    if 3 * len(names) > n_axes:
        wanted = f"{3 * len(names)} axes (X, Y, Z of {len(names)} markers)"
        raise RecordingError.at(f"{path}, line 5", wanted, n_axes)
    return names


def _are_counters(fields: list[str]) -> bool:
    """Tell whether the first two columns are the frame's number and time."""
    if len(fields) < 2:
        return False
    return all(
        re.fullmatch(pattern, field.lower()) is not None
        for pattern, field in zip(_COUNTERS, fields, strict=True)
    )
