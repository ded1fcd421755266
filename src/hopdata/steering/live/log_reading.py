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
from hopdata.steering.frame_changes import HOPPER
from hopdata.steering.live.log import (
    CHUNKS,
    COUNT,
    EVENT,
    FORMAT,
    INPUTS,
    decision_type,
    frame_type,
)
from hopdata.steering.strides import StrideAxes

EARLIER = ("hopdata drive 1",)  # written by versions whose loop went on by itself
# One of a version that drove the hopper alone; its columns by their present names.
OF_HOPPER = "hopdata drive 2"
RENAMED = {
    "boom_angle_rad": "state",
    "swung_rad": "previous",
    "boom_age_s": "state_age_s",
    "planned_rad": "planned",
    "command_rad": "command",
}
WANTED = "the log of a drive, as hopdata drive writes it (a file such as drive.h5)"


@dataclass(frozen=True)
class LoggedDrive:
    """Contents of a log: tables as in the file, with decoded texts.

    In `decisions` states and inputs have a column each, named by the robot's `axes`:
    for the hopper ``boom_angle_rad, previous_swing_rad, planned_swing_rad,
    command_swing_rad``.
    """

    setup: dict[str, Any]
    axes: StrideAxes
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
    axes = StrideAxes.of_dict(found["axes"])
    return LoggedDrive(
        setup=found["setup"],
        axes=axes,
        files={name: one.tobytes() for name, one in found["files"].items()},
        frames=tables["frames"],
        decisions=_by_axis(_table(tables["decisions"]), axes),
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
            if form not in (FORMAT, OF_HOPPER):
                raise ValueError
            setup = json.loads(file.attrs["setup"])
            tables = {name: _plain(file[name][:]) for name in CHUNKS}
            axes = HOPPER
            if form == FORMAT:
                axes = StrideAxes.of_dict(json.loads(file.attrs["axes"]))
            else:
                tables["decisions"] = _renamed(*tables["decisions"])
            kept = {name: np.ravel(one[:]) for name, one in file["files"].items()}
        _require_columns(setup, tables, axes)
    except UNREADABLE as error:
        raise _no_log(path) from error
    return {"setup": setup, "axes": axes.as_dict(), "tables": tables, "files": kept}


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


def _renamed(
    columns: Sequence[Any], content: NDArray[Any]
) -> tuple[list[Any], NDArray[Any]]:
    """Return the decisions of a log of the hopper alone, with their present names."""
    present = []
    for name, kind, shape in columns:
        is_vector = RENAMED.get(name) in ("state", *INPUTS)
        present.append((RENAMED.get(name, name), kind, (1,) if is_vector else shape))
    return present, content


def _by_axis(table: pd.DataFrame, axes: StrideAxes) -> pd.DataFrame:
    """Return decisions with a column for each state and input."""
    columns: dict[str, Any] = {}
    n_states = len(axes.states)
    for name in table.columns:
        rows = table[name].tolist()
        if name == "state":
            for k, column in enumerate(axes.columns[:n_states]):
                columns[column] = [row[k] for row in rows]
        elif name in INPUTS:
            for k, axis in enumerate(axes.inputs):
                columns[f"{name}_{axis.column}"] = [row[k] for row in rows]
        else:
            columns[name] = rows
    return pd.DataFrame(columns)


def _require_columns(
    setup: object, tables: Mapping[str, Any], axes: StrideAxes
) -> None:
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
        "decisions": decision_type(axes),
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
