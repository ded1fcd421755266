"""A rigid body on legs: its twelve states, its yaw-pitch-roll attitude and its events.

The state holds the position of the origin O (world, m), yaw, pitch and roll (rad), the
velocity of O (world, m/s) and the angular velocity (body axes, rad/s). Rotations
(z-y'-x'') map body coordinates to world coordinates: ``R = Rz(yaw) Ry(pitch)
Rx(roll)``.

The mode of a body with n legs is int64: one lock per leg (+1 in contact, otherwise -1),
one for the apex and one for a fall; then one integer per leg, 1 once it is released;
then one that is 1 once any foot has touched.

The compiled helpers take scalars so that a vector field allocates no memory. They are
compiled together with the field that calls them and are cached with it.
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
    """Return the rates of yaw, pitch and roll (rad/s) at the body-axes rate (wx, wy, wz).

    The rates are singular at a pitch of +-pi/2.
    """
    cr, sr = math.cos(roll), math.sin(roll)
    yaw_rate = (wy * sr + wz * cr) / math.cos(pitch)
    return yaw_rate, wy * cr - wz * sr, wx + yaw_rate * math.sin(pitch)


@kept_njit(error_model="numpy")
def cross(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> Vector:
    """Return the cross product a x b of two vectors given by their components."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@kept_njit(error_model="numpy")
def vertical_rate(y: FloatArray, dy: FloatArray, rot: Rotation) -> Vector:
    """Return the rate of the vertical in body axes (last row of R) for the state's rate `dy`."""
    by_pitch, by_roll = dy[4], dy[5]
    return (
        -math.cos(y[4]) * by_pitch,
        rot[6] * math.sin(y[5]) * by_pitch + rot[8] * by_roll,
        rot[6] * math.cos(y[5]) * by_pitch - rot[7] * by_roll,
    )


@kept_njit(error_model="numpy")
def after_event(mode: IntArray, n: int, guard: int, direction: int) -> int:
    """Update the mode after an event and return 1 if the event ends the integration, else 0.

    The n legs are released once all of them stand; a leg that lifts off is re-armed. A
    fall always ends the integration. An apex ends it in flight, once a foot has
    touched.
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
    """Return the hybrid system of a body on legs with the given field, guards and handler.

    The guards are ``foot1`` ... ``foot<n>`` (two-way), ``apex`` (the climb rate falls
    through zero) and ``fallen`` (the angle between the body z-axis and the vertical
    exceeds its limit; terminal).
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
    """Return the mode of an upright body in flight that has not touched the floor yet."""
    mode = np.zeros(system.n_modes, dtype=np.int64)
    mode[: system.n_guards] = -1
    mode[system.guard_names.index("apex")] = 1 if climb_rate_m_s > 0 else -1
    return mode


def rotation_matrices(angles: FloatArray) -> FloatArray:
    """Return the body-to-world rotation matrices of many attitudes.

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
