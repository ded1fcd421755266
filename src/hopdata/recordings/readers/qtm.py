"""Reader of QTM's MAT exports: one struct, named after the file, in either kind of MAT file.

What is read: ``FrameRate``, ``Frames``, ``StartFrame``, ``Timestamp``, ``Events`` and
``Trajectories.Labeled`` with ``Labels``, ``Data`` (marker, x y z residual, frame), in mm, and
``TrajectoryTypes``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import RecordingError, did_you_mean
from hopdata.recording import Event
from hopdata.recordings import raw
from hopdata.recordings.readers import qtm_header
from hopdata.recordings.readers.mat import read_mat
from hopdata.recordings.readers.text import Rows, blank_unseen


def read_qtm_mat(
    path: str | Path,
    *,
    rate_hz: float | None = None,
    most_unpacked_mb: float = raw.MOST_UNPACKED_MB,
) -> raw.RawRecording:
    """Read the labelled trajectories of a MAT file that QTM exported.

    A marker counts as unseen where a coordinate is NaN, or where all three are 0.

    Parameters
    ----------
    path : path
        The ``.mat`` file, version 5 to 7.3.
    rate_hz : float, optional
        Frame rate, for a file that does not state it.
    most_unpacked_mb : float
        Memory that the file may ask for, MB.

    Returns
    -------
    RawRecording
        Positions in mm along the file's axes.

    Raises
    ------
    RecordingError
        Naming the file, the field, what was expected and what was found.
    """
    path = Path(path)
    name, export = _export(path, read_mat(path, most_unpacked_mb))
    place = f"{path}: {name}"
    labelled = _field(_field(export, "Trajectories", place), "Labeled", f"{place}.Trajectories")
    inner = f"{place}.Trajectories.Labeled"
    data = _positions(labelled, inner)
    labels = _labels(labelled, inner)
    if len(labels) != len(data):
        raise RecordingError(
            f"{inner}.Labels: expected {len(data)} as in Data, found {len(labels)}"
        )
    positions: FloatArray = np.array(np.moveaxis(data[:, :3], 2, 0), np.float64, order="C")
    _check_counts(export, labelled, positions, place)
    blank_unseen(positions)
    rate = raw.resolve_rate(
        f"{place}.FrameRate", stated=_number(export, "FrameRate", place), given=rate_hz
    )
    start = _number(export, "StartFrame", place)
    first = 1.0 if start is None else start
    markers, remarks = raw.distinct_names(f"{inner}.Labels", labels)
    return raw.RawRecording(
        markers,
        np.asarray((first - 1 + np.arange(len(positions))) / rate, dtype=np.float64),
        positions,
        rate,
        unit="mm",
        events=_events(export, place),
        started=qtm_header.moment(export.get("Timestamp")),
        remarks=remarks,
        has_stamps=False,
    )


def _export(path: Path, variables: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """Name and content of the one struct with trajectories."""
    for name, value in variables.items():
        if isinstance(value, dict) and "Trajectories" in value:
            return name, value
    found = ", ".join(variables) or "none"
    raise RecordingError(
        f"{path}: expected a struct with the field Trajectories, found the variables {found}"
    )


def _field(struct: Any, name: str, place: str) -> Any:
    if not isinstance(struct, dict):
        raise RecordingError(f"{place}: expected a struct, found {_kind(struct)}")
    if name not in struct:
        raise RecordingError(
            f"{place}: expected the field {name}, found {', '.join(struct) or 'none'}"
            f"{did_you_mean(name, struct)}"
        )
    return struct[name]


def _positions(labelled: Any, place: str) -> FloatArray:
    """Return ``Data`` as (M, 4, N); MATLAB drops a last axis of length 1."""
    data = _field(labelled, "Data", place)
    if not isinstance(data, np.ndarray) or data.dtype.kind not in "iuf":
        raise RecordingError(f"{place}.Data: expected numbers, found {_kind(data)}")
    if data.ndim == 2:
        data = data[:, :, None]
    if data.ndim != 3 or data.shape[1] not in (3, 4) or not data.size:
        raise RecordingError(
            f"{place}.Data: expected markers x 4 x frames, found {' x '.join(map(str, data.shape))}"
        )
    checked: FloatArray = data
    return checked


def _labels(labelled: Any, place: str) -> list[str]:
    labels = _field(labelled, "Labels", place)
    labels = [labels] if isinstance(labels, str) else labels
    if not isinstance(labels, list) or not all(isinstance(text, str) for text in labels):
        raise RecordingError(f"{place}.Labels: expected a cell of texts, found {_kind(labels)}")
    return [text.strip(" \0") for text in labels]


def _check_counts(export: Any, labelled: Any, positions: FloatArray, place: str) -> None:
    n_frames, n_markers = positions.shape[:2]
    inner = f"{place}.Trajectories.Labeled"
    claims = ((export, "Frames", n_frames, place), (labelled, "Count", n_markers, inner))
    for struct, key, found, where in claims:
        stated = _number(struct, key, where)
        if stated is not None and stated != found:
            cut = "; was the file cut short?" if key == "Frames" and stated > found else ""
            raise RecordingError(
                f"{where}.{key}: expected {stated:g} as stated, found {found}{cut}"
            )


def _number(struct: dict[str, Any], name: str, place: str) -> float | None:
    """Return a finite number of a struct; None if it is absent or empty."""
    value = struct.get(name)
    if value is None or (isinstance(value, np.ndarray) and not value.size):
        return None
    if not isinstance(value, np.ndarray) or value.size != 1 or not np.isfinite(value).all():
        raise RecordingError(f"{place}.{name}: expected a number, found {_kind(value)}")
    return float(value.item())


def _events(export: dict[str, Any], place: str) -> tuple[Event, ...]:
    """Events: an array of structs, in version 7.3 a struct of lists."""
    found = export.get("Events")
    if isinstance(found, dict) and any(isinstance(value, list) for value in found.values()):
        lists = [value if isinstance(value, list) else [value] for value in found.values()]
        found = [dict(zip(found, entries, strict=False)) for entries in zip(*lists, strict=False)]
    events, place = [], f"{place}.Events"
    for event in [found] if isinstance(found, dict) else found if isinstance(found, list) else []:
        label, time = _field(event, "Label", place), _number(event, "Time", place)
        if not isinstance(label, str) or time is None:
            raise RecordingError(
                f"{place}: expected a Label and a Time each, found {_kind(label)} and {time}"
            )
        events.append(Event(label.split("\0")[0].strip(), time))
    return tuple(events)


def _kind(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of {' x '.join(map(str, value.shape))} {value.dtype}"
    names: dict[type, str] = {dict: "a struct", list: "a list", str: "text"}
    return names.get(type(value), "something else")


# Reader of QTM motion-data exports (TSV) and of plain tables with a column row: mm.

KEYS_OF_EXPORTS = frozenset(qtm_header.KEYS)  # which are in mm; of a bare table nothing says so


def read_qtm_tsv(path: str | Path, *, rate_hz: float | None = None) -> raw.RawRecording:
    """Read a 3-D motion-data export of Qualisys Track Manager.

    A marker counts as unseen where a coordinate is missing in one of its spellings (empty,
    ``NULL``, ``NaN``), or where all three are 0; a single 0 is a valid coordinate.

    Parameters
    ----------
    path : path
        The ``.tsv`` file, with or without header, column row, Frame and Time columns.
    rate_hz : float, optional
        Frame rate, needed where the file does not state one (``FREQUENCY`` is ``EXT``).

    Returns
    -------
    RawRecording
        Positions in mm along the file's axes.

    Raises
    ------
    RecordingError
        Naming the file, the line, what was expected and what was found.
    """
    header = qtm_header.read_header(Path(path))
    _check_kind(header)
    place, names, counters, wrong = qtm_header.layout(header)
    markers, renamed = raw.distinct_names(place, names, may_lack=True)
    n_columns, width = len(counters) + 3 * len(names), len(header.first_row)
    rows = Rows(header.path, header.n_lines, header.offset, width, header.mark)
    unit, factor = (
        raw.metric(str(header.path), header.unit) if header.unit else (raw.USUAL_UNIT, 1.0)
    )
    columns = range(len(counters), n_columns)
    counted, positions = rows.markers(counters, columns, factor=factor)
    key = "NO_OF_FRAMES"
    wrong += raw.frame_count(header.place(key), key, header.number(key), len(positions))
    time, rate, remarks = _time_and_rate(header, counted, counters, rate_hz)
    return raw.RawRecording(
        markers,
        time,
        positions,
        rate,
        unit=unit,
        unit_is_stated=bool(header.unit) or not KEYS_OF_EXPORTS.isdisjoint(header.values),
        events=tuple(header.events),
        started=qtm_header.moment((header.values.get("TIME_STAMP") or [""])[0]),
        remarks=header.remarks + renamed + wrong + remarks + _event_remarks(header, rate),
        has_stamps="Time" in counters,
    )


def _check_kind(header: qtm_header.QtmHeader) -> None:
    kind = (header.values.get("DATA_INCLUDED") or ["3D"])[0]
    if kind != "3D":
        raise RecordingError(
            f"{header.place('DATA_INCLUDED')}: DATA_INCLUDED: expected '3D', found '{kind}'; "
            "export the trajectories as 3D data"
        )


def _time_and_rate(
    header: qtm_header.QtmHeader, table: FloatArray, counters: list[str], given_hz: float | None
) -> tuple[FloatArray, float, tuple[str, ...]]:
    """Time stamps (N,) in s, the rate in Hz, and remarks."""
    stamps = table[:, counters.index("Time")].copy() if "Time" in counters else None
    number = np.arange(len(table), dtype=np.float64)
    if "Frame" in counters:
        number = table[:, counters.index("Frame")].copy()
    remarks: tuple[str, ...] = ()
    external = (header.values.get("FREQUENCY") or [""])[0].upper() == "EXT"
    if stamps is not None and external and not np.all(np.diff(stamps) > 0):
        stamps = None  # with an external trigger the clock is the trigger
        remarks = (
            f"{header.path}: FREQUENCY is EXT and the time stamps do not increase; "
            "time counted from the frames",
        )
    rate = raw.resolve_rate(
        header.place("FREQUENCY"),
        stated=_stated_rate(header, external, stamps, number),
        given=given_hz,
    )
    if stamps is None:
        return (number - number[0]) / rate, rate, remarks
    if external:
        return stamps, rate, remarks
    time, remarks = raw.settle(str(header.path), stamps, number, rate)
    return time, rate, remarks


def _stated_rate(
    header: qtm_header.QtmHeader, external: bool, stamps: FloatArray | None, number: FloatArray
) -> float | None:
    """Frame rate by the header or, without it, by the time stamps; None if neither tells."""
    if external:
        return None
    if header.values:
        near = did_you_mean("FREQUENCY", set(header.values) - set(qtm_header.KEYS))
        if near and "FREQUENCY" not in header.values:
            raise RecordingError(
                f"{header.path}: header: expected the key FREQUENCY, found none{near}"
            )
        if "FREQUENCY" in header.values:
            return header.number("FREQUENCY")
    return None if stamps is None else raw.rate_of(stamps, number)


def _event_remarks(header: qtm_header.QtmHeader, rate_hz: float) -> tuple[str, ...]:
    """Remark on events whose time is not that of their frame, from 1."""
    off = sum(
        abs(event.time_s * rate_hz - (frame - 1)) > 1
        for event, frame in zip(header.events, header.event_frames, strict=True)
    )
    if not off:
        return ()
    return (
        f"{header.path}: EVENT: in {off} of {len(header.events)} events the time is not that of "
        "the frame; the time is used",
    )
