"""A ring of the newest frames: one thread writes, others read, and no reader holds it up."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

from hopdata.steering.live.packets import FloatArray


@dataclass(frozen=True)
class Frame:
    """One frame as it arrived.

    Parameters
    ----------
    index : int
        Place among all frames written so far, from 0.
    epoch : int
        Counts the connections; camera times of two epochs have nothing to do with each other.
    number : int
        Frame number of the camera system.
    time_s : float
        Camera time, s.
    arrival_s : float
        When it arrived, on the monotonic clock, s.
    captured_s : float
        When it was captured, on the monotonic clock, s: camera time and the shortest delay seen.
    markers : (M, 3) array
        m, NaN for those not seen; not to be written.
    """

    index: int
    epoch: int
    number: int
    time_s: float
    arrival_s: float
    captured_s: float
    markers: FloatArray


class FrameBuffer:
    """Holds the newest frames.

    Frames are made once and never changed, and a slot is replaced by a single assignment. A reader
    so gets whole frames however long it takes, and the writer waits for nobody.
    """

    def __init__(self, capacity: int = 256) -> None:
        if capacity < 1:
            raise ValueError(f"capacity: expected at least one frame, found {capacity}")
        self._slots: list[Frame | None] = [None] * capacity
        self._written = 0
        self._news = threading.Condition()

    def __len__(self) -> int:
        return min(self._written, len(self._slots))

    @property
    def written(self) -> int:
        """How many frames have been written so far."""
        return self._written

    def write(
        self,
        markers: FloatArray,
        *,
        epoch: int,
        number: int,
        time_s: float,
        arrival_s: float,
        captured_s: float,
    ) -> None:
        """Put in a frame, in place of the oldest one."""
        markers = markers.copy()
        markers.flags.writeable = False
        index = self._written
        frame = Frame(index, epoch, number, time_s, arrival_s, captured_s, markers)
        self._slots[index % len(self._slots)] = frame
        self._written = index + 1
        self.wake()

    def newest(self) -> Frame | None:
        """Return the newest frame."""
        written = self._written
        return self._slots[(written - 1) % len(self._slots)] if written else None

    def since(self, index: int) -> list[Frame]:
        """Return the frames from `index` on that are still there, oldest first.

        If more have come than the buffer holds, the first of these has a higher index.
        """
        written = self._written
        first = max(index, written - len(self._slots), 0)
        slots = (self._slots[k % len(self._slots)] for k in range(first, written))
        # What was overwritten in the meantime is left for the next time.
        return [frame for frame in slots if frame is not None and frame.index < written]

    def wait(
        self, index: int, timeout_s: float, *, unless: Callable[[], bool] = lambda: False
    ) -> bool:
        """Wait for the frame `index`, or until `unless` is true; say whether the frame has come."""
        with self._news:
            self._news.wait_for(lambda: self._written > index or unless(), timeout_s)
        return self._written > index

    def wake(self) -> None:
        """Make those who wait look again. The lock is only ever held for a look at the count."""
        with self._news:
            self._news.notify_all()
