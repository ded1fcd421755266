"""Which reader a file's suffix calls for; the readers are imported when they are needed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np

from hopdata.errors import RecordingError
from hopdata.recordings.raw import (
    MOST_UNPACKED_MB,
    RawRecording,
    distinct_names,
    events_outside,
    irregular,
    largest,
    resolve_rate,
)
from hopdata.recordings.readers.text import require_file

LARGEST = 1e9  # mm or m: no camera sees so far


def _hdf5(path: Path, rate_hz: float | None, *, most_mb: float, least_score: float) -> RawRecording:
    from hopdata.recordings.readers.hdf5 import read_recording
    from hopdata.recordings.readers.keypoints import keypoints, pandas_table

    if (table := pandas_table(path, most_mb)) is not None:
        return keypoints(path, *table, rate_hz, least_score)
    own = read_recording(path, most_unpacked_mb=most_mb)
    if own.filled is not None:  # what was filled in was not seen
        own.positions[own.filled] = np.nan
    names, renamed = distinct_names(str(path), own.markers)
    return RawRecording(
        names,
        own.time,
        own.positions,
        resolve_rate(str(path), stated=own.rate_hz, given=rate_hz),
        unit="m",
        vertical_axis=own.vertical_axis,
        roles=own.roles,
        events=own.events,
        stated_up="z",
        remarks=own.remarks + renamed,
    )


LEAST_SCORE = 0.6  # as the default of input.least_score in the schema


def _text(path: Path, rate_hz: float | None, *, least_score: float, **_: float) -> RawRecording:
    from hopdata.recordings.readers.bids import ENDS, read_bids
    from hopdata.recordings.readers.csv_exports import read_export

    if path.name.endswith(ENDS):
        return read_bids(path, rate_hz=rate_hz)
    return read_export(path, rate_hz=rate_hz, least_score=least_score)


def _qtm_mat(path: Path, rate_hz: float | None, *, most_mb: float, **_: float) -> RawRecording:
    from hopdata.recordings.readers.qtm import read_qtm_mat

    return read_qtm_mat(path, rate_hz=rate_hz, most_unpacked_mb=most_mb)


def _c3d(path: Path, rate_hz: float | None, **_: float) -> RawRecording:
    from hopdata.recordings.readers.c3d import read_c3d

    return read_c3d(path, rate_hz=rate_hz)


def _trc(path: Path, rate_hz: float | None, **_: float) -> RawRecording:
    from hopdata.recordings.readers.trc import read_trc

    return read_trc(path, rate_hz=rate_hz)


_READERS: dict[str, Callable[..., RawRecording]] = {
    ".tsv": _text,
    ".txt": _text,
    ".csv": _text,
    ".mat": _qtm_mat,
    ".c3d": _c3d,
    ".trc": _trc,
    ".h5": _hdf5,
    ".hdf5": _hdf5,
}


@cache
def _readers() -> dict[str, Callable[..., RawRecording]]:
    """Return our readers and, by suffix, those of installed packages (``hopdata.readers``)."""
    others = entry_points(group="hopdata.readers")
    return {**{other.name: other.load() for other in others}, **_READERS}


def suffixes() -> tuple[str, ...]:
    """File suffixes that can be read."""
    return tuple(_readers())


def read_raw(
    path: str | Path,
    *,
    rate_hz: float | None = None,
    most_unpacked_mb: float = MOST_UNPACKED_MB,
    least_score: float = LEAST_SCORE,
) -> RawRecording:
    """Read all markers of a file, by the reader that its suffix calls for.

    Parameters
    ----------
    path : path
        A file whose suffix is one of `suffixes`.
    rate_hz : float, optional
        Frame rate, for files that do not state it.
    most_unpacked_mb : float
        Memory that a packed file (MAT, HDF5) may ask for, MB.
    least_score : float
        Keypoints from video that are less sure count as unseen.

    Raises
    ------
    RecordingError
        If there is no such file or no reader for it, or if the reader finds a fault.
    """
    path = Path(path)
    if path.suffix.lower() not in _readers():
        raise RecordingError(
            f"{path}: format: expected a file ending in {', '.join(_readers())}, "
            f"found '{path.suffix}'"
        )
    require_file(path)
    read = _readers()[path.suffix.lower()]
    raw = read(path, rate_hz, most_mb=most_unpacked_mb, least_score=least_score)
    _check_finite(path, raw)
    more = irregular(str(path), raw.time, raw.rate_hz)
    more += events_outside(str(path), raw.events, raw.time, raw.rate_hz)
    return replace(raw, remarks=raw.remarks + more)


def _check_finite(path: Path, raw: RawRecording) -> None:
    """Require finite times, and positions that are NaN or such as can be."""
    if not np.isfinite(raw.time).all():
        frame = int(np.argmin(np.isfinite(raw.time)))
        raise RecordingError(
            f"{path}: frame {frame + 1}: expected a finite time, found {raw.time[frame]}"
        )
    if largest(raw.positions) > LARGEST:
        absurd = np.abs(raw.positions) > LARGEST
        frame, marker, axis = np.argwhere(absurd)[0]
        raise RecordingError(
            f"{path}: frame {frame + 1}, marker {raw.markers[marker]}, {'xyz'[axis]}: expected a "
            f"coordinate below {LARGEST:g} {raw.unit}, found {raw.positions[frame, marker, axis]:g}"
        )
