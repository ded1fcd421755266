"""Writer of C3D files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import RecordingError
from hopdata.jobs import whole_file
from hopdata.recordings.c3d_header import MOST_16_BIT
from hopdata.recordings.c3d_numbers import PROCESSORS, Processor
from hopdata.recordings.c3d_parameter_writing import parameter_bytes
from hopdata.recordings.c3d_parameters import BLOCK
from hopdata.recordings.raw import Event, FloatArray, RawRecording

NEAR = 1e-3  # of a frame: C3D has no time stamps, so all must lie on the grid
_WIDEST = 255  # texts in one list


def write_c3d(
    path: str | Path, raw: RawRecording, *, whole_numbers: bool = False, processor: str = "Intel"
) -> None:
    """Write markers and events to a C3D file.

    Positions are rounded to 32-bit floats, or to 1/32,000 of the largest; unseen markers get the
    residual -1.

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

    Raises
    ------
    RecordingError
        If what is to be written does not fit the format: time stamps off the grid or before 0,
        names or texts longer than 255 bytes, a seen marker at exactly (0, 0, 0).
    """
    kind = next(p for p in PROCESSORS.values() if p.name == processor)
    first = _first_frame(path, raw)
    check_no_origin(path, raw.positions)
    largest = float(np.nanmax(np.abs(raw.positions), initial=0.0)) or 1.0
    scale = largest / 32000 if whole_numbers else -1.0
    try:
        parameters = parameter_bytes(kind, _groups(raw, first, scale, 0))
        start = 2 + len(parameters) // BLOCK
        parameters = parameter_bytes(kind, _groups(raw, first, scale, start))
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from None
    with whole_file(path) as temporary, temporary.open("wb") as file:
        file.write(_header(kind, raw, first, scale, start))
        file.write(parameters)
        data = _data(kind, raw.positions, scale)
        file.write(data)
        file.write(b"\0" * (-len(data) % BLOCK))


def check_no_origin(path: str | Path, positions: FloatArray) -> None:
    """Require that no seen marker is at exactly (0, 0, 0), which a reader takes for unseen.

    Raises
    ------
    RecordingError
        Naming the first frame and marker.
    """
    at_origin = np.argwhere((positions == 0).all(axis=2))
    if len(at_origin):
        frame, marker = at_origin[0]
        raise RecordingError(
            f"{path}: frame {frame + 1}, marker {marker + 1}: expected a position other than "
            "(0, 0, 0), which this format reads as unseen, found it"
        )


def _first_frame(path: str | Path, raw: RawRecording) -> int:
    """Return the number of the first frame, from 1, of time stamps that lie on the grid."""
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


def _groups(raw: RawRecording, first: int, scale: float, start: int) -> dict[str, dict[str, Any]]:
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
    """Return lists of at most 255 entries: ``LABELS``, ``LABELS2`` and so on."""
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
        **{f"TIMES{i + 1 if i else ''}": times[k : k + _WIDEST] for i, k in enumerate(pieces)},
    }


def _header(processor: Processor, raw: RawRecording, first: int, scale: float, start: int) -> bytes:
    last = min(first + len(raw.time) - 1, MOST_16_BIT)
    words = [len(raw.markers), 0, min(first, MOST_16_BIT), last, 0]
    lead = bytes([2, 0x50]) + processor.from_whole(words) + processor.from_floats([scale])
    rest = processor.from_whole([start, 0]) + processor.from_floats([raw.rate_hz])
    return (lead + rest).ljust(BLOCK, b"\0")


def _data(processor: Processor, positions: FloatArray, scale: float) -> bytes:
    """Encode positions (N, M, 3) with their residuals, 0 or -1."""
    unseen = np.asarray(np.isnan(positions).any(axis=2))
    points: NDArray[np.float64] = np.zeros((*positions.shape[:2], 4))
    points[:, :, :3] = np.where(unseen[:, :, None], 0.0, positions)
    points[:, :, 3] = np.where(unseen, -1.0, 0.0)
    if scale < 0:
        return processor.from_floats(points)
    points[:, :, :3] /= scale
    return processor.from_whole(np.round(points))
