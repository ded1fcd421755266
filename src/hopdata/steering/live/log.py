"""Log of a drive: an HDF5 file, written during the drive, read back and replayed.

Others may read the file while it is written (HDF5's SWMR), and if the process dies,
only the last moment is lost. `frames` are those that the loop took, in order, with the
number of the batch they came in (`taken`). `decisions` has the columns of `Decision`,
and the code of the reason. `events` are states of the stream, changes of the state of
the drive with their causes (code, values and words), and rests of the boom. `counts`
are the counters.
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
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import pd
from hopdata.errors import ConfigError, RecordingError
from hopdata.foreign import door
from hopdata.messages import Message
from hopdata.recordings.readers.hdf5_checks import require_sound
from hopdata.steering.control.interface import Controller
from hopdata.steering.live.buffer import Frame, FrameBuffer, Status
from hopdata.steering.live.checks import FrameChecks
from hopdata.steering.live.loop import ControlLoop, Decision, Observers
from hopdata.steering.live.machine import Event, Machine, State, Step, Told, Transition
from hopdata.steering.live.safety import Limits, NoBoom, Watch

FORMAT = "hopdata drive 2"
EARLIER = ("hopdata drive 1",)  # written by versions whose loop went on by itself
WRITE_S = 0.25  # time between writes
# Rows for which the file grows at once: some seconds of frames and of stances.
CHUNKS = {"frames": 256, "decisions": 16, "events": 16, "counts": 16}
#: Bytes kept free for the file's own indices.
#: Unit: bytes. Origin: chosen. Of 75 logs that met limits of 60 kB to 3 MB none was
#: damaged with this, with half of it, or with none.
MARGIN_BYTES = 1 << 14
WANTED = f"the log of a drive ({FORMAT})"  # in messages
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
DECISION = np.dtype(
    [
        *((one.name, KINDS.get(one.name, "f8")) for one in fields(Decision)),
        ("code", CODE),
    ]
)
COUNT = np.dtype([("at_s", "f8"), ("count", "S40"), ("value", "i8")])


def _frame_type(n_markers: int) -> np.dtype[Any]:
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
        kept = self._file.create_group("files")
        for name, content in files.items():
            kept[name] = np.frombuffer(content, dtype=np.uint8)
        types = {
            "frames": _frame_type(markers),
            "decisions": DECISION,
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
        row = tuple(_stored(value) for value in vars(decision).values())
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
        "frames": _frame_type(n_markers),
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


# Replay of a log in the loop.


def replay(
    log: LoggedDrive,
    observers: Observers,
    controller: Controller,
    *,
    limits: Limits | None = None,
    checks: Callable[[], FrameChecks] | None = None,
) -> pd.DataFrame:
    """Replay the frames of a log in a loop, in their batches and at their times.

    Nothing is sent. The controller is called wherever it was called in the drive, so a
    learning controller learns the same again.

    Returns
    -------
    DataFrame
        One row per stance at which it was called: ``told_s``, the swings planned in the
        drive and now (``then_rad, now_rad``), and ``same``, whether inputs and swing
        are identical to the bit.
    """
    # Each decision by the frame that revealed its stance, whose time is `told_s`.
    decided: dict[tuple[int, float], Any] = {}
    for row in log.decisions.to_dict("records"):
        decided[row["epoch"], row["told_s"]] = row
    batches: list[NDArray[Any]] = []
    if len(log.frames):
        begins = np.flatnonzero(np.diff(log.frames["taken"])) + 1
        batches = np.split(log.frames, begins)
    buffer = FrameBuffer(max(map(len, batches), default=1))
    machine = _ReplayedMachine(is_armed=True)
    drive = _Replayed(machine)
    rows: list[tuple[float, float, float, bool]] = []

    def compare(made: Decision) -> None:
        before = decided.get((made.epoch, made.told_s))
        if before is None or not _was_called(before):
            return
        is_same = _bits(before) == _bits(vars(made))
        rows.append((made.told_s, before["planned_rad"], made.planned_rad, is_same))

    loop = ControlLoop(
        buffer,
        observers,
        controller,
        NoBoom(),
        limits=limits,
        checks=checks,
        machine=machine,
        on_decision=compare,
        clock=lambda: drive.now_s,
    )
    for batch in batches:
        frames = [Frame(*row.item()[1:]) for row in batch]
        keys = [(frame.epoch, frame.time_s) for frame in frames]
        drive.go_to([decided[key] for key in keys if key in decided], frames[-1])
        for frame in frames:
            buffer.write(frame)
        loop.take(frames)
    return pd.DataFrame(rows, columns=["told_s", "then_rad", "now_rad", "same"])


@dataclass
class _ReplayedMachine(Machine):
    """Has a swing planned where one was planned then, whatever else happens.

    What brought the drive to rest is not all in its log: the time that a driver took is
    not, for instance.
    """

    plans: bool = True

    @property
    def may_swing(self) -> bool:
        return self.plans

    def _make(
        self,
        event: Event,
        at_s: float,
        cause: Message | None,
        *,
        is_kept: bool = True,  # noqa: ARG002 - nothing is kept
    ) -> Step:
        told = Told.NOTHING
        if event is Event.STANCE and self.plans:
            told = Told.SWING
        stays = Transition(State.RUNNING, event, State.RUNNING, told)
        return Step(at_s, stays, cause)


@dataclass
class _Replayed:
    """The clock of a drive that is replayed, and whether its controller was called."""

    machine: _ReplayedMachine
    now_s: float = 0.0

    def go_to(self, decisions: Sequence[Mapping[str, Any]], last: Frame) -> None:
        """Set both for a batch: as at its last decision, if there is one."""
        if not decisions:
            self.now_s = last.arrival_s
            self.machine.plans = True
            return
        decision = decisions[-1]
        self.now_s = decision["asked_s"]
        self.machine.plans = _was_called(decision)


def _was_called(decision: Mapping[str, Any]) -> bool:
    """Return whether the controller was called: only then has its planning a time."""
    return bool(np.isfinite(decision["planning_s"]))


def _bits(decision: Mapping[str, Any]) -> bytes:
    """Return what a plan depends on, and the plan, bit by bit."""
    names = ("pose", "boom_angle_rad", "swung_rad", "planned_rad")
    numbers = [np.asarray(decision[name], dtype=float) for name in names]
    return np.hstack(numbers).tobytes()
