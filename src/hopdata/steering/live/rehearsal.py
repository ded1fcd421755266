"""Rehearsal: each act that must bring a robot to rest, on its simulation.

After each, the boom must stay at rest though the cause is gone, until the operator arms
the drive again.

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
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from hopdata.arrays import FloatArray
from hopdata.messages import Message
from hopdata.steering.live.buffer import Stream
from hopdata.steering.live.clocked import ClockedDrive
from hopdata.steering.live.drive import drive
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.log import DriveLog
from hopdata.steering.live.loop import ControlLoop, checks_of, observers_of
from hopdata.steering.live.machine import Machine
from hopdata.steering.live.packets import LiveError
from hopdata.steering.live.rehearsed_acts import (
    BLOCKED,
    ENDED_BY,
    ONE_HOP_S,
    REAL_S,
    SOON_S,
    SWING_RAD,
    Act,
    Performed,
    all_acts,
    exact,
    nothing_else,
)
from hopdata.steering.live.robots import DrivenRobot
from hopdata.steering.live.seen_robots import SeenRobot, released
from hopdata.steering.live.simulated import LiveHopper, SimulatedBoom, SimulatedStream
from hopdata.steering.observation.calibration import calibrate
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.robot import SteeredHopper
from hopdata.steering.strides import StrideAxes, at_rest
from hopdata.steering.trial import record_trial

RATE_HZ = 100.0
START = (1.0, 0.0, 0.0)  # m, m, rad
SEED = 1
BEFORE_S = 3.0  # drive before each act: four hops
GONE_S = 2.0  # time after an act, three hops, in which it must not go on by itself
BLOCKED_S = 1.0  # patience with a driver, in that drive


def perform(
    geometry: HopperGeometry, limits: Limits, robot: DrivenRobot | None = None
) -> Iterator[Performed]:
    """Perform each act on the hopper or another robot, and yield what came of it."""
    for act in all_acts(geometry, limits, robot):
        if act.in_real_time is None:
            yield _on_simulated_clock(act, geometry, limits, robot)
        else:
            yield _in_real_time(act, geometry, robot)


def simulated_geometry() -> HopperGeometry:
    """Return the geometry of the simulated hopper, learned from a recording of it."""
    swings = [0.5, 0.4, -0.6, -0.5, 0.7] * 8
    return calibrate(record_trial(SteeredHopper(), swings, seed=SEED).recording)


class SimulatedDrive(ClockedDrive):
    """A drive of the simulated hopper, or another robot, on a simulated clock.

    Parameters
    ----------
    geometry, limits
    seed : int
        Seed of the robot.
    machine : Machine, optional
        As in `ClockedDrive`.
    robot : DrivenRobot, optional
        By default the hopper.

    Attributes
    ----------
    cameras, boom, refuses, plan, is_silent
        As in `Act`; may be replaced at any time.
    swings : list of (time_s, rad)
        What the boom was told; of another robot, its first input less that at rest.
    """

    def __init__(
        self,
        geometry: HopperGeometry,
        limits: Limits,
        *,
        seed: int = SEED,
        machine: Machine | None = None,
        robot: DrivenRobot | None = None,
    ) -> None:
        self.swings: list[tuple[float, float]] = []
        self.boom: Callable[[float], float] = exact
        self.refuses = 0
        self.is_silent = False
        self.plan: Callable[[SimulatedDrive], float] = lambda _: self._to_and_fro()
        self._beats = 0
        self._next_swing_rad = SWING_RAD
        self._moved = SimulatedBoom()
        answers: dict[str, Any] = {"alive": self._alive, "heard": lambda: self._beats}
        common: dict[str, Any] = {
            "limits": limits,
            "checks": checks_of(geometry, RATE_HZ, limits),
            "machine": machine,
            "cameras": nothing_else,
        }
        if robot is None:
            self.hopper = LiveHopper(
                SteeredHopper(),
                self._moved_by,
                pose=START,
                rate_hz=RATE_HZ,
                seed=seed,
            )
            super().__init__(
                self.hopper,
                observers_of(geometry, RATE_HZ),
                _controller(lambda: self.plan(self)),
                SimpleNamespace(swing=self._told, **answers),
                **common,
            )
            return
        simulation = robot.simulation()
        self._held = released(simulation)
        seen = SeenRobot(simulation, self._held, pose=START, seed=seed, rate_hz=RATE_HZ)
        super().__init__(
            seen,
            robot.observers(geometry, RATE_HZ),
            _controller(lambda: self.plan(self), robot.axes),
            SimpleNamespace(command=self._commanded, **answers),
            axes=robot.axes,
            **common,
        )

    def begin(self, act: Act) -> None:
        """Begin an act."""
        self.cameras = act.cameras
        self.boom = act.boom
        self.refuses = act.refuses
        self.is_silent = act.is_silent
        if act.plan is not None:
            self.plan = act.plan
        if act.presses_key:
            self.loop.end(Message("steering.operators_key"))

    def end_act(self) -> None:
        """End an act; all is well again."""
        self.cameras = nothing_else
        self.boom = exact
        self.refuses = 0
        self.is_silent = False
        self.plan = lambda _: self._to_and_fro()

    def has_swung_since(self, begun_s: float) -> bool:
        """Return whether the boom was told to move after a time."""
        return any(rad != 0.0 for at_s, rad in self.swings if at_s > begun_s)

    def _told(self, rad: float) -> None:
        if self.refuses > 0:
            self.refuses -= 1
            raise OSError(errno.EIO, "no answer from the motor")
        self.swings.append((self.now_s, rad))
        self._moved.swing(rad)

    def _commanded(self, inputs: FloatArray) -> None:
        self._told(float(inputs[0] - at_rest(self.loop.axes)[0]))
        self._held.command(inputs)

    def _alive(self, number: int) -> None:
        if not self.is_silent:
            self._beats = number

    def _moved_by(self) -> float | None:
        rad = self._moved.newest()
        return self.boom(0.0 if rad is None else rad)

    def _to_and_fro(self) -> float:
        self._next_swing_rad = -self._next_swing_rad
        return self._next_swing_rad


def _controller(
    swing: Callable[[], float], axes: StrideAxes | None = None
) -> SimpleNamespace:
    """Return a controller that plans a swing, or as much of another robot's inputs."""
    if axes is None:
        return SimpleNamespace(plan=lambda *_: SimpleNamespace(swing_rad=swing()))
    rest = at_rest(axes)
    reach = 0.5 * (axes.upper - rest)

    def plan(*_: object) -> SimpleNamespace:
        inputs = rest + swing() / SWING_RAD * reach
        return SimpleNamespace(inputs=inputs[None])

    return SimpleNamespace(plan=plan)


def _on_simulated_clock(
    act: Act,
    geometry: HopperGeometry,
    limits: Limits,
    robot: DrivenRobot | None = None,
) -> Performed:
    simulated = SimulatedDrive(geometry, limits, robot=robot)
    loop = simulated.loop
    simulated.run(BEFORE_S)
    early = [rest.cause for rest in loop.watch.rests]
    if early or not simulated.has_swung_since(0.0):
        why = {"why": early[0] if early else "no swing"}
        return Performed(act, Message("steering.before_the_act", why))
    begun_s = simulated.now_s
    simulated.begin(act)
    until_s = begun_s + act.within_s + SOON_S
    simulated.run(until_s, ended=lambda: bool(loop.watch.rests))
    if not loop.watch.rests:
        return Performed(act, None)
    rest = loop.watch.rests[0]
    simulated.run(rest.sent_s + SOON_S)  # the act lasts
    moved = simulated.has_swung_since(rest.sent_s)
    simulated.end_act()
    ended_s = simulated.now_s
    simulated.run(ended_s + GONE_S)
    resumed = simulated.has_swung_since(ended_s)
    armed_s = simulated.now_s
    is_armed = loop.arm() is None
    simulated.run(armed_s + ONE_HOP_S)
    has_moved = simulated.has_swung_since(armed_s)
    obeyed = is_armed == has_moved == (not act.is_over)
    return Performed(act, rest.cause, rest.sent_s - begun_s, moved, resumed, obeyed)


# Acts in real time.


class _LogOnSmallDisk(DriveLog):
    """A log whose disk is full from some moment on."""

    is_full = False

    def _append(self, name: str, rows: list[tuple[Any, ...]], count: int) -> None:
        if self.is_full:
            raise OSError(errno.ENOSPC, "No space left on device")
        super()._append(name, rows, count)


class RealParts:
    """Robot and log of a drive in real time, with the faults that they can be given.

    `swings` are times and what was sent, 0 at rest; `frames` are those of the robot.
    """

    frames: Iterable[tuple[float, FloatArray]]

    def __init__(self, log: _LogOnSmallDisk) -> None:
        self.swings: list[tuple[float, float]] = []
        self.blocks = False
        self.released = threading.Event()
        self.log = log

    def _note(self, sent: float) -> None:
        """Note what was sent, or block."""
        if self.blocks:
            self.released.wait(REAL_S)
        self.swings.append((time.monotonic(), sent))


class _RealBoom(RealParts):
    """The hopper's boom."""

    def __init__(self, log: _LogOnSmallDisk) -> None:
        super().__init__(log)
        self._moved = SimulatedBoom()
        self.frames = LiveHopper(
            SteeredHopper(), self._moved.newest, pose=START, seed=SEED
        )

    def swing(self, rad: float) -> None:
        """Move the boom."""
        self._note(rad)
        self._moved.swing(rad)


class _RealActuator(RealParts):
    """The actuator of another robot."""

    def __init__(self, log: _LogOnSmallDisk, robot: DrivenRobot) -> None:
        super().__init__(log)
        simulation = robot.simulation()
        self._rest = at_rest(robot.axes)
        self._held = released(simulation)
        self.frames = SeenRobot(simulation, self._held, pose=START, seed=SEED)

    def command(self, inputs: FloatArray, /) -> None:
        """Give the robot inputs."""
        self._note(float(inputs[0] - self._rest[0]))
        self._held.command(inputs)


def _real_parts(
    folder: str, geometry: HopperGeometry, robot: DrivenRobot | None
) -> tuple[RealParts, dict[str, Any]]:
    """Return the parts of a drive in real time, and what it is told of the robot."""
    path = Path(folder, "rehearsal.h5")
    if robot is None:
        return _RealBoom(_LogOnSmallDisk(path, 4, setup={}, files={})), {}
    n_markers = len(geometry.body_names)
    axes = robot.axes
    log = _LogOnSmallDisk(path, n_markers, setup={}, files={}, axes=axes)
    observers = robot.observers(geometry, RATE_HZ)
    return _RealActuator(log, robot), {"axes": axes, "observers": observers}


def _in_real_time(
    act: Act, geometry: HopperGeometry, robot: DrivenRobot | None = None
) -> Performed:
    # A machine that is busy must not be told as a fault of its own.
    limits = Limits(pose_age_s=REAL_S, hop_s=REAL_S, wrong_swings=10**6)
    command_s = BLOCKED_S if act.code == BLOCKED else REAL_S
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
        cause = loop.watch.cause
        if cause is not None and cause.code == BLOCKED:
            # The driver returns, and the rest that waits is sent.
            parts.released.set()
        if any(act.code == rest.cause.code for rest in loop.watch.rests):
            stop.set()

    with tempfile.TemporaryDirectory() as folder, _default_handlers():
        parts, of_robot = _real_parts(folder, geometry, robot)
        controller = _controller(lambda: SWING_RAD, of_robot.get("axes"))
        moves: Any = parts  # a boom or an actuator
        try:
            drive(
                geometry,
                controller,
                moves,
                stream=SimulatedStream(parts.frames),
                stop=stop,
                seconds=REAL_S,
                limits=limits,
                armed=True,
                on_look=look,
                log=parts.log,
                rest_without_log=True,
                **of_robot,
            )
        except LiveError:  # a driver that never returns
            pass
        except SystemExit:
            if not loops or ENDED_BY not in act.rest:  # the operator's own Ctrl-C
                raise
        parts.released.set()
    if not loops:
        why = {"why": f"no swing within {REAL_S:g} s"}
        return Performed(act, Message("steering.before_the_act", why))
    told = [rest for rest in loops[0].watch.rests if rest.sent_s >= begun_s]
    if not told:
        return Performed(act, None)
    right = [rest for rest in told if act.code == rest.cause.code]
    rest = (right or told)[0]
    moved = any(rad != 0.0 for at_s, rad in parts.swings if at_s > rest.sent_s)
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
