"""A rigid body on legs: its twelve states, its attitude by yaw, pitch and roll, and its events.

State: position of the origin O (world, m), yaw, pitch, roll (rad), velocity of O (world, m/s),
angular velocity (body axes, rad/s). Rotations (z-y'-x'') take body to world coordinates,
``R = Rz(yaw) Ry(pitch) Rx(roll)``.

Modes on n legs, as int64: for each leg +1 while in contact and -1 else, one for the apex, one for a
fall; then for each leg 1 once released; then 1 once any foot has touched.

The compiled helpers work on scalars, so that they allocate nothing inside a vector field, and are
compiled with the field that calls them, in whose cache they are kept.
"""

import math
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.code_cache import kept_njit
from hopdata.hybrid import System

N_STATES = 12

Vector = tuple[float, float, float]
Wrench = tuple[Vector, Vector]  # force and torque
Rotation = tuple[float, float, float, float, float, float, float, float, float]


@kept_njit(error_model="numpy")
def rotation_entries(yaw: float, pitch: float, roll: float) -> Rotation:
    """Return the nine entries of R(yaw, pitch, roll), row by row; angles in rad."""
    cy, sy = np.cos(yaw), np.sin(yaw)
    cp, sp = np.cos(pitch), np.sin(pitch)
    cr, sr = np.cos(roll), np.sin(roll)
    return (
        cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr,
        sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr,
        -sp, cp * sr, cp * cr,
    )  # fmt: skip


@kept_njit(error_model="numpy")
def euler_rates(pitch: float, roll: float, wx: float, wy: float, wz: float) -> Vector:
    """Rates of yaw, pitch and roll, rad/s, of a body turning at (wx, wy, wz) in its own axes.

    Singular at a pitch of +-pi/2.
    """
    cr, sr = math.cos(roll), math.sin(roll)
    yaw_rate = (wy * sr + wz * cr) / math.cos(pitch)
    return yaw_rate, wy * cr - wz * sr, wx + yaw_rate * math.sin(pitch)


@kept_njit(error_model="numpy")
def cross(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> Vector:
    """Cross product a x b of two vectors given by their components."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@kept_njit(error_model="numpy")
def vertical_rate(y: FloatArray, dy: FloatArray, rot: Rotation) -> Vector:
    """Rate of the vertical in body axes (last row of R), when the angles change as `dy` says."""
    by_pitch, by_roll = dy[4], dy[5]
    return (
        -math.cos(y[4]) * by_pitch,
        rot[6] * math.sin(y[5]) * by_pitch + rot[8] * by_roll,
        rot[6] * math.cos(y[5]) * by_pitch - rot[7] * by_roll,
    )


@kept_njit(error_model="numpy")
def after_event(mode: IntArray, n: int, guard: int, direction: int) -> int:
    """Release the n legs once all stand, re-arm one that lifts; 1 at an apex or a fall, which stop.

    An apex counts in flight, once a foot has touched.
    """
    standing = 0
    for leg in range(n):
        standing += mode[leg] > 0
    released, touched = n + 2, 2 * n + 2
    if guard > n:
        return 1
    if guard == n:
        return 1 if standing == 0 and mode[touched] > 0 else 0
    if direction > 0:
        mode[touched] = 1
        if standing == n:
            mode[released : released + n] = 1
    else:
        mode[released + guard] = 0
    return 0


def legged_system(n_legs: int, *, n_states: int = N_STATES, **functions: Any) -> System:
    """Return a body on legs as a hybrid system, by its field, guards and handler.

    The guards are ``foot1`` ... ``foot<n>`` (two-way), ``apex`` (climb rate falling through zero)
    and ``fallen`` (angle between body z-axis and the vertical rising through its limit; stops).
    """
    return System(
        **functions,
        n_states=n_states,
        guard_names=(*(f"foot{leg + 1}" for leg in range(n_legs)), "apex", "fallen"),
        directions=(*(0 for _ in range(n_legs)), -1, 1),
        terminal=(*(False for _ in range(n_legs + 1)), True),
        n_extra_modes=n_legs + 1,
    )


def flight_mode(system: System, climb_rate_m_s: float) -> IntArray:
    """Mode of an upright body in flight that has not touched the floor yet."""
    mode = np.zeros(system.n_modes, dtype=np.int64)
    mode[: system.n_guards] = -1
    mode[system.guard_names.index("apex")] = 1 if climb_rate_m_s > 0 else -1
    return mode


def rotation_matrices(angles: FloatArray) -> FloatArray:
    """Rotation matrices, body to world, of many attitudes.

    Parameters
    ----------
    angles : (..., 3) array
        Yaw, pitch and roll, rad.

    Returns
    -------
    (..., 3, 3) array
    """
    entries = rotation_entries.py_func(*np.moveaxis(angles, -1, 0))
    return np.stack(entries, axis=-1).reshape(*np.shape(angles)[:-1], 3, 3)
