"""Replay of a drive: the frames of its log in a loop, and the plans compared."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import pd
from hopdata.messages import Message
from hopdata.steering.control.interface import Controller
from hopdata.steering.live.actuator import NoActuator
from hopdata.steering.live.buffer import Frame, FrameBuffer
from hopdata.steering.live.checks import FrameChecks
from hopdata.steering.live.decisions import Decision, Numbers
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.log_reading import LoggedDrive
from hopdata.steering.live.loop import ControlLoop, Observers
from hopdata.steering.live.machine import (
    DriveState,
    Event,
    Machine,
    Step,
    Told,
    Transition,
)
from hopdata.steering.strides import StrideAxes


def replay(
    log: LoggedDrive,
    observers: Observers,
    controller: Controller,
    *,
    limits: Limits | None = None,
    checks: Callable[[], FrameChecks] | None = None,
) -> pd.DataFrame:
    """Replay the frames of a log in a loop, in their batches and at their times.

    Nothing is sent. The controller is called wherever it was called in the drive, so a
    learning controller learns the same again.

    Returns
    -------
    DataFrame
        One row per stance at which it was called: ``told_s``, the swings planned in the
        drive and now (``then, now``: tuples), and ``same``, whether pose, states and
        inputs are identical to the bit.
    """
    # Each decision by the frame that revealed its stance, whose time is `told_s`.
    decided: dict[tuple[int, float], Any] = {}
    for row in log.decisions.to_dict("records"):
        decided[row["epoch"], row["told_s"]] = row
    batches: list[NDArray[Any]] = []
    if len(log.frames):
        begins = np.flatnonzero(np.diff(log.frames["taken"])) + 1
        batches = np.split(log.frames, begins)
    buffer = FrameBuffer(max(map(len, batches), default=1))
    machine = _ReplayedMachine(is_armed=True)
    drive = _Replayed(machine, log.axes)
    rows: list[tuple[float, Numbers, Numbers, bool]] = []
    planned = [f"planned_{axis.column}" for axis in log.axes.inputs]

    def compare(made: Decision) -> None:
        before = decided.get((made.epoch, made.told_s))
        if before is None or not _was_called(before):
            return
        then = tuple(before[name] for name in planned)
        is_same = _logged_bits(before, log.axes) == _bits(made)
        rows.append((made.told_s, then, made.planned, is_same))

    loop = _ReplayedLoop(
        buffer,
        observers,
        controller,
        NoActuator(),
        axes=log.axes,
        limits=limits,
        checks=checks,
        machine=machine,
        on_decision=compare,
        clock=lambda: drive.now_s,
    )
    loop.logged = drive
    for batch in batches:
        frames = [Frame(*row.item()[1:]) for row in batch]
        keys = [(frame.epoch, frame.time_s) for frame in frames]
        drive.go_to([decided[key] for key in keys if key in decided], frames[-1])
        for frame in frames:
            buffer.write(frame)
        loop.take(frames)
    return pd.DataFrame(rows, columns=["told_s", "then", "now", "same"])


@dataclass
class _ReplayedMachine(Machine):
    """Has a swing planned where one was planned then, whatever else happens.

    What brought the drive to rest is not all in its log: the time that a driver took is
    not, for instance.
    """

    plans: bool = True

    @property
    def may_swing(self) -> bool:
        return self.plans

    def _make(
        self,
        event: Event,
        at_s: float,
        cause: Message | None,
        *,
        is_kept: bool = True,  # noqa: ARG002 - nothing is kept
    ) -> Step:
        told = Told.NOTHING
        if event is Event.STANCE and self.plans:
            told = Told.SWING
        stays = Transition(DriveState.RUNNING, event, DriveState.RUNNING, told)
        return Step(at_s, stays, cause)


class _ReplayedLoop(ControlLoop):
    """Takes the inputs that the robot had from the log: a rest may have replaced them.

    Where a state shows them, they are measured again.
    """

    logged: _Replayed

    def _inputs_in_force(self) -> Numbers:
        return self.logged.in_force or super()._inputs_in_force()


@dataclass
class _Replayed:
    """The clock of a drive that is replayed, and whether its controller was called."""

    machine: _ReplayedMachine
    axes: StrideAxes
    now_s: float = 0.0
    in_force: Numbers = ()

    def go_to(self, decisions: Sequence[Mapping[str, Any]], last: Frame) -> None:
        """Set both for a batch: as at its last decision, if there is one."""
        if not decisions:
            self.now_s = last.arrival_s
            self.machine.plans = True
            return
        decision = decisions[-1]
        self.now_s = decision["asked_s"]
        self.machine.plans = _was_called(decision)
        self.in_force = _in_force(decision, self.axes)


def _in_force(decision: Mapping[str, Any], axes: StrideAxes) -> Numbers:
    """Return the inputs that the robot had at a stance, by the log."""
    set_by = {axis.set_by: axis.column for axis in axes.states if axis.set_by}
    inputs = []
    for axis in axes.inputs:
        column = set_by.get(axis.name, f"previous_{axis.column}")
        inputs.append(float(decision[column]))
    return tuple(inputs)


def _was_called(decision: Mapping[str, Any]) -> bool:
    """Return whether the controller was called: only then has its planning a time."""
    return bool(np.isfinite(decision["planning_s"]))


def _bits(made: Decision) -> bytes:
    """Return what a plan depends on, and the plan, bit by bit."""
    return np.hstack([made.pose, made.state, made.previous, made.planned]).tobytes()


def _logged_bits(logged: Mapping[str, Any], axes: StrideAxes) -> bytes:
    """Return the same of a decision in a log."""
    numbers = [np.asarray(logged["pose"], dtype=float)]
    names = list(axes.columns[: len(axes.states)])
    for what in ("previous", "planned"):
        names += [f"{what}_{axis.column}" for axis in axes.inputs]
    numbers.append(np.array([logged[name] for name in names], dtype=float))
    return np.hstack(numbers).tobytes()
