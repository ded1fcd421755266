"""A drive on a simulated clock: the loop and its watch without threads.

Time is a number that passes from one frame, or look of the watch, to the next. So a
drive takes as long as its arithmetic, and gives the same result every time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from hopdata.arrays import FloatArray
from hopdata.messages import Message
from hopdata.steering.control.objectives import Controller
from hopdata.steering.live.buffer import Frame, FrameBuffer
from hopdata.steering.live.checks import FrameChecks
from hopdata.steering.live.loop import ControlLoop, Decision, Observers
from hopdata.steering.live.machine import Machine
from hopdata.steering.live.safety import LOOK_S, Boom, Limits

BUFFERED = 256  # frames: more than come during the longest plan


class ClockedDrive:
    """A drive over a source of frames, on a simulated clock and armed from the start.

    Parameters
    ----------
    source : iterable of (time_s, markers)
        Frames in order: time, s, and markers (M, 3), m; such as a `LiveHopper`. Each is
        asked for when the one before has arrived.
    observers : callable
        As in `ControlLoop`; see `hopdata.steering.live.loop.observers_of`.
    controller : Controller
    boom : Boom
    limits, checks, on_decision, on_frames, fault
        As in `ControlLoop`.
    machine : Machine, optional
        One that is armed, by default.
    delay_s : float
        Time from a frame to its arrival, s.
    cameras : callable, optional
        Returns what the cameras show of the markers (M, 3), m; None for no frame. May
        be replaced at any time.

    Attributes
    ----------
    loop : ControlLoop
    now_s : float
        The time, s.
    """

    def __init__(  # noqa: PLR0913 - the parts of the loop, by name
        self,
        source: Iterable[tuple[float, FloatArray]],
        observers: Observers,
        controller: Controller,
        boom: Boom,
        *,
        limits: Limits | None = None,
        checks: Callable[[], FrameChecks] | None = None,
        machine: Machine | None = None,
        on_decision: Callable[[Decision], None] | None = None,
        on_frames: Callable[[Sequence[Frame]], None] | None = None,
        fault: Callable[[], Message | None] = lambda: None,
        delay_s: float = 0.0,
        cameras: Callable[[FloatArray], FloatArray | None] | None = None,
    ) -> None:
        self.now_s = 0.0
        self.cameras = cameras
        self._delay_s = delay_s
        self._buffer = FrameBuffer(BUFFERED)
        self.loop = ControlLoop(
            self._buffer,
            observers,
            controller,
            boom,
            limits=limits,
            checks=checks,
            machine=machine or Machine(is_armed=True),
            on_decision=on_decision,
            on_frames=on_frames,
            fault=fault,
            clock=lambda: self.now_s,
        )
        self._frames = enumerate(source)
        self._look_s = 0.5 * LOOK_S
        self._ask_next()

    def run(self, until_s: float, *, ended: Callable[[], bool] = lambda: False) -> None:
        """Drive until a time, until something holds, or until no frame is left."""
        while self.now_s < until_s and not ended() and self._next is not None:
            self.let_pass(min(self._arrives_s, self._look_s) - self.now_s)
            self.loop.step()

    def let_pass(self, seconds: float) -> None:
        """Let time pass: frames arrive, and the watch looks."""
        until_s = self.now_s + max(0.0, seconds)
        while min(self._arrives_s, self._look_s) <= until_s:
            self.now_s = max(self.now_s, min(self._arrives_s, self._look_s))
            if self._look_s < self._arrives_s:
                self._look_s += LOOK_S
                self.loop.watch.look()
            else:
                self._arrive()
        self.now_s = until_s

    @property
    def _arrives_s(self) -> float:
        if self._next is None:
            return float("inf")
        return self._next[1] + self._delay_s

    def _ask_next(self) -> None:
        found = next(self._frames, None)
        self._next: tuple[int, float, FloatArray] | None = None
        if found is not None:
            number, (time_s, markers) = found
            self._next = (number, time_s, markers)

    def _arrive(self) -> None:
        assert self._next is not None
        number, at_s, markers = self._next
        shown: FloatArray | None = markers
        if self.cameras is not None:
            shown = self.cameras(markers.copy())
        if shown is not None:
            captured_s = at_s + self._delay_s
            frame = Frame(0, number, at_s, self.now_s, captured_s, shown)
            self._buffer.write(frame)
        self._ask_next()
