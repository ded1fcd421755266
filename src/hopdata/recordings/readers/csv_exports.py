"""Comma-separated exports: OptiTrack Motive, Vicon Nexus, and keypoints from video.

The suffix says nothing, so the first lines decide: Motive begins with its format version, Nexus has
a section of trajectories, DeepLabCut three rows from its scorer on, Anipose columns of coordinates
by name. All leave cells empty where a marker was not seen.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import RecordingError
from hopdata.recordings import raw
from hopdata.recordings.readers import text

_MOTIVE_UNITS = {"millimeters": ("mm", 1.0), "centimeters": ("mm", 10.0), "meters": ("m", 1.0)}
_KINDS = {"Marker", "Rigid Body", "Rigid Body Marker", "Bone", "Bone Marker"}
_AXES = ["X", "Y", "Z"]
_MOST_HEADER_LINES = 40

Row = list[str]


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
        content = file.read()
    if b"\0" in content:
        raise RecordingError(f"{path}: expected comma-separated text, found binary data or UTF-16")
    lines = text.decoded(content).splitlines()
    rows = [_cells(line) for line in lines[:_MOST_HEADER_LINES]]
    first = rows[0] if rows else [""]
    if first[0] == "Format Version":
        return _motive(path, lines, rows, rate_hz)
    if any(line.lower().startswith("trajectories") for line in lines):
        return _nexus(path, lines, rate_hz)
    if first[0] == "scorer":
        return _deeplabcut(path, lines, rows, rate_hz, least_score)
    if sum(name.endswith(("_x", "_y", "_z")) for name in first) >= 3:
        return _anipose(path, lines, first, rate_hz, least_score)
    raise RecordingError(
        f"{path}, line 1: expected an export of Motive (Format Version), Vicon Nexus (a section "
        f"Trajectories), DeepLabCut (scorer) or Anipose (columns <name>_x, _y, _z), found "
        f"'{','.join(first)[:40]}'"
    )


def _motive(
    path: Path, lines: list[str], rows: list[Row], rate_hz: float | None
) -> raw.RawRecording:
    """Read markers; those solved from a rigid body or skeleton only if there are no others."""
    keys = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    axes_at = _row_that(path, rows, "Frame, Time (Seconds), X, Y, Z", lambda row: row[0] == "Frame")
    kinds = next((row for row in rows[1:axes_at] if _KINDS & {*row}), [])
    if not kinds:
        raise RecordingError(f"{path}: expected a row of Marker or Rigid Body, found none")
    names = rows[rows.index(kinds) + 1]
    parts = rows[axes_at - 1]
    starts = [
        place
        for place, axis in enumerate(rows[axes_at])
        if axis == "X" and _at(parts, place) == "Position"
    ]
    of_kind = {
        kind: [place for place in starts if _at(kinds, place) == kind]
        for kind in ("Marker", "Rigid Body Marker", "Bone Marker")
    }
    labelled = [p for p in of_kind["Marker"] if not _at(names, p).startswith("Unlabeled")]
    remarks = []
    if of_kind["Marker"] and not labelled:
        labelled = of_kind["Marker"]
    elif nameless := len(of_kind["Marker"]) - len(labelled):
        remarks.append(f"{path}: {nameless} unlabeled markers are left out")
    if not labelled:
        labelled = of_kind["Rigid Body Marker"] or of_kind["Bone Marker"]
        remarks.append(f"{path}: markers are those of the solved bodies, none was exported as seen")
    if not labelled:
        raise RecordingError(
            f"{path}: expected positions of markers, found none; export them from Motive as well"
        )
    place = f"{path}, line 1"
    rate = raw.resolve_rate(
        f"{place}: Export Frame Rate",
        stated=_stated(place, keys, "Export Frame Rate", "Capture Frame Rate"),
        given=rate_hz,
    )
    unit = keys.get("Length Units", "")
    if unit.lower() not in _MOTIVE_UNITS:
        raise RecordingError(
            f"{place}: Length Units: expected Millimeters, Centimeters or Meters, found '{unit}'"
        )
    of_unit, factor = _MOTIVE_UNITS[unit.lower()]
    return _recording(
        path, lines, axes_at, labelled, [_at(names, p) for p in labelled], rate,
        unit=of_unit, factor=factor, remarks=tuple(remarks), has_time=True,
    )  # fmt: skip


def _nexus(path: Path, lines: list[str], rate_hz: float | None) -> raw.RawRecording:
    """Read the section of trajectories; devices and the outputs of models stand in others."""
    at = next(i for i, line in enumerate(lines) if line.lower().startswith("trajectories"))
    head = [_cells(line) for line in lines[at : at + 5]]
    if len(head) < 5 or head[3][:2] != ["Frame", "Sub Frame"]:
        found = ",".join(head[3][:2]) if len(head) > 3 else "the end of the file"
        raise RecordingError(f"{path}, line {at + 4}: expected Frame,Sub Frame, found {found}")
    rate = raw.resolve_rate(
        f"{path}, line {at + 2}",
        stated=_stated(f"{path}, line {at + 2}", {"rate": head[1][0]}, "rate"),
        given=rate_hz,
    )
    starts = [place for place, axis in enumerate(head[3]) if axis == "X"]
    names = [_at(head[2], place) for place in starts]
    subjects = {name.split(":")[0] for name in names if ":" in name}
    if len(subjects) == 1:  # of several animals the names tell whose a marker is
        names = [name.split(":", 1)[-1] for name in names]
    end = next((i for i in range(at + 5, len(lines)) if not lines[i].strip(" ,")), len(lines))
    unit = _at(head[4], starts[0]) if starts else ""
    if unit not in raw.METRES_PER_UNIT:
        raise RecordingError(f"{path}, line {at + 5}: expected mm or m, found '{unit}'")
    others = [line for line in ("Devices", "Model Outputs", "Joints", "Segments") if line in lines]
    remarks = (f"{path}: section {', '.join(others)} not read",) if others else ()
    return _recording(
        path, lines[:end], at + 4, starts, names, rate, unit=unit, remarks=remarks, axes_at=at + 3
    )


def _deeplabcut(
    path: Path, lines: list[str], rows: list[Row], rate_hz: float | None, least_score: float
) -> raw.RawRecording:
    at = _row_that(path, rows, "coords", lambda row: row[0] == "coords")
    coords = rows[at]
    if "z" not in coords:
        raise RecordingError(
            f"{path}, line {at + 1}: expected coordinates x, y and z, found one camera's plane; "
            "triangulate the cameras first (Anipose, or DeepLabCut's 3-D project)"
        )
    starts = [place for place, axis in enumerate(coords) if axis == "x"]
    above = [row for row in rows[1:at] if row[0] in ("individuals", "bodyparts")]
    names = [" ".join(_at(row, place) for row in above) for place in starts]
    scores = [place + 3 if _at(coords, place + 3) == "likelihood" else None for place in starts]
    return _keypoints(path, lines, at, starts, names, scores, rate_hz, least_score)


def _anipose(
    path: Path, lines: list[str], header: Row, rate_hz: float | None, least_score: float
) -> raw.RawRecording:
    names = [
        name[:-2]
        for name in header
        if name.endswith("_x") and {f"{name[:-2]}_y", f"{name[:-2]}_z"} <= set(header)
    ]
    starts = [header.index(f"{name}_x") for name in names]
    scores = [header.index(s) if (s := f"{name}_score") in header else None for name in names]
    return _keypoints(path, lines, 0, starts, names, scores, rate_hz, least_score)


def _keypoints(
    path: Path,
    lines: list[str],
    at: int,
    starts: list[int],
    names: list[str],
    scores: Sequence[int | None],
    rate_hz: float | None,
    least_score: float,
) -> raw.RawRecording:
    """Read keypoints from video: they state neither rate nor unit, but how sure they are."""
    rate = raw.resolve_rate(str(path), stated=None, given=rate_hz)
    found = _recording(path, lines, at, starts, names, rate, unit=raw.USUAL_UNIT, counts=False)
    known = [(m, place) for m, place in enumerate(scores) if place is not None]
    if not known:
        return replace(found, unit_is_stated=False)
    sure = _numbers(path, lines, at + 1, [place for _, place in known]) >= least_score
    positions, columns = found.positions.copy(), [m for m, _ in known]
    unsure = ~sure & np.isfinite(positions[:, columns, 0])
    positions[:, columns] = np.where(sure[..., None], positions[:, columns], np.nan)
    remark = (
        f"{path}: {unsure.sum()} of {unsure.size} places have a score below {least_score:g} "
        "(input.least_score) and count as unseen"
    )
    return replace(
        found, positions=positions, unit_is_stated=False, remarks=(*found.remarks, remark)
    )


def _recording(
    path: Path,
    lines: list[str],
    last_header: int,
    starts: list[int],
    names: list[str],
    rate_hz: float,
    *,
    unit: str,
    factor: float = 1.0,
    remarks: tuple[str, ...] = (),
    has_time: bool = False,
    counts: bool = True,
    axes_at: int | None = None,
) -> raw.RawRecording:
    """Read the blocks of three columns that begin at `starts` in the rows below a header."""
    axes_at = last_header if axes_at is None else axes_at
    axes = _cells(lines[axes_at])
    for place, name in zip(starts, names, strict=True):
        three = [axis[-1:].upper() for axis in axes[place : place + 3]]
        if three != _AXES:
            raise RecordingError(
                f"{path}, line {axes_at + 1}: expected X, Y, Z of '{name}', found "
                f"{', '.join(axes[place : place + 3])}"
            )
    if not starts:
        raise RecordingError(f"{path}, line {last_header + 1}: expected markers, found none")
    columns = [place + k for place in starts for k in range(3)]
    counters = [0, 1] if has_time else [0] if counts else []
    table = _numbers(path, lines, last_header + 1, counters + columns)
    bad = np.argwhere(np.isnan(table[:, : len(counters)]))
    if len(bad):
        raise RecordingError(
            f"{path}, line {last_header + 2 + bad[0, 0]}: expected a frame's number and time, "
            "found an empty cell"
        )
    positions = factor * table[:, len(counters) :].reshape(len(table), len(starts), 3)
    text.blank_unseen(positions)
    if has_time:
        time, late = raw.settle(str(path), table[:, 1].copy(), table[:, 0].copy(), rate_hz)
    else:
        time, late = (table[:, 0] - 1.0 if counts else np.arange(len(table))) / rate_hz, ()
    markers, renamed = raw.distinct_names(str(path), names, may_lack=True)
    return raw.RawRecording(
        markers, time, positions, rate_hz, unit=unit, remarks=remarks + renamed + late
    )


def _numbers(path: Path, lines: list[str], first: int, columns: list[int]) -> FloatArray:
    """Read columns of numbers, (N, C), NaN where a cell is empty, of the rows from a line on."""
    import pandas as pd

    body = lines[first:]
    while body and not body[-1].strip(" ,"):
        body.pop()
    if not body:
        raise RecordingError(f"{path}: expected rows of numbers after the header, found none")
    width = body[0].count(",") + 1
    uneven = next((i for i, line in enumerate(body) if line.count(",") + 1 != width), None)
    if uneven is not None:
        end = "; the file ends here, was it cut short?" if uneven == len(body) - 1 else ""
        raise RecordingError(
            f"{path}, line {first + uneven + 1}: expected {width} columns, found "
            f"{body[uneven].count(',') + 1}{end}"
        )
    if max(columns) >= width:
        raise RecordingError(
            f"{path}, line {first + 1}: expected {max(columns) + 1} columns, found {width}"
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
        raise _bad_cell(path, body, first, columns)
    return np.asarray(table)


def _bad_cell(path: Path, body: list[str], first: int, columns: list[int]) -> RecordingError:
    for row, line in enumerate(body):
        cells = line.split(",")
        for column in columns:
            cell = cells[column].strip()
            if cell not in text.TEXT_TABLE_MISSING and (fault := text.no_number(cell)):
                return RecordingError(
                    f"{path}, line {first + row + 1}, column {column + 1}: {fault}"
                )
    return RecordingError(f"{path}: expected rows of numbers, found other text")


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
