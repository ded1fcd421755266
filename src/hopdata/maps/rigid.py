"""A rigid body on a section: from marker states to the eight coordinates that can vary there.

Three or more markers on one rigid body have 6B coordinates and twelve degrees of freedom. On a
section (one less), and with place and heading left out (three less), eight remain: pitch and roll,
the velocity of the centre in the heading frame, and the angular velocity. The outcome of a landing
is described by eleven: the change of place and heading, and the same eight at the post section.

Angles are those of the body relative to its mean attitude, about axes that turn with its heading,
so they stay small and free of singularities for any body that lands on its feet.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError

INPUT_NAMES = (
    *("pitch_rad", "roll_rad"),
    *("forward_m_s", "sideways_m_s", "climb_m_s"),
    *("spin_x_rad_s", "spin_y_rad_s", "spin_z_rad_s"),
)
OUTPUT_NAMES = ("step_x_m", "step_y_m", "turn_rad", *INPUT_NAMES)

_ALIGNMENTS = 20
_SETTLED = 1e-15  # change of the shape, relative
_LEAST_WIDTH = 1e-3

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class RigidStates:
    """States of a rigid body, in the frame of the markers that gave them.

    Attributes
    ----------
    centre, velocity
        (n, 3) mean of the markers, m, and its velocity, m/s.
    rotation
        (n, 3, 3) from the mean attitude to the present one.
    spin
        (n, 3) angular velocity in body axes, rad/s.
    position_residual_m, velocity_residual_m_s
        Rms per degree of freedom of what a rigid body cannot explain: the noise per coordinate.
    """

    centre: Floats
    velocity: Floats
    rotation: Floats
    spin: Floats
    position_residual_m: float
    velocity_residual_m_s: float


def split_states(states: Floats) -> tuple[Floats, Floats]:
    """Return positions and velocities, (n, B, 3) each, of (n, 6B) states."""
    positions, velocities = np.split(np.asarray(states, float), 2, axis=1)
    shape = (len(states), positions.shape[1] // 3, 3)
    return positions.reshape(shape), velocities.reshape(shape)


def body_shape(positions: Floats) -> Floats:
    """Return the mean shape (B, 3) of marker positions (n, B, 3), centred, in the mean attitude.

    Generalised Procrustes alignment without scaling (Gower 1975).

    Raises
    ------
    AnalysisError
        If there are fewer than three markers, or they lie on a line.
    """
    if positions.shape[1] < 3:
        raise AnalysisError(
            f"rigid body: at least 3 body markers are needed, found {positions.shape[1]}"
        )
    centred = positions - positions.mean(axis=1, keepdims=True)
    shape = centred.mean(axis=0)
    for _ in range(_ALIGNMENTS):
        before = shape
        shape = np.einsum("nji,nbj->bi", kabsch(centred, shape), centred) / len(centred)
        if np.abs(shape - before).max() <= _SETTLED * np.abs(shape).max():
            break
    widths = np.linalg.svd(shape, compute_uv=False)
    if widths[1] < _LEAST_WIDTH * widths[0]:
        raise AnalysisError("rigid body: expected body markers that are not on one line")
    return shape


def kabsch(centred: Floats, shape: Floats) -> Floats:
    """Return the rotations (n, 3, 3) that take `shape` (B, 3) closest to points (n, B, 3).

    Least squares over proper rotations (Kabsch 1976); both are centred.
    """
    left, _, right = np.linalg.svd(np.einsum("nbi,bj->nij", centred, shape))
    handed = np.sign(np.linalg.det(left @ right))
    left[:, :, 2] *= handed[:, None]
    rotation: Floats = left @ right
    return rotation


def rigid_states(states: Floats, shape: Floats) -> RigidStates:
    """Fit a rigid body to marker states.

    Parameters
    ----------
    states
        (n, 6B) positions, m, and velocities, m/s.
    shape
        (B, 3) markers in the body, m; see `body_shape`.
    """
    positions, velocities = split_states(states)
    centre, velocity = positions.mean(axis=1), velocities.mean(axis=1)
    rotation = kabsch(positions - centre[:, None], shape)
    arms = np.einsum("nij,bj->nbi", rotation, shape)
    moving = velocities - velocity[:, None]
    inertia = np.einsum("nbi,nbi->n", arms, arms)[:, None, None] * np.eye(3)
    inertia = inertia - np.einsum("nbi,nbj->nij", arms, arms)
    turning = np.linalg.solve(inertia, np.cross(arms, moving).sum(axis=1)[..., None])[..., 0]
    free = 3 * len(shape) - 6
    misses = positions - centre[:, None] - arms
    slips = moving - np.cross(turning[:, None], arms)
    return RigidStates(
        centre,
        velocity,
        rotation,
        np.einsum("nji,nj->ni", rotation, turning),
        float(np.sqrt((misses**2).sum() / (free * len(misses)))),
        float(np.sqrt((slips**2).sum() / (free * len(slips)))),
    )


def section_coordinates(pre: RigidStates, post: RigidStates) -> tuple[Floats, Floats]:
    """Return inputs (n, 8) and outputs (n, 11): see `INPUT_NAMES`, `OUTPUT_NAMES`.

    Outputs are in the heading frame of the state at the pre section.
    """
    yaw, after = _heading(pre.rotation), _heading(post.rotation)
    step = _turned(post.centre - pre.centre, yaw)[:, :2]
    turn = (after - yaw + np.pi) % (2 * np.pi) - np.pi
    x = np.column_stack([_tilt(pre.rotation), _turned(pre.velocity, yaw), pre.spin])
    y = np.column_stack([_tilt(post.rotation), _turned(post.velocity, yaw), post.spin])
    return x, np.column_stack([step, turn, y])


def input_noise(states: RigidStates, shape: Floats) -> Floats:
    """Return the standard deviations (8,) that marker noise gives to the inputs, in their units."""
    number = np.sqrt(len(shape))
    about = np.sqrt(np.mean((shape**2).sum(axis=1, keepdims=True) - shape**2, axis=0))
    place = states.position_residual_m / number
    speed = states.velocity_residual_m_s / number
    return np.concatenate([place / about[[1, 0]], np.full(3, speed), speed / about])


def output_weights(shape: Floats, time_unit_s: float) -> Floats:
    """Return weights (11,) that turn outputs into rms displacements of the markers, m.

    An angle counts by the rms distance of the markers from its axis, a velocity by the way it
    makes in the unit of time.
    """
    about = np.sqrt(np.mean((shape**2).sum(axis=1, keepdims=True) - shape**2, axis=0))
    tilt = about[[1, 0]]
    position = np.concatenate([[1.0, 1.0, about[2]], tilt])
    return np.concatenate([position, time_unit_s * np.ones(3), time_unit_s * about])


def _heading(rotation: Floats) -> Floats:
    angle: Floats = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])
    return angle


def _tilt(rotation: Floats) -> Floats:
    pitch = -np.arcsin(np.clip(rotation[:, 2, 0], -1.0, 1.0))
    return np.column_stack([pitch, np.arctan2(rotation[:, 2, 1], rotation[:, 2, 2])])


def _turned(vectors: Floats, yaw: Floats) -> Floats:
    """Return vectors (n, 3) in frames turned by `yaw` about the vertical."""
    c, s = np.cos(yaw), np.sin(yaw)
    x, y = vectors[:, 0], vectors[:, 1]
    return np.column_stack([c * x + s * y, c * y - s * x, vectors[:, 2]])
