"""Reader of TRC files, the marker format of OpenSim and Cortex: often y up, in m or mm."""

import re
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
_HEADER_LINES = 5  # file type, keys, values, marker names, axes; possibly an empty line follows


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
        If the file cannot be read; names the file, the line, what was expected and found.
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


def _read_header(path: Path) -> tuple[dict[str, str], tuple[str, ...], text.Rows, tuple[str, ...]]:
    """Return values by key, marker names, the location of the numbers, and remarks."""
    lines: list[list[str]] = []
    with text.readable(path) as file:
        for line in islice(file, _HEADER_LINES):
            lines.append(text.split_line(path, line, _mark(line) if lines else "\t"))
        while (first := file.readline()).isspace():
            lines.append([])
        offset = file.tell() - len(first)
    if not lines or re.split(r"[\s,;]", lines[0][0])[0].lower() != "pathfiletype":
        found = f"'{lines[0][0][:40]}'" if lines else "an empty file"
        raise RecordingError.at(f"{path}, line 1", "PathFileType", found)
    if not first:
        raise RecordingError.at(path, "rows of numbers after the header", "none")
    values, unknown = _values(path, lines[1], lines[2])
    n_axes = _count_axes(path, lines[4])
    names = _names(path, lines[3], n_axes)
    stated = _stated(path, values, "NumMarkers")
    if stated == n_axes // 3:  # the last may have no name
        names += [""] * (n_axes // 3 - len(names))
    told = f"{path}, line 4: expected {stated or 0:g} marker names (NumMarkers), found {len(names)}"
    if stated not in (None, len(names), n_axes // 3) and n_axes != 3 * len(names):
        raise RecordingError(told)
    markers, remarks = raw.distinct_names(f"{path}, line 4", names, may_lack=True)
    remarks += unknown + (f"{told}, which are used",) * (stated not in (None, len(names)))
    mark = _mark(first)
    fields = text.split_line(path, first, mark)
    width = max(len(fields), 2 + 3 * len(markers))
    if any(fields[2 + 3 * len(markers) :]) or n_axes > 3 * len(markers):
        wanted = f"{3 * len(markers)} columns of {len(markers)} markers"
        found = f"{max(n_axes, len(text.trimmed(fields)) - 2)}; the others are not read"
        remarks += (mismatch(path, wanted, found),)
    return values, markers, text.Rows(path, len(lines), offset, width, mark), remarks


def _mark(line: bytes) -> str:
    """Return the field separator of a line: a tab, or a blank if it has no tabs."""
    return "\t" if b"\t" in line.strip() else " "


def _values(
    path: Path, keys: list[str], values: list[str]
) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return values by key, and remarks on unknown keys, which are ignored."""
    known = {key.lower(): key for key in KEYS}
    keys, values = " ".join(keys).split(), " ".join(values).split()  # some use blanks for tabs
    keys = [known.get(key.lower(), key) for key in keys]
    if len(keys) != len(values) or len(set(keys)) != len(keys):
        wanted = f"a value for each of {len(keys)} different keys"
        raise RecordingError.at(f"{path}, line 3", wanted, f"{len(values)} values")
    place, wanted = f"{path}, line 2", f"keys such as {', '.join(KEYS[:5])}"
    odd = (f"'{key[:40]}'{did_you_mean(key, KEYS)}" for key in keys if key not in KEYS)
    remarks = tuple(mismatch(place, wanted, f"{found}; it is not read") for found in odd)
    return dict(zip(keys, values, strict=True)), remarks


def _names(path: Path, fields: list[str], n_axes: int) -> list[str]:
    """Return marker names, from the first of three columns each, or from anywhere if complete."""
    place = f"{path}, line 4"
    if not (len(fields) > 1 and all(map(re.fullmatch, _COUNTERS, (f.lower() for f in fields[:2])))):
        raise RecordingError.at(place, " and ".join(COUNTERS), fields[:2])
    cells = text.trimmed(fields[2:])
    if len(cells) == n_axes and all(cells[k] == cells[k - k % 3] for k in range(n_axes)):
        cells = [name if k % 3 == 0 else "" for k, name in enumerate(cells)]  # each name thrice
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
        want = f"{'XYZ'[i % 3]}{i // 3 + 1}"  # some count from 0, skip numbers or do not count
        if not re.fullmatch(rf"{want[0]}\d*", have.upper()):
            raise RecordingError.at(f"{path}, line 5", f"'{want}'", f"'{have[:40]}'")
    if len(found) % 3:
        raise RecordingError.at(f"{path}, line 5", "X, Y, Z of each marker", f"{found[-1]} last")
    return len(found)
