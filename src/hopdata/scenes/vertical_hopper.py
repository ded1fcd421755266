# ruff: noqa: ARG001 (the integrator prescribes the signatures of its callbacks)
"""The hopper in one dimension (section 4.3.4): a mass on a springy leg.

The state is the mass's height above the floor, m, and its velocity, m/s. The leg
touches the floor where the height equals the contact length; this is one guard, crossed
in both directions. It is integrated only, so it is none of `hopdata.scenes.SCENES`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid import System, affine, field, guards


@field
def hopper_field(
    t: float, y: FloatArray, mode: IntArray, params: FloatArray, dy: FloatArray
) -> None:
    """Fill in gravity, and in stance (lock -1) the push of spring and damper."""
    gravity, stiffness, rest_length, damping = (
        params[0],
        params[1],
        params[2],
        params[3],
    )
    dy[0] = y[1]
    dy[1] = -gravity
    if mode[0] < 0:
        dy[1] += stiffness * (rest_length - y[0]) - damping * y[1]


@guards
def hopper_guards(
    t: float,
    y: FloatArray,
    dy: FloatArray,
    mode: IntArray,
    params: FloatArray,
    h: FloatArray,
    hdot: FloatArray,
) -> None:
    """Fill in the height above contact, negative in stance."""
    h[0] = y[0] - params[4]
    hdot[0] = dy[0]


@affine
def hopper_affine(
    mode: IntArray, params: FloatArray, a: FloatArray, b: FloatArray
) -> None:
    """Fill in the matrix and the constant of flight or stance (lock -1)."""
    gravity, stiffness, rest_length, damping = (
        params[0],
        params[1],
        params[2],
        params[3],
    )
    a[0, 1] = 1.0
    b[1] = -gravity
    if mode[0] < 0:
        a[1, 0], a[1, 1] = -stiffness, -damping
        b[1] += stiffness * rest_length


HOPPER_SYSTEM = System(
    field=hopper_field, guards=hopper_guards, affine=hopper_affine, n_states=2,
    guard_names=("contact",),
)  # fmt: skip


@dataclass(frozen=True)
class VerticalHopper:
    """Parameters of the hopper, in SI units.

    Parameters
    ----------
    mass_kg : float
        Mass.
    stiffness_n_m : float
        Stiffness of the leg, N/m.
    contact_length_m : float
        Height of the mass at which the leg touches the floor (L).
    rest_length_m : float
        Length at which the leg's spring is relaxed (L0). If it exceeds L, the leg is
        preloaded and the force jumps at contact.
    gravity_m_s2 : float
        Acceleration of gravity.
    damping_n_s_m : float
        Viscous damping of the leg, N s/m.
    """

    mass_kg: float = 1.0
    stiffness_n_m: float = 1000.0
    contact_length_m: float = 1.0
    rest_length_m: float = 1.0
    gravity_m_s2: float = 9.81
    damping_n_s_m: float = 0.0

    def __post_init__(self) -> None:
        if not (
            self.mass_kg > 0 and self.stiffness_n_m > 0 and self.damping_n_s_m >= 0
        ):
            raise ValueError(
                f"expected mass and stiffness > 0 and damping >= 0, found {self}"
            )

    @property
    def params(self) -> tuple[float, ...]:
        """Parameters in the form that the compiled functions take."""
        return (
            self.gravity_m_s2,
            self.stiffness_n_m / self.mass_kg,
            self.rest_length_m,
            self.damping_n_s_m / self.mass_kg,
            self.contact_length_m,
        )

    def system(self) -> System:
        """Return the system; its guard ``contact`` falls at touchdown."""
        return HOPPER_SYSTEM

    def energy(self, y: ArrayLike) -> FloatArray:
        """Return the energy of states (2, ...), J; the floor is at height 0."""
        height, velocity = np.asarray(y, dtype=np.float64)
        length = np.minimum(height, self.contact_length_m)  # of the leg, also in flight
        spring = 0.5 * self.stiffness_n_m * (self.rest_length_m - length) ** 2
        fall = self.mass_kg * self.gravity_m_s2 * height
        return 0.5 * self.mass_kg * velocity**2 + fall + spring


# Closed form of the undamped hopper, at any time.


def hopper_states(
    hopper: VerticalHopper, drop_m: float, times_s: ArrayLike
) -> FloatArray:
    """Return height and velocity, (2, N), of the hopper dropped from rest.

    It has neither preload nor damping. Touchdown and lift-off are mirror images about
    the lowest point, so each hop repeats the last.
    """
    if hopper.damping_n_s_m != 0 or hopper.rest_length_m != hopper.contact_length_m:
        raise ValueError(f"expected neither damping nor preload, found {hopper}")
    g, omega = hopper.gravity_m_s2, np.sqrt(hopper.stiffness_n_m / hopper.mass_kg)
    speed = np.sqrt(2 * g * (drop_m - hopper.contact_length_m))
    sag = g / omega**2
    stance = 2 * np.arctan2(speed / omega, -sag) / omega
    flight = 2 * speed / g
    since = (np.asarray(times_s, dtype=np.float64) + flight / 2) % (stance + flight)
    after = since - flight  # since touchdown
    swing = omega * after
    down = sag * np.cos(swing) - speed / omega * np.sin(swing) - sag
    rate = -sag * omega * np.sin(swing) - speed * np.cos(swing)
    in_flight = after < 0
    height = np.where(in_flight, speed * since - 0.5 * g * since**2, down)
    return np.array(
        [hopper.contact_length_m + height, np.where(in_flight, speed - g * since, rate)]
    )


def hopper_end(hopper: VerticalHopper, drop_m: float, until_s: float) -> FloatArray:
    """Return the exact state, in flight, of the undamped hopper dropped from rest."""
    g, omega = hopper.gravity_m_s2, np.sqrt(hopper.stiffness_n_m / hopper.mass_kg)
    fall = drop_m - hopper.contact_length_m
    speed = np.sqrt(2 * g * fall)
    rest = hopper.rest_length_m - hopper.contact_length_m - g / omega**2
    stance = (
        2 * np.arctan2(speed / omega, rest) / omega
    )  # symmetric about the lowest point
    in_flight = (until_s - speed / g) % (stance + 2 * speed / g) - stance
    if in_flight < 0:
        raise ValueError("choose an end in flight")
    height = hopper.contact_length_m + speed * in_flight - 0.5 * g * in_flight**2
    return np.array([height, speed - g * in_flight])
