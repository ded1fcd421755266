"""Variants of the hopper: controls, and a board that it pushes.

A control breaks the conditions for a continuously differentiable landing in one of
three ways (`hopdata.scenes.scene.Control`).

- Coupling: the force of each leg is multiplied by 1 + kappa (s - n) while s of the n
  legs are in contact. Forces are no longer additive.
- Impulse: at touchdown a vertical impulse at the foot removes the fraction eps of the
  foot's normal velocity. The state jumps. An impulse at one foot also moves the other
  feet, so the state after a simultaneous contact depends on the order, unless the feet
  are orthogonal with respect to the inertia (Pace and Burden 2017).
- Delay: contact occurs at gap + tau dgap/dt = 0. The guards depend on velocity.
"""

import math
from dataclasses import dataclass, replace
from functools import cache

from hopdata.arrays import FloatArray, IntArray
from hopdata.code_cache import kept_njit
from hopdata.hybrid import System, field, guards, on_event
from hopdata.scenes import hopper_parameters as hp
from hopdata.scenes.body import cross, rotation_entries
from hopdata.scenes.hopper import (
    body_accelerations,
    boom_motion,
    fill_rates,
    foot_gap,
    foot_lift,
    hopper_event,
    hopper_guards,
    hopper_system,
    total_wrench,
)
from hopdata.scenes.scene import Variant

# Indices of the strengths, which follow the legs' entries at the end of the parameter
# vector.
COUPLING, IMPULSE, DELAY = -3, -2, -1

_guards = kept_njit(error_model="numpy")(hopper_guards.function)
_event = kept_njit(error_model="numpy")(hopper_event.function)


@field
def control_field(
    t: float, y: FloatArray, mode: IntArray, p: FloatArray, dy: FloatArray
) -> None:
    """Fill `dy` with the state's rate; the legs' forces are coupled."""
    rot = rotation_entries(y[3], y[4], y[5])
    (force, torque), standing = total_wrench(y, mode, rot, p)
    share = 1.0 + p[COUPLING] * (standing - p[hp.N_LEGS])
    force = (share * force[0], share * force[1], share * force[2])
    torque = (share * torque[0], share * torque[1], share * torque[2])
    fill_rates(t, y, rot, (force, torque), p, dy)


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
    """Fill `h` and `hdot` as for the hopper, but with the legs' guards ahead in time."""
    _guards(t, y, dy, mode, p, h, hdot)
    rot = rotation_entries(y[3], y[4], y[5])
    for leg in range(int(p[hp.N_LEGS])):
        h[leg] -= p[DELAY] * foot_gap(leg, y, rot, p)[1]
        hdot[leg] -= p[DELAY] * foot_lift(leg, y, dy, rot, p)


@kept_njit(error_model="numpy")
def take_normal_velocity(
    t: float, y: FloatArray, leg: int, fraction: float, p: FloatArray
) -> None:
    """Apply a vertical impulse at a foot to `y` that reduces its normal velocity by `fraction`.

    An impulse changes the momenta as a force changes their rates, and
    velocity-dependent forces are finite and contribute nothing. The change therefore
    follows from the equations of motion at rest.
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
    """Handle events as the hopper does; at touchdown a foot loses part of its normal velocity."""
    if guard < int(p[hp.N_LEGS]) and direction > 0 and p[IMPULSE] > 0.0:
        take_normal_velocity(t, y, guard, p[IMPULSE], p)
    return int(_event(t, y, mode, p, guard, direction))


@cache
def control_system(n_legs: int = 3) -> System:
    """Return the hybrid system of the control; its guards and modes are as in `hopper_system`."""
    return replace(
        hopper_system(n_legs),
        field=control_field,
        guards=control_guards,
        on_event=control_event,
    )


# The board of the dissertation's Sec. 3.5 (Fig. 3.7) is pushed along the floor. It has
# no inertia. While a leg is in contact, the board holds the chassis back at its centre
# of mass with a force that is constant except at low speed and that opposes only motion
# into the board. Each leg in contact contributes its share of the force, so forces stay
# additive over the legs.

# Indices of the board's numbers, which follow the legs' entries at the end of the
# parameter vector.
DRAG, DIRECTION_X, DIRECTION_Y, FRONT = -4, -3, -2, -1


@dataclass(frozen=True, kw_only=True)
class HopperDrag:
    """A board pushed by a hopper that is past its front; the first guard of the system, ``board``.

    Parameters
    ----------
    drag_n : float
        Friction force of the board when all legs are in contact, N.
    direction : (x, y)
        Unit vector into the board, world frame.
    front_m : float
        Position along `direction` at which the chassis' centre of mass touches the
        board, m.
    """

    drag_n: float
    direction: tuple[float, float]
    front_m: float

    @property
    def numbers(self) -> tuple[float, ...]:
        """Force, direction and front, in the order of the parameter vector."""
        return self.drag_n, *self.direction, self.front_m


@field
def drag_field(
    t: float, y: FloatArray, mode: IntArray, p: FloatArray, dy: FloatArray
) -> None:
    """Fill `dy` with the state's rate, including the board's drag while it is touched."""
    rot = rotation_entries(y[3], y[4], y[5])
    (force, torque), standing = total_wrench(y, mode[1:], rot, p)
    ux, uy = p[DIRECTION_X], p[DIRECTION_Y]
    into = max(y[6] * ux + y[7] * uy, 0.0) if mode[0] > 0 else 0.0
    size = math.sqrt(into * into + p[hp.SLIP_VELOCITY] ** 2)
    drag = -p[DRAG] * standing / p[hp.N_LEGS] * into / size
    fx, fy = drag * ux, drag * uy
    held = (
        force[0] + rot[0] * fx + rot[3] * fy,
        force[1] + rot[1] * fx + rot[4] * fy,
        force[2] + rot[2] * fx + rot[5] * fy,
    )
    fill_rates(t, y, rot, (held, torque), p, dy)


@guards
def drag_guards(
    t: float,
    y: FloatArray,
    dy: FloatArray,
    mode: IntArray,
    p: FloatArray,
    h: FloatArray,
    hdot: FloatArray,
) -> None:
    """Fill `h` and `hdot` with the distance past the board's front, then as the hopper does."""
    h[0] = y[0] * p[DIRECTION_X] + y[1] * p[DIRECTION_Y] - p[FRONT]
    hdot[0] = dy[0] * p[DIRECTION_X] + dy[1] * p[DIRECTION_Y]
    _guards(t, y, dy, mode[1:], p, h[1:], hdot[1:])


@on_event
def drag_event(
    t: float, y: FloatArray, mode: IntArray, p: FloatArray, guard: int, direction: int
) -> int:
    """Handle events as the hopper does; the board does not affect the state of the legs."""
    return 0 if guard == 0 else int(_event(t, y, mode[1:], p, guard - 1, direction))


@cache
def drag_system(n_legs: int = 3) -> System:
    """Return the hybrid system of a hopper with a board: `hopper_system` with one guard before."""
    plain = hopper_system(n_legs)
    return replace(
        plain, field=drag_field, guards=drag_guards, on_event=drag_event,
        guard_names=("board", *plain.guard_names), directions=(0, *(plain.directions or ())),
        terminal=(False, *(plain.terminal or ())),
    )  # fmt: skip


def system_of(n_legs: int, variant: Variant | None) -> System:
    """Return the hybrid system of a hopper with `n_legs` legs, or of its variant if given."""
    if variant is None:
        return hopper_system(n_legs)
    return (
        drag_system(n_legs)
        if isinstance(variant, HopperDrag)
        else control_system(n_legs)
    )
