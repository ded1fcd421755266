"""Reader of QTM motion-data exports (TSV): positions in mm, missing in four spellings."""

from __future__ import annotations

from csv import QUOTE_NONE
from pathlib import Path

import numpy as np

from hopdata.errors import RecordingError, did_you_mean
from hopdata.recordings.qtm_columns import counter_columns, marker_names, n_empty_columns
from hopdata.recordings.qtm_header import KEYS, MISSING, QtmHeader, read_header
from hopdata.recordings.raw import RATE_TOLERANCE, FloatArray, RawRecording, resolve_rate

BLOCK = 1 << 20  # bytes
SNAP = 0.05  # of a frame: time stamps this near to the nominal grid are its rounded values


def read_qtm_tsv(path: str | Path, *, rate_hz: float | None = None) -> RawRecording:
    """Read a 3-D motion-data export of Qualisys Track Manager.

    A marker counts as unseen where a coordinate is empty, ``NULL`` or ``NaN``, or where all three
    are 0; a single 0 is a valid coordinate.

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
    markers = marker_names(header)
    counters = counter_columns(header, markers)
    n_columns = len(counters) + 3 * len(markers)
    table = _numbers(header, n_columns + n_empty_columns(header, markers))
    _check_frame_count(header, len(table))
    _check_counters(header, table[:, : len(counters)], counters)
    positions = table[:, len(counters) : n_columns].reshape(len(table), len(markers), 3)
    _blank_unseen(positions)
    time, rate = _time_and_rate(header, table, counters, rate_hz)
    return RawRecording(markers, time, positions, rate, unit="mm", events=tuple(header.events))


def _check_kind(header: QtmHeader) -> None:
    kind = (header.values.get("DATA_INCLUDED") or ["3D"])[0]
    if kind != "3D":
        raise RecordingError(
            f"{header.place('DATA_INCLUDED')}: DATA_INCLUDED: expected '3D', found '{kind}'; "
            "export the trajectories as 3D data"
        )


def _numbers(header: QtmHeader, width: int) -> FloatArray:
    """Rows of numbers, (N, width), NaN where a field is missing.

    pandas pads short rows in silence but refuses long ones. So if no row is too long and the
    number of tabs is right in total, every row is right.
    """
    import pandas as pd

    try:
        frame = pd.read_csv(
            header.path,
            sep="\t",
            header=None,
            skiprows=header.n_lines,
            dtype=np.float64,
            na_values=list(MISSING),
            keep_default_na=False,
            quoting=QUOTE_NONE,
        )
    except (ValueError, OverflowError) as error:  # pandas' own errors are ValueErrors
        raise _bad_row(header, width, str(error)) from None
    table: FloatArray = frame.to_numpy()
    n_tabs, is_text = _survey(header)
    if not is_text or n_tabs != len(table) * (width - 1) or np.isinf(table).any():
        raise _bad_row(header, width, f"{len(table)} rows with {n_tabs} tabs")
    table.setflags(write=True)  # the frame is ours alone
    return table


def _survey(header: QtmHeader) -> tuple[int, bool]:
    """Count the tabs after the header, and tell whether there are no control characters."""
    n_tabs, is_text = 0, True
    with header.path.open("rb") as file:
        file.seek(header.offset)
        while block := file.read(BLOCK):
            codes = np.frombuffer(block, dtype=np.uint8)
            n_tabs += int(np.count_nonzero(codes == ord("\t")))
            is_text &= bool(codes.min() >= ord("\t"))
    return n_tabs, is_text


def _bad_row(header: QtmHeader, width: int, cause: str) -> RecordingError:
    """Find the first row that is not `width` numbers, and say so."""
    with header.path.open("rb") as file:
        file.seek(header.offset)
        number, fields = header.n_lines, [""]
        for line in file:
            number += 1
            fields = line.decode("latin-1").rstrip("\r\n").split("\t")
            if fields != [""] and (fault := _fault(fields, width)):
                cut = "" if file.read(1) else "; the file ends here, was it cut short?"
                return RecordingError(f"{header.path}, line {number}{fault}{cut}")
    return RecordingError(f"{header.path}: expected rows of {width} numbers, found {cause}")


def _fault(fields: list[str], width: int) -> str:
    """Say what is wrong with a row, as the end of a message; empty if nothing is."""
    if len(fields) != width:
        return f": expected {width} columns, found {len(fields)}"
    for k, text in enumerate(fields):
        if not _is_finite_or_missing(text):
            comma = "; write decimals with a point" if "," in text else ""
            return f", column {k + 1}: expected a number, found '{text[:40]}'{comma}"
    return ""


def _is_finite_or_missing(text: str) -> bool:
    if text in MISSING:
        return True
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False


def _check_frame_count(header: QtmHeader, n_rows: int) -> None:
    stated = header.number("NO_OF_FRAMES")
    if stated is not None and stated != n_rows:
        cut = "; was the file cut short?" if n_rows < stated else ""
        raise RecordingError(
            f"{header.place('NO_OF_FRAMES')}: NO_OF_FRAMES: expected {stated:g} frames as stated, "
            f"found {n_rows} rows{cut}"
        )


def _check_counters(header: QtmHeader, values: FloatArray, counters: list[str]) -> None:
    bad = np.argwhere(np.isnan(values))
    if len(bad):
        row, column = bad[0]
        raise RecordingError(
            f"{header.path}, line {header.n_lines + 1 + row}: {counters[column]}: "
            "expected a number, found a missing value"
        )


def _blank_unseen(positions: FloatArray) -> None:
    """Set markers (in place) to NaN in the frames in which the file says they were not seen."""
    x, y, z = (positions[:, :, axis] for axis in range(3))
    unseen = (x == 0) & (y == 0) & (z == 0)
    unseen |= np.isnan(x + y + z)
    positions[unseen] = np.nan


def _time_and_rate(
    header: QtmHeader, table: FloatArray, counters: list[str], given_hz: float | None
) -> tuple[FloatArray, float]:
    """Time stamps (N,) in s, and the rate in Hz.

    Exports round the time to 10 us. Stamps within `SNAP` of a frame from the nominal grid are put
    back onto it; all others stay as they are, for the checks to judge.
    """
    stamps = table[:, counters.index("Time")].copy() if "Time" in counters else None
    external = (header.values.get("FREQUENCY") or [""])[0].upper() == "EXT"
    if stamps is not None and external and not np.all(np.diff(stamps) > 0):
        stamps = None  # with an external trigger the clock is the trigger
    rate = resolve_rate(
        header.place("FREQUENCY"), stated=_stated_rate(header, external, stamps), given=given_hz
    )
    number = table[:, 0] if "Frame" in counters else np.arange(len(table), dtype=np.float64)
    if stamps is None:
        return (number - number[0]) / rate, rate
    grid = stamps[0] + (number - number[0]) / rate
    near = np.max(np.abs(stamps - grid)) * rate < SNAP
    return (grid if near else stamps), rate


def _stated_rate(header: QtmHeader, external: bool, stamps: FloatArray | None) -> float | None:
    """Frame rate by the header or, without a header, by the time stamps; None if neither tells."""
    if external:
        return None
    if header.values:
        near = did_you_mean("FREQUENCY", set(header.values) - set(KEYS))
        if near and "FREQUENCY" not in header.values:
            raise RecordingError(f"{header.path}: header: expected the key FREQUENCY{near}")
        return header.number("FREQUENCY")
    if stamps is None or len(stamps) < 2 or not stamps[-1] > stamps[0]:
        return None
    rate = (len(stamps) - 1) / (stamps[-1] - stamps[0])
    whole = np.round(rate)
    return float(whole if abs(rate - whole) < RATE_TOLERANCE * rate else rate)
