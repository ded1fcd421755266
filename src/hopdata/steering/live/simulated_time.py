"""A drive of a simulated robot in simulated time, with decisions and log as any other.

Its time is not that of the wall clock, so a busy computer gives the same drive.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from hopdata.messages import Message
from hopdata.steering.control.interface import Controller
from hopdata.steering.live.actuator import Driven
from hopdata.steering.live.buffer import StreamCounts
from hopdata.steering.live.clocked import ClockedDrive, HoppingSource
from hopdata.steering.live.decisions import Decision
from hopdata.steering.live.drive import Drive
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.log import DriveLog
from hopdata.steering.live.loop import Observers, checks_of, observers_of
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.strides import StrideAxes


def drive_in_simulated_time(  # noqa: PLR0913 - the parts of a drive, by name
    geometry: HopperGeometry,
    controller: Controller,
    boom: Driven,
    source: HoppingSource,
    *,
    seconds: float,
    rate_hz: float,
    limits: Limits,
    log: DriveLog,
    axes: StrideAxes | None = None,
    observers: Observers | None = None,
    on_decision: Callable[[Decision], None] = lambda _: None,
    is_over: Callable[[], bool] = lambda: False,
) -> Drive:
    """Drive a simulated robot, armed from the start, as fast as it can be computed.

    Parameters
    ----------
    geometry, controller, boom, axes, observers, limits, rate_hz
        As in `hopdata.steering.live.drive.drive`.
    source : HoppingSource
        The robot as cameras see it.
    seconds : float
        Longest drive, s of its own time.
    log : DriveLog
        Written during the drive, and closed at its end.
    on_decision : callable
        Called with each decision.
    is_over : callable
        Whether the drive ends; a rest ends it, too, since nobody arms it again.

    Returns
    -------
    Drive
        Without states of a stream, as there is none.
    """
    counts = StreamCounts()

    def decided(decision: Decision) -> None:
        log.decision(decision)
        on_decision(decision)

    driven = ClockedDrive(
        source,
        observers or observers_of(geometry, rate_hz),
        controller,
        boom,
        axes=axes,
        limits=limits,
        checks=checks_of(geometry, rate_hz, limits),
        on_decision=decided,
        on_frames=log.frames,
    )
    loop = driven.loop
    log.start(partial(log.events, (), loop.watch))
    why = Message("steering.the_end")
    try:
        driven.run(seconds, ended=lambda: is_over() or loop.state == "resting")
        if is_over():
            why = Message("steering.excitation_over")
        elif loop.state == "resting":
            why = Message("steering.nobody_arms")
    finally:
        loop.end(why)
        counts.frames = loop.counts.frames
        log.close(driven.now_s, {"stream": counts, "loop": loop.counts})
    return Drive(
        decisions=loop.decisions(),
        states=(),
        steps=tuple(loop.watch.machine.steps),
        rests=tuple(loop.watch.rests),
        stream=counts,
        loop=loop.counts,
    )
