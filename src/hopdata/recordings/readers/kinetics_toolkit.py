"""Reader of what Kinetics Toolkit saves: JSON in a zip file, ending in ``.ktk.zip``.

The member ``data.json`` holds a time series, or dictionaries of them. A series of
points has an array of four columns for each marker, the last of which is 1. Its size in
memory is estimated from the text before that is taken apart.
"""

import json
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import RecordingError
from hopdata.messages import Message
from hopdata.recording import Event
from hopdata.recordings import raw
from hopdata.recordings.budget import (
    MOST_LINKS,
    require_few,
    require_memory,
    require_unpacked,
)
from hopdata.recordings.readers.text import listed, one_line

DATA = "data.json"

# Class of a time series, and names of the one that is taken if there are several.
_SERIES = "ktk.TimeSeries"
_USUAL = ("markers", "points", "trajectories")

# Bytes of memory for what stands in JSON: an entry, a list and a dictionary.
_PER_ENTRY = 40
_PER_LIST = 96
_PER_DICTIONARY = 300

Series = dict[str, Any]


def read_ktk(
    path: Path, *, rate_hz: float | None = None, most_unpacked_mb: float
) -> raw.RawRecording:
    """Read the points of a file that Kinetics Toolkit saved.

    Parameters
    ----------
    path : path
        The ``.ktk.zip`` file.
    rate_hz : float, optional
        Frame rate, for a file whose time does not tell it.
    most_unpacked_mb : float
        Most memory that the file may use, MB.

    Raises
    ------
    RecordingError
        If the file cannot be read; names the file, the series, what was expected and
        found.
    """
    try:
        content = _content(path, most_unpacked_mb)
        found = _series_of(content)
        require_few("time series", len(found), MOST_LINKS)
    except RecursionError:
        found_deep = "dictionaries or lists too deep to be one"
        raise RecordingError.at(path, "time series", found_deep) from None
    except (
        zipfile.BadZipFile,
        zlib.error,
        EOFError,
        OSError,
        NotImplementedError,
        ValueError,
        RuntimeError,  # an encrypted member
    ) as error:
        words = one_line(str(error))
        if "expected" not in words:
            how = "; save it again with kineticstoolkit.save"
            words = f"expected what Kinetics Toolkit saves, found: {words}{how}"
        raise RecordingError(f"{path}: {words}") from None
    names, remarks = _chosen(path, found)
    series = found[names]
    place = f"{path}: {names}" if names else str(path)
    return _recording(place, series, rate_hz, remarks)


def _content(path: Path, most_unpacked_mb: float) -> Any:
    """Return what ``data.json`` holds, if its size in memory is allowed."""
    with zipfile.ZipFile(path) as archive:
        members = {Path(name).name: name for name in archive.namelist()}
        if DATA not in members:
            some = listed(archive.namelist()) or "none"
            raise ValueError(f"expected a member {DATA}, found {some}")
        n_bytes = archive.getinfo(members[DATA]).file_size
        require_unpacked(n_bytes, most_unpacked_mb)
        with archive.open(members[DATA]) as member:
            text = member.read(n_bytes + 1)
    in_memory = (
        2 * len(text)
        + _PER_ENTRY * text.count(b",")
        + _PER_LIST * text.count(b"[")
        + _PER_DICTIONARY * text.count(b"{")
    )
    require_memory(in_memory, most_unpacked_mb)
    return json.loads(text)


def _series_of(content: Any) -> dict[str, Series]:
    """Return the time series in nested dictionaries, by their names joined by dots."""
    found: dict[str, Series] = {}
    waiting: list[tuple[str, Any]] = [("", content)]
    while waiting:
        name, item = waiting.pop()
        if not isinstance(item, dict):
            continue
        if item.get("class__") == _SERIES:
            found[name] = item
            continue
        for key, inner in reversed(item.items()):
            inner_name = f"{name}.{key}" if name else str(key)
            waiting.append((inner_name, inner))
    return found


def _chosen(path: Path, found: dict[str, Series]) -> tuple[str, tuple[raw.Remark, ...]]:
    """Return the name of the series of points, and remarks on others."""
    with_points = [name for name, series in found.items() if _points(series)]
    if not with_points:
        some = listed([name or "one" for name in found]) or "none"
        wanted = "a time series with points (N x 4, the last column 1)"
        raise RecordingError.at(path, wanted, f"time series without: {some}")
    usual = [name for name in with_points if name.rpartition(".")[2].lower() in _USUAL]
    name = (usual or with_points)[0]
    remarks: list[raw.Remark] = []
    others = [other for other in with_points if other != name]
    if others:
        values = {"place": str(path), "read": name, "others": listed(others)}
        remarks.append(Message("recordings.series_read", values))
    rest = [other for other in found if other not in with_points]
    if rest:
        values = {"place": str(path), "series": listed(rest)}
        remarks.append(Message("recordings.series_left_out", values))
    return name, tuple(remarks)


def _points(series: Series) -> dict[str, FloatArray]:
    """Return the arrays (N, 4) of a series whose last column is 1, by name."""
    time = series.get("time")
    data = series.get("data")
    if not isinstance(time, list) or not isinstance(data, dict):
        return {}
    points = {}
    for name, rows in data.items():
        if not isinstance(rows, list) or len(rows) != len(time):
            continue
        try:
            array = np.array(rows, dtype=np.float64)
        except (ValueError, TypeError, OverflowError):  # not all are numbers
            continue
        if array.ndim != 2 or array.shape[1] != 4 or not len(array):
            continue
        fourth = array[:, 3][np.isfinite(array).all(axis=1)]
        if (fourth == 1).all():
            points[str(name)] = array
    return points


def _recording(
    place: str,
    series: Series,
    rate_hz: float | None,
    remarks: tuple[raw.Remark, ...],
) -> raw.RawRecording:
    points = _points(series)
    try:
        stamps = np.array(series["time"], dtype=np.float64)
    except (ValueError, TypeError, OverflowError):
        raise RecordingError.at(f"{place}: time", "numbers", "others") from None
    if stamps.ndim != 1 or not np.isfinite(stamps).all():
        raise RecordingError.at(f"{place}: time", "finite numbers", "others")
    left_out = [str(name) for name in series["data"] if str(name) not in points]
    if left_out:
        values = {"place": place, "columns": listed(left_out)}
        remarks += (Message("recordings.columns_left_out", values),)
    # A point that was not seen has no finite coordinates, and so no fourth 1.
    positions = np.stack([array[:, :3] for array in points.values()], axis=1)
    return raw.assembled(
        place,
        raw.distinct_names(place, list(points)),
        positions,
        number=np.arange(1.0, len(stamps) + 1),
        stamps=stamps,
        unit=(f"{place}: data_info", _unit(place, series, list(points))),
        rates_hz=(None, rate_hz),
        remarks=remarks,
        events=_events(series),
    )


def _unit(place: str, series: Series, names: list[str]) -> str:
    """Return the unit of all points; metres, as is usual, if none is stated."""
    info = series.get("data_info")
    stated = set()
    if isinstance(info, dict):
        for name in names:
            of_one = info.get(name)
            unit = of_one.get("Unit") if isinstance(of_one, dict) else None
            if isinstance(unit, str) and unit:
                stated.add(unit)
    if len(stated) > 1:
        found = listed(sorted(stated))
        raise RecordingError.at(f"{place}: data_info", "one unit", found)
    return stated.pop() if stated else "m"


def _events(series: Series) -> tuple[Event, ...]:
    """Return the events of a series; those without a name or a finite time are none."""
    events = []
    stored = series.get("events")
    for one in stored if isinstance(stored, list) else []:
        if not isinstance(one, dict):
            continue
        name = one.get("name")
        time_s = one.get("time")
        if not isinstance(time_s, int | float) or not isinstance(name, str):
            continue
        if np.isfinite(float(time_s)) and name.isprintable():
            events.append(Event(name, float(time_s)))
    return tuple(events)
