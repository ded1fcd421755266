"""Hopper on preloaded springy legs with a counterweight boom: field, guards and events.

State (12): position of the chassis' centre of mass O (world, m), yaw, pitch, roll (rad), velocity
of O (world, m/s), angular velocity (body axes, rad/s). Modes: one lock per leg (+1 in contact) and
one for the apex, then for each leg whether it has been released, then whether any foot has touched.

Each leg in contact adds its own force, whatever the others do, and contact depends on position
alone; these two make the flow through a landing continuously differentiable.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hopdata.scenes import hopper_parameters as hp
from hopdata.scenes.rigid_body import cross, euler_rates, rotation_entries, solve_with_point_mass

FloatArray = NDArray[np.float64]
ModeArray = NDArray[np.int64]


def boom(t, p):
    """Place, velocity and acceleration of the counterweight in the body frame; s, m."""
    s = (t - p[hp.BOOM_START]) / p[hp.BOOM_DURATION]
    s = min(max(s, 0.0), 1.0)
    swing, turn = p[hp.BOOM_SWING], 2.0 * math.pi
    phi = p[hp.BOOM_ANGLE] + swing * (s - math.sin(turn * s) / turn)
    rate = swing * (1.0 - math.cos(turn * s)) / p[hp.BOOM_DURATION]
    acceleration = swing * turn * math.sin(turn * s) / p[hp.BOOM_DURATION] ** 2
    x, y = p[hp.BOOM_RADIUS] * math.cos(phi), p[hp.BOOM_RADIUS] * math.sin(phi)
    return (
        (p[hp.BOOM_OFFSET] + x, y, p[hp.BOOM_HEIGHT]),
        (-y * rate, x * rate, 0.0),
        (-y * acceleration - x * rate**2, x * acceleration - y * rate**2, 0.0),
    )
