"""Writers of C3D and QTM files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import FloatArray
from hopdata.errors import RecordingError
from hopdata.jobs import whole_file
from hopdata.recording import Event
from hopdata.recordings.raw import METRES_PER_UNIT, RawRecording
from hopdata.recordings.readers.c3d_parameters import (
    BLOCK,
    MOST_16_BIT,
    PROCESSORS,
    Processor,
)


def from_whole(processor: Processor, values: Any) -> bytes:
    """Encode 16-bit integers; values up to 65535 have the same bits without a sign."""
    whole = np.atleast_1d(np.asarray(values, dtype=np.int64)) & 0xFFFF
    return whole.astype(f"{processor.order}u2").tobytes()


def from_floats(processor: Processor, values: Any) -> bytes:
    """Encode 32-bit floating-point numbers."""
    if processor.name != "DEC":
        return np.atleast_1d(values).astype(f"{processor.order}f4").tobytes()
    halves = np.ravel(np.asarray(values, dtype="<f4") * np.float32(4)).view("<u2")
    return halves.reshape(-1, 2)[:, ::-1].tobytes()


# The parameter section of a C3D file.


def parameter_bytes(processor: Processor, groups: dict[str, dict[str, Any]]) -> bytes:
    """Encode groups of parameters: texts (list of str), integers (int) or floats.

    Returns
    -------
    bytes
        A whole number of blocks.

    Raises
    ------
    ValueError
        If a text or list is longer than the format allows (255).
    """
    body = b""
    for number, (group, parameters) in enumerate(groups.items(), start=1):
        body += _record(processor, group, -number, b"\0")
        for name, value in parameters.items():
            body += _record(
                processor, name, number, _content(processor, name, value) + b"\0"
            )
    body += b"\0\0"
    n_blocks = -(-(len(body) + 4) // BLOCK)
    number = next(key for key, kind in PROCESSORS.items() if kind == processor)
    if n_blocks > 255:
        raise ValueError(f"parameters: expected at most 255 blocks, found {n_blocks}")
    return bytes([1, 0x50, n_blocks, number]) + body.ljust(n_blocks * BLOCK - 4, b"\0")


def _record(processor: Processor, name: str, number: int, content: bytes) -> bytes:
    title = name.encode()
    lead = bytes([len(title), number % 256]) + title
    return lead + from_whole(processor, [len(content) + 2]) + content


def _content(processor: Processor, name: str, value: Any) -> bytes:
    if isinstance(value, list):
        texts = [text.encode() for text in value]
        width = max([1, *map(len, texts)])
        if width > 255 or len(texts) > 255:
            raise ValueError(
                f"{name}: expected at most 255 texts of 255 bytes, found {len(texts)} of {width}"
            )
        data = b"".join(text.ljust(width) for text in texts)
        return bytes([255, 2, width, len(texts)]) + data
    array = np.asarray(value)
    sizes = array.shape[::-1]
    if array.dtype.kind == "f":
        return bytes([4, len(sizes), *sizes]) + from_floats(processor, array)
    return bytes([2, len(sizes), *sizes]) + from_whole(processor, array)


NEAR = 1e-3  # of a frame: C3D has no time stamps, so all must lie on the grid
_WIDEST = 255  # texts in one list


@dataclass(frozen=True)
class Analog:
    """Analog channels of a C3D file, and groups that tell what they are.

    Parameters
    ----------
    names, units : list of str
        Label and unit of each of the C channels.
    values : (N, K, C) array
        K samples in each of the N frames, in `units`.
    scale, offset : (C,) arrays
        A value is (stored - offset) x scale x general_scale.
    is_unsigned : bool
        Whether samples and offsets are stored without a sign.
    groups : dict
        Further groups of parameters, such as ``FORCE_PLATFORM``.
    """

    names: list[str]
    units: list[str]
    values: FloatArray
    scale: FloatArray
    offset: FloatArray
    general_scale: float = 1.0
    is_unsigned: bool = False
    groups: dict[str, dict[str, Any]] | None = None

    def stored(self) -> FloatArray:
        """Return the numbers of each frame (N, K C), before any rounding."""
        numbers = self.values / (self.scale * self.general_scale) + self.offset
        return numbers.reshape(len(numbers), -1)

    def group(self, rate_hz: float) -> dict[str, Any]:
        """Return the group ``ANALOG``."""
        offset = np.round(self.offset).astype(int)
        return {
            "USED": len(self.names),
            "LABELS": self.names,
            "UNITS": self.units,
            "SCALE": np.asarray(self.scale, dtype=np.float32),
            "OFFSET": offset,
            "GEN_SCALE": np.float32(self.general_scale),
            "RATE": np.float32(rate_hz * self.values.shape[1]),
            "FORMAT": ["UNSIGNED" if self.is_unsigned else "SIGNED"],
        }


def write_c3d(
    path: str | Path,
    raw: RawRecording,
    *,
    whole_numbers: bool = False,
    processor: str = "Intel",
    analog: Analog | None = None,
) -> None:
    """Write markers and events to a C3D file.

    Positions are rounded to 32-bit floats, or to 1/32,000 of the largest. Unseen
    markers get the residual -1.

    Parameters
    ----------
    path : path
        File to write; replaced if it exists.
    raw : RawRecording
        Positions in `raw.unit`.
    whole_numbers : bool
        Whether to store positions as scaled 16-bit whole numbers.
    processor : {"Intel", "DEC", "MIPS"}
        Byte order of the numbers.
    analog : Analog, optional
        Analog channels.

    Raises
    ------
    RecordingError
        If the recording does not fit the format: time stamps off the grid or before 0,
        names or texts longer than 255 bytes, a seen marker at exactly (0, 0, 0).
    """
    kind = next(p for p in PROCESSORS.values() if p.name == processor)
    first = _first_frame(path, raw)
    check_no_origin(path, raw.positions)
    largest = float(np.nanmax(np.abs(raw.positions), initial=0.0)) or 1.0
    scale = largest / 32000 if whole_numbers else -1.0
    try:
        groups = _groups(raw, first, scale, 0)
        if analog is not None:
            groups |= {"ANALOG": analog.group(raw.rate_hz), **(analog.groups or {})}
        start = 2 + len(parameter_bytes(kind, groups)) // BLOCK
        groups["POINT"]["DATA_START"] = start
        parameters = parameter_bytes(kind, groups)
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from None
    with whole_file(path) as temporary, temporary.open("wb") as file:
        file.write(_header(kind, raw, first, scale, start, analog))
        file.write(parameters)
        data = _data(kind, raw.positions, scale, analog)
        file.write(data)
        file.write(b"\0" * (-len(data) % BLOCK))


def check_no_origin(path: str | Path, positions: FloatArray) -> None:
    """Require that no seen marker is at exactly (0, 0, 0), which readers interpret as unseen.

    Raises
    ------
    RecordingError
        If one is; the message names the first frame and marker.
    """
    at_origin = np.argwhere((positions == 0).all(axis=2))
    if len(at_origin):
        frame, marker = at_origin[0]
        raise RecordingError(
            f"{path}: frame {frame + 1}, marker {marker + 1}: expected a position other than "
            "(0, 0, 0), which this format reads as unseen, found it"
        )


def _first_frame(path: str | Path, raw: RawRecording) -> int:
    """Return the number of the first frame, from 1, for time stamps on the grid."""
    if not len(raw.time):
        raise RecordingError(f"{path}: expected at least 1 frame to write, found none")
    first = int(np.round(raw.time[0] * raw.rate_hz)) + 1
    off = raw.time * raw.rate_hz - (first - 1 + np.arange(len(raw.time)))
    worst = int(np.argmax(np.abs(off)))
    if first < 1 or not abs(off[worst]) <= NEAR:
        raise RecordingError(
            f"{path}: frame {worst + 1}: expected time stamps at multiples of 1/{raw.rate_hz:g} s "
            f"from 0 on, since C3D has none, found {raw.time[worst]:.9g} s"
        )
    return first


def _groups(
    raw: RawRecording, first: int, scale: float, start: int
) -> dict[str, dict[str, Any]]:
    n_frames, last = len(raw.time), first + len(raw.time) - 1
    point: dict[str, Any] = {
        "USED": len(raw.markers),
        "SCALE": np.float32(scale),
        "RATE": np.float32(raw.rate_hz),
        "DATA_START": start,
        "FRAMES": min(n_frames, MOST_16_BIT),
        "LONG_FRAMES": np.float32(n_frames),
        "UNITS": [raw.unit],
        **_lists("LABELS", list(raw.markers)),
    }
    if raw.stated_up:
        point["X_SCREEN"] = ["+" + "XYZ"["YZX".index(raw.stated_up.upper())]]
        point["Y_SCREEN"] = ["+" + raw.stated_up.upper()]
    groups = {
        "POINT": point,
        "ANALOG": {"USED": 0},
        "TRIAL": {
            "ACTUAL_START_FIELD": [first % 65536, first // 65536],
            "ACTUAL_END_FIELD": [last % 65536, last // 65536],
        },
    }
    for name, words in groups["TRIAL"].items():
        groups["TRIAL"][name] = np.asarray(words)
    if raw.events:
        groups["EVENT"] = _event_group(raw.events)
    return groups


def _lists(name: str, entries: list[str]) -> dict[str, list[str]]:
    """Return the entries in lists of at most 255: ``LABELS``, ``LABELS2`` and so on."""
    starts = range(0, max(len(entries), 1), _WIDEST)
    return {
        name + (str(i + 1) if i else ""): entries[start : start + _WIDEST]
        for i, start in enumerate(starts)
    }


def _event_group(events: tuple[Event, ...]) -> dict[str, Any]:
    minutes = np.floor(np.asarray([event.time_s for event in events]) / 60)
    seconds = np.asarray([event.time_s for event in events]) - 60 * minutes
    times = np.column_stack([minutes, seconds]).astype(np.float32)
    pieces = range(0, len(events), _WIDEST)
    return {
        "USED": len(events),
        **_lists("LABELS", [event.label for event in events]),
        **{
            f"TIMES{i + 1 if i else ''}": times[k : k + _WIDEST]
            for i, k in enumerate(pieces)
        },
    }


def _header(
    processor: Processor,
    raw: RawRecording,
    first: int,
    scale: float,
    start: int,
    analog: Analog | None,
) -> bytes:
    last = min(first + len(raw.time) - 1, MOST_16_BIT)
    n_analog, per_frame = 0, 0
    if analog is not None:
        per_frame = analog.values.shape[1]
        n_analog = per_frame * len(analog.names)
    words = [len(raw.markers), n_analog, min(first, MOST_16_BIT), last, 0]
    lead = (
        bytes([2, 0x50])
        + from_whole(processor, words)
        + from_floats(processor, [scale])
    )
    rest = from_whole(processor, [start, per_frame]) + from_floats(
        processor, [raw.rate_hz]
    )
    return (lead + rest).ljust(BLOCK, b"\0")


def _data(
    processor: Processor, positions: FloatArray, scale: float, analog: Analog | None
) -> bytes:
    """Encode positions (N, M, 3) with their residuals, 0 or -1."""
    unseen = np.asarray(np.isnan(positions).any(axis=2))
    points: NDArray[np.float64] = np.zeros((*positions.shape[:2], 4))
    points[:, :, :3] = np.where(unseen[:, :, None], 0.0, positions)
    points[:, :, 3] = np.where(unseen, -1.0, 0.0)
    if scale > 0:
        points[:, :, :3] /= scale
    numbers = points.reshape(len(points), -1)
    if analog is not None:
        numbers = np.hstack([numbers, analog.stored()])
    if scale < 0:
        return from_floats(processor, numbers)
    return from_whole(processor, np.round(numbers))


# Writer of QTM motion-data exports (TSV).

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
        Positions in `raw.unit`; written in mm, as the format requires, to 9 digits.
    missing : str
        Text for the coordinates of an unseen marker: empty, ``"NULL"``, ``"NaN"`` or
        ``"0"``.

    Raises
    ------
    RecordingError
        If a name or label is empty or contains a tab or a line end, or a seen marker is
        at exactly (0, 0, 0), which readers interpret as unseen.
    """
    import pandas as pd

    for what, text in _texts(raw):
        if (
            not text.strip()
            or text != text.strip()
            or {"\t", "\n", "\r", "\0"} & set(text)
        ):
            raise RecordingError(
                f"{path}: {what}: expected a text without tabs, line ends or spaces about it, "
                f"found {text!r}"
            )
    check_no_origin(path, raw.positions)
    with (
        whole_file(path) as temporary,
        temporary.open("w", encoding="utf-8", newline="") as file,
    ):
        file.write(LINE_END.join(_header_qtm_tsv_writing(raw)) + LINE_END)
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
        *(("event label", event.label) for event in raw.events),
    ]


def _header_qtm_tsv_writing(raw: RawRecording) -> list[str]:
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
            (
                "EVENT",
                event.label,
                f"{_frame(raw, event.time_s)}",
                repr(float(event.time_s)),
            )
            for event in raw.events
        ),
        ("MARKER_NAMES", *raw.markers),
        (
            "Frame",
            "Time",
            *(f"{name} {axis}" for name in raw.markers for axis in "XYZ"),
        ),
    ]
    return ["\t".join(row) for row in rows]


def _frame(raw: RawRecording, time_s: float) -> int:
    return round(time_s * raw.rate_hz) + 1


def _table(raw: RawRecording) -> dict[str, object]:
    """Return the columns of the rows of numbers; frames are numbered by the clock."""
    millimetres = raw.positions.reshape(len(raw.time), -1) * (
        METRES_PER_UNIT[raw.unit] / 1e-3
    )
    number = np.round(raw.time * raw.rate_hz).astype(np.int64) + 1
    times = np.char.mod(_TIME, raw.time)
    columns: dict[str, object] = {"Frame": number, "Time": times}
    return columns | {
        f"{i}": _unseen(millimetres, i) for i in range(millimetres.shape[1])
    }


def _unseen(millimetres: FloatArray, column: int) -> FloatArray:
    """Return one coordinate, NaN where any of the marker's three is."""
    first = column - column % 3
    hidden = np.isnan(millimetres[:, first : first + 3]).any(axis=1)
    return np.where(hidden, np.nan, millimetres[:, column])
