"""Springy legs: their gaps, and the force of the floor on those in contact."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hopdata.scenes import hopper_parameters as hp
from hopdata.scenes.rigid_body import Rotation, Vector, cross

FloatArray = NDArray[np.float64]
ModeArray = NDArray[np.int64]


@njit(error_model="numpy")
def foot_gap(leg: int, y: FloatArray, rot: Rotation, p: FloatArray) -> tuple[float, float]:
    """Gap of a leg, m, and its rate, m/s."""
    k = hp.LEGS + hp.LEG_STRIDE * leg
    px, py, pz = p[k + 1], p[k + 2], -p[hp.LEG_LENGTH]
    sx, sy, sz = cross(y[9], y[10], y[11], px, py, pz)
    gap = y[2] + rot[6] * px + rot[7] * py + rot[8] * pz
    return gap, y[8] + rot[6] * sx + rot[7] * sy + rot[8] * sz


@njit(error_model="numpy")
def vertical_rate(y: FloatArray, dy: FloatArray, rot: Rotation) -> Vector:
    """Rate of the vertical in body axes (last row of R), when the angles change as `dy` says."""
    by_pitch, by_roll = dy[4], dy[5]
    return (
        -math.cos(y[4]) * by_pitch,
        rot[6] * math.sin(y[5]) * by_pitch + rot[8] * by_roll,
        rot[6] * math.cos(y[5]) * by_pitch - rot[7] * by_roll,
    )


@njit(error_model="numpy")
def gap_rate_along(leg: int, y: FloatArray, dy: FloatArray, rot: Rotation, p: FloatArray) -> float:
    """Rate of a leg's gap, m/s, when the state changes at the rate `dy`."""
    k = hp.LEGS + hp.LEG_STRIDE * leg
    tx, ty, tz = vertical_rate(y, dy, rot)
    return dy[2] + tx * p[k + 1] + ty * p[k + 2] - tz * p[hp.LEG_LENGTH]


@njit(error_model="numpy")
def foot_lift(leg: int, y: FloatArray, dy: FloatArray, rot: Rotation, p: FloatArray) -> float:
    """Acceleration of a leg's gap, m/s^2, when the state changes at the rate `dy`."""
    k = hp.LEGS + hp.LEG_STRIDE * leg
    px, py, pz = p[k + 1], p[k + 2], -p[hp.LEG_LENGTH]
    sx, sy, sz = cross(y[9], y[10], y[11], px, py, pz)
    ax, ay, az = cross(dy[9], dy[10], dy[11], px, py, pz)
    tx, ty, tz = vertical_rate(y, dy, rot)
    turned = tx * sx + ty * sy + tz * sz
    return dy[8] + turned + rot[6] * ax + rot[7] * ay + rot[8] * az


@njit(error_model="numpy")
def leg_wrench(leg: int, y: FloatArray, rot: Rotation, p: FloatArray) -> tuple[Vector, Vector]:
    """Force of the floor on one leg and its torque about O, both in body axes; N, N m.

    It acts at the floor under the foot; the sliding speed is that of the body there, so that
    friction takes power from the body whatever its motion.
    """
    gap, gap_rate = foot_gap(leg, y, rot, p)
    k = hp.LEGS + hp.LEG_STRIDE * leg
    normal = p[k] - p[hp.STIFFNESS] * gap - p[hp.DAMPING] * gap_rate
    # Arm from O to the floor under the foot, in body axes: rest foot less the gap along world z.
    qx = p[k + 1] - gap * rot[6]
    qy = p[k + 2] - gap * rot[7]
    qz = -p[hp.LEG_LENGTH] - gap * rot[8]
    sx, sy, sz = cross(y[9], y[10], y[11], qx, qy, qz)
    vx = y[6] + rot[0] * sx + rot[1] * sy + rot[2] * sz
    vy = y[7] + rot[3] * sx + rot[4] * sy + rot[5] * sz
    drag = -p[hp.FRICTION] * normal / math.sqrt(vx * vx + vy * vy + p[hp.SLIP_VELOCITY] ** 2)
    fx, fy = drag * vx, drag * vy
    bx = rot[0] * fx + rot[3] * fy + rot[6] * normal
    by = rot[1] * fx + rot[4] * fy + rot[7] * normal
    bz = rot[2] * fx + rot[5] * fy + rot[8] * normal
    return (bx, by, bz), cross(qx, qy, qz, bx, by, bz)


@njit(error_model="numpy")
def total_wrench(
    y: FloatArray, mode: ModeArray, rot: Rotation, p: FloatArray
) -> tuple[Vector, Vector]:
    """Sum of force and torque over the legs in contact, in body axes."""
    fx, fy, fz, tx, ty, tz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for leg in range(int(p[hp.N_LEGS])):
        if mode[leg] > 0:
            force, torque = leg_wrench(leg, y, rot, p)
            fx, fy, fz = fx + force[0], fy + force[1], fz + force[2]
            tx, ty, tz = tx + torque[0], ty + torque[1], tz + torque[2]
    return (fx, fy, fz), (tx, ty, tz)
