# ruff: noqa: ARG001 (the integrator prescribes the signatures of its callbacks)
"""Scenes outside the studies, their exact final states, and `solve_ivp` restarted at each event.

`octant` is table 4.3 of the dissertation: three affine modes per coordinate, switched
at the coordinate planes. State (x, y, z) and time have no dimension. From the initial
state, each guard is crossed once: y rising, z falling, x rising.
"""

from __future__ import annotations

import math
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
from hopdata.hybrid import (
    System,
    affine,
    field,
    guard,
    guards,
    jacobian,
    on_event,
    rate_bound,
)

INITIAL_STATE = (-0.4, -0.15, 0.3)
T_SPAN = (0.0, 0.5)


@field
def octant_field(
    t: float, y: FloatArray, mode: IntArray, params: FloatArray, dy: FloatArray
) -> None:
    """Fill in the affine field of the octant given by the locks."""
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
    """Fill in the coordinate planes; z is crossed downwards, so that -z rises."""
    h[0], hdot[0] = y[0], dy[0]
    h[1], hdot[1] = y[1], dy[1]
    h[2], hdot[2] = -y[2], -dy[2]


@affine
def octant_affine(
    mode: IntArray, params: FloatArray, a: FloatArray, b: FloatArray
) -> None:
    """Fill in the matrix and the constant of the octant given by the locks."""
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


# The one-dimensional hopper (section 4.3.4): a mass on a preloaded springy leg. The
# state is its height above the floor, m, and its velocity, m/s. The leg touches the
# floor where the height equals the contact length; this is one guard, crossed in both
# directions.


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
        """Return the hybrid system; its guard ``contact`` falls at touchdown, rises at lift-off."""
        return HOPPER_SYSTEM

    def energy(self, y: ArrayLike) -> FloatArray:
        """Return the mechanical energy of states (2, ...), J; the floor is at height 0."""
        height, velocity = np.asarray(y, dtype=np.float64)
        length = np.minimum(height, self.contact_length_m)  # of the leg, also in flight
        spring = 0.5 * self.stiffness_n_m * (self.rest_length_m - length) ** 2
        fall = self.mass_kg * self.gravity_m_s2 * height
        return 0.5 * self.mass_kg * velocity**2 + fall + spring


# Closed form of the undamped hopper, at any time.


def hopper_states(
    hopper: VerticalHopper, drop_m: float, times_s: ArrayLike
) -> FloatArray:
    """Return height and velocity, (2, N), of the hopper dropped from rest; no preload, no damping.

    Touchdown and lift-off are mirror images about the lowest point, so each hop repeats
    the last.
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


# scipy's `solve_ivp`, stopped at each event and restarted in the new mode.
#
# It calls the same Numba-compiled field and guards as our solver, with one terminal
# event per guard in the direction that its lock allows. It does not handle systems with
# a handler.

Restarted = Callable[..., tuple[FloatArray, int]]


def restarted(
    system: System,
    params: Sequence[float],
    t_span: tuple[float, float],
    y0: Sequence[float],
) -> Restarted:
    """Return a function of `solve_ivp`'s options that gives final state and field evaluations.

    The option `first_step` applies to the start; after an event scipy chooses its own.
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

    def run(
        *, first_step: float | None = None, **options: Any
    ) -> tuple[FloatArray, int]:
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
    """Return the generator of an affine flow, acting on the state with a 1 appended."""
    return np.block(
        [[np.array(rows), np.array(constants)[:, None]], [np.zeros((1, 4))]]
    )


def octant_end() -> FloatArray:
    """Return the exact end of table 4.3, computed mode by mode with matrix exponentials."""
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
    stance = (
        2 * np.arctan2(speed / omega, rest) / omega
    )  # symmetric about the lowest point
    in_flight = (until_s - speed / g) % (stance + 2 * speed / g) - stance
    if in_flight < 0:
        raise ValueError("choose an end in flight")
    height = hopper.contact_length_m + speed * in_flight - 0.5 * g * in_flight**2
    return np.array([height, speed - g * in_flight])


def plate_end() -> FloatArray:
    """Return the end of the plate's first bounce (`peers`), which has no closed form.

    The numbers come from heyoka in extended precision at a tolerance of 1e-18; at 1e-17
    they change by 1e-19. In double precision, heyoka reaches them within 2e-15 and
    SciPy's DOP853 within 1e-13, as the benchmark's own rows confirm.
    """
    x, z, angle = (
        -0.03919835492659511175,
        1.2427224171290427716,
        0.065025766442365411495,
    )
    vx, vz, omega = (
        -0.08629287118608017742,
        -1.1722267053343060242,
        0.2288024630480736818,
    )
    return np.array([x, z, angle, vx, vz, omega])


# A plate that falls onto a bed of springs (dissertation, section 4.4.4), as a scene of
# many contacts.
#
# State (6): position x, z of the centre of mass, m, angle theta of the plate, rad, and
# their rates. The plate is a rigid line, long enough to lie above every spring. Each
# spring stands upright at x_i and has no mass or friction; a guide keeps its end on a
# vertical line. The plate's line passes above it at z - tan(theta) (x - x_i), so its
# compression is
#
#     h_i = L0 + tan(theta) (x - x_i) - z.
#
# It is a guard crossed in both directions, rising at touchdown. While h_i > 0, the
# spring pushes up with F_i = k h_i + c dh_i/dt. The generalised forces are -F_i Dh_i,
# the gradient of the potential (k / 2) h_i^2, so energy is conserved for c = 0. In
# other words, the reaction is normal to the plate, as it must be without friction, and
# its vertical part is F_i. Contact depends on position alone, so a damped spring pulls
# a little just before it lets go.
#
# With a_i = x - x_i, compression and rate are affine in a_i, and so is F_i = P + Q a_i.
# The plate depends on the contacts only through their sums of 1, a_i and a_i^2. For
# very many springs, the field needs only their count and the sums of their indices and
# squared indices. The handler keeps these in the memory behind the parameters. They are
# integers, so they stay exact however often springs come and go.

# Places in the flat vector of parameters; spring i stands at first + i * spacing.
GRAVITY, MASS, INERTIA, REST_LENGTH, STIFFNESS, DAMPING, FIRST, SPACING = range(8)
N_PARAMS = 8

Sums = tuple[float, float, float]  # sums over the contacts of 1, a and a^2


@njit(error_model="numpy")
def compression(i: float, y: FloatArray, p: FloatArray) -> float:
    """Return the compression h_i of spring i, m; negative while the plate is above it."""
    arm = y[0] - p[FIRST] - i * p[SPACING]
    return p[REST_LENGTH] + math.tan(y[2]) * arm - y[1]


@njit(error_model="numpy")
def added_up(y: FloatArray, mode: IntArray, p: FloatArray) -> Sums:
    """Return the sums over the springs whose locks indicate contact."""
    count, arms, squares = 0.0, 0.0, 0.0
    arm = y[0] - p[FIRST]
    for i in range(len(mode)):
        if mode[i] > 0:
            a = arm - i * p[SPACING]
            count += 1.0
            arms += a
            squares += a * a
    return count, arms, squares


@njit(error_model="numpy")
def push(y: FloatArray, p: FloatArray, slope: float) -> tuple[float, float]:
    """Return the coefficients (P, Q) of the force P + Q a of a spring in contact at this slope."""
    steepening = (1.0 + slope * slope) * y[5]
    force = p[STIFFNESS] * (p[REST_LENGTH] - y[1]) + p[DAMPING] * (slope * y[3] - y[4])
    return force, p[STIFFNESS] * slope + p[DAMPING] * steepening


@njit(error_model="numpy")
def fill_rates(y: FloatArray, p: FloatArray, sums: Sums, dy: FloatArray) -> None:
    """Fill the rate of the state, (6,)."""
    slope = math.tan(y[2])
    at_centre, per_arm = push(y, p, slope)
    force = at_centre * sums[0] + per_arm * sums[1]
    moment = at_centre * sums[1] + per_arm * sums[2]
    dy[0], dy[1], dy[2] = y[3], y[4], y[5]
    dy[3] = -slope * force / p[MASS]
    dy[4] = force / p[MASS] - p[GRAVITY]
    dy[5] = -(1.0 + slope * slope) * moment / p[INERTIA]


@njit(error_model="numpy")
def fill_force_row(
    y: FloatArray, p: FloatArray, s0: float, s1: float, row: FloatArray
) -> None:
    """Fill the gradient, (6,), of sum(F_i w_i) at fixed weights: s0 = sum(w), s1 = sum(w a)."""
    slope, k, c = math.tan(y[2]), p[STIFFNESS], p[DAMPING]
    grow = 1.0 + slope * slope  # derivative of the slope with respect to the angle
    row[0] = push(y, p, slope)[1] * s0
    row[1] = -k * s0
    row[2] = grow * (c * y[3] * s0 + (k + 2.0 * c * slope * y[5]) * s1)
    row[3] = c * slope * s0
    row[4] = -c * s0
    row[5] = c * grow * s1


@njit(error_model="numpy")
def fill_jacobian(y: FloatArray, p: FloatArray, sums: Sums, jac: FloatArray) -> None:
    """Fill the derivative of the rates with respect to the state, (6, 6), initially zero."""
    slope = math.tan(y[2])
    grow = 1.0 + slope * slope
    at_centre, per_arm = push(y, p, slope)
    force = at_centre * sums[0] + per_arm * sums[1]
    moment = at_centre * sums[1] + per_arm * sums[2]
    for i in range(3):
        jac[i, 3 + i] = 1.0
    fill_force_row(y, p, sums[0], sums[1], jac[4])
    fill_force_row(y, p, sums[1], sums[2], jac[5])
    jac[5, 0] += force  # the arms vary: each grows with x
    for j in range(6):
        jac[4, j] /= p[MASS]
        jac[3, j] = -slope * jac[4, j]
        jac[5, j] *= -grow / p[INERTIA]
    jac[3, 2] -= grow * force / p[MASS]
    jac[5, 2] -= 2.0 * slope * grow * moment / p[INERTIA]


# Places in the memory behind the parameters.
COUNT, NUMBERS, SQUARES = N_PARAMS, N_PARAMS + 1, N_PARAMS + 2
N_MEMORY = 3


@njit(error_model="numpy")
def sums_of_arms(y: FloatArray, p: FloatArray) -> Sums:
    """Return the sums over the contacts of 1, a and a^2, where a = x - x_i."""
    arm, step = y[0] - p[FIRST], p[SPACING]
    arms = arm * p[COUNT] - step * p[NUMBERS]
    squares = arm * (arms - step * p[NUMBERS]) + step * step * p[SQUARES]
    return p[COUNT], arms, squares


@field
def plate_field_of_sums(
    t: float, y: FloatArray, mode: IntArray, params: FloatArray, dy: FloatArray
) -> None:
    """Fill in gravity and the push of all springs in contact, from the sums."""
    fill_rates(y, params, sums_of_arms(y, params), dy)


@guard
def plate_guard(
    t: float,
    y: FloatArray,
    dy: FloatArray,
    mode: IntArray,
    params: FloatArray,
    k: int,
    h: FloatArray,
    hdot: FloatArray,
) -> None:
    """Return the compression of spring k, positive in contact."""
    slope, arm = math.tan(y[2]), y[0] - params[FIRST] - k * params[SPACING]
    h[k] = params[REST_LENGTH] + slope * arm - y[1]
    hdot[k] = slope * dy[0] - dy[1] + (1.0 + slope * slope) * dy[2] * arm


@rate_bound
def plate_rate_bound(
    t: float, y: FloatArray, dy: FloatArray, mode: IntArray, params: FloatArray
) -> float:
    """Return the largest rate of any compression, m/s, which is at the first or the last spring."""
    slope, arm = math.tan(y[2]), y[0] - params[FIRST]
    rate, per_arm = slope * dy[0] - dy[1], (1.0 + slope * slope) * dy[2]
    last = arm - (len(mode) - 1) * params[SPACING]
    return max(abs(rate + per_arm * arm), abs(rate + per_arm * last))


@jacobian
def plate_jacobian(
    t: float, y: FloatArray, mode: IntArray, params: FloatArray, jac: FloatArray
) -> None:
    """Fill in the derivative of the field with respect to the state."""
    fill_jacobian(y, params, sums_of_arms(y, params), jac)


@on_event
def update_sums(
    t: float,
    y: FloatArray,
    mode: IntArray,
    params: FloatArray,
    spring: int,
    direction: int,
) -> int:
    """Add a spring that touches to the sums, or remove one that lets go."""
    params[COUNT] += direction
    params[NUMBERS] += direction * spring
    params[SQUARES] += direction * float(spring) * float(spring)
    return 0


@field
def plate_field(
    t: float, y: FloatArray, mode: IntArray, params: FloatArray, dy: FloatArray
) -> None:
    """Fill in gravity and the push of every spring in contact."""
    fill_rates(y, params, added_up(y, mode, params), dy)


@jacobian
def plate_field_jacobian(
    t: float, y: FloatArray, mode: IntArray, params: FloatArray, jac: FloatArray
) -> None:
    """Fill in the derivative of the field with respect to the state."""
    fill_jacobian(y, params, added_up(y, mode, params), jac)


@guards
def plate_guards(
    t: float,
    y: FloatArray,
    dy: FloatArray,
    mode: IntArray,
    params: FloatArray,
    h: FloatArray,
    hdot: FloatArray,
) -> None:
    """Fill in the compression of every spring, positive in contact."""
    slope = math.tan(y[2])
    steepening = (1.0 + slope * slope) * dy[2]
    arm = y[0] - params[FIRST]
    height, rate = params[REST_LENGTH] - y[1], slope * dy[0] - dy[1]
    for i in range(len(h)):
        a = arm - i * params[SPACING]
        h[i] = height + slope * a
        hdot[i] = rate + steepening * a


@dataclass(frozen=True)
class Plate:
    """Parameters of the plate and its bed, in SI units.

    Parameters
    ----------
    n_contacts : int
        Number of springs, evenly spaced over the bed; a single one stands in the
        middle.
    mass_kg, inertia_kg_m2 : float
        Mass of the plate and its moment of inertia about the centre of mass.
    stiffness_n_m, damping_n_s_m : float
        Stiffness and damping of all springs together, shared evenly.
    rest_length_m : float
        Height of a relaxed spring's end above the floor (L0).
    half_width_m : float
        Half the width of the bed, which is centred at 0.
    gravity_m_s2 : float
        Acceleration of gravity.
    """

    n_contacts: int = 35
    mass_kg: float = 1.0
    inertia_kg_m2: float = 1.0 / 3.0
    stiffness_n_m: float = 2000.0
    damping_n_s_m: float = 20.0
    rest_length_m: float = 1.0
    half_width_m: float = 1.0
    gravity_m_s2: float = 9.81

    def __post_init__(self) -> None:
        if self.n_contacts < 1:
            raise ValueError(
                f"n_contacts: expected at least 1, found {self.n_contacts}"
            )
        if not (self.mass_kg > 0 and self.inertia_kg_m2 > 0 and self.half_width_m > 0):
            raise ValueError(f"expected mass, inertia and half width > 0, found {self}")
        if not (self.stiffness_n_m > 0 and self.damping_n_s_m >= 0):
            raise ValueError(f"expected stiffness > 0 and damping >= 0, found {self}")

    @property
    def spring_places_m(self) -> FloatArray:
        """Places of the springs along the bed, (n_contacts,), m."""
        *_, first, spacing = self.params
        return np.asarray(first + spacing * np.arange(self.n_contacts))

    @property
    def params(self) -> tuple[float, ...]:
        """Parameters in the form that the compiled functions take."""
        n, w = self.n_contacts, self.half_width_m
        first, spacing = (-w, 2 * w / (n - 1)) if n > 1 else (0.0, 0.0)
        return (
            self.gravity_m_s2,
            self.mass_kg,
            self.inertia_kg_m2,
            self.rest_length_m,
            self.stiffness_n_m / n,
            self.damping_n_s_m / n,
            first,
            spacing,
        )

    def system(self, *, sums: bool = False, sparse: bool = False) -> System:
        """Return the hybrid system, with guards ``spring1`` ... ``spring<n>``.

        With `sums`, the field reads sums over the contacts, which the handler keeps in
        the system's memory; a start in contact needs ``solve(...,
        memory=plate.memory(y0))``. With `sparse`, meant for hundreds of springs or
        more, guards are also evaluated one by one, and distant ones sleep.
        """
        if sparse:
            return _system_of_sums(self.n_contacts, sparse=True)
        return (
            _system_of_sums(self.n_contacts, sparse=False)
            if sums
            else _system(self.n_contacts)
        )

    def memory(self, y0: ArrayLike) -> tuple[float, ...]:
        """Return the sums over the contacts for a start that may be in contact."""
        touching = np.flatnonzero(self.compressions(y0) > 0).astype(np.float64)
        return float(len(touching)), float(touching.sum()), float((touching**2).sum())

    def initial_states(self, count: int, seed: int) -> FloatArray:
        """Return random states at rest, centred over the bed, (count, 6), as in section 4.4.4.

        Heights are drawn from (2, 3) m and angles from (-0.1, 0.1) rad.
        """
        states = np.zeros((count, 6))
        states[:, 1:3] = np.random.default_rng(seed).uniform(
            (2.0, -0.1), (3.0, 0.1), (count, 2)
        )
        return states

    def compressions(self, y: ArrayLike) -> FloatArray:
        """Return h_i for states (6, ...): (n_contacts, ...), m; positive in contact."""
        x, z, angle, *_ = np.asarray(y, dtype=np.float64)
        arms = x - self.spring_places_m.reshape(-1, *(1,) * np.ndim(x))
        return self.rest_length_m + np.tan(angle) * arms - z

    def energy(self, y: ArrayLike) -> FloatArray:
        """Return the mechanical energy of states (6, ...), J; the floor is at height 0."""
        y = np.asarray(y, dtype=np.float64)
        motion = self.mass_kg * (y[3] ** 2 + y[4] ** 2) + self.inertia_kg_m2 * y[5] ** 2
        squares = np.sum(np.maximum(self.compressions(y), 0.0) ** 2, axis=0)
        springs = self.stiffness_n_m / self.n_contacts * squares
        fall = self.mass_kg * self.gravity_m_s2 * y[1]
        return np.asarray(0.5 * (motion + springs) + fall)


@cache
def _system(n_contacts: int) -> System:
    return System(
        field=plate_field,
        guards=plate_guards,
        jacobian=plate_field_jacobian,
        n_states=6,
        guard_names=_names(n_contacts),
    )


@cache
def _system_of_sums(n_contacts: int, sparse: bool) -> System:
    if sparse:
        guards = {"guard": plate_guard, "rate_bound": plate_rate_bound}
    else:
        guards = {"guards": plate_guards}
    return System(
        field=plate_field_of_sums,
        on_event=update_sums,
        jacobian=plate_jacobian,
        n_states=6,
        guard_names=_names(n_contacts),
        n_memory=N_MEMORY,
        **guards,
    )


def _names(n_contacts: int) -> tuple[str, ...]:
    return tuple(f"spring{i + 1}" for i in range(n_contacts))
