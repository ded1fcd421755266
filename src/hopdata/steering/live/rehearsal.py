"""Rehearsal: each act that must bring a robot to rest, on its simulation.

After each, the boom must stay at rest though the cause is gone, until the operator arms
the drive again.

Most acts are performed on a simulated clock, so that a rehearsal takes seconds and
gives the same result every time. Those that need threads or signals (Ctrl-C, a driver
that blocks) are short drives in real time.
"""

from __future__ import annotations

import errno
import itertools
import math
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.messages import Message
from hopdata.steering.live.buffer import Stream
from hopdata.steering.live.clocked import ClockedDrive
from hopdata.steering.live.decisions import moved_part
from hopdata.steering.live.drive import drive
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.log import DriveLog
from hopdata.steering.live.loop import ControlLoop, checks_of, observers_of
from hopdata.steering.live.machine import REST_WITHIN_S, Machine
from hopdata.steering.live.packets import LiveError
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
SWING_RAD = 0.4  # to and fro: a third of the limit, eight times what the loop can tell
BEFORE_S = 3.0  # drive before each act: four hops
# Time for what must be told within two hops of 0.6 to 0.7 s: the hop that has begun
# does not count, since its swing was executed before the act.
TWO_HOPS_S = 3.0
ONE_HOP_S = 1.5  # time for what is told at the next stance
SOON_S = REST_WITHIN_S
GONE_S = 2.0  # time after an act, three hops, in which it must not go on by itself
REAL_S = 20.0  # longest drive in real time; on a free machine each takes about 2 s
ENDED_BY = "ended by"  # the cause of a rest after a signal, with its name
BLOCKED_S = 1.0  # patience with a driver, in that drive
BLOCKED = "steering.boom_blocked"


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
    code : str
        Its code, or that of a message in it.
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
    is_silent : bool
        Whether the robot answers no heartbeats.
    presses_key : bool
        Whether the operator's key is pressed.
    is_over : bool
        Whether the drive is over after it, so that it cannot be armed again.
    in_real_time : callable, optional
        Performs the act in a drive in real time, given its loop, its stream and its
        parts.
    """

    name: str
    by_hand: str
    rest: str
    code: str
    within_s: float
    cameras: Callable[[FloatArray], FloatArray | None] = _nothing_else
    boom: Callable[[float], float] = _exact
    refuses: int = 0
    plan: Callable[[SimulatedDrive], float] | None = None
    is_silent: bool = False
    presses_key: bool = False
    is_over: bool = False
    in_real_time: Callable[[ControlLoop, Stream, _RealParts], None] | None = None


@dataclass(frozen=True)
class Performed:
    """What came of an act.

    Parameters
    ----------
    act : Act
    cause : Message or None
        What was told, if anything was.
    after_s : float
        Time from the act to the boom's rest, s; NaN if it did not rest.
    moved : bool
        Whether a swing other than 0 followed the rest while the act lasted.
    resumed : bool
        Whether one followed after it, before the operator armed the drive again.
    obeyed : bool
        Whether the drive could be armed again then, and moved; or could not, if it was
        over.
    """

    act: Act
    cause: Message | None
    after_s: float = math.nan
    moved: bool = False
    resumed: bool = False
    obeyed: bool = True

    @property
    def is_told(self) -> bool:
        """Whether the cause is the one expected, by its code and its words."""
        if self.cause is None:
            return False
        return self.act.code in codes_in(self.cause) and self.act.rest in str(
            self.cause
        )

    @property
    def is_right(self) -> bool:
        """Whether the boom rested in time for the cause, and until it was armed."""
        is_at_rest = not self.moved and not self.resumed
        is_in_time = self.after_s <= self.act.within_s
        return self.is_told and is_in_time and is_at_rest and self.obeyed


def codes_in(message: Message) -> set[str]:
    """Return the codes of a message and of those among its values."""
    codes = {message.code}
    for value in message.values.values():
        if isinstance(value, Message):
            codes |= codes_in(value)
    return codes


def acts(names: tuple[str, ...], limits: Limits) -> tuple[Act, ...]:
    """Return all acts of a rehearsal, for markers of these names, the boom's last."""
    unseen_s = limits.pose_age_s + SOON_S
    late_s = ONE_HOP_S + limits.command_s
    covered = [
        Act(
            name=f"marker {name} is covered",
            by_hand=f"cover marker {name}",
            rest=f"marker '{name}' is not seen",
            code="steering.markers_unseen",
            within_s=unseen_s,
            cameras=_covered(k),
        )
        for k, name in enumerate(names)
    ]
    exchanged = [
        Act(
            name=f"markers {names[i]} and {names[j]} are exchanged",
            by_hand=f"exchange the names of markers {names[i]} and {names[j]}",
            rest=f"'{names[i]}' and '{names[j]}' are exchanged",
            code="steering.markers_exchanged",
            within_s=SOON_S,
            cameras=_exchanged(i, j),
        )
        for i, j in itertools.combinations(range(len(names)), 2)
    ]
    return (
        Act(
            name="the cable of the cameras is pulled",
            by_hand="pull the cable of the cameras",
            rest="no frame for",
            code="steering.no_frame",
            within_s=unseen_s,
            cameras=lambda _: None,
        ),
        Act(
            name="the server of the cameras goes away",
            by_hand="quit Qualisys Track Manager",
            rest="the stream is lost",
            code="steering.stream_lost",
            within_s=REAL_S,
            in_real_time=_lose_stream,
        ),
        Act(
            name="coordinates freeze while frame numbers run",
            by_hand="",
            rest="the markers have not moved by a bit",
            code="steering.markers_frozen",
            within_s=SOON_S,
            cameras=_Frozen(),
        ),
        *covered,
        *exchanged,
        Act(
            name="the markers are mirrored",
            by_hand="mirror an axis of the camera system",
            rest="they are mirrored along x",
            code="steering.markers_mirrored",
            within_s=SOON_S,
            cameras=lambda markers: markers * np.array([-1.0, 1.0, 1.0]),
        ),
        Act(
            name="the markers come in mm in place of m",
            by_hand="",
            rest="are their units mm, not m?",
            code="steering.markers_scaled",
            within_s=SOON_S,
            cameras=lambda markers: 1000.0 * markers,
        ),
        Act(
            name=f"marker {names[-1]} is off the circle of the boom",
            by_hand=f"hold marker {names[-1]} 10 cm above its place",
            rest=f"marker '{names[-1]}' is off the circle",
            code="steering.markers_unseen",
            within_s=unseen_s,
            cameras=_lifted,
        ),
        Act(
            name="frames cannot be understood",
            by_hand="",
            rest="a frame could not be understood",
            code="steering.not_understood",
            within_s=SOON_S,
            cameras=lambda markers: markers[:1],
        ),
        Act(
            name="a plan is late",
            by_hand="",
            rest="planned too late",
            code="steering.plan_late",
            within_s=late_s,
            plan=_late,
        ),
        Act(
            name="the controller fails",
            by_hand="",
            rest="the controller failed",
            code="steering.controller_failed",
            within_s=ONE_HOP_S,
            plan=_failing,
        ),
        Act(
            name="the hopper leaves the arena",
            by_hand="carry the robot beyond the fence",
            rest="left the arena",
            code="steering.left_arena",
            within_s=SOON_S,
            is_over=True,
            cameras=_beyond(limits.fence_m),
        ),
        Act(
            name="the hopper tips over",
            by_hand="tilt the robot by 60 degrees",
            rest="tips over",
            code="steering.tips_over",
            within_s=SOON_S,
            is_over=True,
            cameras=_tilted,
        ),
        Act(
            name="the operator's key is pressed",
            by_hand="press Enter",
            rest="the operator's key",
            code="steering.operators_key",
            within_s=SOON_S,
            is_over=True,
            presses_key=True,
        ),
        Act(
            name="Ctrl-C is pressed",
            by_hand="press Ctrl-C",
            rest=f"{ENDED_BY} SIGINT",
            code="steering.ended_by",
            within_s=REAL_S,
            is_over=True,
            in_real_time=_signalled(signal.SIGINT),
        ),
        Act(
            name="SIGTERM comes",
            by_hand="kill the process of hopdata (kill PID)",
            rest=f"{ENDED_BY} SIGTERM",
            code="steering.ended_by",
            within_s=REAL_S,
            is_over=True,
            in_real_time=_signalled(signal.SIGTERM),
        ),
        Act(
            name="the boom acknowledges no heartbeats",
            by_hand="pull the cable between this computer and the robot",
            rest="has not acknowledged a heartbeat",
            code="steering.unacknowledged",
            within_s=limits.heard_s + limits.alive_s + SOON_S,
            is_silent=True,
        ),
        Act(
            name="the boom's driver blocks",
            by_hand="",
            rest="the boom's driver has not returned",
            code=BLOCKED,
            within_s=REAL_S,
            in_real_time=_block,
        ),
        Act(
            name="the boom's driver fails",
            by_hand="",
            rest="the boom failed",
            code="steering.boom_failed",
            within_s=ONE_HOP_S,
            refuses=3,
        ),
        Act(
            name="the boom is wired backwards",
            by_hand="swap the wires of the boom's motor",
            rest="it turns the other way",
            code="steering.other_way",
            within_s=TWO_HOPS_S,
            is_over=True,
            boom=lambda rad: -rad,
        ),
        Act(
            name="the boom is dead",
            by_hand="pull the cable of the boom's motor, or switch it off",
            rest="it does not move",
            code="steering.does_not_move",
            within_s=TWO_HOPS_S,
            is_over=True,
            boom=lambda _: 0.0,
        ),
        Act(
            name="the boom moves by half of each swing",
            by_hand="set the gain of the boom to one half",
            rest="% of its swings",
            code="steering.moves_by",
            within_s=TWO_HOPS_S,
            is_over=True,
            boom=lambda rad: 0.5 * rad,
        ),
        Act(
            name="the boom moves though it is told to stay",
            by_hand="turn the boom by hand",
            rest="though it was told to stay",
            code="steering.moves_unbidden",
            within_s=TWO_HOPS_S,
            is_over=True,
            boom=lambda rad: rad or SWING_RAD,
            plan=lambda _: 0.0,
        ),
        Act(
            name="the disk of the log is full, with --log-full rest",
            by_hand="",
            rest="the log could not be written",
            code="steering.log_failed",
            within_s=REAL_S,
            in_real_time=_fill_disk,
        ),
    )


def acts_of(names: tuple[str, ...], axes: StrideAxes, limits: Limits) -> list[Act]:
    """Return the acts for a robot that is not the hopper, by its body's markers.

    Left out is what needs a boom with a marker. As a pose needs three markers, all but
    two are covered at once.
    """
    what = moved_part(axes)
    found = []
    for act in acts(names, limits):
        if act.boom is not _exact or act.code == "steering.markers_unseen":
            continue
        words = {
            key: getattr(act, key).replace("boom", what).replace("hopper", "robot")
            for key in ("name", "by_hand", "rest")
        }
        found.append(replace(act, **words))
    hidden = Act(
        name="all markers but two are covered",
        by_hand="cover all markers but two",
        rest=f"marker '{names[-1]}' is not seen",
        code="steering.markers_unseen",
        within_s=limits.pose_age_s + SOON_S,
        cameras=_all_covered_but_two,
    )
    return [*found, hidden]


def _all_covered_but_two(markers: FloatArray) -> FloatArray:
    markers[2:] = np.nan
    return markers


def _covered(index: int) -> Callable[[FloatArray], FloatArray]:
    def shown(markers: FloatArray) -> FloatArray:
        markers[index] = np.nan
        return markers

    return shown


class _Frozen:
    """Cameras that show the first markers for ever."""

    def __init__(self) -> None:
        self._first: FloatArray | None = None

    def __call__(self, markers: FloatArray) -> FloatArray:
        if self._first is None:
            self._first = markers
        return self._first


def _exchanged(first: int, second: int) -> Callable[[FloatArray], FloatArray]:
    def shown(markers: FloatArray) -> FloatArray:
        order = np.arange(len(markers))
        order[[first, second]] = [second, first]
        return markers[order]

    return shown


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


def perform(
    geometry: HopperGeometry, limits: Limits, robot: DrivenRobot | None = None
) -> Iterator[Performed]:
    """Perform each act on the hopper or another robot, and yield what came of it."""
    for act in all_acts(geometry, limits, robot):
        if act.in_real_time is None:
            yield _on_simulated_clock(act, geometry, limits, robot)
        else:
            yield _in_real_time(act, geometry, robot)


def all_acts(
    geometry: HopperGeometry, limits: Limits, robot: DrivenRobot | None = None
) -> Sequence[Act]:
    """Return the acts of the hopper or of another robot."""
    if robot is not None:
        return acts_of(geometry.body_names, robot.axes, limits)
    return acts((*geometry.body_names, str(geometry.boom_name)), limits)


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
        self.boom: Callable[[float], float] = _exact
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
            "cameras": _nothing_else,
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
        self.cameras = _nothing_else
        self.boom = _exact
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


class _RealParts:
    """Robot and log of a drive in real time, with the faults that they can be given.

    `swings` are times and what was sent, 0 at rest; `frames` are those of the robot.
    """

    frames: Iterable[tuple[float, FloatArray]]

    def __init__(self, log: DriveLog) -> None:
        self.swings: list[tuple[float, float]] = []
        self.blocks = False
        self.released = threading.Event()
        self.log = log

    def _note(self, sent: float) -> None:
        """Note what was sent, or block."""
        if self.blocks:
            self.released.wait(REAL_S)
        self.swings.append((time.monotonic(), sent))


class _RealBoom(_RealParts):
    """The hopper's boom."""

    def __init__(self, log: DriveLog) -> None:
        super().__init__(log)
        self._moved = SimulatedBoom()
        self.frames = LiveHopper(
            SteeredHopper(), self._moved.newest, pose=START, seed=SEED
        )

    def swing(self, rad: float) -> None:
        """Move the boom."""
        self._note(rad)
        self._moved.swing(rad)


class _RealActuator(_RealParts):
    """The actuator of another robot."""

    def __init__(self, log: DriveLog, robot: DrivenRobot) -> None:
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
) -> tuple[_RealParts, dict[str, Any]]:
    """Return the parts of a drive in real time, and what it is told of the robot."""
    path = Path(folder, "rehearsal.h5")
    if robot is None:
        return _RealBoom(_LogOnSmallDisk(path, 4, setup={}, files={})), {}
    n_markers = len(geometry.body_names)
    axes = robot.axes
    log = _LogOnSmallDisk(path, n_markers, setup={}, files={}, axes=axes)
    observers = robot.observers(geometry, RATE_HZ)
    return _RealActuator(log, robot), {"axes": axes, "observers": observers}


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
    assert isinstance(parts.log, _LogOnSmallDisk)
    parts.log.is_full = True


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
