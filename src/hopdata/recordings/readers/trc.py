"""Reader of TRC files, the marker format of OpenSim and Cortex: often y up, in m or mm."""

import re
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from hopdata.errors import RecordingError, did_you_mean, mismatch
from hopdata.recordings import raw
from hopdata.recordings.readers import text

KEYS = (
    *("DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units"),
    *("OrigDataRate", "OrigDataStartFrame", "OrigNumFrames"),
)
COUNTERS = ["Frame#", "Time"]
_COUNTERS = (r"frames? ?#?", r"times?( ?\(s(ec)?\))?")
_NAMED_LINES = (
    4  # file type, keys, values, marker names; axes and empty lines may follow
)


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
    values, markers, rows, remarks = _read_header(path)
    place, columns = f"{path}, line 3", range(2, 2 + 3 * len(markers))
    counted, positions = rows.markers(COUNTERS, columns)
    number, stamps = counted.T.copy()
    n_frames = _stated(path, values, "NumFrames")
    return raw.assembled(
        str(path),
        (markers, remarks),
        positions,
        number=number,
        stamps=stamps,
        unit=(f"{place}: Units", values.get("Units", "")),
        rates_hz=(_stated(path, values, "DataRate"), rate_hz),
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


def _read_header(
    path: Path,
) -> tuple[dict[str, str], tuple[str, ...], text.Rows, tuple[str, ...]]:
    """Return values by key, marker names, the location of the numbers, and remarks."""
    lines = _lines_above(path)
    values, unknown = _values(path, lines.named[1], lines.named[2])
    stated = _stated(path, values, "NumMarkers")
    if lines.axes is None:
        n_axes = _count_columns(lines, stated)
    else:
        n_axes = _count_axes(path, lines.axes)
    names, without_columns = _with_columns(lines, n_axes, stated)
    if stated == n_axes // 3:  # the last may have no name
        names += [""] * (n_axes // 3 - len(names))
    told = f"{path}, line 4: expected {stated or 0:g} marker names (NumMarkers), found {len(names)}"
    if stated not in (None, len(names), n_axes // 3) and n_axes != 3 * len(names):
        raise RecordingError(told)
    markers, remarks = raw.distinct_names(f"{path}, line 4", names, may_lack=True)
    remarks += unknown + without_columns
    if stated not in (None, len(names)):
        remarks += (f"{told}, which are used",)
    needed = 2 + 3 * len(markers)
    width = max(len(lines.first), needed)
    if any(lines.first[needed:]) or n_axes > 3 * len(markers):
        wanted = f"{3 * len(markers)} columns of {len(markers)} markers"
        found = f"{max(n_axes, len(text.trimmed(lines.first)) - 2)}; the others are not read"
        remarks += (mismatch(path, wanted, found),)
    rows = text.Rows(
        path, lines.n_above, lines.offset, width, lines.mark, needed=needed
    )
    return values, markers, rows, remarks


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
            named.append(text.split_line(path, line, _mark(line) if named else "\t"))
        _require_type(path, named)
        n_above = len(named)
        axes: list[str] | None = None
        while first := file.readline():
            fields = text.split_line(path, first, _mark(first))
            is_blank = not any(fields)
            if not is_blank and (
                axes is not None or text.is_number(text.pointed(fields[0]))
            ):
                break
            if not is_blank:
                axes = fields
            n_above += 1
        offset = file.tell() - len(first)
    if not first:
        raise RecordingError.at(path, "rows of numbers after the header", "none")
    return _Lines(path, named, axes, fields, n_above, offset, _mark(first))


def _require_type(path: Path, named: list[list[str]]) -> None:
    """Require a file to begin with PathFileType, and to have all lines up to the names."""
    if not named or re.split(r"[\s,;]", named[0][0])[0].lower() != "pathfiletype":
        found = f"'{named[0][0][:40]}'" if named else "an empty file"
        raise RecordingError.at(f"{path}, line 1", "PathFileType", found)
    if len(named) < _NAMED_LINES:
        raise RecordingError.at(path, "rows of numbers after the header", "none")


def _mark(line: bytes) -> str:
    """Return the field separator of a line: a tab, a comma or semicolon, or else a blank."""
    inner = line.strip()
    return next((mark for mark in ("\t", ";", ",") if mark.encode() in inner), " ")


def _count_columns(lines: _Lines, stated: float | None) -> int:
    """Return the number of coordinates in a file without a line of axes: that of its first row."""
    n_columns = len(text.trimmed(lines.first)) - 2
    if stated is not None and stated == stated // 1:
        n_columns = max(n_columns, 3 * int(stated))  # markers at the end may be unseen
    if n_columns % 3:
        wanted = "X, Y, Z of each marker"
        found = f"{n_columns} numbers after {' and '.join(COUNTERS)}"
        raise RecordingError.at(
            f"{lines.path}, line {lines.n_above + 1}", wanted, found
        )
    return n_columns


def _with_columns(
    lines: _Lines, n_axes: int, stated: float | None
) -> tuple[list[str], tuple[str, ...]]:
    """Return the names of the markers that have columns, and a remark on the other names.

    Cortex names its virtual markers behind the measured ones, also where it exports no
    columns for them. They are left out if `NumMarkers` agrees with the columns.
    """
    fields = lines.named[3]
    n_markers = n_axes // 3
    named = [k for k, name in enumerate(fields) if k >= 2 and name]
    if (
        stated != n_markers
        or len(named) <= n_markers
        or fields[2:].count(fields[2]) == 3
    ):
        return _names(lines.path, fields, n_axes), ()
    last = named[n_markers - 1]
    beyond = [fields[k] for k in named[n_markers:]]
    place = f"{lines.path}, line 4"
    wanted = f"{stated:g} marker names (NumMarkers)"
    found = f"{text.listed(beyond)} beyond them, without columns; they are left out"
    names = _names(lines.path, fields[: last + 1], n_axes)
    return names, (mismatch(place, wanted, found),)


def _values(
    path: Path, keys: list[str], values: list[str]
) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return values by key, and remarks on unknown keys, which are ignored."""
    known = {key.lower(): key for key in KEYS}
    keys, values = (
        " ".join(keys).split(),
        " ".join(values).split(),
    )  # some use blanks for tabs
    keys = [known.get(key.lower(), key) for key in keys]
    if len(keys) != len(values) or len(set(keys)) != len(keys):
        wanted = f"a value for each of {len(keys)} different keys"
        raise RecordingError.at(f"{path}, line 3", wanted, f"{len(values)} values")
    place, wanted = f"{path}, line 2", f"keys such as {', '.join(KEYS[:5])}"
    odd = (f"'{key[:40]}'{did_you_mean(key, KEYS)}" for key in keys if key not in KEYS)
    remarks = tuple(
        mismatch(place, wanted, f"{found}; it is not read") for found in odd
    )
    return dict(zip(keys, values, strict=True)), remarks


def _names(path: Path, fields: list[str], n_axes: int) -> list[str]:
    """Return marker names, from the first of three columns each, or from anywhere if complete."""
    place = f"{path}, line 4"
    if not (
        len(fields) > 1
        and all(map(re.fullmatch, _COUNTERS, (f.lower() for f in fields[:2])))
    ):
        raise RecordingError.at(place, " and ".join(COUNTERS), fields[:2])
    cells = text.trimmed(fields[2:])
    if len(cells) == n_axes and all(
        cells[k] == cells[k - k % 3] for k in range(n_axes)
    ):
        cells = [
            name if k % 3 == 0 else "" for k, name in enumerate(cells)
        ]  # each name thrice
    names = [name for name in cells if name]
    astray = next((i for i, name in enumerate(cells) if name and i % 3), None)
    if astray is None:
        names = cells[::3]
    elif 3 * len(names) != n_axes:
        found = f"'{cells[astray][:40]}'"
        raise RecordingError.at(f"{place}, column {astray + 3}", "nothing", found)
    if not names:
        raise RecordingError.at(place, "marker names", "none")
    if 3 * len(names) > n_axes:
        wanted = f"{3 * len(names)} axes (X, Y, Z of {len(names)} markers)"
        raise RecordingError.at(f"{path}, line 5", wanted, n_axes)
    return names


def _count_axes(path: Path, fields: list[str]) -> int:
    """Require the fifth line to be X1, Y1, Z1, X2 and so on."""
    found = [field for field in fields if field]
    for i, have in enumerate(found):
        # Some count from 0, skip numbers or do not count
        want = f"{'XYZ'[i % 3]}{i // 3 + 1}"
        if not re.fullmatch(rf"{want[0]}\d*", have.upper()):
            raise RecordingError.at(f"{path}, line 5", f"'{want}'", f"'{have[:40]}'")
    if len(found) % 3:
        raise RecordingError.at(
            f"{path}, line 5", "X, Y, Z of each marker", f"{found[-1]} last"
        )
    return len(found)
