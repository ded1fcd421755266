"""Reader of QTM motion-data exports (TSV) and of plain tables with a column row: mm."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hopdata.errors import RecordingError, did_you_mean
from hopdata.recordings.frame_times import rate_of, settle
from hopdata.recordings.qtm_columns import (
    counter_columns,
    marker_names,
    n_empty_columns,
    trajectory_types,
)
from hopdata.recordings.qtm_dates import moment
from hopdata.recordings.qtm_header import KEYS, QtmHeader, read_header
from hopdata.recordings.raw import (
    USUAL_UNIT,
    FloatArray,
    RawRecording,
    distinct_names,
    resolve_rate,
)
from hopdata.recordings.text_table import Rows, blank_unseen, require_counters

KEYS_OF_EXPORTS = frozenset(KEYS)  # which are in mm; of a bare table nothing says so


def read_qtm_tsv(path: str | Path, *, rate_hz: float | None = None) -> RawRecording:
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
    header = read_header(Path(path))
    _check_kind(header)
    place, names = marker_names(header)
    markers, renamed = distinct_names(place, names)
    counters = counter_columns(header, names)
    types = trajectory_types(header, len(markers))
    n_columns = len(counters) + 3 * len(markers)
    width = n_columns + n_empty_columns(header, names)
    rows = Rows(header.path, header.n_lines, header.offset, width)
    table = rows.numbers()
    _check_frame_count(header, len(table))
    require_counters(rows, table[:, : len(counters)], counters)
    positions = table[:, len(counters) : n_columns].reshape(len(table), len(markers), 3)
    blank_unseen(positions)
    time, rate, remarks = _time_and_rate(header, table, counters, rate_hz)
    return RawRecording(
        markers,
        time,
        positions,
        rate,
        unit=USUAL_UNIT,
        unit_is_stated=not KEYS_OF_EXPORTS.isdisjoint(header.values),
        events=tuple(header.events),
        trajectory_types=types,
        started=moment((header.values.get("TIME_STAMP") or [""])[0]),
        remarks=renamed + remarks + _event_remarks(header, rate),
    )


def _check_kind(header: QtmHeader) -> None:
    kind = (header.values.get("DATA_INCLUDED") or ["3D"])[0]
    if kind != "3D":
        raise RecordingError(
            f"{header.place('DATA_INCLUDED')}: DATA_INCLUDED: expected '3D', found '{kind}'; "
            "export the trajectories as 3D data"
        )


def _check_frame_count(header: QtmHeader, n_rows: int) -> None:
    stated = header.number("NO_OF_FRAMES")
    if stated is not None and stated != n_rows:
        cut = "; was the file cut short?" if n_rows < stated else ""
        raise RecordingError(
            f"{header.place('NO_OF_FRAMES')}: NO_OF_FRAMES: expected {stated:g} frames as stated, "
            f"found {n_rows} rows{cut}"
        )


def _time_and_rate(
    header: QtmHeader, table: FloatArray, counters: list[str], given_hz: float | None
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
    rate = resolve_rate(
        header.place("FREQUENCY"),
        stated=_stated_rate(header, external, stamps, number),
        given=given_hz,
    )
    if stamps is None:
        return (number - number[0]) / rate, rate, remarks
    if external:
        return stamps, rate, remarks
    time, remarks = settle(str(header.path), stamps, number, rate)
    return time, rate, remarks


def _stated_rate(
    header: QtmHeader, external: bool, stamps: FloatArray | None, number: FloatArray
) -> float | None:
    """Frame rate by the header or, without a header, by the time stamps; None if neither tells."""
    if external:
        return None
    if header.values:
        near = did_you_mean("FREQUENCY", set(header.values) - set(KEYS))
        if near and "FREQUENCY" not in header.values:
            raise RecordingError(
                f"{header.path}: header: expected the key FREQUENCY, found none{near}"
            )
        return header.number("FREQUENCY")
    return None if stamps is None else rate_of(stamps, number)


def _event_remarks(header: QtmHeader, rate_hz: float) -> tuple[str, ...]:
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
