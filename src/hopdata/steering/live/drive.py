"""Drive a robot: the whole loop of Fig. 3.4, from the cameras to the boom, with its logs."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any, Self

from hopdata.errors import ConfigError
from hopdata.steering.control.objectives import Controller
from hopdata.steering.live.buffer import LoopCounts, Status, StreamCounts
from hopdata.steering.live.loop import ControlLoop, Decision, write_logs
from hopdata.steering.live.packets import PORT
from hopdata.steering.live.safety import Boom, Limits, Rest
from hopdata.steering.live.stream import MarkerStream, Patience
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.live_stances import StanceDetector
from hopdata.steering.observation.tracking import HopperTracker

SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")  # those of them that the system has


@dataclass(frozen=True)
class Drive:
    """What happened: decisions, states of the stream, rests of the boom, and what was counted."""

    decisions: tuple[Decision, ...]
    states: tuple[Status, ...]
    rests: tuple[Rest, ...]
    stream: StreamCounts
    loop: LoopCounts


def drive(
    geometry: HopperGeometry,
    controller: Controller,
    boom: Boom,
    *,
    host: str = "127.0.0.1",
    port: int = PORT,
    stop: threading.Event,
    seconds: float | None = None,
    first_frame_s: float = 30.0,
    rate_hz: float = 100.0,
    limits: Limits | None = None,
    patience: Patience | None = None,
    on_decision: Callable[[Decision], None] | None = None,
    folder: str | Path | None = None,
) -> Drive:
    """Plan at each stance of a hopper that a Qualisys system sees, and tell its boom.

    Returns when `stop` is set, or after `seconds`. However it ends, the boom is then told to stay,
    no thread is left, and the logs are written. So it is, too, when the process is told to end
    by a signal, unless it is ignored, has a handler of the caller's own, or `drive` is not called
    in the main thread.

    Parameters
    ----------
    geometry : HopperGeometry
        The hopper; its markers must be labelled in the camera system by the names that it has here.
    controller : Controller
        Plans the swings, as those of `hopdata.steering.control` do; of a plan nothing but its
        `swing_rad` is used.
    boom : Boom
        Told each swing.
    host, port : str, int
        The camera system; the loopback address unless told otherwise.
    stop : threading.Event
        Ends the drive; may be set from any thread.
    seconds : float, optional
        Longest duration, counted from the first frame, s.
    first_frame_s : float
        How long to wait for the first frame, s.
    rate_hz : float
        Frame rate of the camera system, Hz.
    limits, patience : optional
        See `Limits` and `Patience`.
    on_decision : callable, optional
        Called with each decision, in the loop's thread.
    folder : path, optional
        Where `decisions.csv`, `stream_states.csv`, `rests.csv` and `counts.csv` are written.

    Raises
    ------
    ConfigError
        If the geometry has no boom, the controller no `plan`, or the boom no `swing`; nothing has
        moved then, nor in the next case.
    OSError
        If `folder` cannot be made.
    LiveError
        If no frame comes, or the camera system is set up otherwise: a marker has another name, z is
        not up, or the frame rate is not `rate_hz`.
    SystemExit
        After SIGINT, SIGTERM or SIGHUP (a terminal that closes), at the end, with 128 and the
        number of the signal: 130, 143 or 129.
    """
    _check_parts(geometry, controller, boom)
    if folder is not None:
        Path(folder).mkdir(parents=True, exist_ok=True)  # complains now rather than after the drive
    names = (*geometry.body_names, str(geometry.boom_name))
    stream = MarkerStream(names, host=host, port=port, rate_hz=rate_hz, patience=patience)

    def fault() -> str:
        """Say whether the stream has been lost after its first frame."""
        status = stream.states.status
        gone = stream.counts.frames and status.state in ("lost", "failed", "closed")
        return f"the stream is {status.state}: {status.message}" if gone else ""

    loop = ControlLoop(
        stream.buffer,
        lambda: (HopperTracker(geometry, names), StanceDetector.of(geometry, rate_hz=rate_hz)),
        controller,
        boom,
        limits=limits,
        on_decision=on_decision,
        fault=fault,
        stop=stop,
    )
    with _Signals() as signals:
        try:
            with stream, loop, signals.heeded():
                try:
                    stream.wait_until_streaming(first_frame_s)
                    stop.wait(seconds)
                finally:
                    loop.rest(
                        f"told to end by {signals.first.name}" if signals.first else "the end"
                    )
        finally:
            with suppress(Exception):  # the robot may be gone
                boom.swing(0.0)
            if signals.first is not None:
                stream.states.report("closed", f"the drive was ended by {signals.first.name}")
            if folder is not None:
                states = stream.states.history()
                counts = {"stream": stream.counts, "loop": loop.counts}
                write_logs(Path(folder), loop.decisions(), states, loop.watch.rests, **counts)
    rests = tuple(loop.watch.rests)
    return Drive(loop.decisions(), stream.states.history(), rests, stream.counts, loop.counts)


class _Signals:
    """Keeps the signals that end a process until the boom rests and the logs are written.

    The first one is raised as `SystemExit`: at once where it is heeded, elsewhere at the end.
    """

    def __init__(self) -> None:
        self.first: signal.Signals | None = None
        self._heeded = False
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():  # no other may set handlers
            for number in (getattr(signal, name) for name in SIGNALS if hasattr(signal, name)):
                before = signal.getsignal(number)
                if before in (signal.SIG_DFL, signal.default_int_handler):
                    self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(self, _: object, error: BaseException | None, *__: object) -> None:
        for number, before in self._before.items():
            signal.signal(number, before)
        if self.first is not None and not isinstance(error, SystemExit):
            raise SystemExit(128 + self.first)

    @contextmanager
    def heeded(self) -> Iterator[None]:
        """Let a signal end what is done inside, once."""
        self._heeded = True
        try:
            if self.first is not None:
                raise SystemExit(128 + self.first)
            yield
        finally:
            self._heeded = False

    def _note(self, number: int, _: FrameType | None) -> None:
        self.first = self.first or signal.Signals(number)
        if self._heeded:
            self._heeded = False
            raise SystemExit(128 + self.first)


def _check_parts(geometry: HopperGeometry, controller: Controller, boom: Boom) -> None:
    """Refuse at once what would hold each hop for ever."""
    if geometry.boom_name is None or geometry.circle is None:
        raise ConfigError(
            "geometry: expected a boom and its circle, found none; calibrate with a recording that "
            "has a marker with the role boom (markers.boom)"
        )
    parts = (("controller", controller, "plan"), ("boom", boom, "swing"))
    for name, part, method in parts:
        if isinstance(part, type) or not callable(getattr(part, method, None)):
            kind = f"the class {part.__name__}" if isinstance(part, type) else type(part).__name__
            raise ConfigError(f"{name}: expected an object with the method {method}, found {kind}")
