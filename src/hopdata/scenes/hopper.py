"""Hopper on preloaded springy legs with a counterweight boom: field, guards and events.

The robot of the dissertation's chapters II and III is modelled as a rigid chassis of
mass M and inertia I with a point mass m at c(t) in the body; m_t = M + m. Let f be the
force of the floor and tau its torque about the chassis' centre of mass O, both in body
axes. With beta = w x (w x c) + 2 w x c' + c'' and mu = m (1 - m / m_t), the two
momentum balances give

    [I + mu (|c|^2 1 - c c^T)] w' = tau - w x I w - (m / m_t) c x f - mu c x beta
    v' = g + R [f / m_t - (m / m_t) (w' x c + beta)].

State and modes are those of the chassis on its legs (`hopdata.scenes.body`); the
parameters p are a flat vector (`hopdata.scenes.hopper_vector`).

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
from hopdata.scenes import hopper_vector as at
from hopdata.scenes.body import (
    CLIMB,
    HEIGHT,
    PITCH,
    ROLL,
    YAW,
    Rotation,
    Vector,
    Wrench,
    after_event,
    angular_velocity,
    cross,
    dot,
    euler_rates,
    legged_system,
    rotation_entries,
    turned,
    turned_back,
    vertical_rate,
)


@kept_njit(error_model="numpy")
def solve_with_point_mass(inertia: Vector, mass: float, c: Vector, b: Vector) -> Vector:
    """Solve ``[diag(inertia) + mass (|c|^2 1 - c c^T)] u = b`` for u.

    The matrix is a diagonal matrix minus a dyad, so the Sherman-Morrison formula
    applies.
    """
    swing = mass * dot(c, c)
    dx = inertia[0] + swing
    dy = inertia[1] + swing
    dz = inertia[2] + swing
    # The diagonal matrix's solutions for the dyad and for the right-hand side.
    g = (c[0] / dx, c[1] / dy, c[2] / dz)
    u = (b[0] / dx, b[1] / dy, b[2] / dz)
    factor = mass * dot(c, u) / (1.0 - mass * dot(c, g))
    return u[0] + factor * g[0], u[1] + factor * g[1], u[2] + factor * g[2]


# The counterweight on its boom: a prescribed swing about a vertical body axis.


@kept_njit(error_model="numpy")
def boom_angle(t: float | FloatArray, p: FloatArray) -> tuple[Any, Any, Any]:
    """Return the boom angle, rad, and its first two time derivatives, at one or many t.

    The boom moves along a cycloid, so its acceleration is continuous at the start and
    the end.
    """
    since_start = (t - p[at.BOOM_START]) / p[at.BOOM_DURATION]
    s = np.minimum(np.maximum(since_start, 0.0), 1.0)
    swing = p[at.BOOM_SWING]
    turn = 2.0 * np.pi
    angle = p[at.BOOM_ANGLE] + swing * (s - np.sin(turn * s) / turn)
    rate = swing * (1.0 - np.cos(turn * s)) / p[at.BOOM_DURATION]
    growth = swing * turn * np.sin(turn * s) / p[at.BOOM_DURATION] ** 2
    return angle, rate, growth


@kept_njit(error_model="numpy")
def boom_motion(t: float, p: FloatArray) -> tuple[Vector, Vector, Vector]:
    """Return the counterweight's position, velocity and acceleration in the body frame.

    In m, m/s and m/s^2.
    """
    angle, rate, growth = boom_angle(t, p)
    x = p[at.BOOM_RADIUS] * np.cos(angle)
    y = p[at.BOOM_RADIUS] * np.sin(angle)
    position = (p[at.BOOM_OFFSET] + x, y, p[at.BOOM_HEIGHT])
    velocity = (-y * rate, x * rate, 0.0)
    acceleration = (-y * growth - x * rate**2, x * growth - y * rate**2, 0.0)
    return position, velocity, acceleration


# Springy legs: their gaps, and the floor's force on the legs in contact.


@kept_njit(error_model="numpy")
def n_legs_of(p: FloatArray) -> int:
    """Return the number of legs, which stays when a derivative moves it a little."""
    return int(p[at.N_LEGS] + 0.5)


@kept_njit(error_model="numpy")
def rest_foot(leg: int, p: FloatArray) -> Vector:
    """Return a leg's foot at rest length, body frame, m."""
    first = at.LEGS + at.LEG_STRIDE * leg
    below = -p[at.LEG_LENGTH] - p[first + at.LONGER]
    return p[first + at.FOOT_X], p[first + at.FOOT_Y], below


@kept_njit(error_model="numpy")
def foot_gap(
    leg: int, y: FloatArray, rot: Rotation, p: FloatArray
) -> tuple[float, float]:
    """Return the gap of a leg, m, and its rate, m/s."""
    foot = rest_foot(leg, p)
    moved = cross(angular_velocity(y), foot)
    gap = y[HEIGHT] + rot[6] * foot[0] + rot[7] * foot[1] + rot[8] * foot[2]
    gap_rate = y[CLIMB] + rot[6] * moved[0] + rot[7] * moved[1] + rot[8] * moved[2]
    return gap, gap_rate


@kept_njit(error_model="numpy")
def foot_lift(
    leg: int, y: FloatArray, dy: FloatArray, rot: Rotation, p: FloatArray
) -> float:
    """Return the acceleration of a leg's gap, m/s^2, for the state's rate `dy`."""
    foot = rest_foot(leg, p)
    moved = cross(angular_velocity(y), foot)
    pushed = cross(angular_velocity(dy), foot)
    by_turning = dot(vertical_rate(y, dy, rot), moved)
    lift = dy[CLIMB] + by_turning
    return lift + rot[6] * pushed[0] + rot[7] * pushed[1] + rot[8] * pushed[2]


@kept_njit(error_model="numpy")
def leg_wrench(leg: int, y: FloatArray, rot: Rotation, p: FloatArray) -> Wrench:
    """Return the floor's force on one leg, N, and its torque about O, N m, body axes.

    The force acts at the floor beneath the foot. The sliding speed is that of the body
    at this point, so friction dissipates energy for any motion of the body.
    """
    gap, gap_rate = foot_gap(leg, y, rot, p)
    preload = p[at.LEGS + at.LEG_STRIDE * leg + at.PRELOAD]
    normal = preload - p[at.STIFFNESS] * gap - p[at.DAMPING] * gap_rate
    # Arm from O to the floor beneath the foot: rest foot minus the gap along world z.
    foot = rest_foot(leg, p)
    arm = (foot[0] - gap * rot[6], foot[1] - gap * rot[7], foot[2] - gap * rot[8])
    moved = cross(angular_velocity(y), arm)
    slide_x = y[6] + rot[0] * moved[0] + rot[1] * moved[1] + rot[2] * moved[2]
    slide_y = y[7] + rot[3] * moved[0] + rot[4] * moved[1] + rot[5] * moved[2]
    slip = p[at.SLIP_VELOCITY] ** 2
    speed = math.sqrt(slide_x * slide_x + slide_y * slide_y + slip)
    drag = -p[at.FRICTION] * normal / speed
    force = turned_back(rot, (drag * slide_x, drag * slide_y, normal))
    return force, cross(arm, force)


@kept_njit(error_model="numpy")
def total_wrench(
    y: FloatArray, mode: IntArray, rot: Rotation, p: FloatArray
) -> tuple[Wrench, int]:
    """Return force and torque of the legs in contact, body axes, and their number."""
    fx = fy = fz = 0.0
    tx = ty = tz = 0.0
    standing = 0
    for leg in range(n_legs_of(p)):
        if mode[leg] > 0:
            force, torque = leg_wrench(leg, y, rot, p)
            fx += force[0]
            fy += force[1]
            fz += force[2]
            tx += torque[0]
            ty += torque[1]
            tz += torque[2]
            standing += 1
    return ((fx, fy, fz), (tx, ty, tz)), standing


@kept_njit(error_model="numpy")
def swing_acceleration(w: Vector, swing: tuple[Vector, Vector, Vector]) -> Vector:
    """Return the counterweight's acceleration in the turning body.

    This is w x (w x c) + 2 w x c' + c'' for its motion (c, c', c'').
    """
    c, velocity, acceleration = swing
    a = cross(w, c)
    doubled = (
        a[0] + 2.0 * velocity[0],
        a[1] + 2.0 * velocity[1],
        a[2] + 2.0 * velocity[2],
    )
    n = cross(w, doubled)
    return n[0] + acceleration[0], n[1] + acceleration[1], n[2] + acceleration[2]


@kept_njit(error_model="numpy")
def body_accelerations(
    w: Vector,
    force: Vector,
    torque: Vector,
    swing: tuple[Vector, Vector, Vector],
    p: FloatArray,
) -> tuple[Vector, Vector]:
    """Return specific force on O and angular acceleration of body and point mass.

    Both are in body axes.
    """
    total = p[at.MASS] + p[at.COUNTERWEIGHT]
    share = p[at.COUNTERWEIGHT] / total
    reduced = p[at.COUNTERWEIGHT] * (1.0 - share)
    inertia = (p[at.INERTIA_X], p[at.INERTIA_Y], p[at.INERTIA_Z])
    c = swing[0]
    beta = swing_acceleration(w, swing)
    spin = (inertia[0] * w[0], inertia[1] * w[1], inertia[2] * w[2])
    gyroscopic = cross(w, spin)
    load = (
        share * force[0] + reduced * beta[0],
        share * force[1] + reduced * beta[1],
        share * force[2] + reduced * beta[2],
    )
    moment = cross(c, load)
    right = (
        torque[0] - gyroscopic[0] - moment[0],
        torque[1] - gyroscopic[1] - moment[1],
        torque[2] - gyroscopic[2] - moment[2],
    )
    turning = solve_with_point_mass(inertia, reduced, c, right)
    s = cross(turning, c)
    specific = (
        force[0] / total - share * (s[0] + beta[0]),
        force[1] / total - share * (s[1] + beta[1]),
        force[2] / total - share * (s[2] + beta[2]),
    )
    return specific, turning


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
    w = angular_velocity(y)
    force, torque = wrench
    specific, turning = body_accelerations(w, force, torque, boom_motion(t, p), p)
    for axis in range(3):
        dy[axis] = y[6 + axis]
    dy[YAW], dy[PITCH], dy[ROLL] = euler_rates(y[PITCH], y[ROLL], w)
    dy[6], dy[7], climbing = turned(rot, specific)
    dy[CLIMB] = climbing - p[at.GRAVITY]
    dy[9], dy[10], dy[11] = turning


@field
def hopper_field(
    t: float, y: FloatArray, mode: IntArray, p: FloatArray, dy: FloatArray
) -> None:
    """Fill `dy` with the state's rate by the Newton-Euler equations above."""
    rot = rotation_entries(y[YAW], y[PITCH], y[ROLL])
    wrench, _standing = total_wrench(y, mode, rot, p)
    fill_rates(t, y, rot, wrench, p, dy)


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
    """Fill `h` and `hdot`: each leg's reach minus its gap, climb rate, excess tilt."""
    n = n_legs_of(p)
    apex = n
    fallen = n + 1
    released = n + 2
    rot = rotation_entries(y[YAW], y[PITCH], y[ROLL])
    tx, ty, tz = vertical_rate(y, dy, rot)
    for leg in range(n):
        foot_x, foot_y, below = rest_foot(leg, p)
        reach = 0.0
        if mode[released + leg] > 0:
            reach = p[at.RELEASE_EXTENSION]
        h[leg] = reach - foot_gap(leg, y, rot, p)[0]
        hdot[leg] = -(dy[HEIGHT] + tx * foot_x + ty * foot_y + tz * below)
    h[apex] = y[CLIMB]
    hdot[apex] = dy[CLIMB]
    h[fallen] = math.cos(p[at.TILT_LIMIT]) - rot[8]
    hdot[fallen] = -tz


@on_event
def hopper_event(
    _t: float, _y: FloatArray, mode: IntArray, p: FloatArray, guard: int, direction: int
) -> int:
    """Release the legs once all stand, re-arm one that lifts off, stop if due."""
    return int(after_event(mode, n_legs_of(p), guard, direction))


@cache
def hopper_system(n_legs: int = 3) -> System:
    """Return the hybrid system of a hopper with `n_legs` legs; see `legged_system`."""
    return legged_system(
        n_legs, field=hopper_field, guards=hopper_guards, on_event=hopper_event
    )
