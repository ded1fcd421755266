"""Which reader a file's suffix calls for; the readers are imported when they are needed."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from importlib.metadata import EntryPoint, entry_points
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
    overrule_rate,
    resolve_rate,
)
from hopdata.recordings.readers.text import require_file

LARGEST = 1e9  # mm or m: no camera sees so far


LEAST_SCORE = 0.6  # as the default of input.least_score in the schema
TEXTS, HDF5 = (".tsv", ".txt", ".csv"), (".h5", ".hdf5")
SUFFIXES = (*TEXTS, ".mat", ".c3d", ".trc", *HDF5)


@cache
def _others() -> dict[str, EntryPoint]:
    """Return the readers of installed packages (``hopdata.readers``) by their suffix."""
    found = {one.name: one for one in entry_points(group="hopdata.readers")}
    return {suffix: one for suffix, one in found.items() if suffix not in SUFFIXES}


def suffixes() -> tuple[str, ...]:
    """File suffixes that can be read."""
    return (*SUFFIXES, *_others())


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
        Frame rate, for files that do not state it, or not the true one.
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
    if path.suffix.lower() not in suffixes():
        raise RecordingError(
            f"{path}: format: expected a file ending in {', '.join(suffixes())}, "
            f"found '{path.suffix}'"
        )
    require_file(path)
    raw = overrule_rate(str(path), _read(path, rate_hz, most_unpacked_mb, least_score), rate_hz)
    _check_finite(path, raw)
    more = irregular(str(path), raw.time, raw.rate_hz)
    more += events_outside(str(path), raw.events, raw.time, raw.rate_hz)
    return replace(raw, remarks=raw.remarks + more)


def _read(path: Path, rate_hz: float | None, most_mb: float, least_score: float) -> RawRecording:
    suffix = path.suffix.lower()
    if suffix in _others():
        raw: RawRecording = _others()[suffix].load()(path, rate_hz)
        return raw
    if suffix == ".c3d":
        from hopdata.recordings.readers.c3d import read_c3d

        return read_c3d(path, rate_hz=rate_hz)
    if suffix == ".trc":
        from hopdata.recordings.readers.trc import read_trc

        return read_trc(path, rate_hz=rate_hz)
    if suffix == ".mat":
        from hopdata.recordings.readers.qtm import read_qtm_mat

        return read_qtm_mat(path, rate_hz=rate_hz, most_unpacked_mb=most_mb)
    if suffix in HDF5:
        return _hdf5(path, rate_hz, most_mb=most_mb, least_score=least_score)
    from hopdata.recordings.readers.bids import ENDS, read_bids
    from hopdata.recordings.readers.csv_exports import read_export

    if path.name.endswith(ENDS):
        return read_bids(path, rate_hz=rate_hz)
    return read_export(path, rate_hz=rate_hz, least_score=least_score)


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
