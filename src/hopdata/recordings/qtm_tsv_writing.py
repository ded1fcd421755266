"""Writer of QTM motion-data exports (TSV)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hopdata.errors import RecordingError
from hopdata.jobs import whole_file
from hopdata.recordings.c3d_writing import check_no_origin
from hopdata.recordings.raw import METRES_PER_UNIT, FloatArray, RawRecording

LINE_END = "\r\n"
_NUMBER = "%.9g"  # 1 nm within 1 m of the origin
_TIME = "%.12g"


def write_qtm_tsv(path: str | Path, raw: RawRecording, *, missing: str = "") -> None:
    """Write markers and events as Qualisys Track Manager exports them.

    Parameters
    ----------
    path : path
        File to write; replaced if it exists.
    raw : RawRecording
        Positions in `raw.unit`; written in mm, which the format prescribes, to 9 digits.
    missing : str
        How the coordinates of an unseen marker are written: empty, ``"NULL"``, ``"NaN"`` or
        ``"0"``.

    Raises
    ------
    RecordingError
        If a name or label holds a tab or a line end or is empty, or a seen marker is at exactly
        (0, 0, 0), which a reader takes for unseen.
    """
    import pandas as pd

    for what, text in _texts(raw):
        if not text.strip() or text != text.strip() or {"\t", "\n", "\r", "\0"} & set(text):
            raise RecordingError(
                f"{path}: {what}: expected a text without tabs, line ends or spaces about it, "
                f"found {text!r}"
            )
    check_no_origin(path, raw.positions)
    with whole_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        file.write(LINE_END.join(_header(raw)) + LINE_END)
        pd.DataFrame(_table(raw)).to_csv(
            file,
            sep="\t",
            header=False,
            index=False,
            na_rep=missing,
            lineterminator=LINE_END,
            float_format=_NUMBER,
        )


def _texts(raw: RawRecording) -> list[tuple[str, str]]:
    return [
        *(("marker name", name) for name in raw.markers),
        *(("trajectory type", kind) for kind in raw.trajectory_types),
        *(("event label", event.label) for event in raw.events),
    ]


def _header(raw: RawRecording) -> list[str]:
    started = (
        f"{raw.started:%Y-%m-%d, %H:%M:%S}.{raw.started.microsecond // 1000:03d}"
        if raw.started
        else ""
    )
    rows = [
        ("NO_OF_FRAMES", str(len(raw.time))),
        ("NO_OF_CAMERAS", "0"),
        ("NO_OF_MARKERS", str(len(raw.markers))),
        ("FREQUENCY", f"{raw.rate_hz:.12g}"),
        ("NO_OF_ANALOG", "0"),
        ("ANALOG_FREQUENCY", "0"),
        ("DESCRIPTION", "--"),
        *([("TIME_STAMP", started)] if started else []),
        ("DATA_INCLUDED", "3D"),
        *(
            ("EVENT", event.label, f"{_frame(raw, event.time_s)}", repr(float(event.time_s)))
            for event in raw.events
        ),
        ("MARKER_NAMES", *raw.markers),
        *([("TRAJECTORY_TYPES", *raw.trajectory_types)] if raw.trajectory_types else []),
        ("Frame", "Time", *(f"{name} {axis}" for name in raw.markers for axis in "XYZ")),
    ]
    return ["\t".join(row) for row in rows]


def _frame(raw: RawRecording, time_s: float) -> int:
    return round(time_s * raw.rate_hz) + 1


def _table(raw: RawRecording) -> dict[str, object]:
    """Columns of the rows of numbers; frames are numbered by the clock."""
    millimetres = raw.positions.reshape(len(raw.time), -1) * (METRES_PER_UNIT[raw.unit] / 1e-3)
    number = np.round(raw.time * raw.rate_hz).astype(np.int64) + 1
    times = np.char.mod(_TIME, raw.time)
    columns: dict[str, object] = {"Frame": number, "Time": times}
    return columns | {f"{i}": _unseen(millimetres, i) for i in range(millimetres.shape[1])}


def _unseen(millimetres: FloatArray, column: int) -> FloatArray:
    """One coordinate, NaN where any of the marker's three is."""
    first = column - column % 3
    hidden = np.isnan(millimetres[:, first : first + 3]).any(axis=1)
    return np.where(hidden, np.nan, millimetres[:, column])
