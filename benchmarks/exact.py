# ruff: noqa: ARG001 (the integrator prescribes the signatures of field and guards)
"""Where the scenes with closed forms truly end; and `solve_ivp`, started again at each event.

`octant` is table 4.3 of the dissertation: three affine modes a coordinate, switched at the
coordinate planes. State (x, y, z) and time have no dimension; from the initial state each guard is
crossed once: y rising, z falling, x rising.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid import System, affine, field, guards

INITIAL_STATE = (-0.4, -0.15, 0.3)
T_SPAN = (0.0, 0.5)


@field
def octant_field(
    t: float, y: FloatArray, mode: IntArray, params: FloatArray, dy: FloatArray
) -> None:
    """Return the affine field of the octant that the locks name."""
    x_side, y_side, z_fell = mode[0] > 0, mode[1] > 0, mode[2] > 0
    if x_side:
        dy[0] = (10.0 * y[0] if y_side else -2.0 * y[1]) + 1.0
        dy[1] = y[1] + 1.0 if y_side else 0.5 * y[0] + 2.0
    else:
        dy[0] = (y[1] if y_side else -y[1]) + 1.0
        dy[1] = (-y[0] if y_side else y[0]) + 1.0
    dy[2] = 3.0 * y[2] - 1.0 if z_fell else -y[2] - 1.0


@guards
def octant_guards(
    t: float,
    y: FloatArray,
    dy: FloatArray,
    mode: IntArray,
    params: FloatArray,
    h: FloatArray,
    hdot: FloatArray,
) -> None:
    """Return the coordinate planes; z is crossed downwards, so that -z rises."""
    h[0], hdot[0] = y[0], dy[0]
    h[1], hdot[1] = y[1], dy[1]
    h[2], hdot[2] = -y[2], -dy[2]


@affine
def octant_affine(mode: IntArray, params: FloatArray, a: FloatArray, b: FloatArray) -> None:
    """Return the matrix and the constant of the octant that the locks name."""
    x_side, y_side, z_fell = mode[0] > 0, mode[1] > 0, mode[2] > 0
    b[0], b[1], b[2] = 1.0, 1.0, -1.0
    if x_side and y_side:
        a[0, 0], a[1, 1] = 10.0, 1.0
    elif x_side:
        a[0, 1], a[1, 0], b[1] = -2.0, 0.5, 2.0
    elif y_side:
        a[0, 1], a[1, 0] = 1.0, -1.0
    else:
        a[0, 1], a[1, 0] = -1.0, 1.0
    a[2, 2] = 3.0 if z_fell else -1.0


@cache
def octant() -> System:
    """Return the system of table 4.3: guards ``x`` (rising), ``y`` (rising) and ``z`` (falling)."""
    return System(
        field=octant_field, guards=octant_guards, affine=octant_affine, n_states=3,
        guard_names=("x", "y", "z"),
    )  # fmt: skip


# The hopper in one dimension (section 4.3.4): a mass on a preloaded springy leg. State: its height
# above the floor, m, and velocity, m/s. The leg touches the floor where the height is the contact
# length, in both directions: one two-way guard.


@field
def hopper_field(
    t: float, y: FloatArray, mode: IntArray, params: FloatArray, dy: FloatArray
) -> None:
    """Return gravity, and in stance (lock -1) the spring's and the damper's push."""
    gravity, stiffness, rest_length, damping = params[0], params[1], params[2], params[3]
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
    """Return the height above contact: negative in stance."""
    h[0] = y[0] - params[4]
    hdot[0] = dy[0]


@affine
def hopper_affine(mode: IntArray, params: FloatArray, a: FloatArray, b: FloatArray) -> None:
    """Return the matrix and the constant of flight, or of stance (lock -1)."""
    gravity, stiffness, rest_length, damping = params[0], params[1], params[2], params[3]
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
        Length at which the leg's spring is relaxed (L0); longer than L means preload: the force
        jumps at contact.
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
        if not (self.mass_kg > 0 and self.stiffness_n_m > 0 and self.damping_n_s_m >= 0):
            raise ValueError(f"expected mass and stiffness > 0 and damping >= 0, found {self}")

    @property
    def params(self) -> tuple[float, ...]:
        """Parameters as the compiled functions take them."""
        return (
            self.gravity_m_s2,
            self.stiffness_n_m / self.mass_kg,
            self.rest_length_m,
            self.damping_n_s_m / self.mass_kg,
            self.contact_length_m,
        )

    def system(self) -> System:
        """Return the hybrid system: its guard ``contact`` falls at touchdown, rises at lift-off."""
        return HOPPER_SYSTEM

    def energy(self, y: ArrayLike) -> FloatArray:
        """Return the mechanical energy of states (2, ...), J; the floor is at height 0."""
        height, velocity = np.asarray(y, dtype=np.float64)
        length = np.minimum(height, self.contact_length_m)  # the leg's, in stance and in flight
        spring = 0.5 * self.stiffness_n_m * (self.rest_length_m - length) ** 2
        fall = self.mass_kg * self.gravity_m_s2 * height
        return 0.5 * self.mass_kg * velocity**2 + fall + spring


# The undamped hopper in closed form, at all times.


def hopper_states(hopper: VerticalHopper, drop_m: float, times_s: ArrayLike) -> FloatArray:
    """Return height and velocity, (2, N), of the hopper dropped from rest; no preload, no damping.

    Touchdown and lift-off are mirror images about the lowest point, so that each hop repeats.
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


# scipy's `solve_ivp`, stopped at each event and started again in the new mode.
#
# It calls the same Numba-compiled field and guards as ours: a terminal event per guard, in the
# direction that its lock leaves open. Systems with a handler are not for it.

Restarted = Callable[..., tuple[FloatArray, int]]


def restarted(
    system: System, params: Sequence[float], t_span: tuple[float, float], y0: Sequence[float]
) -> Restarted:
    """Return a function of the options of `solve_ivp`: final state and field evaluations.

    Its `first_step`, if given, is that of the start; after an event scipy chooses for itself.
    """
    ivp: Any = solve_ivp
    assert system.guards is not None
    assert system.on_event is None
    rates_of, heights_of = njit(system.field.function), njit(system.guards.function)
    numbers, n_guards = np.array(params, dtype=np.float64), system.n_guards

    def slope(t: float, y: FloatArray, mode: IntArray) -> FloatArray:
        dy = np.empty_like(y)
        rates_of(t, y, mode, numbers, dy)
        return dy

    def heights(t: float, y: FloatArray, mode: IntArray) -> FloatArray:
        h, rates = np.empty(n_guards), np.empty(n_guards)
        heights_of(t, y, slope(t, y, mode), mode, numbers, h, rates)
        return h

    def event(k: int, lock: int) -> Callable[..., float]:
        def value(t: float, y: FloatArray, mode: IntArray) -> float:
            return heights(t, y, mode)[k]

        value.terminal, value.direction = True, -lock  # type: ignore[attr-defined]
        return value

    def run(*, first_step: float | None = None, **options: Any) -> tuple[FloatArray, int]:
        now, state, evaluations = t_span[0], np.array(y0, dtype=np.float64), 0
        mode = np.full(n_guards, -1)
        mode[:] = np.where(heights(now, state, mode) > 0, 1, -1)
        while now < t_span[1]:
            part = ivp(
                slope, (now, t_span[1]), state, args=(mode,), first_step=first_step,
                events=[event(k, lock) for k, lock in enumerate(mode)], **options,
            )  # fmt: skip
            now, state, evaluations = part.t[-1], part.y[:, -1], evaluations + part.nfev
            first_step = None
            for k, times in enumerate(part.t_events):
                if len(times) > 0:
                    mode[k] = -mode[k]
        return state, evaluations

    return run


def affine_flow(rows: ArrayLike, constants: ArrayLike) -> FloatArray:
    """Return the generator of an affine flow on the state with a 1 behind it."""
    return np.block([[np.array(rows), np.array(constants)[:, None]], [np.zeros((1, 4))]])


def octant_end() -> FloatArray:
    """Return the exact end of table 4.3, mode by mode, by matrix exponentials."""
    modes = [
        ([[0, -1, 0], [1, 0, 0], [0, 0, -1]], [1, 1, -1], 1),  # until y = 0
        ([[0, 1, 0], [-1, 0, 0], [0, 0, -1]], [1, 1, -1], 2),  # until z = 0
        ([[0, 1, 0], [-1, 0, 0], [0, 0, 3]], [1, 1, -1], 0),  # until x = 0
    ]
    state, now = np.array([*INITIAL_STATE, 1.0]), 0.0
    for rows, constants, axis in modes:
        flow = affine_flow(rows, constants)
        span = brentq(lambda t: (expm(flow * t) @ state)[axis], 1e-9, 0.3, xtol=1e-16)  # noqa: B023
        state, now = expm(flow * span) @ state, now + span
    last = affine_flow([[10, 0, 0], [0, 1, 0], [0, 0, 3]], [1, 1, -1])
    return (expm(last * (T_SPAN[1] - now)) @ state)[:3]


def hopper_end(hopper: VerticalHopper, drop_m: float, until_s: float) -> FloatArray:
    """Return the exact state, in flight, of the undamped hopper dropped from rest."""
    g, omega = hopper.gravity_m_s2, np.sqrt(hopper.stiffness_n_m / hopper.mass_kg)
    fall = drop_m - hopper.contact_length_m
    speed = np.sqrt(2 * g * fall)
    rest = hopper.rest_length_m - hopper.contact_length_m - g / omega**2
    stance = 2 * np.arctan2(speed / omega, rest) / omega  # symmetric about the lowest point
    in_flight = (until_s - speed / g) % (stance + 2 * speed / g) - stance
    if in_flight < 0:
        raise ValueError("choose an end in flight")
    height = hopper.contact_length_m + speed * in_flight - 0.5 * g * in_flight**2
    return np.array([height, speed - g * in_flight])


def plate_end() -> FloatArray:
    """Return the end of the plate's first bounce (`peers`), which has no closed form.

    From heyoka in extended precision at 1e-18; it changes by 1e-19 at 1e-17, and is met within
    2e-15 by heyoka and 1e-13 by SciPy's DOP853 in doubles: the benchmark's own rows show it again.
    """
    x, z, angle = -0.03919835492659511175, 1.2427224171290427716, 0.065025766442365411495
    vx, vz, omega = -0.08629287118608017742, -1.1722267053343060242, 0.2288024630480736818
    return np.array([x, z, angle, vx, vz, omega])
