"""Quadruped that pronks: a rigid body on four compliant legs whose feet stay where they touch.

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
    N_STATES,
    Rotation,
    Vector,
    after_event,
    cross,
    euler_rates,
    legged_system,
    rotation_entries,
    vertical_rate,
)
from hopdata.scenes.scene import Scene, Variant, parameter

N_LEGS = 4
APEX, FALLEN, RELEASED = N_LEGS, N_LEGS + 1, N_LEGS + 2

# Indices into the flat vector: the fields of `Quadruped` in order, then the preloads
# and kappa.
(
    MASS,
    INERTIA_X,
    INERTIA_Y,
    INERTIA_Z,
    STIFFNESS,
    DAMPING,
    SIDE_STIFFNESS,
    SIDE_DAMPING,
) = range(8)
HALF_LENGTH, HALF_WIDTH, LEG_LENGTH, RELEASE_EXTENSION, TILT_LIMIT, GRAVITY = range(
    9, 15
)
PRELOADS, COUPLING = 15, 15 + N_LEGS


@kept_njit(error_model="numpy")
def rest_place(leg: int, p: FloatArray) -> Vector:
    """Return a leg's foot at rest length, body frame, m: left and right in front, then behind."""
    x = p[HALF_LENGTH] if leg < 2 else -p[HALF_LENGTH]
    return x, p[HALF_WIDTH] if leg % 2 == 0 else -p[HALF_WIDTH], -p[LEG_LENGTH]


@kept_njit(error_model="numpy")
def turned(rot: Rotation, x: float, y: float, z: float) -> Vector:
    """Return the vector R (x, y, z)."""
    return (
        rot[0] * x + rot[1] * y + rot[2] * z,
        rot[3] * x + rot[4] * y + rot[5] * z,
        rot[6] * x + rot[7] * y + rot[8] * z,
    )


@kept_njit(error_model="numpy")
def rest_motion(
    leg: int, y: FloatArray, rot: Rotation, p: FloatArray
) -> tuple[Vector, Vector]:
    """Return a rest foot's position relative to O, m, and its velocity, m/s, in world axes."""
    bx, by, bz = rest_place(leg, p)
    sx, sy, sz = cross(y[9], y[10], y[11], bx, by, bz)
    ux, uy, uz = turned(rot, sx, sy, sz)
    return turned(rot, bx, by, bz), (y[6] + ux, y[7] + uy, y[8] + uz)


@field
def quadruped_field(
    _t: float, y: FloatArray, mode: IntArray, p: FloatArray, dy: FloatArray
) -> None:
    """Fill `dy` with the state's rate (Newton-Euler equations, see the module docstring)."""
    rot = rotation_entries(y[3], y[4], y[5])
    fx, fy, fz, tx, ty, tz, standing = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0
    dy[N_STATES:] = 0.0
    for leg in range(N_LEGS):
        if mode[leg] > 0:
            k = N_STATES + 2 * leg
            (rx, ry, rz), (vx, vy, vz) = rest_motion(leg, y, rot, p)
            px = -p[SIDE_STIFFNESS] * y[k] - p[SIDE_DAMPING] * vx
            py = -p[SIDE_STIFFNESS] * y[k + 1] - p[SIDE_DAMPING] * vy
            pz = p[PRELOADS + leg] - p[STIFFNESS] * (y[2] + rz) - p[DAMPING] * vz
            qx, qy, qz = cross(rx, ry, rz, px, py, pz)
            fx, fy, fz, tx, ty, tz = (
                fx + px,
                fy + py,
                fz + pz,
                tx + qx,
                ty + qy,
                tz + qz,
            )
            dy[k], dy[k + 1] = vx, vy
            standing += 1
    share = 1.0 + p[COUPLING] * (standing - N_LEGS)
    per_mass = share / p[MASS]
    ix, iy, iz = p[INERTIA_X], p[INERTIA_Y], p[INERTIA_Z]
    gx, gy, gz = cross(y[9], y[10], y[11], ix * y[9], iy * y[10], iz * y[11])
    dy[0], dy[1], dy[2] = y[6], y[7], y[8]
    dy[3], dy[4], dy[5] = euler_rates(y[4], y[5], y[9], y[10], y[11])
    dy[6], dy[7], dy[8] = per_mass * fx, per_mass * fy, per_mass * fz - p[GRAVITY]
    dy[9] = (share * (rot[0] * tx + rot[3] * ty + rot[6] * tz) - gx) / ix
    dy[10] = (share * (rot[1] * tx + rot[4] * ty + rot[7] * tz) - gy) / iy
    dy[11] = (share * (rot[2] * tx + rot[5] * ty + rot[8] * tz) - gz) / iz


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
    """Fill `h` and `hdot`: each leg's reach minus its foot's height, climb rate, tilt."""
    rot = rotation_entries(y[3], y[4], y[5])
    tx, ty, tz = vertical_rate(y, dy, rot)
    for leg in range(N_LEGS):
        bx, by, bz = rest_place(leg, p)
        reach = p[RELEASE_EXTENSION] if mode[RELEASED + leg] > 0 else 0.0
        h[leg] = reach - (y[2] + rot[6] * bx + rot[7] * by + rot[8] * bz)
        hdot[leg] = -(dy[2] + tx * bx + ty * by + tz * bz)
    h[APEX], hdot[APEX] = y[8], dy[8]
    h[FALLEN], hdot[FALLEN] = math.cos(p[TILT_LIMIT]) - rot[8], -tz


@on_event
def quadruped_event(
    _t: float, y: FloatArray, mode: IntArray, _p: FloatArray, guard: int, direction: int
) -> int:
    """Release the legs once all stand, free a foot that lifts off, stop at an apex or a fall."""
    if guard < N_LEGS and direction < 0:
        y[N_STATES + 2 * guard], y[N_STATES + 2 * guard + 1] = 0.0, 0.0
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
    """Parameters of the quadruped, in SI units. Feet 1 and 2 are in front, 1 and 3 on the left."""

    controls: ClassVar[tuple[str, ...]] = ("coupling",)
    feet_slide: ClassVar[bool] = False

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
        """Return the flat parameter vector; its last entry is the coupling."""
        scalars = [getattr(self, one.name) for one in fields(self)]
        preloads = np.broadcast_to(
            self.preload_n if preloads_n is None else preloads_n, N_LEGS
        )
        return np.array([*scalars, *preloads, variant.numbers[0] if variant else 0.0])
