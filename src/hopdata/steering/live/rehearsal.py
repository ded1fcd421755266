"""Rehearsal: each act that must bring the boom to rest, on the simulated robot.

Most acts are performed on a simulated clock, so that a rehearsal takes seconds and
gives the same result every time. Those that need threads or signals (Ctrl-C, a driver
that blocks) are short drives in real time.
"""

from __future__ import annotations

import errno
import math
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.steering.live.buffer import Frame, FrameBuffer, Stream
from hopdata.steering.live.drive import drive
from hopdata.steering.live.log import DriveLog
from hopdata.steering.live.loop import ControlLoop, observers_of
from hopdata.steering.live.packets import LiveError
from hopdata.steering.live.safety import LOOK_S, Limits
from hopdata.steering.live.simulated import LiveHopper, SimulatedBoom, SimulatedStream
from hopdata.steering.observation.calibration import calibrate
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.robot import SteeredHopper
from hopdata.steering.trial import record_trial

RATE_HZ = 100.0
SEED = 1
SWING_RAD = 0.4  # to and fro: a third of the limit, eight times what the loop can tell
BEFORE_S = 3.0  # drive before each act: four hops
# Time for what must be told within two hops of 0.6 to 0.7 s: the hop that has begun
# does not count, since its swing was executed before the act.
TWO_HOPS_S = 3.0
ONE_HOP_S = 1.5  # time for what is told at the next stance
SOON_S = 0.05  # a few looks of the watch
REAL_S = 20.0  # longest drive in real time; on a free machine each takes about 2 s
ENDED_BY = "ended by"  # the cause of a rest after a signal, with its name
BLOCKED_S = 1.0  # patience with a driver, in that drive
BLOCKED = "the boom's driver has not returned"


# The acts.


def _nothing_else(markers: FloatArray) -> FloatArray | None:
    return markers


def _exact(rad: float) -> float:
    return rad


@dataclass(frozen=True)
class Act:
    """Something that must bring the boom to rest.

    Parameters
    ----------
    name : str
        What is done.
    by_hand : str
        How an operator does it with a robot; empty if it needs none.
    rest : str
        Words of the cause that must be told.
    within_s : float
        Longest time from the act to the boom's rest, s.
    cameras : callable
        Returns what the cameras show of the markers (M, 3), m, after the act; None for
        no frame.
    boom : callable
        Returns how far the boom moves for a swing, rad.
    refuses : int
        Number of commands for which the boom raises an error.
    plan : callable, optional
        Given the simulated drive, plans in place of the controller, rad; may raise.
    presses_key : bool
        Whether the operator's key is pressed.
    in_real_time : callable, optional
        Performs the act in a drive in real time, given its loop, its stream and its
        parts.
    """

    name: str
    by_hand: str
    rest: str
    within_s: float
    cameras: Callable[[FloatArray], FloatArray | None] = _nothing_else
    boom: Callable[[float], float] = _exact
    refuses: int = 0
    plan: Callable[[SimulatedDrive], float] | None = None
    presses_key: bool = False
    in_real_time: Callable[[ControlLoop, Stream, _RealParts], None] | None = None


@dataclass(frozen=True)
class Performed:
    """What came of an act.

    `cause` is what was told, empty if nothing was. `after_s` is the time from the act
    to the boom's rest, s; NaN if it did not rest. `moved` tells whether a swing other
    than 0 followed the rest.
    """

    act: Act
    cause: str
    after_s: float
    moved: bool

    @property
    def is_right(self) -> bool:
        """Whether the boom rested in time, stayed at rest, and the cause was told."""
        told = self.act.rest in self.cause
        return told and self.after_s <= self.act.within_s and not self.moved


def acts(names: tuple[str, ...], limits: Limits) -> tuple[Act, ...]:
    """Return all acts of a rehearsal, for markers of these names, the boom's last."""
    unseen_s = limits.pose_age_s + SOON_S
    late_s = ONE_HOP_S + limits.command_s
    covered = [
        Act(
            name=f"marker {name} is covered",
            by_hand=f"cover marker {name}",
            rest=f"marker '{name}' is not seen",
            within_s=unseen_s,
            cameras=_covered(k),
        )
        for k, name in enumerate(names)
    ]
    return (
        Act(
            name="the cable of the cameras is pulled",
            by_hand="pull the cable of the cameras",
            rest="no frame for",
            within_s=unseen_s,
            cameras=lambda _: None,
        ),
        Act(
            name="the server of the cameras goes away",
            by_hand="quit Qualisys Track Manager",
            rest="the stream is lost",
            within_s=REAL_S,
            in_real_time=_lose_stream,
        ),
        *covered,
        Act(
            name=f"markers {names[0]} and {names[-1]} are exchanged",
            by_hand=f"exchange the names of markers {names[0]} and {names[-1]}",
            rest="the markers do not fit together",
            within_s=SOON_S,
            cameras=_exchanged,
        ),
        Act(
            name=f"marker {names[-1]} is off the circle of the boom",
            by_hand=f"hold marker {names[-1]} 10 cm above its place",
            rest=f"marker '{names[-1]}' is off the circle",
            within_s=unseen_s,
            cameras=_lifted,
        ),
        Act(
            name="a frame cannot be understood",
            by_hand="",
            rest="a frame could not be understood",
            within_s=SOON_S,
            cameras=lambda markers: markers[:1],
        ),
        Act(
            name="a plan is late",
            by_hand="",
            rest="planned too late",
            within_s=late_s,
            plan=_late,
        ),
        Act(
            name="the controller fails",
            by_hand="",
            rest="the controller failed",
            within_s=ONE_HOP_S,
            plan=_failing,
        ),
        Act(
            name="the hopper leaves the arena",
            by_hand="carry the robot beyond the fence",
            rest="left the arena",
            within_s=SOON_S,
            cameras=_beyond(limits.fence_m),
        ),
        Act(
            name="the hopper tips over",
            by_hand="tilt the robot by 60 degrees",
            rest="tips over",
            within_s=SOON_S,
            cameras=_tilted,
        ),
        Act(
            name="the operator's key is pressed",
            by_hand="press Enter",
            rest="the operator's key",
            within_s=SOON_S,
            presses_key=True,
        ),
        Act(
            name="Ctrl-C is pressed",
            by_hand="press Ctrl-C",
            rest=f"{ENDED_BY} SIGINT",
            within_s=REAL_S,
            in_real_time=_signalled(signal.SIGINT),
        ),
        Act(
            name="SIGTERM comes",
            by_hand="kill the process of hopdata (kill PID)",
            rest=f"{ENDED_BY} SIGTERM",
            within_s=REAL_S,
            in_real_time=_signalled(signal.SIGTERM),
        ),
        Act(
            name="the boom's driver blocks",
            by_hand="",
            rest=BLOCKED,
            within_s=REAL_S,
            in_real_time=_block,
        ),
        Act(
            name="the boom's driver fails",
            by_hand="",
            rest="the boom failed",
            within_s=ONE_HOP_S,
            refuses=3,
        ),
        Act(
            name="the boom is wired backwards",
            by_hand="swap the wires of the boom's motor",
            rest="it turns the other way",
            within_s=TWO_HOPS_S,
            boom=lambda rad: -rad,
        ),
        Act(
            name="the boom is dead",
            by_hand="pull the cable of the boom, or switch off its motor",
            rest="it does not move",
            within_s=TWO_HOPS_S,
            boom=lambda _: 0.0,
        ),
        Act(
            name="the boom moves by half of each swing",
            by_hand="set the gain of the boom to one half",
            rest="% of its swings",
            within_s=TWO_HOPS_S,
            boom=lambda rad: 0.5 * rad,
        ),
        Act(
            name="the boom moves though it is told to stay",
            by_hand="turn the boom by hand",
            rest="though it was told to stay",
            within_s=TWO_HOPS_S,
            boom=lambda rad: rad or SWING_RAD,
            plan=lambda _: 0.0,
        ),
        Act(
            name="the disk of the log is full, with --log-full rest",
            by_hand="",
            rest="the log could not be written",
            within_s=REAL_S,
            in_real_time=_fill_disk,
        ),
    )


def _covered(index: int) -> Callable[[FloatArray], FloatArray]:
    def shown(markers: FloatArray) -> FloatArray:
        markers[index] = np.nan
        return markers

    return shown


def _exchanged(markers: FloatArray) -> FloatArray:
    """Exchange the first marker and the last."""
    order = np.arange(len(markers))
    order[[0, -1]] = order[[-1, 0]]
    return markers[order]


def _lifted(markers: FloatArray) -> FloatArray:
    markers[-1, 2] += 0.1
    return markers


def _beyond(fence_m: float) -> Callable[[FloatArray], FloatArray]:
    return lambda markers: markers + np.array([2.0 * fence_m + 1.0, 0.0, 0.0])


def _tilted(markers: FloatArray) -> FloatArray:
    """Turn the hopper by 60 degrees about the x axis."""
    cosine = 0.5
    sine = math.sqrt(0.75)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, cosine, sine], [0.0, -sine, cosine]])
    middle = markers.mean(axis=0)
    return np.asarray(middle + (markers - middle) @ turn)


def _late(simulated: SimulatedDrive) -> float:
    """Plan for so long that only the watch can bring the boom to rest in time."""
    simulated.let_pass(10.0 * simulated.loop.limits.command_s)
    return SWING_RAD


def _failing(_: SimulatedDrive) -> float:
    raise ArithmeticError("no way out")


# Performing them.


def perform(geometry: HopperGeometry, limits: Limits) -> Iterator[Performed]:
    """Perform each act, and yield what came of it."""
    names = (*geometry.body_names, str(geometry.boom_name))
    for act in acts(names, limits):
        if act.in_real_time is None:
            yield _on_simulated_clock(act, geometry, limits)
        else:
            yield _in_real_time(act, geometry)


def simulated_geometry() -> HopperGeometry:
    """Return the geometry of the simulated hopper, learned from a recording of it."""
    swings = [0.5, 0.4, -0.6, -0.5, 0.7] * 8
    return calibrate(record_trial(SteeredHopper(), swings, seed=SEED).recording)


class SimulatedDrive:
    """A loop, its watch and the simulated hopper on a simulated clock, without threads.

    Parameters
    ----------
    geometry, limits
    seed : int
        Seed of the hopper.

    Attributes
    ----------
    cameras, boom, refuses, plan
        As in `Act`; may be replaced at any time.
    now_s : float
        The time, s.
    swings : list of (time_s, rad)
        What the boom was told.
    """

    def __init__(
        self, geometry: HopperGeometry, limits: Limits, *, seed: int = SEED
    ) -> None:
        self.now_s = 0.0
        self.swings: list[tuple[float, float]] = []
        self.cameras: Callable[[FloatArray], FloatArray | None] = _nothing_else
        self.boom: Callable[[float], float] = _exact
        self.refuses = 0
        self.plan: Callable[[SimulatedDrive], float] = lambda _: self._to_and_fro()
        self._next_swing_rad = SWING_RAD
        self._moved = SimulatedBoom()
        self.hopper = LiveHopper(
            SteeredHopper(),
            self._moved_by,
            pose=(1.0, 0.0, 0.0),
            rate_hz=RATE_HZ,
            seed=seed,
        )
        self._buffer = FrameBuffer(256)
        self.loop = ControlLoop(
            self._buffer,
            observers_of(geometry, RATE_HZ),
            SimpleNamespace(plan=lambda *_: SimpleNamespace(swing_rad=self.plan(self))),
            SimpleNamespace(swing=self._told),
            limits=limits,
            clock=lambda: self.now_s,
        )
        self._frames = enumerate(self.hopper)
        self._number, (self._frame_s, self._markers) = next(self._frames)
        self._look_s = 0.5 * LOOK_S
        self._taken = 0

    def run(self, until_s: float, *, ended: Callable[[], bool] = lambda: False) -> None:
        """Drive until a time, or until something holds."""
        while self.now_s < until_s and not ended():
            self.let_pass(min(self._frame_s, self._look_s) - self.now_s)
            frames = self._buffer.since(self._taken)
            if frames:
                self._taken = frames[-1].index + 1
                self.loop.take(frames)

    def let_pass(self, seconds: float) -> None:
        """Let time pass: frames arrive, and the watch looks."""
        until_s = self.now_s + max(0.0, seconds)
        while min(self._frame_s, self._look_s) <= until_s:
            self.now_s = max(self.now_s, min(self._frame_s, self._look_s))
            if self._look_s < self._frame_s:
                self._look_s += LOOK_S
                self.loop.watch.look()
            else:
                self._arrive()
        self.now_s = until_s

    def _arrive(self) -> None:
        shown = self.cameras(self._markers.copy())
        if shown is not None:
            at_s = self._frame_s
            self._buffer.write(Frame(0, self._number, at_s, self.now_s, at_s, shown))
        self._number, (self._frame_s, self._markers) = next(self._frames)

    def _told(self, rad: float) -> None:
        if self.refuses > 0:
            self.refuses -= 1
            raise OSError(errno.EIO, "no answer from the motor")
        self.swings.append((self.now_s, rad))
        self._moved.swing(rad)

    def _moved_by(self) -> float | None:
        rad = self._moved.newest()
        return self.boom(0.0 if rad is None else rad)

    def _to_and_fro(self) -> float:
        self._next_swing_rad = -self._next_swing_rad
        return self._next_swing_rad


def _on_simulated_clock(
    act: Act, geometry: HopperGeometry, limits: Limits
) -> Performed:
    simulated = SimulatedDrive(geometry, limits)
    loop = simulated.loop
    simulated.run(BEFORE_S)
    early = [rest.cause for rest in loop.watch.rests]
    if early or not any(rad for _, rad in simulated.swings):
        why = f"before the act: {early or 'no swing'}"
        return Performed(act, why, math.nan, moved=False)
    begun_s = simulated.now_s
    simulated.cameras = act.cameras
    simulated.boom = act.boom
    simulated.refuses = act.refuses
    if act.plan is not None:
        simulated.plan = act.plan
    if act.presses_key:
        loop.rest("the operator's key")
    until_s = begun_s + act.within_s + SOON_S
    simulated.run(until_s, ended=lambda: bool(_told_since(loop, begun_s)))
    told = _told_since(loop, begun_s)
    if not told:
        return Performed(act, "", math.nan, moved=False)
    rested_s, cause = told[0]
    simulated.run(rested_s + SOON_S)  # the act lasts
    moved = any(rad != 0.0 for at_s, rad in simulated.swings if at_s > rested_s)
    return Performed(act, cause, rested_s - begun_s, moved)


def _told_since(loop: ControlLoop, begun_s: float) -> list[tuple[float, str]]:
    """Return when the boom was brought to rest or held, and why."""
    rests = [(rest.sent_s, rest.cause) for rest in loop.watch.rests]
    held = [
        (made.stance_s + made.since_stance_s, made.reason)  # when it was sent
        for made in loop.decisions()
        if made.outcome == "held" and made.command_rad == 0.0
    ]
    return sorted(one for one in [*rests, *held] if one[0] >= begun_s)


# Acts in real time.


class _RealParts:
    """Boom and log of a drive in real time, with the faults that they can be given."""

    def __init__(self, log: Path) -> None:
        self.moved = SimulatedBoom()
        self.swings: list[tuple[float, float]] = []
        self.blocks = False
        self.released = threading.Event()
        self.log = _LogOnSmallDisk(log, 4, setup={}, files={})

    def swing(self, rad: float) -> None:
        """Move the boom, or block."""
        if self.blocks:
            self.released.wait(REAL_S)
        self.swings.append((time.monotonic(), rad))
        self.moved.swing(rad)


class _LogOnSmallDisk(DriveLog):
    """A log whose disk is full from some moment on."""

    is_full = False

    def _append(self, name: str, rows: list[tuple[Any, ...]], count: int) -> None:
        if self.is_full:
            raise OSError(errno.ENOSPC, "No space left on device")
        super()._append(name, rows, count)


def _lose_stream(_: ControlLoop, stream: Stream, __: _RealParts) -> None:
    stream.states.report("lost", "the server has hung up")


def _signalled(
    number: signal.Signals,
) -> Callable[[ControlLoop, Stream, _RealParts], None]:
    return lambda *_: signal.raise_signal(number)


def _block(_: ControlLoop, __: Stream, parts: _RealParts) -> None:
    parts.blocks = True


def _fill_disk(_: ControlLoop, __: Stream, parts: _RealParts) -> None:
    parts.log.is_full = True


def _in_real_time(act: Act, geometry: HopperGeometry) -> Performed:
    # A machine that is busy must not be told as a fault of its own.
    limits = Limits(pose_age_s=REAL_S, hop_s=REAL_S, wrong_swings=10**6)
    command_s = BLOCKED_S if act.rest == BLOCKED else REAL_S
    limits = replace(limits, command_s=command_s)
    assert act.in_real_time is not None
    perform_act = act.in_real_time
    loops: list[ControlLoop] = []
    begun_s = math.nan
    stop = threading.Event()

    def look(loop: ControlLoop, stream: Stream) -> None:
        nonlocal begun_s
        if math.isnan(begun_s):
            if any(rad != 0.0 for _, rad in parts.swings):
                loops.append(loop)
                begun_s = time.monotonic()
                perform_act(loop, stream, parts)
            return
        if BLOCKED in loop.watch.cause:
            # The driver returns, and the rest that waits is sent.
            parts.released.set()
        if any(act.rest in rest.cause for rest in loop.watch.rests):
            stop.set()

    with tempfile.TemporaryDirectory() as folder, _default_handlers():
        parts = _RealParts(Path(folder, "rehearsal.h5"))
        hopper = LiveHopper(
            SteeredHopper(), parts.moved.newest, pose=(1.0, 0.0, 0.0), seed=SEED
        )
        controller = SimpleNamespace(
            plan=lambda *_: SimpleNamespace(swing_rad=SWING_RAD)
        )
        try:
            drive(
                geometry,
                controller,
                parts,
                stream=SimulatedStream(hopper),
                stop=stop,
                seconds=REAL_S,
                limits=limits,
                on_look=look,
                log=parts.log,
                rest_without_log=True,
            )
        except LiveError:  # a driver that never returns
            pass
        except SystemExit:
            if not loops or ENDED_BY not in act.rest:  # the operator's own Ctrl-C
                raise
        parts.released.set()
    if not loops:
        why = f"before the act: no swing within {REAL_S:g} s"
        return Performed(act, why, math.nan, moved=False)
    told = [rest for rest in loops[0].watch.rests if rest.sent_s >= begun_s]
    if not told:
        return Performed(act, "", math.nan, moved=False)
    right = [rest for rest in told if act.rest in rest.cause]
    rest = (right or told)[0]
    # A driver that returns ends the act, so the drive may go on at once.
    lasts = act.rest != BLOCKED
    moved = lasts and any(
        rad != 0.0 for at_s, rad in parts.swings if at_s > rest.sent_s
    )
    return Performed(act, rest.cause, rest.sent_s - begun_s, moved)


@contextmanager
def _default_handlers() -> Iterator[None]:
    """Handle signals as in a terminal; in the background some are ignored.

    Only the main thread may do so.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {
        signal.SIGINT: signal.signal(signal.SIGINT, signal.default_int_handler),
        signal.SIGTERM: signal.signal(signal.SIGTERM, signal.SIG_DFL),
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
