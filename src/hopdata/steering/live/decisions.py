"""The decision at a stance, and how a controller is asked for its inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from hopdata.messages import Message
from hopdata.steering.control.interface import Controller
from hopdata.steering.frame_changes import HOPPER
from hopdata.steering.strides import StrideAxes

DecisionOutcome = Literal["planned", "cut", "held", "overtaken", "waiting"]

Numbers: TypeAlias = tuple[float, ...]


@dataclass(frozen=True)
class Decision:
    """A stance and the resulting command.

    States and inputs are those of the robot's axes (`StrideAxes`): S and U numbers.

    Parameters
    ----------
    stance_s : float
        Time of the stance, camera time, s.
    told_s : float
        Camera time of the frame that revealed it, s.
    epoch : int
        The camera clock of these times; see `hopdata.steering.live.buffer.Frame`.
    pose : (x_m, y_m, heading_rad)
        Pose of the frame nearest to the stance, of those up to the frame that revealed
        it; NaN if there was none.
    state : tuple of S floats
        Newest states up to that frame; one that an input sets is the input last sent.
        NaN if unknown.
    previous : tuple of U floats
        Inputs of the stride that led here: as measured, if a state shows them, or as
        they were sent; NaN if unknown.
    asked_s : float
        Time of the decision on the loop's clock, s.
    pose_age_s, state_age_s : float
        Ages of the newest pose and of the newest measured states up to that frame, at
        the decision, s.
    outcome : str
        "planned": the controller's command was sent. "cut": so it was, clipped to the
        limits. "held": the inputs at rest were sent, for `reason`. "overtaken": nothing
        was sent, since another stance had been seen in the meantime. "waiting": nothing
        was sent, since the operator has not armed the drive.
    planned : tuple of U floats
        The controller's inputs; NaN if it was not called, or failed.
    command : tuple of U floats
        Inputs that were sent; NaN if none.
    planning_s : float
        Time that the controller took, s; NaN if it was not called.
    latency_s : float
        From the arrival of the frame that revealed the stance to the command, s.
    since_stance_s : float
        From the stance itself to the command, s.
    reason : Message or None
        Why the planned inputs were not sent as they are.
    """

    stance_s: float
    told_s: float
    epoch: int
    pose: tuple[float, float, float]
    state: Numbers
    previous: Numbers
    asked_s: float
    pose_age_s: float
    state_age_s: float
    outcome: DecisionOutcome
    planned: Numbers
    command: Numbers
    planning_s: float
    latency_s: float
    since_stance_s: float
    reason: Message | None

    # The hopper's: one state and one input.

    @property
    def boom_angle_rad(self) -> float:
        """The hopper's boom angle, rad."""
        return self.state[0]

    @property
    def swung_rad(self) -> float:
        """The hopper's preceding swing as measured, rad."""
        return self.previous[0]

    @property
    def planned_rad(self) -> float:
        """The swing that was planned, rad."""
        return self.planned[0]

    @property
    def command_rad(self) -> float:
        """The swing that was sent, rad."""
        return self.command[0]


def is_hopper(axes: StrideAxes) -> bool:
    """Return whether axes are those of the steered hopper."""
    same_states = [one.name for one in axes.states] == [
        one.name for one in HOPPER.states
    ]
    return same_states and axes.input_names == HOPPER.input_names


def moved_part(axes: StrideAxes) -> str:
    """Return what messages call the part that inputs move: the boom, or by its input.

    The hopper's swing moves its boom; of other robots only the inputs have names.
    """
    if is_hopper(axes):
        return "boom"
    return " and ".join(name.replace("_", " ") for name in axes.input_names)


def planned_inputs(
    controller: Controller,
    axes: StrideAxes,
    pose: Any,
    state: Sequence[float],
    previous: Sequence[float] | None,
) -> Numbers:
    """Ask a controller for the inputs (U,) of the next stride.

    The hopper's controllers are given its boom angle and swing as numbers, and need to
    plan no more than a `swing_rad`.
    """
    if is_hopper(axes):
        swung = None if previous is None else previous[0]
        return (float(controller.plan(pose, state[0], swung).swing_rad),)
    before = None if previous is None else np.array(previous)
    plan = controller.plan(pose, np.array(state), before)
    first = np.asarray(plan.inputs, dtype=float)[0]
    return tuple(first.tolist())
