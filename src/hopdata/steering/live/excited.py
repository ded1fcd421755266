"""An excitation through the live loop: its inputs one by one, and the strides.

To the loop it is a controller like any other. Arming, limits, rests, log and replay are
those of every drive.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import ConfigError
from hopdata.steering.control.interface import Plan
from hopdata.steering.frame_changes import hopper_axes
from hopdata.steering.live.decisions import Decision, is_hopper
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.loop import input_limits
from hopdata.steering.strides import (
    INPUT_MARGIN,
    StrideAxes,
    Strides,
    at_rest,
    recorded_strides,
)

#: How far a measured input may be beyond its limits, as a share of their distance.
#: Unit: 1. Origin: derived: ten times the error of a swing, as `SWING_MARGIN_RAD`.
MEASURED_MARGIN = 0.02

# Outcomes with which the controller's inputs were sent.
_SENT = ("planned", "cut")


class Excitation:
    """Plans one input of a sequence after the other, wherever the robot is.

    After the last one it plans inputs at rest. A pause of the drive is a pause of the
    sequence: it goes on where it stopped.

    Parameters
    ----------
    axes : StrideAxes
        States and inputs of the robot.
    inputs : (n, U) array
        Inputs of each stride, such as those of `hopdata.steering.excitation`.
    limits : Limits, optional
        Those of the drive.

    Attributes
    ----------
    inputs : (n, U) array

    Raises
    ------
    ConfigError
        If there is no stride, a stride has not U finite inputs, or one is beyond the
        limits of the drive.
    """

    def __init__(
        self, axes: StrideAxes, inputs: ArrayLike, limits: Limits | None = None
    ) -> None:
        self.inputs = _checked(axes, inputs, limits or Limits())
        self._rest = at_rest(axes)
        self._n_planned = 0

    @property
    def is_over(self) -> bool:
        """Whether the stance after the last stride has been planned for."""
        return self._n_planned > len(self.inputs)

    def plan(
        self,
        pose: ArrayLike,
        state: ArrayLike,  # noqa: ARG002 - the sequence goes on in any state
        previous_inputs: ArrayLike | None = None,  # noqa: ARG002 - and after any stride
        /,
    ) -> Plan:
        """Return the next inputs of the sequence; nothing is predicted."""
        inputs = self._rest
        if self._n_planned < len(self.inputs):
            inputs = self.inputs[self._n_planned]
        self._n_planned += 1
        poses = np.full((2, 3), np.nan)
        poses[0] = pose
        return Plan(inputs=inputs[None].copy(), poses=poses, objective=math.nan)


def _checked(axes: StrideAxes, inputs: ArrayLike, limits: Limits) -> FloatArray:
    """Return inputs as an array (n, U) within the limits of a drive."""
    n_inputs = len(axes.inputs)
    try:
        rows = np.array(inputs, dtype=float)
    except (TypeError, ValueError, OverflowError):
        rows = np.empty(0)
    if rows.ndim != 2 or rows.shape[1] != n_inputs or not len(rows):
        wanted = f"strides with {n_inputs} of {', '.join(axes.input_names)} each"
        raise ConfigError.at("excitation", wanted, f"an array {rows.shape}")
    lower, upper = input_limits(axes, limits)
    margin = INPUT_MARGIN * (upper - lower)
    # What is not a number is not within limits.
    is_within = (rows >= lower - margin) & (rows <= upper + margin)
    if not is_within.all():
        stride, place = np.argwhere(~is_within)[0]
        column = axes.inputs[place].column
        wanted = f"{column} from {lower[place]:.4g} to {upper[place]:.4g}"
        found = f"{rows[stride, place]:.4g}"
        raise ConfigError.at(f"excitation, stride {stride + 1}", wanted, found)
    return np.clip(rows, lower, upper)


def excited_strides(
    decisions: Sequence[Decision],
    axes: StrideAxes,
    n_inputs: int,
    limits: Limits | None = None,
    *,
    recording: str = "",
) -> Strides:
    """Collect the strides that were made with the inputs of an excitation.

    Parameters
    ----------
    decisions : sequence of Decision
        Those of the drive, in order.
    axes : StrideAxes
        States and inputs of the robot.
    n_inputs : int
        Number of inputs of the excitation.
    limits : Limits, optional
        Those of the drive.
    recording : str
        Name of the drive.

    Returns
    -------
    Strides
        A row for each stride whose inputs were sent and after which the next stance was
        seen, used or not. Inputs are as measured where a state shows them, and
        otherwise as sent.
    """
    limits = limits or Limits()
    if is_hopper(axes):
        axes = hopper_axes(limits.swing_rad)
    n_states = len(axes.states)
    shape = (len(decisions), len(axes.inputs))
    made = np.full(shape, np.nan)
    pairs = _pairs(decisions, n_inputs, limits.hop_s)
    for first, second in pairs:
        made[first] = _within_limits(np.array(decisions[second].previous), axes)
    pose = np.array([_fresh(one.pose, one.pose_age_s, limits) for one in decisions])
    state = np.array([_fresh(one.state, one.state_age_s, limits) for one in decisions])
    return recorded_strides(
        axes,
        time_s=np.array([one.stance_s for one in decisions]),
        pose=pose.reshape(-1, 3),
        state=state.reshape(-1, n_states),
        inputs=made,
        pairs=pairs,
        recording=recording,
    )


def _pairs(decisions: Sequence[Decision], n_inputs: int, hop_s: float) -> IntArray:
    """Return pairs (P, 2) of stances between which inputs of the sequence took effect.

    Only where the controller was called has its planning a time.
    """
    called = [k for k, one in enumerate(decisions) if math.isfinite(one.planning_s)]
    pairs = []
    for first in called[:n_inputs]:
        second = first + 1
        if second == len(decisions) or decisions[first].outcome not in _SENT:
            continue
        begin = decisions[first]
        end = decisions[second]
        passed_s = end.stance_s - begin.stance_s
        if begin.epoch == end.epoch and 0 < passed_s <= hop_s:
            pairs.append((first, second))
    return np.array(pairs, dtype=int).reshape(-1, 2)


def _fresh(values: Sequence[float], age_s: float, limits: Limits) -> FloatArray:
    """Return measurements, or NaN if they are older than a stance may use."""
    numbers = np.array(values, dtype=float)
    return numbers if age_s <= limits.pose_age_s else np.nan * numbers


def _within_limits(measured: FloatArray, axes: StrideAxes) -> FloatArray:
    """Return inputs (U,) at their limits if only an error of measurement is beyond."""
    margin = MEASURED_MARGIN * (axes.upper - axes.lower)
    within = np.clip(measured, axes.lower, axes.upper)
    return np.where(np.abs(measured - within) <= margin, within, measured)
