"""Reading the log of a drive, also while it is written or if it was cut off."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import pd
from hopdata.errors import RecordingError
from hopdata.foreign import door
from hopdata.recordings.readers.hdf5_checks import require_sound
from hopdata.steering.live.log import (
    CHUNKS,
    COUNT,
    DECISION,
    EVENT,
    FORMAT,
    frame_type,
)

EARLIER = ("hopdata drive 1",)  # written by versions whose loop went on by itself
WANTED = f"the log of a drive ({FORMAT})"  # in messages


@dataclass(frozen=True)
class LoggedDrive:
    """Contents of a log: tables as in the file, with decoded texts."""

    setup: dict[str, Any]
    files: dict[str, bytes]
    frames: NDArray[Any]
    decisions: pd.DataFrame
    events: pd.DataFrame
    counts: pd.DataFrame


def read_log(path: str | Path) -> LoggedDrive:
    """Read a log, even if its drive is still running or was cut off.

    Raises
    ------
    RecordingError
        If it is missing or not a log.
    """
    if not Path(path).is_file():
        raise RecordingError.at(path, WANTED, "no file")
    found = door.read(
        f"{__name__}:contents_of",
        str(path),
        place=path,
        n_bytes=door.size_of(path),
        reader="the HDF5 library",
    )
    tables = {name: _rows(*found["tables"][name]) for name in CHUNKS}
    return LoggedDrive(
        setup=found["setup"],
        files={name: one.tobytes() for name, one in found["files"].items()},
        frames=tables["frames"],
        decisions=_table(tables["decisions"]),
        events=_table(tables["events"]),
        counts=_table(tables["counts"]),
    )


# What the HDF5 library and the checks raise for a file that is no log.
UNREADABLE = (
    OSError,
    LookupError,
    ValueError,
    TypeError,
    ArithmeticError,
    AttributeError,
    RuntimeError,
)


def contents_of(path: str) -> dict[str, Any]:
    """Return what a log holds as plain values: each table as its columns and its bytes.

    Raises
    ------
    RecordingError
        If it is not a log.
    """
    try:
        with _opened(path) as file:
            require_sound(file, math.inf)  # no link to another file
            form = str(file.attrs["format"])
            if form in EARLIER:
                raise _earlier_log(path, form)
            if form != FORMAT:
                raise ValueError
            setup = json.loads(file.attrs["setup"])
            tables = {name: _plain(file[name][:]) for name in CHUNKS}
            kept = {name: np.ravel(one[:]) for name, one in file["files"].items()}
        _require_columns(setup, tables)
    except UNREADABLE as error:
        raise _no_log(path) from error
    return {"setup": setup, "tables": tables, "files": kept}


def _opened(path: str) -> Any:
    """Open a log, also one that is still written or was cut off.

    A log that is whole is opened as a file at rest. One that was not closed cannot be,
    and is opened as a file that somebody writes (SWMR); there the HDF5 library waits
    for seconds for each part that it cannot read.
    """
    import h5py

    try:
        return h5py.File(path, "r", libver="latest", locking=False)
    except OSError as error:
        if "already open" not in str(error):
            raise
    return h5py.File(path, "r", libver="latest", swmr=True, locking=False)


def _no_log(path: str) -> RecordingError:
    return RecordingError.at(path, WANTED, "another file, or a damaged one")


def _earlier_log(path: str, form: str) -> RecordingError:
    found = f"one of an earlier version ({form}); replay it with the one that wrote it"
    return RecordingError.at(path, WANTED, found)


def _plain(rows: NDArray[Any]) -> tuple[list[Any], NDArray[Any]]:
    """Return the columns of a table (name, type and shape of each) and its bytes."""
    columns: list[Any] = []
    for name in rows.dtype.names or ():
        kind = rows.dtype[name]
        if kind.base.kind not in "fiS":
            raise ValueError(f"column {name} of {kind}")
        columns.append((name, kind.base.str, kind.shape))
    packed = rows.astype(np.dtype(columns))
    return columns, np.frombuffer(packed.tobytes(), np.uint8)


def _rows(columns: Sequence[Any], content: NDArray[Any]) -> NDArray[Any]:
    """Return the table that `_plain` took apart."""
    kinds = [(name, kind, tuple(shape)) for name, kind, shape in columns]
    return np.frombuffer(content.tobytes(), np.dtype(kinds))


def _require_columns(setup: object, tables: Mapping[str, Any]) -> None:
    """Require the columns that a log has, with rows of numbers of their kind.

    Raises
    ------
    ValueError
        If one is missing or of another type.
    """
    if not isinstance(setup, dict):
        raise ValueError("no settings")
    n_markers = 0
    for name, _, shape in tables["frames"][0]:
        if name == "markers" and shape:
            n_markers = shape[0]
    wanted = {
        "frames": frame_type(n_markers),
        "decisions": DECISION,
        "events": EVENT,
        "counts": COUNT,
    }
    for table, kinds in wanted.items():
        found = {name: (kind, tuple(shape)) for name, kind, shape in tables[table][0]}
        for name in kinds.names or ():
            one = kinds[name]
            if found.get(name) != (one.base.str, one.shape):
                raise ValueError(f"column {name} of {table}")


def _table(rows: NDArray[Any]) -> pd.DataFrame:
    """Return the rows as a table, with decoded texts."""
    columns: dict[str, list[Any]] = {}
    for name in rows.dtype.names or ():
        columns[name] = list(rows[name])
        if rows.dtype[name].kind == "S":
            texts = [text.decode(errors="replace") for text in rows[name]]
            columns[name] = texts
    return pd.DataFrame(columns)
