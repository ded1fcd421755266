"""A rigid body on legs: its twelve states, its yaw-pitch-roll attitude and its events.

The state holds the position of the origin O (world, m), yaw, pitch and roll (rad), the
velocity of O (world, m/s) and the angular velocity (body axes, rad/s). Rotations
(z-y'-x'') map body coordinates to world coordinates: ``R = Rz(yaw) Ry(pitch)
Rx(roll)``.

The mode of a body with n legs is int64: one lock per leg (+1 in contact, otherwise -1),
one for the apex and one for a fall; then one integer per leg, 1 once it is released;
then one that is 1 once any foot has touched.

The compiled helpers take numbers and tuples of numbers so that a vector field allocates
no memory. They are compiled together with the field that calls them and are cached with
it.
"""

import math
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.code_cache import kept_njit
from hopdata.hybrid import System

N_STATES = 12

#: Names of the states, with their units: the position of the origin, yaw, pitch and
#: roll, the velocity of the origin, and the angular velocity in body axes.
STATE_NAMES = (
    "x_m",
    "y_m",
    "z_m",
    "yaw_rad",
    "pitch_rad",
    "roll_rad",
    "vx_m_s",
    "vy_m_s",
    "vz_m_s",
    "wx_rad_s",
    "wy_rad_s",
    "wz_rad_s",
)

# Indices into the state: height of O, the attitude, and the climb rate.
HEIGHT = 2
YAW = 3
PITCH = 4
ROLL = 5
CLIMB = 8

Vector = tuple[float, float, float]
Wrench = tuple[Vector, Vector]  # force and torque
Rotation = tuple[float, float, float, float, float, float, float, float, float]


@kept_njit(error_model="numpy")
def rotation_entries(yaw: float, pitch: float, roll: float) -> Rotation:
    """Return the nine entries of R(yaw, pitch, roll), row by row; angles in rad."""
    cy = np.cos(yaw)
    sy = np.sin(yaw)
    cp = np.cos(pitch)
    sp = np.sin(pitch)
    cr = np.cos(roll)
    sr = np.sin(roll)
    return (
        cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr,
        sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr,
        -sp, cp * sr, cp * cr,
    )  # fmt: skip


@kept_njit(error_model="numpy")
def turned(rot: Rotation, v: Vector) -> Vector:
    """Return R v: a vector in body axes, in world axes."""
    return (
        rot[0] * v[0] + rot[1] * v[1] + rot[2] * v[2],
        rot[3] * v[0] + rot[4] * v[1] + rot[5] * v[2],
        rot[6] * v[0] + rot[7] * v[1] + rot[8] * v[2],
    )


@kept_njit(error_model="numpy")
def turned_back(rot: Rotation, v: Vector) -> Vector:
    """Return R^T v: a vector in world axes, in body axes."""
    return (
        rot[0] * v[0] + rot[3] * v[1] + rot[6] * v[2],
        rot[1] * v[0] + rot[4] * v[1] + rot[7] * v[2],
        rot[2] * v[0] + rot[5] * v[1] + rot[8] * v[2],
    )


@kept_njit(error_model="numpy")
def angular_velocity(y: FloatArray) -> Vector:
    """Return the angular velocity in a state, or its rate in a state's rate."""
    return y[9], y[10], y[11]


@kept_njit(error_model="numpy")
def euler_rates(pitch: float, roll: float, w: Vector) -> Vector:
    """Return the rates of yaw, pitch and roll, rad/s, at the angular velocity w.

    The rates are singular at a pitch of +-pi/2.
    """
    cr = math.cos(roll)
    sr = math.sin(roll)
    yaw_rate = (w[1] * sr + w[2] * cr) / math.cos(pitch)
    pitch_rate = w[1] * cr - w[2] * sr
    roll_rate = w[0] + yaw_rate * math.sin(pitch)
    return yaw_rate, pitch_rate, roll_rate


@kept_njit(error_model="numpy")
def dot(a: Vector, b: Vector) -> float:
    """Return the inner product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kept_njit(error_model="numpy")
def cross(a: Vector, b: Vector) -> Vector:
    """Return the cross product a x b."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@kept_njit(error_model="numpy")
def vertical_rate(y: FloatArray, dy: FloatArray, rot: Rotation) -> Vector:
    """Return the rate of the vertical in body axes for the state's rate `dy`.

    The vertical in body axes is the last row of R.
    """
    by_pitch = dy[PITCH]
    by_roll = dy[ROLL]
    return (
        -math.cos(y[PITCH]) * by_pitch,
        rot[6] * math.sin(y[ROLL]) * by_pitch + rot[8] * by_roll,
        rot[6] * math.cos(y[ROLL]) * by_pitch - rot[7] * by_roll,
    )


@kept_njit(error_model="numpy")
def after_event(mode: IntArray, n: int, guard: int, direction: int) -> int:
    """Update the mode after an event and return 1 if it ends the integration, else 0.

    The n legs are released once all of them stand; a leg that lifts off is re-armed. A
    fall always ends the integration. An apex ends it in flight, once a foot has
    touched.
    """
    apex = n
    fallen = n + 1
    released = n + 2
    touched = 2 * n + 2
    standing = 0
    for leg in range(n):
        if mode[leg] > 0:
            standing += 1
    if guard == fallen:
        return 1
    if guard == apex:
        return 1 if standing == 0 and mode[touched] > 0 else 0
    if direction > 0:
        mode[touched] = 1
        if standing == n:
            mode[released : released + n] = 1
    else:
        mode[released + guard] = 0
    return 0


def legged_system(n_legs: int, *, n_states: int = N_STATES, **functions: Any) -> System:
    """Return the system of a body on legs with the given field, guards and handler.

    The guards are ``foot1`` ... ``foot<n>`` (two-way), ``apex`` (the climb rate falls
    through zero) and ``fallen`` (the angle between the body z-axis and the vertical
    exceeds its limit; terminal).
    """
    feet = [f"foot{leg + 1}" for leg in range(n_legs)]
    return System(
        **functions,
        n_states=n_states,
        guard_names=(*feet, "apex", "fallen"),
        directions=(*(0 for _ in feet), -1, 1),
        terminal=(*(False for _ in feet), False, True),
        n_extra_modes=n_legs + 1,
    )


def flight_mode(system: System, climb_rate_m_s: float) -> IntArray:
    """Return the mode of an upright body in flight that has not touched the floor."""
    mode = np.zeros(system.n_modes, dtype=np.int64)
    mode[: system.n_guards] = -1
    if climb_rate_m_s > 0:
        mode[system.guard_names.index("apex")] = 1
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
    angles = np.asarray(angles)
    entries = rotation_entries.py_func(angles[..., 0], angles[..., 1], angles[..., 2])
    # Filled entry by entry, in a third of the time of `np.stack`.
    rows = np.empty((*angles.shape[:-1], 9), dtype=entries[0].dtype)
    for k, entry in enumerate(entries):
        rows[..., k] = entry
    return rows.reshape(*angles.shape[:-1], 3, 3)
