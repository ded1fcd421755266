"""Reader of TRC files, the marker format of OpenSim and Cortex: often y up, in m or mm."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from hopdata.errors import RecordingError, did_you_mean
from hopdata.recordings.raw import (
    METRES_PER_UNIT,
    USUAL_UNIT,
    RawRecording,
    distinct_names,
    resolve_rate,
    settle,
)
from hopdata.recordings.readers.text import (
    Rows,
    blank_unseen,
    is_number,
    require_counters,
    split_line,
    trimmed,
)

KEYS = (
    *("DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units"),
    *("OrigDataRate", "OrigDataStartFrame", "OrigNumFrames"),
)
COUNTERS = ["Frame#", "Time"]
_HEADER_LINES = 5  # file type, keys, values, marker names, axes; then perhaps an empty one


@dataclass(frozen=True)
class _Header:
    """Values by key, marker names, and where the rows of numbers stand."""

    path: Path
    values: dict[str, str]
    markers: tuple[str, ...]
    rows: Rows

    def number(self, key: str) -> float | None:
        """Value of a key as a finite number; None if the key is absent."""
        text = self.values.get(key)
        if text is None:
            return None
        if not (is_number(text) and np.isfinite(float(text))):
            raise RecordingError(
                f"{self.path}, line 3: {key}: expected a number, found '{text[:40]}'"
            )
        return float(text)


def read_trc(path: str | Path, *, rate_hz: float | None = None) -> RawRecording:
    """Read the markers of a TRC file.

    A marker counts as unseen where a coordinate is missing, or where all three are 0.

    Parameters
    ----------
    path : path
        The ``.trc`` file.
    rate_hz : float, optional
        Frame rate; must be the file's, if it states one.

    Raises
    ------
    RecordingError
        Naming the file, the line, what was expected and what was found.
    """
    path = Path(path)
    header = _read_header(path)
    unit = _unit(header)
    rate = resolve_rate(
        f"{path}, line 3: DataRate", stated=header.number("DataRate"), given=rate_hz
    )
    table = header.rows.numbers()
    n_frames = header.number("NumFrames")
    if n_frames is not None and n_frames != len(table):
        cut = "; was the file cut short?" if len(table) < n_frames else ""
        raise RecordingError(
            f"{path}, line 3: NumFrames: expected {n_frames:g} frames as stated, "
            f"found {len(table)} rows{cut}"
        )
    require_counters(header.rows, table[:, :2], COUNTERS)
    n_columns = 2 + 3 * len(header.markers)
    positions = table[:, 2:n_columns].reshape(len(table), len(header.markers), 3)
    blank_unseen(positions)
    time, remarks = settle(str(path), table[:, 1].copy(), table[:, 0].copy(), rate)
    return RawRecording(
        header.markers,
        time,
        positions,
        rate,
        unit=unit or USUAL_UNIT,
        unit_is_stated=bool(unit),
        remarks=remarks,
    )


def _read_header(path: Path) -> _Header:
    lines: list[list[str]] = []
    offset = 0
    try:
        with path.open("rb") as file:
            for line in islice(file, _HEADER_LINES):
                lines.append(split_line(path, line))
                offset += len(line)
            first = next(iter(file), b"")
            while first and not first.strip(b"\r\n\t "):
                lines.append([])
                offset += len(first)
                first = next(iter(file), b"")
    except OSError as error:
        raise RecordingError(
            f"{path}: expected a readable file, found: {error.strerror or error}"
        ) from None
    if not lines or lines[0][0] != "PathFileType":
        found = f"'{lines[0][0][:40]}'" if lines else "an empty file"
        raise RecordingError(f"{path}, line 1: expected PathFileType, found {found}")
    if not first:
        raise RecordingError(f"{path}: expected rows of numbers after the header, found none")
    values, markers = _values(path, lines[1], lines[2]), _markers(path, lines[3])
    _check_axes(path, lines[4], len(markers))
    n_markers = _Header(path, values, markers, Rows(path, 0, 0, 0)).number("NumMarkers")
    if n_markers is not None and n_markers != len(markers):
        raise RecordingError(
            f"{path}, line 4: expected {n_markers:g} marker names (NumMarkers), "
            f"found {len(markers)}"
        )
    width = 2 + 3 * len(markers)
    fields = split_line(path, first)
    width += int(len(fields) == width + 1 and not fields[-1])
    return _Header(path, values, markers, Rows(path, len(lines), offset, width))


def _values(path: Path, keys: list[str], values: list[str]) -> dict[str, str]:
    keys, values = trimmed(keys), trimmed(values)
    for key in keys:
        if key not in KEYS:
            raise RecordingError(
                f"{path}, line 2: expected keys such as {', '.join(KEYS[:5])}, "
                f"found '{key[:40]}'{did_you_mean(key, KEYS)}"
            )
    if len(keys) != len(values) or len(set(keys)) != len(keys):
        raise RecordingError(
            f"{path}, line 3: expected a value for each of {len(keys)} different keys, "
            f"found {len(values)} values"
        )
    return dict(zip(keys, values, strict=True))


def _markers(path: Path, fields: list[str]) -> tuple[str, ...]:
    """Marker names, each in the first of its three columns."""
    place = f"{path}, line 4"
    if fields[:2] != COUNTERS:
        raise RecordingError(f"{place}: expected Frame# and Time, found {fields[:2]}")
    named = trimmed(fields[2:])
    for i, name in enumerate(named):
        if bool(name) != (i % 3 == 0):
            expected = f"the name of marker {i // 3 + 1}" if i % 3 == 0 else "nothing"
            raise RecordingError(
                f"{place}, column {i + 3}: expected {expected}, found '{name[:40]}'"
            )
    if not named:
        raise RecordingError(f"{place}: expected marker names, found none")
    return distinct_names(place, named[::3])


def _check_axes(path: Path, fields: list[str], n_markers: int) -> None:
    """Require the fifth line to say X1, Y1, Z1, X2 and so on."""
    found = [field for field in fields if field]
    expected = [f"{axis}{i + 1}" for i in range(n_markers) for axis in "XYZ"]
    for want, have in zip(expected, found, strict=False):
        if want != have:
            raise RecordingError(f"{path}, line 5: expected '{want}', found '{have[:40]}'")
    if len(found) != len(expected):
        raise RecordingError(
            f"{path}, line 5: expected {len(expected)} axes (X, Y, Z of {n_markers} markers), "
            f"found {len(found)}"
        )


def _unit(header: _Header) -> str:
    """Return the unit that the file states; empty if it states none."""
    stated = header.values.get("Units")
    if stated is None:
        return ""
    if stated.lower() not in METRES_PER_UNIT:
        raise RecordingError(f"{header.path}, line 3: Units: expected mm or m, found '{stated}'")
    return stated.lower()
