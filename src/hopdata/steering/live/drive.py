"""Drive a robot: the whole loop of Fig. 3.4, from cameras to boom, with its logs.

However a drive ends, the boom is first commanded to stay, then the logs are written,
and only then does a signal that came in the meantime end the process.
"""

import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from types import FrameType
from typing import Any, Self

from hopdata.errors import ConfigError
from hopdata.messages import Message
from hopdata.steering.control.interface import Controller
from hopdata.steering.frame_changes import HOPPER
from hopdata.steering.live.actuator import Driven
from hopdata.steering.live.buffer import (
    CAPACITY,
    LoopCounts,
    Status,
    Stream,
    StreamCounts,
)
from hopdata.steering.live.decisions import Decision, is_hopper
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.log import DriveLog
from hopdata.steering.live.loop import (
    ControlLoop,
    Observers,
    checks_of,
    observers_of,
)
from hopdata.steering.live.machine import Machine, Step
from hopdata.steering.live.packets import LOOPBACK, PORT
from hopdata.steering.live.sender import LAST_REST_S, rest_within
from hopdata.steering.live.stream import MarkerStream, Patience
from hopdata.steering.live.watch import Rest
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.strides import StrideAxes, at_rest

# Time between calls of `on_look` and checks of `stop`, in the caller's thread.
OPERATOR_S = 0.02
SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")  # used if the operating system has them


@dataclass(frozen=True)
class Drive:
    """Record of a drive: decisions, states of stream and drive, rests, and counters."""

    decisions: tuple[Decision, ...]
    states: tuple[Status, ...]
    steps: tuple[Step, ...]
    rests: tuple[Rest, ...]
    stream: StreamCounts
    loop: LoopCounts


def drive(  # noqa: PLR0913 - the parts of the loop and its options, by name
    geometry: HopperGeometry,
    controller: Controller,
    boom: Driven,
    *,
    axes: StrideAxes | None = None,
    observers: Observers | None = None,
    host: str = LOOPBACK,
    port: int = PORT,
    stream: Stream | None = None,
    stop: threading.Event,
    seconds: float | None = None,
    first_frame_s: float = 30.0,
    rate_hz: float = 100.0,
    limits: Limits | None = None,
    patience: Patience | None = None,
    armed: bool = False,
    on_decision: Callable[[Decision], None] | None = None,
    on_look: Callable[[ControlLoop, Stream], None] | None = None,
    log: DriveLog | None = None,
    rest_without_log: bool = False,
) -> Drive:
    """Plan at each stance of a hopper that cameras see, and command its boom.

    Nothing is sent until the drive is armed: by `ControlLoop.arm`, which `on_look` may
    call, or from the start with `armed`. If a fault brings the boom to rest, it stays
    there until the drive is armed again.

    Returns when `stop` is set, or after `seconds`. However it ends, the boom is then
    commanded to stay, no thread is left, and the logs are written. This also holds if a
    signal ends the process, unless the signal is ignored, the caller has a handler of
    their own, or `drive` is not called in the main thread.

    Parameters
    ----------
    geometry : HopperGeometry
        The hopper; the camera system must label its markers by the names used here.
    controller : Controller
        Plans the swings, like those of `hopdata.steering.control`; of a plan only its
        `swing_rad` is used.
    boom : Boom or Actuator
        Gets each swing, or the inputs of each stride.
    axes : StrideAxes, optional
        States and inputs of the robot; by default the hopper's.
    observers : callable, optional
        Returns a new tracker and a new detector of stances, as `apex_observers` of
        `hopdata.steering.observation.bodies`; by default those of a hopper.
    host, port : str, int
        Address of the camera system; the loopback address by default.
    stream : Stream, optional
        Replaces the camera system.
    stop : threading.Event
        Ends the drive; may be set from any thread.
    seconds : float, optional
        Longest duration, from the first frame on, s.
    first_frame_s : float
        Longest wait for the first frame, s.
    rate_hz : float
        Frame rate of the camera system, Hz.
    limits, patience : optional
        See `Limits` and `Patience`.
    armed : bool
        Whether the first swing is sent at the first stance, without an operator who
        arms the drive. For simulated robots and for booms that move nothing.
    on_decision : callable, optional
        Called with each decision, in the loop's thread.
    on_look : callable, optional
        Called every `OPERATOR_S` with the loop and the stream, in the caller's thread.
    log : DriveLog, optional
        Written during the drive, and closed at its end.
    rest_without_log : bool
        Whether the drive rests if the log cannot be written any more (a full disk). By
        default it goes on.

    Raises
    ------
    ConfigError
        If the geometry has no boom, the controller no `plan`, or the boom no `swing`;
        nothing has moved by then.
    LiveError
        If no frame comes, or the camera system is set up differently: a marker has
        another name, z does not point up, or the frame rate is not `rate_hz`.
    SystemExit
        At the end, after SIGINT, SIGTERM or SIGHUP (a closed terminal), with 128 plus
        the number of the signal: 130, 143 or 129.
    """
    axes = axes or HOPPER
    _check_parts(geometry, controller, boom, axes)
    names = geometry.body_names
    if geometry.boom_name is not None:
        names = (*names, geometry.boom_name)
    if stream is None:
        stream = MarkerStream(
            names,
            host=host,
            port=port,
            rate_hz=rate_hz,
            capacity=CAPACITY,
            patience=patience,
        )
    needed_log = log if rest_without_log else None
    limits = limits or Limits()
    loop = ControlLoop(
        stream.buffer,
        observers or observers_of(geometry, rate_hz),
        controller,
        boom,
        axes=axes,
        limits=limits,
        checks=checks_of(geometry, rate_hz, limits),
        machine=Machine(is_armed=armed),
        on_decision=partial(_decided, log, on_decision),
        on_frames=None if log is None else log.frames,
        fault=partial(_fault, stream, needed_log),
        stop=stop,
    )
    if log is not None:
        log.start(lambda: log.events(stream.states.history(), loop.watch))
    with _Signals() as signals:
        try:
            with stream, loop, signals.heeded():
                try:
                    stream.wait_until_streaming(first_frame_s)
                    end_s = math.inf if seconds is None else time.monotonic() + seconds
                    while time.monotonic() < end_s and not stop.wait(OPERATOR_S):
                        if on_look is not None:
                            on_look(loop, stream)
                finally:
                    loop.end(_why_it_ends(signals.first))
        finally:
            # Once more, in case the loop's own thread has not begun or is blocked.
            rest_within(boom, LAST_REST_S, tuple(at_rest(axes).tolist()))
            if signals.first is not None:
                ended = f"the drive was ended by {signals.first.name}"
                stream.states.report("closed", ended)
            if log is not None:
                counts = {"stream": stream.counts, "loop": loop.counts}
                log.close(time.monotonic(), counts)
    return Drive(
        decisions=loop.decisions(),
        states=stream.states.history(),
        steps=tuple(loop.watch.machine.steps),
        rests=tuple(loop.watch.rests),
        stream=stream.counts,
        loop=loop.counts,
    )


def _why_it_ends(first: signal.Signals | None) -> Message:
    if first is None:
        return Message("steering.the_end")
    return Message("steering.ended_by", {"signal": first.name})


def _fault(stream: Stream, needed_log: DriveLog | None) -> Message | None:
    """Return why the boom must rest, if it must.

    The stream was lost after its first frame, or a log that is needed has failed.
    """
    status = stream.states.status
    if stream.counts.frames and status.state in ("lost", "failed", "closed"):
        values = {"state": status.state, "reason": status.message}
        return Message("steering.stream_lost", values)
    if needed_log is not None and needed_log.failure:
        return Message("steering.log_failed", {"failure": needed_log.failure})
    return None


def _decided(
    log: DriveLog | None,
    on_decision: Callable[[Decision], None] | None,
    decision: Decision,
) -> None:
    """Pass a decision on to the log and to the caller."""
    if log is not None:
        log.decision(decision)
    if on_decision is not None:
        on_decision(decision)


class _Signals:
    """Holds back signals that would end the process.

    They wait until the boom rests and the logs are written. The first signal is raised
    as `SystemExit`: at once if it comes within `heeded`, otherwise when this context
    ends. Later ones are ignored.
    """

    def __init__(self) -> None:
        self.first: signal.Signals | None = None
        self._heeded = False
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():  # others may set none
            known = [name for name in SIGNALS if hasattr(signal, name)]
            for name in known:
                number = getattr(signal, name)
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
        """Let a signal interrupt the body of this context, once."""
        self._heeded = True
        try:
            if self.first is not None:  # it came before
                raise SystemExit(128 + self.first)
            yield
        finally:
            self._heeded = False

    def _note(self, number: int, _: FrameType | None) -> None:
        """Handle a signal: remember the first, and interrupt the body if `heeded`."""
        self.first = self.first or signal.Signals(number)
        if self._heeded:
            self._heeded = False
            raise SystemExit(128 + self.first)


def _check_parts(
    geometry: HopperGeometry, controller: Controller, boom: Driven, axes: StrideAxes
) -> None:
    """Refuse at once any parts with which no swing could be planned or sent."""
    has_boom = geometry.boom_name is not None and geometry.circle is not None
    if is_hopper(axes) and not has_boom:
        found = (
            "none; calibrate with a recording that has a marker with the role boom "
            "(markers.boom)"
        )
        raise ConfigError.at("geometry", "a boom and its circle", found)
    _check_method("controller", controller, "plan")
    moves_boom = is_hopper(axes) and not hasattr(boom, "command")
    _check_method("boom", boom, "swing" if moves_boom else "command")
    given = [name for name in ("alive", "heard") if hasattr(boom, name)]
    if len(given) == 1:
        wanted = "both of the methods alive and heard, or none of them"
        raise ConfigError.at("boom", wanted, f"{given[0]} alone")


def _check_method(name: str, part: object, method: str) -> None:
    """Refuse a part without this method; a class is not an object with it."""
    if isinstance(part, type):
        kind = f"the class {part.__name__}"
    elif callable(getattr(part, method, None)):
        return
    else:
        kind = type(part).__name__
    raise ConfigError.at(name, f"an object with the method {method}", kind)
