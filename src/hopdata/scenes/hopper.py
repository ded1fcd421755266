"""Hopper on preloaded springy legs with a counterweight boom: field, guards and events.

The robot of the dissertation's chapters II and III is modelled as a rigid chassis of
mass M and inertia I with a point mass m at c(t) in the body; m_t = M + m. Let f be the
force of the floor and tau its torque about the chassis' centre of mass O, both in body
axes. With beta = w x (w x c) + 2 w x c' + c'' and mu = m (1 - m / m_t), the two
momentum balances give

    [I + mu (|c|^2 1 - c c^T)] w' = tau - w x I w - (m / m_t) c x f - mu c x beta
    v' = g + R [f / m_t - (m / m_t) (w' x c + beta)].

State and modes are those of the chassis on its legs (`hopdata.scenes.body`).

The gap of a foot is its height at rest length above the floor, the plane z = 0. A leg
in contact pushes with F0 - k gap - c dgap/dt. Contact begins at touchdown, gap = 0, and
ends at lift-off: at gap = e if all legs have stood in the meantime, which restores
energy. Each leg adds its own force independently of the others, and contact depends on
position alone. These two properties make the flow through a landing continuously
differentiable.
"""

import math
from functools import cache
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.code_cache import kept_njit
from hopdata.hybrid import System, field, guards, on_event
from hopdata.scenes import hopper_parameters as hp
from hopdata.scenes.body import (
    Rotation,
    Vector,
    Wrench,
    after_event,
    cross,
    euler_rates,
    legged_system,
    rotation_entries,
    vertical_rate,
)


@kept_njit(error_model="numpy")
def solve_with_point_mass(
    ix: float, iy: float, iz: float, mass: float, c: Vector, b: Vector
) -> Vector:
    """Solve ``[diag(ix, iy, iz) + mass (|c|^2 1 - c c^T)] u = b`` for u.

    The matrix is a diagonal matrix minus a dyad, so the Sherman-Morrison formula
    applies.
    """
    cx, cy, cz = c
    swing = mass * (cx * cx + cy * cy + cz * cz)
    dx, dy, dz = ix + swing, iy + swing, iz + swing
    gx, gy, gz = cx / dx, cy / dy, cz / dz
    ux, uy, uz = b[0] / dx, b[1] / dy, b[2] / dz
    factor = (
        mass
        * (cx * ux + cy * uy + cz * uz)
        / (1.0 - mass * (cx * gx + cy * gy + cz * gz))
    )
    return ux + factor * gx, uy + factor * gy, uz + factor * gz


# The counterweight on its boom: a prescribed swing about a vertical body axis.


@kept_njit(error_model="numpy")
def boom_angle(t: float | FloatArray, p: FloatArray) -> tuple[Any, Any, Any]:
    """Return the boom angle (rad) and its first two time derivatives at one or many times.

    The boom moves along a cycloid, so its acceleration is continuous at the start and
    the end.
    """
    s = np.minimum(np.maximum((t - p[hp.BOOM_START]) / p[hp.BOOM_DURATION], 0.0), 1.0)
    swing, turn = p[hp.BOOM_SWING], 2.0 * np.pi
    angle = p[hp.BOOM_ANGLE] + swing * (s - np.sin(turn * s) / turn)
    rate = swing * (1.0 - np.cos(turn * s)) / p[hp.BOOM_DURATION]
    return angle, rate, swing * turn * np.sin(turn * s) / p[hp.BOOM_DURATION] ** 2


@kept_njit(error_model="numpy")
def boom_motion(t: float, p: FloatArray) -> tuple[Vector, Vector, Vector]:
    """Return position, velocity and acceleration of the counterweight in the body frame (m, s)."""
    angle, rate, growth = boom_angle(t, p)
    x, y = p[hp.BOOM_RADIUS] * np.cos(angle), p[hp.BOOM_RADIUS] * np.sin(angle)
    return (
        (p[hp.BOOM_OFFSET] + x, y, p[hp.BOOM_HEIGHT]),
        (-y * rate, x * rate, 0.0),
        (-y * growth - x * rate**2, x * growth - y * rate**2, 0.0),
    )


# Springy legs: their gaps, and the floor's force on the legs in contact.


@kept_njit(error_model="numpy")
def foot_gap(
    leg: int, y: FloatArray, rot: Rotation, p: FloatArray
) -> tuple[float, float]:
    """Return the gap of a leg, m, and its rate, m/s."""
    k = hp.LEGS + hp.LEG_STRIDE * leg
    px, py, pz = p[k + 1], p[k + 2], -p[hp.LEG_LENGTH]
    sx, sy, sz = cross(y[9], y[10], y[11], px, py, pz)
    gap = y[2] + rot[6] * px + rot[7] * py + rot[8] * pz
    return gap, y[8] + rot[6] * sx + rot[7] * sy + rot[8] * sz


@kept_njit(error_model="numpy")
def foot_lift(
    leg: int, y: FloatArray, dy: FloatArray, rot: Rotation, p: FloatArray
) -> float:
    """Return the acceleration of a leg's gap, m/s^2, for the state's rate `dy`."""
    k = hp.LEGS + hp.LEG_STRIDE * leg
    px, py, pz = p[k + 1], p[k + 2], -p[hp.LEG_LENGTH]
    sx, sy, sz = cross(y[9], y[10], y[11], px, py, pz)
    ax, ay, az = cross(dy[9], dy[10], dy[11], px, py, pz)
    tx, ty, tz = vertical_rate(y, dy, rot)
    turned = tx * sx + ty * sy + tz * sz
    return dy[8] + turned + rot[6] * ax + rot[7] * ay + rot[8] * az


@kept_njit(error_model="numpy")
def leg_wrench(leg: int, y: FloatArray, rot: Rotation, p: FloatArray) -> Wrench:
    """Return the floor's force on one leg (N) and its torque about O (N m), both in body axes.

    The force acts at the floor beneath the foot. The sliding speed is that of the body
    at this point, so friction dissipates energy for any motion of the body.
    """
    gap, gap_rate = foot_gap(leg, y, rot, p)
    k = hp.LEGS + hp.LEG_STRIDE * leg
    normal = p[k] - p[hp.STIFFNESS] * gap - p[hp.DAMPING] * gap_rate
    # Arm from O to the floor beneath the foot, body axes: rest foot minus the gap along
    # world z.
    qx = p[k + 1] - gap * rot[6]
    qy = p[k + 2] - gap * rot[7]
    qz = -p[hp.LEG_LENGTH] - gap * rot[8]
    sx, sy, sz = cross(y[9], y[10], y[11], qx, qy, qz)
    vx = y[6] + rot[0] * sx + rot[1] * sy + rot[2] * sz
    vy = y[7] + rot[3] * sx + rot[4] * sy + rot[5] * sz
    drag = (
        -p[hp.FRICTION]
        * normal
        / math.sqrt(vx * vx + vy * vy + p[hp.SLIP_VELOCITY] ** 2)
    )
    fx, fy = drag * vx, drag * vy
    bx = rot[0] * fx + rot[3] * fy + rot[6] * normal
    by = rot[1] * fx + rot[4] * fy + rot[7] * normal
    bz = rot[2] * fx + rot[5] * fy + rot[8] * normal
    return (bx, by, bz), cross(qx, qy, qz, bx, by, bz)


@kept_njit(error_model="numpy")
def total_wrench(
    y: FloatArray, mode: IntArray, rot: Rotation, p: FloatArray
) -> tuple[Wrench, int]:
    """Return total force and torque of the legs in contact (body axes) and the number of legs."""
    fx, fy, fz, tx, ty, tz, standing = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0
    for leg in range(int(p[hp.N_LEGS])):
        if mode[leg] > 0:
            force, torque = leg_wrench(leg, y, rot, p)
            fx, fy, fz = fx + force[0], fy + force[1], fz + force[2]
            tx, ty, tz = tx + torque[0], ty + torque[1], tz + torque[2]
            standing += 1
    return ((fx, fy, fz), (tx, ty, tz)), standing


@kept_njit(error_model="numpy")
def swing_acceleration(w: Vector, c: Vector, c1: Vector, c2: Vector) -> Vector:
    """Return the counterweight's acceleration in the turning body: w x (w x c) + 2 w x c' + c''."""
    ax, ay, az = cross(w[0], w[1], w[2], c[0], c[1], c[2])
    nx, ny, nz = cross(
        w[0], w[1], w[2], ax + 2.0 * c1[0], ay + 2.0 * c1[1], az + 2.0 * c1[2]
    )
    return nx + c2[0], ny + c2[1], nz + c2[2]


@kept_njit(error_model="numpy")
def body_accelerations(
    w: Vector,
    force: Vector,
    torque: Vector,
    swing: tuple[Vector, Vector, Vector],
    p: FloatArray,
) -> tuple[Vector, Vector]:
    """Return specific force on O and angular acceleration of body and point mass, in body axes."""
    total = p[hp.MASS] + p[hp.COUNTERWEIGHT]
    share = p[hp.COUNTERWEIGHT] / total
    c = swing[0]
    beta = swing_acceleration(w, c, swing[1], swing[2])
    ix, iy, iz = p[hp.INERTIA_X], p[hp.INERTIA_Y], p[hp.INERTIA_Z]
    gx, gy, gz = cross(w[0], w[1], w[2], ix * w[0], iy * w[1], iz * w[2])
    reduced = p[hp.COUNTERWEIGHT] * (1.0 - share)
    lx = share * force[0] + reduced * beta[0]
    ly = share * force[1] + reduced * beta[1]
    lz = share * force[2] + reduced * beta[2]
    ax, ay, az = cross(c[0], c[1], c[2], lx, ly, lz)
    right = (torque[0] - gx - ax, torque[1] - gy - ay, torque[2] - gz - az)
    turn = solve_with_point_mass(ix, iy, iz, reduced, c, right)
    sx, sy, sz = cross(turn[0], turn[1], turn[2], c[0], c[1], c[2])
    specific = (
        force[0] / total - share * (sx + beta[0]),
        force[1] / total - share * (sy + beta[1]),
        force[2] / total - share * (sz + beta[2]),
    )
    return specific, turn


@kept_njit(error_model="numpy")
def fill_rates(
    t: float,
    y: FloatArray,
    rot: Rotation,
    wrench: Wrench,
    p: FloatArray,
    dy: FloatArray,
) -> None:
    """Fill `dy` with the state's rate under a force and a torque in body axes."""
    w = (y[9], y[10], y[11])
    a, turn = body_accelerations(w, wrench[0], wrench[1], boom_motion(t, p), p)
    dy[0], dy[1], dy[2] = y[6], y[7], y[8]
    dy[3], dy[4], dy[5] = euler_rates(y[4], y[5], y[9], y[10], y[11])
    dy[6] = rot[0] * a[0] + rot[1] * a[1] + rot[2] * a[2]
    dy[7] = rot[3] * a[0] + rot[4] * a[1] + rot[5] * a[2]
    dy[8] = rot[6] * a[0] + rot[7] * a[1] + rot[8] * a[2] - p[hp.GRAVITY]
    dy[9], dy[10], dy[11] = turn


@field
def hopper_field(
    t: float, y: FloatArray, mode: IntArray, p: FloatArray, dy: FloatArray
) -> None:
    """Fill `dy` with the state's rate (Newton-Euler equations, see the module docstring)."""
    rot = rotation_entries(y[3], y[4], y[5])
    fill_rates(t, y, rot, total_wrench(y, mode, rot, p)[0], p, dy)


@guards
def hopper_guards(
    _t: float,
    y: FloatArray,
    dy: FloatArray,
    mode: IntArray,
    p: FloatArray,
    h: FloatArray,
    hdot: FloatArray,
) -> None:
    """Fill `h` and `hdot`: each leg's reach minus its gap, climb rate, tilt beyond its limit."""
    n = int(p[hp.N_LEGS])
    rot = rotation_entries(y[3], y[4], y[5])
    tx, ty, tz = vertical_rate(y, dy, rot)
    for leg in range(n):
        k = hp.LEGS + hp.LEG_STRIDE * leg
        reach = p[hp.RELEASE_EXTENSION] if mode[n + 2 + leg] > 0 else 0.0
        h[leg] = reach - foot_gap(leg, y, rot, p)[0]
        hdot[leg] = -(dy[2] + tx * p[k + 1] + ty * p[k + 2] - tz * p[hp.LEG_LENGTH])
    h[n], hdot[n] = y[8], dy[8]
    h[n + 1], hdot[n + 1] = math.cos(p[hp.TILT_LIMIT]) - rot[8], -tz


@on_event
def hopper_event(
    _t: float, _y: FloatArray, mode: IntArray, p: FloatArray, guard: int, direction: int
) -> int:
    """Release the legs once all stand, re-arm a leg that lifts off, stop at an apex or a fall."""
    return int(after_event(mode, int(p[hp.N_LEGS]), guard, direction))


@cache
def hopper_system(n_legs: int = 3) -> System:
    """Return the hybrid system of a hopper with `n_legs` legs; see `legged_system`."""
    return legged_system(
        n_legs, field=hopper_field, guards=hopper_guards, on_event=hopper_event
    )
