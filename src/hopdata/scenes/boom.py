"""The counterweight on its boom: a prescribed swing about a vertical axis of the body."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hopdata.scenes import hopper_parameters as hp
from hopdata.scenes.rigid_body import Vector

FloatArray = NDArray[np.float64]


@njit(error_model="numpy")
def boom_angle(t: float | FloatArray, p: FloatArray) -> tuple[Any, Any, Any]:
    """Angle of the boom, rad, with its first and second derivative, at a time or an array of times.

    The boom follows a cycloid, whose acceleration is continuous where the move begins and ends.
    """
    s = np.minimum(np.maximum((t - p[hp.BOOM_START]) / p[hp.BOOM_DURATION], 0.0), 1.0)
    swing, turn = p[hp.BOOM_SWING], 2.0 * np.pi
    angle = p[hp.BOOM_ANGLE] + swing * (s - np.sin(turn * s) / turn)
    rate = swing * (1.0 - np.cos(turn * s)) / p[hp.BOOM_DURATION]
    return angle, rate, swing * turn * np.sin(turn * s) / p[hp.BOOM_DURATION] ** 2


@njit(error_model="numpy")
def boom_motion(t: float, p: FloatArray) -> tuple[Vector, Vector, Vector]:
    """Place, velocity and acceleration of the counterweight in the body frame; m, s."""
    angle, rate, growth = boom_angle(t, p)
    x, y = p[hp.BOOM_RADIUS] * np.cos(angle), p[hp.BOOM_RADIUS] * np.sin(angle)
    return (
        (p[hp.BOOM_OFFSET] + x, y, p[hp.BOOM_HEIGHT]),
        (-y * rate, x * rate, 0.0),
        (-y * growth - x * rate**2, x * growth - y * rate**2, 0.0),
    )


def counterweight_places(t: FloatArray, p: FloatArray) -> FloatArray:
    """Places of the counterweight in the body frame at many times, (N, 3), m."""
    angle = boom_angle.py_func(t, p)[0]
    x = p[hp.BOOM_OFFSET] + p[hp.BOOM_RADIUS] * np.cos(angle)
    y = p[hp.BOOM_RADIUS] * np.sin(angle)
    return np.column_stack([x, y, np.full(len(t), p[hp.BOOM_HEIGHT])])
