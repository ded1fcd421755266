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
from hopdata.scenes import hopper_vector as at
from hopdata.scenes.body import (
    PITCH,
    ROLL,
    YAW,
    cross,
    rotation_entries,
    turned,
)
from hopdata.scenes.hopper import (
    body_accelerations,
    boom_motion,
    fill_rates,
    foot_gap,
    foot_lift,
    hopper_event,
    hopper_guards,
    hopper_system,
    n_legs_of,
    rest_foot,
    total_wrench,
)
from hopdata.scenes.scene import Variant

# Indices of the strengths, which follow the legs' entries at the end of the parameter
# vector.
COUPLING = -3
IMPULSE = -2
DELAY = -1

_guards = kept_njit(error_model="numpy")(hopper_guards.function)
_event = kept_njit(error_model="numpy")(hopper_event.function)


@field
def control_field(
    t: float, y: FloatArray, mode: IntArray, p: FloatArray, dy: FloatArray
) -> None:
    """Fill `dy` with the state's rate; the legs' forces are coupled."""
    rot = rotation_entries(y[YAW], y[PITCH], y[ROLL])
    (force, torque), standing = total_wrench(y, mode, rot, p)
    share = 1.0 + p[COUPLING] * (standing - p[at.N_LEGS])
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
    """Fill `h` and `hdot` as for the hopper, with the legs' guards ahead in time."""
    _guards(t, y, dy, mode, p, h, hdot)
    rot = rotation_entries(y[YAW], y[PITCH], y[ROLL])
    for leg in range(n_legs_of(p)):
        h[leg] -= p[DELAY] * foot_gap(leg, y, rot, p)[1]
        hdot[leg] -= p[DELAY] * foot_lift(leg, y, dy, rot, p)


@kept_njit(error_model="numpy")
def take_normal_velocity(
    t: float, y: FloatArray, leg: int, fraction: float, p: FloatArray
) -> None:
    """Reduce a foot's normal velocity by `fraction`, by a vertical impulse to `y`.

    An impulse changes the momenta as a force changes their rates, and
    velocity-dependent forces are finite and contribute nothing. The change therefore
    follows from the equations of motion at rest.
    """
    rot = rotation_entries(y[YAW], y[PITCH], y[ROLL])
    rest = (0.0, 0.0, 0.0)
    foot = rest_foot(leg, p)
    up = (rot[6], rot[7], rot[8])
    counterweight = boom_motion(t, p)[0]
    at_rest = (counterweight, rest, rest)
    # Changes by a unit impulse, of the velocity of O and of the angular velocity.
    a, turn = body_accelerations(rest, up, cross(foot, up), at_rest, p)
    s = cross(turn, foot)
    gained = rot[6] * (a[0] + s[0]) + rot[7] * (a[1] + s[1]) + rot[8] * (a[2] + s[2])
    impulse = -fraction * foot_gap(leg, y, rot, p)[1] / gained
    pushed = turned(rot, a)
    for axis in range(3):
        y[6 + axis] += impulse * pushed[axis]
        y[9 + axis] += impulse * turn[axis]


@on_event
def control_event(
    t: float, y: FloatArray, mode: IntArray, p: FloatArray, guard: int, direction: int
) -> int:
    """Handle events as the hopper does, but take normal velocity at touchdown."""
    if guard < n_legs_of(p) and direction > 0 and p[IMPULSE] > 0.0:
        take_normal_velocity(t, y, guard, p[IMPULSE], p)
    return int(_event(t, y, mode, p, guard, direction))


@cache
def control_system(n_legs: int = 3) -> System:
    """Return the system of the control, with guards and modes of `hopper_system`."""
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
DRAG = -4
DIRECTION_X = -3
DIRECTION_Y = -2
FRONT = -1


@dataclass(frozen=True, kw_only=True)
class HopperDrag:
    """A board pushed by a hopper that is past its front.

    The system's first guard, ``board``, tells whether it is.

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
    """Fill `dy` with the state's rate, with the board's drag while it is touched."""
    rot = rotation_entries(y[YAW], y[PITCH], y[ROLL])
    (force, torque), standing = total_wrench(y, mode[1:], rot, p)
    ux = p[DIRECTION_X]
    uy = p[DIRECTION_Y]
    into = 0.0
    if mode[0] > 0:
        into = max(y[6] * ux + y[7] * uy, 0.0)
    size = math.sqrt(into * into + p[at.SLIP_VELOCITY] ** 2)
    drag = -p[DRAG] * standing / p[at.N_LEGS] * into / size
    fx = drag * ux
    fy = drag * uy
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
    """Fill `h` and `hdot`: distance past the board's front, then the hopper's."""
    h[0] = y[0] * p[DIRECTION_X] + y[1] * p[DIRECTION_Y] - p[FRONT]
    hdot[0] = dy[0] * p[DIRECTION_X] + dy[1] * p[DIRECTION_Y]
    _guards(t, y, dy, mode[1:], p, h[1:], hdot[1:])


@on_event
def drag_event(
    t: float, y: FloatArray, mode: IntArray, p: FloatArray, guard: int, direction: int
) -> int:
    """Handle events as the hopper does; the board does not affect the legs."""
    if guard == 0:
        return 0
    return int(_event(t, y, mode[1:], p, guard - 1, direction))


@cache
def drag_system(n_legs: int = 3) -> System:
    """Return the system of a hopper with a board, whose guard comes first."""
    plain = hopper_system(n_legs)
    return replace(
        plain,
        field=drag_field,
        guards=drag_guards,
        on_event=drag_event,
        guard_names=("board", *plain.guard_names),
        directions=(0, *(plain.directions or ())),
        terminal=(False, *(plain.terminal or ())),
    )


def system_of(n_legs: int, variant: Variant | None) -> System:
    """Return the hybrid system of a hopper with `n_legs` legs, or of its variant."""
    if variant is None:
        return hopper_system(n_legs)
    if isinstance(variant, HopperDrag):
        return drag_system(n_legs)
    return control_system(n_legs)
