"""Log of a drive: an HDF5 file, written during the drive.

Others may read the file while it is written (HDF5's SWMR), and if the process dies,
only the last moment is lost. `frames` are those that the loop took, in order, with the
number of the batch they came in (`taken`). `decisions` has the columns of `Decision`,
and the code of the reason; states and inputs are in the order of the robot's axes,
which the attribute `axes` holds. `events` are states of the stream, changes of the
state of the drive with their causes (code, values and words), and rests of the boom.
`counts` are the counters.
"""

from __future__ import annotations

import errno
import json
import logging
import math
import os
import shutil
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Self

import numpy as np

from hopdata.errors import ConfigError
from hopdata.messages import Message
from hopdata.steering.frame_changes import HOPPER
from hopdata.steering.live.buffer import Frame, Status
from hopdata.steering.live.decisions import Decision
from hopdata.steering.live.machine import Event, Step
from hopdata.steering.live.watch import Watch
from hopdata.steering.strides import StrideAxes

FORMAT = "hopdata drive 3"
WRITE_S = 0.25  # time between writes
# Rows for which the file grows at once: some seconds of frames and of stances.
CHUNKS = {"frames": 256, "decisions": 16, "events": 16, "counts": 16}
#: Bytes kept free for the file's own indices.
#: Unit: bytes. Origin: chosen. Of 75 logs that met limits of 60 kB to 3 MB none was
#: damaged with this, with half of it, or with none.
MARGIN_BYTES = 1 << 14
CODE = "S40"
TEXT_BYTES = 200
TEXT = f"S{TEXT_BYTES}"
EVENT = np.dtype(
    [
        ("at_s", "f8"),
        ("sent_s", "f8"),
        ("kind", "S16"),
        ("code", CODE),
        ("values", TEXT),
        ("text", TEXT),
    ]
)
# Types of the columns of decisions; all others are floats.
KINDS: dict[str, Any] = {
    "pose": "(3,)f8",
    "epoch": "i8",
    "outcome": "S16",
    "reason": TEXT,
}
INPUTS = ("previous", "planned", "command")  # columns with a number for each input
COUNT = np.dtype([("at_s", "f8"), ("count", "S40"), ("value", "i8")])


def decision_type(axes: StrideAxes) -> np.dtype[Any]:
    """Return the type of a row of the table of decisions, for a robot's axes."""
    kinds = KINDS | {"state": f"({len(axes.states)},)f8"}
    kinds |= {name: f"({len(axes.inputs)},)f8" for name in INPUTS}
    if not axes.states:
        kinds["state"] = "(1,)f8"  # HDF5 has no empty one; it is not a number
    columns = [(one.name, kinds.get(one.name, "f8")) for one in fields(Decision)]
    return np.dtype([*columns, ("code", CODE)])


def frame_type(n_markers: int) -> np.dtype[Any]:
    """Return the type of a row of the table of frames."""
    return np.dtype(
        [
            ("taken", "i8"),
            ("epoch", "i8"),
            ("number", "i8"),
            ("time_s", "f8"),
            ("arrival_s", "f8"),
            ("captured_s", "f8"),
            ("markers", "f8", (n_markers, 3)),
        ]
    )


logger = logging.getLogger(__name__)


class DriveLog:
    """Writes what it is given in a thread of its own, without delaying the callers.

    Parameters
    ----------
    path : path
        The file, which must not exist.
    markers : int
        Number of markers per frame.
    setup : mapping
        Settings of the drive, stored as JSON.
    files : mapping
        Contents of the files used for the drive, by name.
    axes : StrideAxes
        States and inputs of the robot; by default the hopper's.

    Attributes
    ----------
    failure : str
        Why nothing more can be written, such as a full disk; empty while all is well.
        The file then keeps what it has, and can be read and replayed.

    Raises
    ------
    ConfigError
        If the file exists.
    OSError
        If the file cannot be created.
    """

    def __init__(
        self,
        path: str | Path,
        markers: int,
        *,
        setup: Mapping[str, object],
        files: Mapping[str, bytes],
        axes: StrideAxes = HOPPER,
    ) -> None:
        import h5py

        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        self.failure = ""
        self._path = path
        try:
            self._file = h5py.File(path, "x", libver="latest", locking=False)
        except FileExistsError:
            how = "a file that exists already; name another one"
            raise ConfigError.at(f"log {path}", "a new file", how) from None
        self._file.attrs.update(format=FORMAT, setup=json.dumps(dict(setup)))
        self._file.attrs["axes"] = json.dumps(axes.as_dict())
        self._axes = axes
        kept = self._file.create_group("files")
        for name, content in files.items():
            kept[name] = np.frombuffer(content, dtype=np.uint8)
        types = {
            "frames": frame_type(markers),
            "decisions": decision_type(axes),
            "events": EVENT,
            "counts": COUNT,
        }
        # Rows of each table that have not been written yet.
        self._waiting: dict[str, list[tuple[Any, ...]]] = {name: [] for name in types}
        for name, dtype in types.items():
            chunks = (CHUNKS[name],)
            self._file.create_dataset(
                name, (0,), dtype, maxshape=(None,), chunks=chunks
            )
        self._file.swmr_mode = True
        self._taken = 0  # batches
        # How many of each are stored as events, and whether it is stored if the boom
        # acknowledges anything.
        self._n_stored = {"states": 0, "steps": 0, "rests": 0}
        self._is_boom_stored = False
        self._look: Callable[[], None] = lambda: None
        self._stop = threading.Event()
        self._thread = threading.Thread(
            target=self._run, name="hopdata-log", daemon=True
        )

    def frames(self, frames: Sequence[Frame]) -> None:
        """Store a batch of frames that the loop has taken."""
        for frame in frames:
            row = (
                self._taken,
                frame.epoch,
                frame.number,
                frame.time_s,
                frame.arrival_s,
                frame.captured_s,
                frame.markers,
            )
            self._waiting["frames"].append(row)
        self._taken += 1

    def decision(self, decision: Decision) -> None:
        """Store a decision."""
        values = vars(decision)
        if not self._axes.states:
            values = values | {"state": (np.nan,)}
        row = tuple(_stored(value) for value in values.values())
        code = "" if decision.reason is None else decision.reason.code
        self._waiting["decisions"].append((*row, code.encode()))

    def events(self, states: Sequence[Status], watch: Watch | None = None) -> None:
        """Store what is new: states of the stream, steps of the drive, and rests."""
        waiting = self._waiting["events"]
        for status in states[self._n_stored["states"] :]:
            text = _stored(status.message)
            row = (status.at_s, np.nan, status.state.encode(), b"", b"", text)
            waiting.append(row)
        self._n_stored["states"] = len(states)
        if watch is None:
            return
        steps = watch.machine.steps[self._n_stored["steps"] :]
        rests = watch.rests[self._n_stored["rests"] :]
        if not self._is_boom_stored:
            self._is_boom_stored = True
            at_s = states[0].at_s if states else np.nan
            waiting.append(_event(at_s, np.nan, "boom", watch.says_of_boom()))
        for step in steps:
            waiting.append(_event(step.at_s, np.nan, _kind(step), step.cause))
        for rest in rests:
            waiting.append(_event(rest.seen_s, rest.sent_s, "rest", rest.cause))
        self._n_stored["steps"] += len(steps)
        self._n_stored["rests"] += len(rests)

    def start(self, look: Callable[[], None]) -> Self:
        """Start writing; `look` is called before each write, to fetch events."""
        self._look = look
        self._thread.start()
        return self

    def close(self, at_s: float, counts: Mapping[str, object]) -> None:
        """Write the remaining data and the counters of each part."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join()
        for part, counted in counts.items():
            for name, value in vars(counted).items():
                self._waiting["counts"].append((at_s, f"{part}.{name}".encode(), value))
        self._write()
        self._file.close()

    def _run(self) -> None:
        while not self._stop.wait(WRITE_S):
            self._write()

    def _write(self) -> None:
        try:
            self._look()
        except Exception as error:
            logger.error("the events of the drive could not be fetched: %r", error)
        if self.failure:
            # Nothing is kept for a disk that is full: the drive may go on for hours.
            for rows in self._waiting.values():
                rows.clear()
            return
        try:
            for name, rows in self._waiting.items():
                self._append(name, rows, len(rows))  # more may be added meanwhile
        except Exception as error:
            # A full disk is no reason to stop a robot in mid-air.
            self.failure = f"the log could not be written any more: {error}"
            logger.error("%s; %s keeps what it has", self.failure, self._path)

    def _append(self, name: str, rows: list[tuple[Any, ...]], count: int) -> None:
        """Write the first rows of a table that wait, if the disk has room for them."""
        if not count:
            return
        table = self._file[name]
        n_before = len(table)
        n_after = n_before + count
        (chunk,) = table.chunks
        n_new_chunks = math.ceil(n_after / chunk) - math.ceil(n_before / chunk)
        n_bytes = n_new_chunks * chunk * table.dtype.itemsize
        _reserve(self._path, n_bytes + MARGIN_BYTES)
        table.resize(n_after, axis=0)
        table[-count:] = np.array(rows[:count], dtype=table.dtype)
        del rows[:count]
        table.flush()


def _reserve(path: Path, n_bytes: int) -> None:
    """Make sure that a file can grow by so many bytes.

    HDF5 must not meet a full disk: a write of its own that fails leaves it in a state
    in which closing the file ends the process.

    Raises
    ------
    OSError
        If the disk, a quota or a limit of the process does not allow it.
    """
    size = path.stat().st_size
    if hasattr(os, "posix_fallocate"):
        with path.open("r+b") as file:
            os.posix_fallocate(file.fileno(), size, n_bytes)
            os.ftruncate(file.fileno(), size)
        return
    free = shutil.disk_usage(path.parent).free
    if free < n_bytes:
        raise OSError(errno.ENOSPC, f"{n_bytes} bytes are needed, {free} are free")


def _stored(value: object) -> object:
    """Truncate a text to the space in the log, without splitting a character."""
    if value is None:
        return b""
    if isinstance(value, Message):
        value = str(value)
    if not isinstance(value, str):
        return value
    return value.encode()[:TEXT_BYTES].decode(errors="ignore").encode()


def _event(
    at_s: float, sent_s: float, kind: str, cause: Message | None
) -> tuple[Any, ...]:
    """Return a row of the table of events."""
    if cause is None:
        return (at_s, sent_s, kind.encode(), b"", b"", b"")
    values = json.dumps(cause.to_dict()["values"])
    code = cause.code.encode()
    return (at_s, sent_s, kind.encode(), code, _stored(values), _stored(cause))


def _kind(step: Step) -> str:
    """Return the state that begins with a step, or what else it is."""
    if step.changes:
        return str(step.transition.target)
    if step.transition.event is Event.ARM_IN_VAIN:
        return "arm in vain"
    return "fault"
