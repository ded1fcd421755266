"""Acts of a rehearsal: each must bring a robot to rest.

An act says what is done, what must be told, and within which time; `rehearsal` performs
it.
"""

from __future__ import annotations

import itertools
import math
import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.messages import Message
from hopdata.steering.live.buffer import Stream
from hopdata.steering.live.decisions import moved_part
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.loop import ControlLoop
from hopdata.steering.live.machine import REST_WITHIN_S
from hopdata.steering.live.robots import DrivenRobot
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.strides import StrideAxes

if TYPE_CHECKING:
    from hopdata.steering.live.rehearsal import RealParts, SimulatedDrive

SWING_RAD = 0.4  # to and fro: a third of the limit, eight times what the loop can tell
# Time for what must be told within two hops of 0.6 to 0.7 s: the hop that has begun
# does not count, since its swing was executed before the act.
TWO_HOPS_S = 3.0
ONE_HOP_S = 1.5  # time for what is told at the next stance
SOON_S = REST_WITHIN_S
REAL_S = 20.0  # longest drive in real time; on a free machine each takes about 2 s
ENDED_BY = "ended by"  # the cause of a rest after a signal, with its name
BLOCKED = "steering.boom_blocked"


def nothing_else(markers: FloatArray) -> FloatArray | None:
    """Show the markers as they are."""
    return markers


def exact(rad: float) -> float:
    """Move by the swing, rad, as a sound boom does."""
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
    cameras: Callable[[FloatArray], FloatArray | None] = nothing_else
    boom: Callable[[float], float] = exact
    refuses: int = 0
    plan: Callable[[SimulatedDrive], float] | None = None
    is_silent: bool = False
    presses_key: bool = False
    is_over: bool = False
    in_real_time: Callable[[ControlLoop, Stream, RealParts], None] | None = None


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
        if act.boom is not exact or act.code == "steering.markers_unseen":
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


def all_acts(
    geometry: HopperGeometry, limits: Limits, robot: DrivenRobot | None = None
) -> Sequence[Act]:
    """Return the acts of the hopper or of another robot."""
    if robot is not None:
        return acts_of(geometry.body_names, robot.axes, limits)
    return acts((*geometry.body_names, str(geometry.boom_name)), limits)


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


def _lose_stream(_: ControlLoop, stream: Stream, __: RealParts) -> None:
    stream.states.report("lost", "the server has hung up")


def _signalled(
    number: signal.Signals,
) -> Callable[[ControlLoop, Stream, RealParts], None]:
    return lambda *_: signal.raise_signal(number)


def _block(_: ControlLoop, __: Stream, parts: RealParts) -> None:
    parts.blocks = True


def _fill_disk(_: ControlLoop, __: Stream, parts: RealParts) -> None:
    parts.log.is_full = True
