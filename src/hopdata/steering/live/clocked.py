"""A drive on a simulated clock: the loop and its watch without threads.

Time is a number that passes from one event to the next. So a drive takes as long as
its arithmetic, and the same seed gives the same drive to the bit. It is what
experiments and rehearsals run.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import require
from hopdata.messages import Message
from hopdata.steering.control.interface import Controller
from hopdata.steering.live.actuator import Driven
from hopdata.steering.live.buffer import Frame, FrameBuffer
from hopdata.steering.live.checks import FrameChecks
from hopdata.steering.live.decisions import Decision
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.loop import ControlLoop, Observers
from hopdata.steering.live.machine import Machine
from hopdata.steering.live.watch import WATCH_S
from hopdata.steering.strides import StrideAxes

PLAN_FRAMES = 256  # frames: more than come during the longest plan


@dataclass(frozen=True, kw_only=True)
class Transport:
    """How frames travel from the cameras to the loop.

    Parameters
    ----------
    delay_s : float
        Time from the capture of a frame to its arrival, s. It is the same for all
        frames, so the loop cannot see it: the clocks of cameras and computer are only
        compared by the frames themselves.
    lost_share : float
        Share of the frames that never arrive, each by chance.

    Raises
    ------
    ConfigError
        If the delay is below 0, or the share is not from 0 to below 1.
    """

    delay_s: float = 0.0
    lost_share: float = 0.0

    def __post_init__(self) -> None:
        require(self.delay_s >= 0, "delay_s", "0 or more", self.delay_s)
        share = self.lost_share
        require(0 <= share < 1, "lost_share", "0 to below 1", share)

    def arriving(self, number: int, rng: np.random.Generator | None) -> list[bool]:
        """Draw which of a number of frames arrive; all do if none are lost."""
        if self.lost_share == 0 or rng is None:
            return [True] * number
        arrives: list[bool] = (rng.random(number) >= self.lost_share).tolist()
        return arrives


class HoppingSource(Protocol):
    """A hopper that makes its hops one by one when it is asked to."""

    rate_hz: float

    @property
    def apex_s(self) -> float:
        """Time of the apex at which the next hop begins, s."""

    def next_frames(self) -> Sequence[tuple[float, FloatArray]]:
        """Make the next hop, by the swing that was commanded before its apex.

        Return time, s, and markers (M, 3), m, of its frames.
        """


class ClockedDrive:
    """A drive of a simulated hopper, on a simulated clock and armed from the start.

    Three things happen, in the order of their times: a hop begins at its apex, with the
    swing that the boom has then; a frame arrives; the watch looks for a cause to rest.
    The loop takes a frame when it arrives, and takes no time to plan, unless the
    controller lets time pass.

    Parameters
    ----------
    source : HoppingSource
        Such as a `LiveHopper`.
    observers : callable
        As in `ControlLoop`; see `hopdata.steering.live.loop.observers_of`.
    controller : Controller
    boom : Boom or Actuator
    axes, limits, checks, on_decision, on_frames, fault
        As in `ControlLoop`.
    machine : Machine, optional
        One that is armed, by default.
    transport : Transport, optional
        Without delay and loss, by default.
    lost : numpy Generator, optional
        Draws which frames are lost.
    cameras : callable, optional
        Returns what the cameras show of the markers (M, 3), m, of a frame that arrives;
        None for no frame. May be replaced at any time.

    Attributes
    ----------
    loop : ControlLoop
    now_s : float
        The time, s.
    """

    def __init__(  # noqa: PLR0913 - the parts of the loop, by name
        self,
        source: HoppingSource,
        observers: Observers,
        controller: Controller,
        boom: Driven,
        *,
        axes: StrideAxes | None = None,
        limits: Limits | None = None,
        checks: Callable[[], FrameChecks] | None = None,
        machine: Machine | None = None,
        on_decision: Callable[[Decision], None] | None = None,
        on_frames: Callable[[Sequence[Frame]], None] | None = None,
        fault: Callable[[], Message | None] = lambda: None,
        transport: Transport | None = None,
        lost: np.random.Generator | None = None,
        cameras: Callable[[FloatArray], FloatArray | None] | None = None,
    ) -> None:
        self.now_s = 0.0
        self.cameras = cameras
        self._source = source
        self._transport = transport or Transport()
        self._lost = lost
        self._buffer = FrameBuffer(PLAN_FRAMES)
        self.loop = ControlLoop(
            self._buffer,
            observers,
            controller,
            boom,
            axes=axes,
            limits=limits,
            checks=checks,
            machine=machine or Machine(is_armed=True),
            on_decision=on_decision,
            on_frames=on_frames,
            fault=fault,
            clock=lambda: self.now_s,
        )
        self._on_the_way: deque[Frame] = deque()
        self._look_s = 0.5 * WATCH_S

    def run(self, until_s: float, *, ended: Callable[[], bool] = lambda: False) -> None:
        """Drive until just before a time, or until something holds."""
        step = self.loop.step
        while True:
            next_s, happen = self._next()
            if next_s >= until_s:
                break
            if ended():
                return
            self.now_s = max(self.now_s, next_s)
            happen()
            step()
        self.now_s = max(self.now_s, until_s)

    def run_hop(self) -> None:
        """Drive from the apex at which the next hop begins to the one after it."""
        self.run(self._source.apex_s)
        self._hop()
        self.run(self._source.apex_s)

    def let_pass(self, seconds: float) -> None:
        """Let time pass for all but the loop, as a controller that plans slowly."""
        until_s = self.now_s + max(0.0, seconds)
        next_s, happen = self._next()
        while next_s <= until_s:
            self._let(next_s, happen)
            next_s, happen = self._next()
        self.now_s = until_s

    def _let(self, next_s: float, happen: Callable[[], None]) -> None:
        self.now_s = max(self.now_s, next_s)
        happen()

    def _next(self) -> tuple[float, Callable[[], None]]:
        """Return when the next thing happens, s, and what lets it happen."""
        apex_s = self._source.apex_s
        arrival_s = math.inf
        if self._on_the_way:
            arrival_s = self._on_the_way[0].arrival_s
        # Of what happens at once, a hop comes first, since a frame may lie on its apex.
        if apex_s <= self._look_s and apex_s <= arrival_s:
            return apex_s, self._hop
        if self._look_s < arrival_s:
            return self._look_s, self._look
        return arrival_s, self._arrive

    def _look(self) -> None:
        self._look_s += WATCH_S
        self.loop.watch.look()

    def _hop(self) -> None:
        """Begin the next hop, and send its frames that are not lost on their way."""
        frames = self._source.next_frames()
        arriving = self._transport.arriving(len(frames), self._lost)
        for (time_s, markers), arrives in zip(frames, arriving, strict=True):
            if arrives:
                number = round(time_s * self._source.rate_hz)
                arrival_s = time_s + self._transport.delay_s
                # The shortest delay seen is that of all frames.
                frame = Frame(0, number, time_s, arrival_s, arrival_s, markers)
                self._on_the_way.append(frame)

    def _arrive(self) -> None:
        frame = self._on_the_way.popleft()
        if self.cameras is not None:
            shown = self.cameras(frame.markers.copy())
            if shown is None:
                return
            frame = replace(frame, markers=shown)
        self._buffer.write(frame)
