"""Dimensionless coordinates of the verdict: inputs, outcomes, and feet.

Lengths are in units of the markers' rms distance from their mean, speeds in units of
the body's speed at the pre section. The axes are those of the body with its mean
attitude upright. The heading of a body is its twist about the vertical; its tilt is the
direction of the vertical in the body. Another frame for the states therefore turns all
coordinates together and linearly, and no result depends on it.
"""

from dataclasses import dataclass

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import AnalysisError
from hopdata.maps.coordinates import RigidStates, rigid_states, split_states
from hopdata.maps.corrected.marker_noise import MarkerNoise, marker_noise
from hopdata.messages import Message
from hopdata.rigid import body_shape, turned, twists, wrapped

#: Larger non-rigid speeds of markers mean mixed-up columns.
#: Unit: share of the body's speed. Origin: chosen.
MOST_APART = 0.5


@dataclass(frozen=True)
class Dimensionless:
    """States of n landings without units.

    Attributes
    ----------
    before, after
        (n, 6B) states of the markers at the two sections.
    shape
        (B, 3) markers in the upright body.
    noise
        Noise of a marker's coordinate before the landing.
    length
        Unit of length, in that of the given states.
    """

    before: FloatArray
    after: FloatArray
    shape: FloatArray
    noise: MarkerNoise
    length: float


def without_units(x: FloatArray, y: FloatArray) -> Dimensionless:
    """Return the states (n, 6B) at both sections in units of size and speed.

    Raises
    ------
    AnalysisError
        If the body does not move, or its markers move apart.
    """
    shape = body_shape(split_states(x)[0])
    pre = rigid_states(x, shape)
    upright = shape @ _upright_axes(pre).T
    speed = float(np.sqrt(np.mean(pre.velocity**2)))
    if not speed > 0:
        raise AnalysisError(Message("maps.body_at_rest"))
    noise = marker_noise(x, upright)
    apart = np.sqrt(noise.velocity) / speed
    if apart > MOST_APART:
        share = {"share": f"{apart:.2g}"}
        raise AnalysisError(Message("maps.markers_move_apart", share))
    length = float(np.sqrt(np.mean(upright**2)))
    units = np.repeat([length, speed], x.shape[1] // 2)
    return Dimensionless(
        before=x / units,
        after=y / units,
        shape=upright / length,
        noise=MarkerNoise(
            position=noise.position / length**2,
            shared=noise.shared / (length * speed),
            velocity=noise.velocity / speed**2,
        ),
        length=length,
    )


def _upright_axes(pre: RigidStates) -> FloatArray:
    """Return axes (3, 3) of the body, of which the third is up in its mean attitude."""
    up = pre.rotation[:, 2].mean(axis=0)
    least_upright = np.eye(3)[np.argmin(np.abs(up))]
    across = np.cross(least_upright, up)
    axes = np.stack([across, np.cross(up, across), up])
    return np.asarray(axes / np.linalg.norm(axes, axis=1, keepdims=True))


def state_inputs(pre: RigidStates) -> FloatArray:
    """Return tilt, velocity and spin (n, 8) at the pre section."""
    heading = twists(pre.rotation)
    tilt = _tilt(pre.rotation, heading)
    velocity = turned(pre.velocity, heading)
    return np.column_stack([tilt, velocity, pre.spin])


def outcomes(pre: RigidStates, post: RigidStates, shape: FloatArray) -> FloatArray:
    """Return the outcome (n, 11), as motions of the markers of this shape (B, 3)."""
    heading = twists(pre.rotation)
    heading_after = twists(post.rotation)
    step = turned(post.centre - pre.centre, heading)[:, :2]
    tilt = _tilt(post.rotation, heading_after)
    turns = np.column_stack([tilt, wrapped(heading_after - heading)])
    velocity = turned(post.velocity, heading)
    root = marker_root(shape)  # makes motions of the markers of turns and spins
    return np.column_stack([step, turns @ root, velocity, post.spin @ root])


def feet_about_body(pre: RigidStates, feet: FloatArray) -> FloatArray:
    """Return the feet (n, feet, 3) about the body's centre, along its heading."""
    heading = twists(pre.rotation)
    about = feet - pre.centre[:, None]
    return np.stack(
        [turned(about[:, foot], heading) for foot in range(feet.shape[1])], axis=1
    )


def _tilt(rotation: FloatArray, heading: FloatArray) -> FloatArray:
    """Return the tilt (n, 2) about the two level axes of the heading frame, rad."""
    up = turned(rotation[:, :, 2], heading)
    return np.column_stack([-up[:, 1], up[:, 0]])


def marker_root(shape: FloatArray) -> FloatArray:
    """Return the matrix (3, 3) from turns about the axes to rms motions of markers."""
    squared_size = np.mean(np.sum(shape**2, axis=1)) * np.eye(3)
    mean_square = squared_size - shape.T @ shape / len(shape)
    return np.asarray(np.linalg.cholesky(mean_square))
