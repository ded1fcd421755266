"""Coordinates of a rigid body on a section: what can vary there, and what a landing makes of it.

On a section the mean of the body markers (the centre) has a given height. With place and heading
left out, eight coordinates remain (the input of a landing): pitch and roll, velocity of the centre
in the heading frame, angular velocity in body axes. The outcome has eleven: the steps of centre and
heading since the pre section, and the same eight at the post section, with the velocity in the
heading frame of the pre section.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.scenes.rigid_body import rotation_matrices

FloatArray = NDArray[np.float64]

INPUT_NAMES = (
    *("pitch_rad", "roll_rad"),
    *("forward_m_s", "sideways_m_s", "climb_m_s"),
    *("spin_x_rad_s", "spin_y_rad_s", "spin_z_rad_s"),
)
OUTPUT_NAMES = ("step_x_m", "step_y_m", "turn_rad", *INPUT_NAMES)

COMPLEX_STEP = 1e-30


def input_coordinates(states: FloatArray, centre_m: FloatArray) -> FloatArray:
    """Coordinates of states (n, 12) at the pre section, (n, 8).

    Parameters
    ----------
    states : (n, 12) array
        See `hopdata.scenes.hopper`.
    centre_m : (3,) array
        Mean of the body markers, body frame, m.
    """
    return _intrinsic(states, centre_m, states[..., 3])


def output_coordinates(pre: FloatArray, post: FloatArray, centre_m: FloatArray) -> FloatArray:
    """Outcome of landings, (n, 11), from their states (n, 12) at both sections."""
    yaw = pre[..., 3]
    step = _turned(_centre(post, centre_m) - _centre(pre, centre_m), yaw)[..., :2]
    turn = (post[..., 3] - yaw)[..., None]
    return np.concatenate([step, turn, _intrinsic(post, centre_m, yaw)], axis=-1)


def section_tangents(pre: FloatArray, centre_m: FloatArray) -> FloatArray:
    """Return the changes of a state (12,) at the pre section by its coordinates, (12, 8).

    Height, place and heading of the centre stay.
    """

    def every(state: Any) -> Any:
        kept = np.concatenate([_centre(state, centre_m), state[..., 3:4]], axis=-1)
        return np.concatenate([kept, input_coordinates(state, centre_m)], axis=-1)

    return np.asarray(np.linalg.inv(derivative(every, pre))[:, 4:])


def output_slopes(pre: FloatArray, post: FloatArray, centre_m: FloatArray) -> FloatArray:
    """Return the derivatives of the outcome by the state at the post section, (11, 12)."""
    return derivative(lambda state: output_coordinates(pre, state, centre_m), post)


def height_slope(state: FloatArray, centre_m: FloatArray) -> FloatArray:
    """Return the derivative of the height of the centre by the state, (12,)."""
    return derivative(lambda y: _centre(y, centre_m)[..., 2:], state)[0]


def derivative(function: Any, state: FloatArray) -> FloatArray:
    """Return the derivative (k, 12) of a function at a state (12,), by complex steps."""
    moved = state + 1j * COMPLEX_STEP * np.eye(len(state))
    return np.asarray(np.array([function(row) for row in moved]).imag.T / COMPLEX_STEP)


def _intrinsic(states: Any, centre_m: FloatArray, yaw: Any) -> Any:
    arm = np.cross(states[..., 9:12], centre_m)
    velocity = states[..., 6:9] + np.einsum(
        "...ij,...j->...i", rotation_matrices(states[..., 3:6]), arm
    )
    return np.concatenate([states[..., 4:6], _turned(velocity, yaw), states[..., 9:12]], axis=-1)


def _centre(states: Any, centre_m: FloatArray) -> Any:
    return states[..., :3] + rotation_matrices(states[..., 3:6]) @ centre_m


def _turned(vectors: Any, yaw: Any) -> Any:
    """Vectors (..., 3) in frames turned by `yaw` about the vertical."""
    c, s = np.cos(yaw), np.sin(yaw)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([c * x + s * y, c * y - s * x, vectors[..., 2]], axis=-1)
