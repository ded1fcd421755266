"""A ring buffer of the newest frames: one thread writes, others do not delay it."""

import asyncio
import threading
import time
from collections import deque
from collections.abc import Callable, Coroutine
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal, Self, TypeAlias

from hopdata.arrays import FloatArray
from hopdata.steering.live.packets import LiveError


@dataclass(frozen=True)
class Frame:
    """One frame as it arrived.

    Parameters
    ----------
    epoch : int
        Number of the connection or camera clock; camera times of two epochs are
        unrelated.
    number : int
        Frame number of the camera system.
    time_s : float
        Camera time, s.
    arrival_s : float
        Arrival time on the monotonic clock, s.
    captured_s : float
        Capture time on the monotonic clock, s: camera time plus the shortest delay
        seen.
    markers : (M, 3) array
        Positions, m; NaN if not seen. Read-only once in the buffer.
    index : int
        Index among all frames written so far, from 0; assigned by the buffer.
    """

    epoch: int
    number: int
    time_s: float
    arrival_s: float
    captured_s: float
    markers: FloatArray
    index: int = -1


#: Frames that are kept of a stream in real time.
#: Unit: frames. Origin: chosen: 8 s at 500 Hz.
CAPACITY = 4096


class FrameBuffer:
    """Holds the newest frames.

    Frames are immutable, and a slot is replaced by a single assignment. So a reader
    gets whole frames however long it takes, and the writer never waits.
    """

    def __init__(self, capacity: int = 256) -> None:
        if capacity < 1:
            raise ValueError(f"capacity: expected at least one frame, found {capacity}")
        self._slots: list[Frame | None] = [None] * capacity
        self.written = 0  # frames since the beginning
        self._news = threading.Condition()

    def write(self, frame: Frame) -> None:
        """Add a frame, replacing the oldest one."""
        markers = frame.markers.copy()
        markers.flags.writeable = False
        index = self.written
        # `dataclasses.replace` would take three times as long.
        numbered = Frame(
            epoch=frame.epoch,
            number=frame.number,
            time_s=frame.time_s,
            arrival_s=frame.arrival_s,
            captured_s=frame.captured_s,
            markers=markers,
            index=index,
        )
        self._slots[index % len(self._slots)] = numbered
        self.written = index + 1
        self.wake()

    def newest(self) -> Frame | None:
        """Return the newest frame."""
        written = self.written
        if written == 0:
            return None
        return self._slots[(written - 1) % len(self._slots)]

    def since(self, index: int) -> list[Frame]:
        """Return the frames from `index` on that are still in the buffer, oldest first.

        If more have come than the buffer holds, the first frame returned has a higher
        index.
        """
        written = self.written
        if index == written - 1:  # as a rule, one frame has come
            frame = self._slots[index % len(self._slots)]
            return [frame] if frame is not None and frame.index < written else []
        first = max(index, written - len(self._slots), 0)
        slots = (self._slots[k % len(self._slots)] for k in range(first, written))
        # Slots overwritten in the meantime are left for the next call.
        return [frame for frame in slots if frame is not None and frame.index < written]

    def wait(
        self,
        index: int,
        timeout_s: float,
        *,
        unless: Callable[[], bool] = lambda: False,
    ) -> bool:
        """Wait for frame `index` or until `unless` is true.

        Return whether the frame has come.
        """
        with self._news:
            self._news.wait_for(lambda: self.written > index or unless(), timeout_s)
        return self.written > index

    def wake(self) -> None:
        """Make waiting readers check again.

        The lock is only ever held to check the count.
        """
        with self._news:
            self._news.notify_all()


# Counters.


@dataclass
class StreamCounts:
    """Frames, markers, packets and connections that came, and those that did not.

    `missing` frames have skipped numbers. `outdated` frames came twice or after a frame
    with a higher number, and were dropped. `garbled` packets were damaged, or had an
    implausible number, time or position, and were dropped. In `broken` connections the
    packet boundaries were lost.
    """

    frames: int = 0
    missing: int = 0
    outdated: int = 0
    late: int = 0
    hidden_markers: int = 0
    garbled: int = 0
    connections: int = 0
    losses: int = 0
    broken: int = 0


@dataclass
class LoopCounts:
    """Frames read, overwritten before they were read, and that raised an error."""

    frames: int = 0
    overrun: int = 0
    failed: int = 0


# Threads: one that works until it is stopped, and one that runs a coroutine until then.

JOIN_S = 10.0


class Worker:
    """Calls `work` in a thread, between `start` and `close` or within a context.

    The work ends when `_stop` is set, or by itself.
    """

    def __init__(self, name: str, work: Callable[[], None]) -> None:
        self._stop = threading.Event()
        self._thread = threading.Thread(target=work, name=name, daemon=True)

    def start(self) -> Self:
        """Start the thread."""
        self._thread.start()
        return self

    def close(self) -> None:
        """Stop the thread and wait for its end; a second call does nothing.

        Raises
        ------
        LiveError
            If it does not end.
        """
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join(JOIN_S)
        if self._thread.is_alive():
            raise LiveError(
                f"thread {self._thread.name!r} has not ended within {JOIN_S:g} s"
            )

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.close()


Main: TypeAlias = Callable[[], Coroutine[Any, Any, None]]


class LoopThread(Worker):
    """Runs `main` in a thread; `failure` is the exception that ended it, if any."""

    def __init__(self, name: str, main: Main) -> None:
        super().__init__(name, self._run)
        self.failure: BaseException | None = None
        self._main = main
        self._begun = threading.Event()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._task: asyncio.Task[Any] | None = None

    def start(self) -> Self:
        """Start the thread, and return once its event loop runs."""
        super().start()
        self._begun.wait()
        return self

    def call(self, function: Callable[..., object], *arguments: object) -> None:
        """Schedule a call in the thread; nothing happens if the thread has ended."""
        with suppress(RuntimeError):  # if the event loop is closed
            if self._loop is not None:
                self._loop.call_soon_threadsafe(function, *arguments)

    def close(self) -> None:
        """Cancel the coroutine and wait for the thread's end, like `Worker.close`."""
        if self._task is not None:
            self.call(self._task.cancel)
        super().close()

    def _run(self) -> None:
        try:
            asyncio.run(self._watched())
        except asyncio.CancelledError:
            return
        except BaseException as error:
            self.failure = error
        finally:
            self._begun.set()

    async def _watched(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._task = asyncio.current_task()
        self._begun.set()
        await self._main()


# States of a live stream, with a log of when and why each began.

StreamState = Literal[
    "idle", "connecting", "streaming", "stale", "lost", "failed", "closed"
]

LONGEST_LOG = 10_000


@dataclass(frozen=True)
class Status:
    """State of the stream since `at_s` on the monotonic clock, s, and its cause."""

    state: StreamState
    at_s: float
    message: str = ""


class StatusLog:
    """The current state and a log of past ones; thread-safe."""

    def __init__(self) -> None:
        self._log: deque[Status] = deque(
            [Status("idle", time.monotonic())], LONGEST_LOG
        )
        self._changed = threading.Condition()

    @property
    def status(self) -> Status:
        """The current state."""
        return self._log[-1]

    def history(self) -> tuple[Status, ...]:
        """Return all logged states, oldest first."""
        with self._changed:
            return tuple(self._log)

    def report(self, state: StreamState, message: str = "") -> None:
        """Enter a state."""
        with self._changed:
            self._log.append(Status(state, time.monotonic(), message))
            self._changed.notify_all()

    def wait_for(self, *states: StreamState, timeout_s: float) -> Status | None:
        """Wait for one of these states; return it, or None after the timeout."""
        with self._changed:
            reached = self._changed.wait_for(
                lambda: self.status.state in states, timeout_s
            )
            return self.status if reached else None


# Sources of frames.


class Stream(LoopThread):
    """Writes frames to a buffer, between `start` and `close` or within a context."""

    def __init__(self, name: str, main: Main, capacity: int) -> None:
        super().__init__(name, main)
        self.buffer = FrameBuffer(capacity)
        self.counts = StreamCounts()
        self.states = StatusLog()

    def close(self) -> None:
        """Disconnect, and wait until the thread has ended."""
        super().close()
        self.states.report("closed")
        self.buffer.wake()

    def wait_until_streaming(self, timeout_s: float = 30.0) -> Status:
        """Wait for the first frame, and return the state reached."""
        reached = self.states.wait_for("streaming", "lost", timeout_s=timeout_s)
        return reached or self.states.status
