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
from hopdata.steering.live.actuator import NoBoom
from hopdata.steering.live.buffer import Frame, FrameBuffer
from hopdata.steering.live.checks import FrameChecks
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.log_reading import LoggedDrive
from hopdata.steering.live.loop import ControlLoop, Decision, Observers
from hopdata.steering.live.machine import (
    DriveState,
    Event,
    Machine,
    Step,
    Told,
    Transition,
)


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
        drive and now (``then_rad, now_rad``), and ``same``, whether inputs and swing
        are identical to the bit.
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
    drive = _Replayed(machine)
    rows: list[tuple[float, float, float, bool]] = []

    def compare(made: Decision) -> None:
        before = decided.get((made.epoch, made.told_s))
        if before is None or not _was_called(before):
            return
        is_same = _bits(before) == _bits(vars(made))
        rows.append((made.told_s, before["planned_rad"], made.planned_rad, is_same))

    loop = ControlLoop(
        buffer,
        observers,
        controller,
        NoBoom(),
        limits=limits,
        checks=checks,
        machine=machine,
        on_decision=compare,
        clock=lambda: drive.now_s,
    )
    for batch in batches:
        frames = [Frame(*row.item()[1:]) for row in batch]
        keys = [(frame.epoch, frame.time_s) for frame in frames]
        drive.go_to([decided[key] for key in keys if key in decided], frames[-1])
        for frame in frames:
            buffer.write(frame)
        loop.take(frames)
    return pd.DataFrame(rows, columns=["told_s", "then_rad", "now_rad", "same"])


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


@dataclass
class _Replayed:
    """The clock of a drive that is replayed, and whether its controller was called."""

    machine: _ReplayedMachine
    now_s: float = 0.0

    def go_to(self, decisions: Sequence[Mapping[str, Any]], last: Frame) -> None:
        """Set both for a batch: as at its last decision, if there is one."""
        if not decisions:
            self.now_s = last.arrival_s
            self.machine.plans = True
            return
        decision = decisions[-1]
        self.now_s = decision["asked_s"]
        self.machine.plans = _was_called(decision)


def _was_called(decision: Mapping[str, Any]) -> bool:
    """Return whether the controller was called: only then has its planning a time."""
    return bool(np.isfinite(decision["planning_s"]))


def _bits(decision: Mapping[str, Any]) -> bytes:
    """Return what a plan depends on, and the plan, bit by bit."""
    names = ("pose", "boom_angle_rad", "swung_rad", "planned_rad")
    numbers = [np.asarray(decision[name], dtype=float) for name in names]
    return np.hstack(numbers).tobytes()
