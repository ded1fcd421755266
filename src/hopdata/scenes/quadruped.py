"""Quadruped that pronks: a rigid body on four legs whose feet stay where they touch.

Let r be the position of a leg's rest foot, v its velocity, and d its displacement since
the foot touched. The floor pushes a leg in contact, at r, with the force

    (-k_s d_x - c_s v_x,  -k_s d_y - c_s v_y,  F0 - k r_z - c v_z).

Contact begins at touchdown, r_z = 0, and ends at lift-off: at r_z = e if all legs have
stood in the meantime, which restores energy. The Newton-Euler equations are m v' = sum
F - m g and I w' = R^T sum (r - O) x F - w x I w.

The state has 20 entries: the body's (`hopdata.scenes.body`), then (d_x, d_y) of each
leg, which are integrated in contact and reset to zero at lift-off. The modes are those
of `hopdata.scenes.body`.

Each leg adds its own force and contact depends on position alone, so the flow through a
landing is continuously differentiable. A coupling kappa multiplies all forces by 1 +
kappa (s - 4) while s legs are in contact, and makes the flow non-differentiable.
"""

import math
from dataclasses import dataclass, fields
from functools import partial
from typing import ClassVar

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.code_cache import kept_njit
from hopdata.hybrid import System, field, guards, on_event
from hopdata.scenes.body import (
    CLIMB,
    HEIGHT,
    N_STATES,
    PITCH,
    ROLL,
    STATE_NAMES,
    YAW,
    Rotation,
    Vector,
    after_event,
    angular_velocity,
    cross,
    euler_rates,
    legged_system,
    rotation_entries,
    turned,
    turned_back,
    vertical_rate,
)
from hopdata.scenes.scene import Scene, Variant, parameter

N_LEGS = 4

# Indices of the guards after the feet, and of the first leg's release in the mode.
APEX = N_LEGS
FALLEN = N_LEGS + 1
RELEASED = N_LEGS + 2

# Indices into the flat vector: the fields of `Quadruped` in order, then the preloads,
# kappa, and how much longer than usual each leg is.
MASS = 0
INERTIA_X = 1
INERTIA_Y = 2
INERTIA_Z = 3
STIFFNESS = 4
DAMPING = 5
SIDE_STIFFNESS = 6
SIDE_DAMPING = 7
HALF_LENGTH = 9
HALF_WIDTH = 10
LEG_LENGTH = 11
RELEASE_EXTENSION = 12
TILT_LIMIT = 13
GRAVITY = 14
PRELOADS = 15
COUPLING = PRELOADS + N_LEGS
LONGER = COUPLING + 1


@kept_njit(error_model="numpy")
def rest_place(leg: int, p: FloatArray) -> Vector:
    """Return a leg's foot at rest length, body frame, m.

    Left and right in front come first, then left and right behind.
    """
    x = p[HALF_LENGTH]
    if leg >= 2:
        x = -x
    y = p[HALF_WIDTH]
    if leg % 2 == 1:
        y = -y
    return x, y, -p[LEG_LENGTH] - p[LONGER + leg]


@kept_njit(error_model="numpy")
def rest_motion(
    leg: int, y: FloatArray, rot: Rotation, p: FloatArray
) -> tuple[Vector, Vector]:
    """Return a rest foot's place relative to O, m, and velocity, m/s, world axes."""
    foot = rest_place(leg, p)
    moved = turned(rot, cross(angular_velocity(y), foot))
    velocity = (y[6] + moved[0], y[7] + moved[1], y[8] + moved[2])
    return turned(rot, foot), velocity


@kept_njit(error_model="numpy")
def leg_force(
    leg: int, y: FloatArray, place: Vector, velocity: Vector, p: FloatArray
) -> Vector:
    """Return the floor's force on a leg in contact, world axes, N.

    The two states of the leg are its foot's way aside since touchdown.
    """
    aside = N_STATES + 2 * leg
    return (
        -p[SIDE_STIFFNESS] * y[aside] - p[SIDE_DAMPING] * velocity[0],
        -p[SIDE_STIFFNESS] * y[aside + 1] - p[SIDE_DAMPING] * velocity[1],
        p[PRELOADS + leg]
        - p[STIFFNESS] * (y[HEIGHT] + place[2])
        - p[DAMPING] * velocity[2],
    )


@field
def quadruped_field(
    _t: float, y: FloatArray, mode: IntArray, p: FloatArray, dy: FloatArray
) -> None:
    """Fill `dy` with the state's rate by the Newton-Euler equations above."""
    rot = rotation_entries(y[YAW], y[PITCH], y[ROLL])
    dy[N_STATES:] = 0.0
    fx = fy = fz = 0.0
    tx = ty = tz = 0.0
    standing = 0
    for leg in range(N_LEGS):
        if mode[leg] > 0:
            place, velocity = rest_motion(leg, y, rot, p)
            force = leg_force(leg, y, place, velocity, p)
            torque = cross(place, force)
            fx += force[0]
            fy += force[1]
            fz += force[2]
            tx += torque[0]
            ty += torque[1]
            tz += torque[2]
            dy[N_STATES + 2 * leg] = velocity[0]
            dy[N_STATES + 2 * leg + 1] = velocity[1]
            standing += 1
    share = 1.0 + p[COUPLING] * (standing - N_LEGS)
    per_mass = share / p[MASS]
    w = angular_velocity(y)
    spin = (p[INERTIA_X] * w[0], p[INERTIA_Y] * w[1], p[INERTIA_Z] * w[2])
    gyroscopic = cross(w, spin)
    torque = turned_back(rot, (tx, ty, tz))
    for axis in range(3):
        dy[axis] = y[6 + axis]
    dy[YAW], dy[PITCH], dy[ROLL] = euler_rates(y[PITCH], y[ROLL], w)
    dy[6] = per_mass * fx
    dy[7] = per_mass * fy
    dy[CLIMB] = per_mass * fz - p[GRAVITY]
    for axis in range(3):
        moment = share * torque[axis] - gyroscopic[axis]
        dy[9 + axis] = moment / p[INERTIA_X + axis]


@guards
def quadruped_guards(
    _t: float,
    y: FloatArray,
    dy: FloatArray,
    mode: IntArray,
    p: FloatArray,
    h: FloatArray,
    hdot: FloatArray,
) -> None:
    """Fill `h` and `hdot`: each leg's reach minus its height, climb rate, tilt."""
    rot = rotation_entries(y[YAW], y[PITCH], y[ROLL])
    tx, ty, tz = vertical_rate(y, dy, rot)
    for leg in range(N_LEGS):
        bx, by, bz = rest_place(leg, p)
        reach = 0.0
        if mode[RELEASED + leg] > 0:
            reach = p[RELEASE_EXTENSION]
        h[leg] = reach - (y[HEIGHT] + rot[6] * bx + rot[7] * by + rot[8] * bz)
        hdot[leg] = -(dy[HEIGHT] + tx * bx + ty * by + tz * bz)
    h[APEX] = y[CLIMB]
    hdot[APEX] = dy[CLIMB]
    h[FALLEN] = math.cos(p[TILT_LIMIT]) - rot[8]
    hdot[FALLEN] = -tz


@on_event
def quadruped_event(
    _t: float, y: FloatArray, mode: IntArray, _p: FloatArray, guard: int, direction: int
) -> int:
    """Release the legs once all stand, free a foot that lifts off, stop if due."""
    if guard < N_LEGS and direction < 0:
        y[N_STATES + 2 * guard] = 0.0
        y[N_STATES + 2 * guard + 1] = 0.0
    return int(after_event(mode, N_LEGS, guard, direction))


positive = partial(parameter, exclusiveMinimum=0)

SYSTEM = legged_system(
    N_LEGS,
    n_states=N_STATES + 2 * N_LEGS,
    field=quadruped_field,
    guards=quadruped_guards,
    on_event=quadruped_event,
)


@dataclass(frozen=True, kw_only=True)
class Quadruped(Scene):
    """Parameters of the quadruped, in SI units.

    Feet 1 and 2 are in front, 1 and 3 on the left.
    """

    controls: ClassVar[tuple[str, ...]] = ("coupling",)
    feet_slide: ClassVar[bool] = False
    legs_can_scatter: ClassVar[bool] = True

    mass_kg: float = positive(2.7, "Mass of the body.", "kg")
    inertia_x_kg_m2: float = positive(
        0.06, "Moment of inertia of the body about its long axis.", "kg m²"
    )
    inertia_y_kg_m2: float = positive(
        0.1, "Moment of inertia of the body about its lateral axis.", "kg m²"
    )
    inertia_z_kg_m2: float = positive(
        0.13, "Moment of inertia of the body about its vertical axis.", "kg m²"
    )
    stiffness_n_m: float = positive(
        67.5, "Stiffness of a leg along the vertical.", "N/m"
    )
    damping_n_s_m: float = parameter(
        3.6, "Damping of a leg along the vertical.", "N s/m", minimum=0
    )
    side_stiffness_n_m: float = parameter(
        60.0,
        "Stiffness of a leg against moving aside from its foothold.",
        "N/m",
        minimum=0,
    )
    side_damping_n_s_m: float = parameter(
        10.0, "Damping of a leg against moving aside.", "N s/m", minimum=0
    )
    preload_n: float = parameter(
        16.5,
        "Force of a leg at its rest length; the contact force jumps to it.",
        "N",
        minimum=0,
    )
    half_length_m: float = positive(
        0.3, "Distance of the feet ahead of or behind the centre.", "m"
    )
    half_width_m: float = positive(
        0.22, "Distance of the feet to the left or right of it.", "m"
    )
    leg_length_m: float = positive(
        0.27, "Height of the centre of mass above the feet at rest length.", "m"
    )
    release_extension_m: float = parameter(
        0.125,
        "How far beyond its rest length a leg pushes once all have stood.",
        "m",
        minimum=0,
    )
    tilt_limit_rad: float = parameter(
        1.0,
        "Tilt beyond which the quadruped has fallen.",
        "rad",
        exclusiveMinimum=0,
        maximum=np.pi,
    )
    gravity_m_s2: float = parameter(
        9.81, "Acceleration due to gravity.", "m/s²", minimum=0
    )

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states: the body's, then how far each leg has moved aside."""
        legs = range(1, N_LEGS + 1)
        aside = [f"foot{leg}_d{axis}_m" for leg in legs for axis in "xy"]
        return (*STATE_NAMES, *aside)

    def rest_feet(self) -> FloatArray:
        """Return the feet at rest length, (4, 3), body frame, m."""
        vector = self.vector()
        return np.array([rest_place.py_func(leg, vector) for leg in range(N_LEGS)])

    def system(self, _variant: Variant | None = None) -> System:
        """Return the hybrid system, which serves the control as well."""
        return SYSTEM

    def vector(
        self, preloads_n: FloatArray | None = None, variant: Variant | None = None
    ) -> FloatArray:
        """Return the flat parameter vector."""
        scalars = [getattr(self, one.name) for one in fields(self)]
        if preloads_n is None:
            preloads_n = np.full(N_LEGS, self.preload_n)
        coupling = 0.0 if variant is None else variant.numbers[0]
        return np.array([*scalars, *preloads_n, coupling, *np.zeros(N_LEGS)])

    def lengthened(self, vectors: FloatArray, longer_m: FloatArray) -> FloatArray:
        """Return parameter vectors with legs that are longer than usual."""
        changed = vectors.copy()
        changed[..., LONGER : LONGER + N_LEGS] = longer_m
        return changed
