"""Rotations of segments in a C3D file, as Theia3D writes them: their origins as points.

The group ROTATION describes a block of its own beside the points and analog samples, or
in place of them: in each frame a matrix of 4 x 4 numbers for each segment, column by
column, and its reliability, which is below 0 for a segment that was not seen. The last
column holds the segment's origin.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import RecordingError
from hopdata.messages import Message
from hopdata.recordings import raw
from hopdata.recordings.readers import c3d_parameters as head
from hopdata.recordings.readers.c3d_parameters import BLOCK, C3dHeader, Parameters
from hopdata.recordings.readers.text import listed

# Numbers of a segment in a sample, and which of them are its origin and reliability.
_PER_SEGMENT = 17
_ORIGIN = slice(12, 15)
_RELIABILITY = 16

# What programs put behind the name of a segment.
_SUFFIX = "_4X4"


@dataclass(frozen=True)
class Segments:
    """Origins of segments.

    Parameters
    ----------
    names : tuple of str
        The S names.
    origins : (N, S, 3) array
        In the unit of the file's points, NaN where a segment was not seen.
    remarks : tuple of Remark
        What was left out.
    """

    names: tuple[str, ...]
    origins: FloatArray
    remarks: tuple[raw.Remark, ...]


def start_of(parameters: Parameters) -> int | None:
    """Return the byte at which rotations begin; None if the file has none."""
    used = parameters.number("ROTATION", "USED") or 0.0
    start = parameters.unsigned_numbers("ROTATION", "DATA_START")
    is_sound = bool(start) and np.isfinite(start[0]) and np.isfinite(used)
    if not is_sound or not used >= 1 or start[0] < 2:
        return None
    return (int(start[0]) - 1) * BLOCK


def read_segments(
    path: Path, header: C3dHeader, parameters: Parameters, rate_hz: float
) -> Segments | None:
    """Read the origins of segments; None if the file has no rotations.

    Parameters
    ----------
    path : path
        The file.
    header, parameters
        What it states.
    rate_hz : float
        Frame rate of the points, Hz.

    Raises
    ------
    RecordingError
        If rotations are stated that are not in the file.
    """
    start = start_of(parameters)
    if start is None:
        return None
    n_segments = parameters.count("ROTATION", "USED")
    ratio = _ratio(parameters, rate_hz)
    # As for analog numbers: so many in each frame, from their own start on.
    per_frame = n_segments * ratio * _PER_SEGMENT
    own = replace(header, n_points=0, n_analog=per_frame, scale=-1.0, data_start=start)
    size = path.stat().st_size
    available = size - start
    if available < own.frame_bytes:
        place = parameters.place("ROTATION", "DATA_START")
        wanted = f"{own.frame_bytes} bytes for each frame after byte {start}"
        raise RecordingError.at(place, wanted, max(available, 0))
    n_zeros = head.zeros_at_end(path, size)
    n_frames, _ = head.count_frames(own, parameters, available, n_zeros=n_zeros)
    stored = np.memmap(path, np.uint8, "r", start, (n_frames * own.frame_bytes,))
    numbers = parameters.processor.floats(np.asarray(stored))
    first = numbers.reshape(n_frames, ratio, n_segments, _PER_SEGMENT)[:, 0]
    with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN
        origins = first[:, :, _ORIGIN].astype(np.float64)
        origins[~(first[:, :, _RELIABILITY] >= 0)] = np.nan
        is_away = (origins != 0) & ~np.isnan(origins)
    labels = parameters.texts("ROTATION", "LABELS")[:n_segments]
    labels += [""] * (n_segments - len(labels))
    names = [label.removesuffix(_SUFFIX) for label in labels]
    moves = is_away.any(axis=(0, 2))
    remarks = _remarks(parameters, names, moves, ratio)
    kept = np.flatnonzero(moves)
    kept_names = tuple(names[k] or f"segment {k + 1}" for k in kept)
    return Segments(kept_names, origins[:, kept], remarks)


def _ratio(parameters: Parameters, rate_hz: float) -> int:
    """Return the number of samples of each rotation in a frame."""
    ratio = parameters.number("ROTATION", "RATIO")
    own_hz = parameters.number("ROTATION", "RATE")
    if ratio is None and own_hz is not None and rate_hz > 0:
        ratio = own_hz / rate_hz
    if ratio is None:
        return 1
    whole = round(ratio) if np.isfinite(ratio) else 0
    if whole < 1 or abs(ratio - whole) > raw.RATE_TOLERANCE * whole:
        place = parameters.place("ROTATION", "RATIO")
        wanted = "a whole number of samples in each frame"
        raise RecordingError.at(place, wanted, f"{ratio:g}")
    return whole


def _remarks(
    parameters: Parameters, names: list[str], moves: np.ndarray, ratio: int
) -> tuple[raw.Remark, ...]:
    place = str(parameters.path)
    kept = [name for name, is_kept in zip(names, moves, strict=True) if is_kept]
    still = [name for name, is_kept in zip(names, moves, strict=True) if not is_kept]
    remarks: list[raw.Remark] = []
    if kept:
        values = {"place": place, "n_segments": len(kept), "segments": listed(kept)}
        remarks.append(Message("recordings.segment_origins", values))
    if still:
        values = {"place": place, "segments": listed(still)}
        remarks.append(Message("recordings.segments_at_origin", values))
    if ratio > 1:
        values = {"place": place, "n_segments": len(names), "ratio": ratio}
        remarks.append(Message("recordings.segments_at_other_rate", values))
    return tuple(remarks)
