"""Rigid motions of the plane, SE(2): poses (x, y, heading), m and rad, on the last array axis."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def wrapped(angle: ArrayLike) -> FloatArray:
    """Bring angles to [-pi, pi), rad."""
    return np.asarray((np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi)


def composed(pose: ArrayLike, change: ArrayLike) -> FloatArray:
    """Pose after a motion given in the frame of the pose, (..., 3).

    Headings add up and are not wrapped, so that turns can be counted.
    """
    (x, y, heading), (dx, dy, turn) = _parts(pose), _parts(change)
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([x + c * dx - s * dy, y + s * dx + c * dy, heading + turn], axis=-1)


def inverse(pose: ArrayLike) -> FloatArray:
    """Motion that undoes this one, (..., 3)."""
    x, y, heading = _parts(pose)
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([-c * x - s * y, s * x - c * y, -heading], axis=-1)


def relative(start: ArrayLike, end: ArrayLike) -> FloatArray:
    """Frame change from one pose to another, in the frame of the first, (..., 3): ``g1^-1 g2``.

    The turn is wrapped to [-pi, pi) (dissertation, Sec. 3.4.2).
    """
    change = composed(inverse(start), end)
    change[..., 2] = wrapped(change[..., 2])
    return change


def _parts(pose: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    x, y, heading = np.moveaxis(np.asarray(pose, dtype=float), -1, 0)
    return x, y, heading
