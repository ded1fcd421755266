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

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hopdata.hybrid import System, field, guards, on_event
from hopdata.scenes import hopper_parameters as hp
from hopdata.scenes.boom import boom_motion
from hopdata.scenes.hopper import (
    body_accelerations,
    fill_rates,
    hopper_event,
    hopper_guards,
    hopper_system,
)
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.legs import foot_gap, foot_lift, total_wrench
from hopdata.scenes.rigid_body import cross, rotation_entries

FloatArray = NDArray[np.float64]
ModeArray = NDArray[np.int64]

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
def control_field(t: float, y: FloatArray, mode: ModeArray, p: FloatArray, dy: FloatArray) -> None:
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
    mode: ModeArray,
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
    t: float, y: FloatArray, mode: ModeArray, p: FloatArray, guard: int, direction: int
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
