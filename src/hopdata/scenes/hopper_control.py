"""Controls of the hopper: three ways to break what makes its landing continuously differentiable.

Each has a strength; with all strengths zero the control is the hopper itself.

- Coupling: the force of each leg is multiplied by 1 + kappa (s - n), with s of the n legs in
  contact. Forces are no longer additive.
- Impulse: at touchdown an impulse at the foot, along the vertical, takes the fraction eps of the
  foot's normal velocity. The state jumps. An impulse at one foot also moves the others, so that the
  state after a simultaneous contact depends on the order, unless the feet are orthogonal in the
  inertia (Pace and Burden 2017).
- Delay: contact is at gap + tau dgap/dt = 0. Guards depend on velocity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.errors import ConfigError
from hopdata.hybrid import System, field, guards, on_event
from hopdata.scenes import hopper_parameters as hp
from hopdata.scenes.hopper import (
    N_STATES,
    body_accelerations,
    boom_motion,
    cross,
    fill_rates,
    foot_gap,
    foot_lift,
    hopper_event,
    hopper_guards,
    hopper_system,
    rotation_entries,
    total_wrench,
    vertical_rate,
)
from hopdata.scenes.hopper_parameters import HopperParameters

# The strengths follow the legs' numbers at the end of the parameters.
COUPLING, IMPULSE, DELAY = -3, -2, -1

_guards = njit(error_model="numpy")(hopper_guards.function)
_event = njit(error_model="numpy")(hopper_event.function)


@dataclass(frozen=True, kw_only=True)
class HopperControl:
    """Strengths of the three controls.

    Parameters
    ----------
    coupling : float
        kappa: change of each leg's force for every leg more in contact, as a fraction.
    impulse : float
        eps: fraction of a foot's normal velocity that touchdown takes by an impulse.
    delay_s : float
        tau: time by which contact runs ahead of the gap (positive: before the foot is down), s.
    """

    coupling: float = 0.0
    impulse: float = 0.0
    delay_s: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.impulse <= 1:
            raise ValueError(f"impulse: expected 0 to 1, found {self.impulse}")

    @property
    def active(self) -> bool:
        """Whether any strength differs from zero."""
        return (self.coupling, self.impulse, self.delay_s) != (0.0, 0.0, 0.0)

    def system(self, n_legs: int) -> System:
        """Return `control_system` with this number of legs."""
        return control_system(n_legs)

    def vector(self, hopper: HopperParameters, preloads_n: FloatArray | None = None) -> FloatArray:
        """Flat parameter vector: the hopper's, then the strengths."""
        return np.append(hopper.vector(preloads_n), [self.coupling, self.impulse, self.delay_s])


@field
def control_field(t: float, y: FloatArray, mode: IntArray, p: FloatArray, dy: FloatArray) -> None:
    """Fill `dy` with the rate of the state; the forces of the legs are coupled."""
    rot = rotation_entries(y[3], y[4], y[5])
    force, torque = total_wrench(y, mode, rot, p)
    n, standing = int(p[hp.N_LEGS]), 0
    for leg in range(n):
        standing += mode[leg] > 0
    share = 1.0 + p[COUPLING] * (standing - n)
    coupled = (
        (share * force[0], share * force[1], share * force[2]),
        (share * torque[0], share * torque[1], share * torque[2]),
    )
    fill_rates(t, y, rot, coupled, p, dy)


@guards
def control_guards(
    t: float,
    y: FloatArray,
    dy: FloatArray,
    mode: IntArray,
    p: FloatArray,
    h: FloatArray,
    hdot: FloatArray,
) -> None:
    """Fill `h` and `hdot` as the hopper does, the legs' guards ahead in time."""
    _guards(t, y, dy, mode, p, h, hdot)
    rot = rotation_entries(y[3], y[4], y[5])
    for leg in range(int(p[hp.N_LEGS])):
        h[leg] -= p[DELAY] * foot_gap(leg, y, rot, p)[1]
        hdot[leg] -= p[DELAY] * foot_lift(leg, y, dy, rot, p)


@njit(error_model="numpy")
def take_normal_velocity(t: float, y: FloatArray, leg: int, fraction: float, p: FloatArray) -> None:
    """Change the velocities in `y` by a vertical impulse at a foot that slows it by a fraction.

    An impulse changes the momenta as a force changes their rates; forces that depend on velocity
    are finite and have no share. So the equations of motion at rest give the change.
    """
    rot = rotation_entries(y[3], y[4], y[5])
    rest = (0.0, 0.0, 0.0)
    k = hp.LEGS + hp.LEG_STRIDE * leg
    px, py, pz = p[k + 1], p[k + 2], -p[hp.LEG_LENGTH]
    up = (rot[6], rot[7], rot[8])
    torque = cross(px, py, pz, rot[6], rot[7], rot[8])
    place = boom_motion(t, p)[0]
    a, turn = body_accelerations(rest, up, torque, (place, rest, rest), p)
    sx, sy, sz = cross(turn[0], turn[1], turn[2], px, py, pz)
    gained = rot[6] * (a[0] + sx) + rot[7] * (a[1] + sy) + rot[8] * (a[2] + sz)
    impulse = -fraction * foot_gap(leg, y, rot, p)[1] / gained
    y[6] += impulse * (rot[0] * a[0] + rot[1] * a[1] + rot[2] * a[2])
    y[7] += impulse * (rot[3] * a[0] + rot[4] * a[1] + rot[5] * a[2])
    y[8] += impulse * (rot[6] * a[0] + rot[7] * a[1] + rot[8] * a[2])
    y[9] += impulse * turn[0]
    y[10] += impulse * turn[1]
    y[11] += impulse * turn[2]


@on_event
def control_event(
    t: float, y: FloatArray, mode: IntArray, p: FloatArray, guard: int, direction: int
) -> int:
    """Do as the hopper does; at touchdown a foot loses part of its normal velocity."""
    if guard < int(p[hp.N_LEGS]) and direction > 0 and p[IMPULSE] > 0.0:
        take_normal_velocity(t, y, guard, p[IMPULSE], p)
    return int(_event(t, y, mode, p, guard, direction))


@cache
def control_system(n_legs: int = 3) -> System:
    """Return the control as a hybrid system: guards and modes are those of `hopper_system`."""
    return replace(
        hopper_system(n_legs), field=control_field, guards=control_guards, on_event=control_event
    )


# The hopper pushing a board along the floor: a drag by Coulomb friction while it stands.
#
# The board of the dissertation's Sec. 3.5 (Fig. 3.7) lies in the way and is pushed along. Here it
# has
# no inertia: while a leg is in contact, it holds the chassis back at its centre of mass with a
# force
# that is constant but for slow motion, and only against motion into the board. Each leg in contact
# brings its share of the force, so that forces stay additive over the legs.

# They follow the legs' numbers at the end of the parameters.
DRAG, DIRECTION_X, DIRECTION_Y = -3, -2, -1


@dataclass(frozen=True, kw_only=True)
class HopperDrag:
    """A board that is being pushed.

    Parameters
    ----------
    drag_n : float
        Force of its friction, N, when all legs are in contact.
    direction : (x, y)
        Unit vector, world frame: the way into the board.
    """

    drag_n: float
    direction: tuple[float, float]

    def __post_init__(self) -> None:
        if not self.drag_n >= 0:
            raise ConfigError(f"obstacle.drag_n: expected >= 0, found {self.drag_n}")

    def system(self, n_legs: int) -> System:
        """Return `drag_system` with this number of legs."""
        return drag_system(n_legs)

    def vector(self, hopper: HopperParameters, preloads_n: FloatArray | None = None) -> FloatArray:
        """Flat parameter vector: the hopper's, then force and direction."""
        return np.append(hopper.vector(preloads_n), [self.drag_n, *self.direction])


@field
def drag_field(t: float, y: FloatArray, mode: IntArray, p: FloatArray, dy: FloatArray) -> None:
    """Fill `dy` with the rate of the state, held back by the board."""
    rot = rotation_entries(y[3], y[4], y[5])
    force, torque = total_wrench(y, mode, rot, p)
    n, standing = int(p[hp.N_LEGS]), 0
    for leg in range(n):
        standing += mode[leg] > 0
    ux, uy = p[DIRECTION_X], p[DIRECTION_Y]
    into = max(y[6] * ux + y[7] * uy, 0.0)
    drag = -p[DRAG] * standing / n * into / math.sqrt(into * into + p[hp.SLIP_VELOCITY] ** 2)
    fx, fy = drag * ux, drag * uy
    held = (
        force[0] + rot[0] * fx + rot[3] * fy,
        force[1] + rot[1] * fx + rot[4] * fy,
        force[2] + rot[2] * fx + rot[5] * fy,
    )
    fill_rates(t, y, rot, (held, torque), p, dy)


@cache
def drag_system(n_legs: int = 3) -> System:
    """Return the hopper with a board as a hybrid system; otherwise as `hopper_system`."""
    return replace(hopper_system(n_legs), field=drag_field)


# A hopper's landing as the sections cut it out: from one height of a point of the body to another.
#
# The hopper, or a control of it, with one guard more, in the place of that for a fall: the height
# of
# a point of the body (the mean of the body markers) over a section, which ends the integration as
# it
# falls through zero. The instants of the first contacts are kept in further states, so that many
# landings can be integrated at once without their events being logged.

NOT_YET = -1.0  # instant of a contact that has not been

# Point of the body and height of the section stand before the strengths that end the parameters.
POINT_X, POINT_Y, POINT_Z, HEIGHT = -7, -6, -5, -4

_field = njit(error_model="numpy")(control_field.function)
_guards_hopper_landing = njit(error_model="numpy")(control_guards.function)
_event_hopper_landing = njit(error_model="numpy")(control_event.function)


def landing_vectors(
    hopper: HopperParameters,
    control: HopperControl,
    preloads_n: FloatArray,
    *,
    point_m: ArrayLike,
    height_m: float,
    boom_time_s: ArrayLike = 0.0,
) -> FloatArray:
    """Return the parameter vectors of L landings, (L, p).

    Parameters
    ----------
    hopper, control
        What lands.
    preloads_n : (L, n) array
        Preload of each leg, N.
    point_m : (3,) array_like
        Point of the body, body frame, m.
    height_m : float
        Height of the section, m.
    boom_time_s : (L,) array_like
        Time since the apex at which the integration begins, s: the boom's swing counts from there.
    """
    section = [*np.asarray(point_m, dtype=float), height_m]
    strengths = [control.coupling, control.impulse, control.delay_s]
    vectors = np.tile([*hopper.vector(), *section, *strengths], (len(preloads_n), 1))
    legs = hp.LEGS + hp.LEG_STRIDE * np.arange(hopper.n_legs)
    vectors[:, legs] = preloads_n
    vectors[:, hp.BOOM_START] -= boom_time_s
    return vectors


@field
def landing_field(t: float, y: FloatArray, mode: IntArray, p: FloatArray, dy: FloatArray) -> None:
    """Fill `dy` with the rate of the control's state; the instants stay."""
    _field(t, y, mode, p, dy)
    for leg in range(int(p[hp.N_LEGS])):
        dy[N_STATES + leg] = 0.0


@guards
def landing_guards(
    t: float,
    y: FloatArray,
    dy: FloatArray,
    mode: IntArray,
    p: FloatArray,
    h: FloatArray,
    hdot: FloatArray,
) -> None:
    """Fill `h` and `hdot` as the control does, and the height of the point over the section."""
    _guards_hopper_landing(t, y, dy, mode, p, h, hdot)
    n = int(p[hp.N_LEGS])
    rot = rotation_entries(y[3], y[4], y[5])
    tx, ty, tz = vertical_rate(y, dy, rot)
    x, y_, z = p[POINT_X], p[POINT_Y], p[POINT_Z]
    h[n + 1] = y[2] + rot[6] * x + rot[7] * y_ + rot[8] * z - p[HEIGHT]
    hdot[n + 1] = dy[2] + tx * x + ty * y_ + tz * z


@on_event
def landing_event(
    t: float, y: FloatArray, mode: IntArray, p: FloatArray, guard: int, direction: int
) -> int:
    """Do as the control does, and note the instant of a leg's first contact."""
    if guard < int(p[hp.N_LEGS]) and direction > 0 and y[N_STATES + guard] < 0.0:
        y[N_STATES + guard] = t
    return int(_event_hopper_landing(t, y, mode, p, guard, direction))


@cache
def landing_system(n_legs: int = 3) -> System:
    """Return the landing as a hybrid system of 12 + n states, the last n of them instants.

    The guards are ``foot1`` ... ``foot<n>``, ``apex`` (stops after a landing, as the hopper's does)
    and ``section`` (stops). Nothing stops a fall.
    """
    control = control_system(n_legs)
    return System(
        field=landing_field,
        guards=landing_guards,
        on_event=landing_event,
        n_states=N_STATES + n_legs,
        guard_names=(*control.guard_names[: n_legs + 1], "section"),
        directions=(*(0 for _ in range(n_legs)), -1, -1),
        terminal=(*(False for _ in range(n_legs + 1)), True),
        n_extra_modes=control.n_extra_modes,
    )
