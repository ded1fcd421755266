"""Strides whose state also holds the last step, of a robot whose speed carries over.

On a slippery floor the speed of one stride carries over into the next. It is not among
the states of the robot, but the step from the last stance to this one tells it. So the
last change of pose becomes three more states, and how it goes on is learned: the next
last step is the change of pose itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import require
from hopdata.steering.models.process import FrameChangeProcess
from hopdata.steering.strides import COMPONENTS, State, StrideAxes, Strides

#: Strides after which the step has settled.
#: Unit: strides. Origin: measured: at a friction of 0.2 a released hopper goes as fast
#: as it will after some 12.
SETTLING = 20
#: Longest time from one stance to the next between which the robot was not put down, in
#: median times.
#: Unit: 1. Origin: chosen: strides differ by a tenth; carrying the hopper back takes
#: three strides.
LONGEST = 1.5

_LAST_STEP = tuple(
    State(name=f"last_{name}", unit=unit)
    for name, unit in zip(COMPONENTS, ("m", "m", "rad"), strict=True)
)


def without_last_step(axes: StrideAxes) -> StrideAxes:
    """Return the axes of the robot itself.

    Raises
    ------
    ConfigError
        If the last step is not among the states.
    """
    found = ", ".join(state.name for state in axes.states) or "none"
    require(has_last_step(axes), "states", "the last step among them", found)
    return replace(axes, linear=axes.linear[: -len(_LAST_STEP)])


def has_last_step(axes: StrideAxes) -> bool:
    """Tell whether the last step is among the states."""
    return axes.linear[-len(_LAST_STEP) :] == _LAST_STEP


def with_last_step(strides: Strides) -> Strides:
    """Return the strides with the last step as three more states.

    Parameters
    ----------
    strides : Strides
        In the order in which they were made, used or not.

    Returns
    -------
    Strides
        Those before which the last step is known: not the first, and not the first
        after the robot was put down.
    """
    gap = np.diff(strides.time_s)
    is_same = strides.recording[1:] == strides.recording[:-1]
    typical = np.median(gap[is_same]) if is_same.any() else np.inf
    follows = is_same & (gap > 0) & (gap <= LONGEST * typical)
    follows &= np.isfinite(strides.change[:-1]).all(axis=1)
    second = np.flatnonzero(follows) + 1
    found = strides.rows(second)
    axes = strides.axes
    last_step = strides.change[second - 1]
    return Strides(
        axes=replace(axes, linear=(*axes.linear, *_LAST_STEP)),
        recording=found.recording,
        time_s=found.time_s,
        state=np.concatenate([found.state, last_step], axis=1),
        inputs=found.inputs,
        change=found.change,
        next_state=np.concatenate([found.next_state, found.change], axis=1),
        reason=found.reason,
    )


@dataclass(frozen=True)
class SettledModel:
    """The model of a robot that has been on its way for a while; a `StrideModel`.

    The last step is not among its states. It is the mean one to which the model itself
    leads, from rest, by any inputs in any states. Strides after a release are shorter
    where speed carries over, so a model that is learned from many of them without their
    last step expects too short ones on the way.

    Parameters
    ----------
    process : FrameChangeProcess
        Learned from strides that `with_last_step` returned.
    """

    process: FrameChangeProcess

    @cached_property
    def axes(self) -> StrideAxes:
        """The axes of the robot itself."""
        return without_last_step(self.process.axes)

    @cached_property
    def last_step(self) -> FloatArray:
        """The mean step on the way, (3,), m, m, rad."""
        n_states = len(self.axes.states)
        points = self.process.points
        state = points[:, :n_states]
        inputs = points[:, len(self.process.axes.states) :]
        step = np.zeros(len(COMPONENTS))
        for _ in range(SETTLING):
            step = self._after(step, state, inputs).mean(axis=0)
        return step

    def change(self, state: ArrayLike, inputs: ArrayLike) -> FloatArray:
        """Return the changes of pose (n, 3), m, m, rad; see `StrideModel`."""
        points = self.axes.points(state, inputs)
        n_states = len(self.axes.states)
        return self._after(self.last_step, points[:, :n_states], points[:, n_states:])

    def next_state(self, state: ArrayLike, inputs: ArrayLike) -> FloatArray:
        """Return the states (n, S) after strides."""
        points = self.axes.points(state, inputs)
        n_states = len(self.axes.states)
        whole = self._with(self.last_step, points[:, :n_states])
        after = self.process.next_state(whole, points[:, n_states:])
        return after[:, :n_states]

    def _after(
        self, step: FloatArray, state: FloatArray, inputs: FloatArray
    ) -> FloatArray:
        """Return the changes of pose after a last step."""
        return self.process.change(self._with(step, state), inputs)

    def _with(self, step: FloatArray, state: FloatArray) -> FloatArray:
        """Return states (n, S + 3) with a last step."""
        return np.column_stack([state, np.tile(step, (len(state), 1))])
