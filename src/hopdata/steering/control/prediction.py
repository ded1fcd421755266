"""One-step prediction, and what follows stride after stride.

A stride from the pose g with states s and inputs u leads to the pose g d(s, u), where
the model says the change of pose d, and to the states that the model says, too.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.rigid import turned
from hopdata.steering.models.interface import StrideModel
from hopdata.steering.strides import StrideAxes


def predicted_change(
    model: StrideModel, state: FloatArray, inputs: FloatArray
) -> FloatArray:
    """Return the changes of pose (..., 3) by states (..., S) and inputs (..., U)."""
    states, commands, shape = _rows(state, inputs)
    return np.asarray(model.change(states, commands)).reshape(*shape, 3)


def next_state(model: StrideModel, state: FloatArray, inputs: FloatArray) -> FloatArray:
    """Return the states (..., S) after a stride; angles are not wrapped."""
    moving = moving_inputs(model.axes)
    if moving is not None:
        return np.asarray(state + inputs[..., moving])
    states, commands, shape = _rows(state, inputs)
    after = np.asarray(model.next_state(states, commands))
    return after.reshape(*shape, len(model.axes.states))


def _rows(
    state: FloatArray, inputs: FloatArray
) -> tuple[FloatArray, FloatArray, tuple[int, ...]]:
    """Return states and inputs as rows (n, S) and (n, U), and their common shape."""
    shape = np.broadcast_shapes(state.shape[:-1], inputs.shape[:-1])
    n_rows = math.prod(shape)
    states = np.broadcast_to(state, (*shape, state.shape[-1]))
    commands = np.broadcast_to(inputs, (*shape, inputs.shape[-1]))
    of_state = states.reshape(n_rows, state.shape[-1])
    return of_state, commands.reshape(n_rows, inputs.shape[-1]), shape


@cache
def moving_inputs(axes: StrideAxes) -> list[int] | None:
    """Return the number of the input that is added to each state in a stride.

    None if another rule holds for any of them.
    """
    if not all(state.moved_by for state in axes.states):
        return None
    return [axes.input_names.index(state.moved_by) for state in axes.states]


def predicted_poses(
    model: StrideModel, pose: ArrayLike, state: ArrayLike, inputs: ArrayLike
) -> FloatArray:
    """Return poses (H + 1, ..., 3) of a robot with one input, by inputs (..., H).

    See `poses_ahead`.
    """
    return poses_ahead(model, pose, state, np.asarray(inputs, dtype=float)[..., None])


def poses_ahead(
    model: StrideModel, pose: ArrayLike, state: ArrayLike, inputs: FloatArray
) -> FloatArray:
    """Return poses (H + 1, ..., 3) after inputs (..., H, U), the present one first.

    They follow Sec. 3.4.1.
    """
    commanded = np.moveaxis(inputs, -2, 0)
    start = np.asarray(state, dtype=float).reshape(-1)
    before = _states_before(model, start, commanded)
    change = predicted_change(model, before, commanded)
    present = np.broadcast_to(pose, change[:1].shape)
    steps = np.concatenate([present, change])
    # Each change of pose is turned to the world by the heading before it.
    headings = np.cumsum(steps[:-1, ..., 2], axis=0)
    steps[1:] = turned(change, -headings)
    return np.cumsum(steps, axis=0)


def _states_before(
    model: StrideModel, state: FloatArray, inputs: FloatArray
) -> FloatArray:
    """Return the states (H, ..., S) before each of the strides (H, ..., U)."""
    moving = moving_inputs(model.axes)
    if moving is not None:  # all at once
        steps = inputs[..., moving]
        return np.asarray(state + np.cumsum(steps, axis=0) - steps)
    before = [np.broadcast_to(state, (*inputs.shape[1:-1], len(state)))]
    for commanded in inputs[:-1]:
        before.append(next_state(model, before[-1], commanded))
    return np.array(before)
