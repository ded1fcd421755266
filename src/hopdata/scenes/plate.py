# ruff: noqa: ARG001 (the integrator prescribes the signatures of its callbacks)
"""A plate that falls onto a bed of springs (section 4.4.4): a scene of many contacts.

State (6): position x, z of the centre of mass, m, angle theta of the plate, rad, and
their rates. The plate is a rigid line, long enough to lie above every spring (an
infinite bar). Each spring stands upright at x_i and has no mass or friction; a guide
keeps its end on a vertical line. The plate's line passes above it at z - tan(theta) (x
- x_i), so its compression is

    h_i = L0 + tan(theta) (x - x_i) - z.

It is a guard crossed in both directions, rising at touchdown. While h_i > 0, the spring
pushes up with F_i = k h_i + c dh_i/dt. The generalised forces are -F_i Dh_i, the
gradient of the potential (k / 2) h_i^2, so energy is conserved for c = 0. In other
words, the reaction is normal to the plate, as it must be without friction, and its
vertical part is F_i. Contact depends on position alone, so a damped spring pulls a
little just before it lets go.

With a_i = x - x_i, compression and rate are affine in a_i, and so is F_i = P + Q a_i.
The plate depends on the contacts only through their sums of 1, a_i and a_i^2. For very
many springs, the field needs only their count and the sums of their indices and squared
indices. The handler keeps these in the memory behind the parameters. They are integers,
so they stay exact however often springs come and go.

It is integrated only, so it is none of `hopdata.scenes.SCENES`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, IntArray
from hopdata.code_cache import kept_njit
from hopdata.hybrid import (
    System,
    field,
    guard,
    guards,
    jacobian,
    on_event,
    rate_bound,
)

# Places in the flat vector of parameters; spring i stands at first + i * spacing.
GRAVITY, MASS, INERTIA, REST_LENGTH, STIFFNESS, DAMPING, FIRST, SPACING = range(8)
N_PARAMS = 8

Sums = tuple[float, float, float]  # sums over the contacts of 1, a and a^2


@kept_njit(error_model="numpy")
def compression(i: float, y: FloatArray, p: FloatArray) -> float:
    """Return the compression h_i of spring i, m; negative above it."""
    arm = y[0] - p[FIRST] - i * p[SPACING]
    return p[REST_LENGTH] + math.tan(y[2]) * arm - y[1]


@kept_njit(error_model="numpy")
def added_up(y: FloatArray, mode: IntArray, p: FloatArray) -> Sums:
    """Return the sums over the springs whose locks indicate contact."""
    count = 0.0
    arms = 0.0
    squares = 0.0
    arm = y[0] - p[FIRST]
    for i in range(len(mode)):
        if mode[i] > 0:
            a = arm - i * p[SPACING]
            count += 1.0
            arms += a
            squares += a * a
    return count, arms, squares


@kept_njit(error_model="numpy")
def push(y: FloatArray, p: FloatArray, slope: float) -> tuple[float, float]:
    """Return (P, Q) of the force P + Q a of a spring in contact at this slope."""
    steepening = (1.0 + slope * slope) * y[5]
    height = p[REST_LENGTH] - y[1]
    rate = slope * y[3] - y[4]
    at_centre = p[STIFFNESS] * height + p[DAMPING] * rate
    per_arm = p[STIFFNESS] * slope + p[DAMPING] * steepening
    return at_centre, per_arm


@kept_njit(error_model="numpy")
def fill_rates(y: FloatArray, p: FloatArray, sums: Sums, dy: FloatArray) -> None:
    """Fill the rate of the state, (6,)."""
    slope = math.tan(y[2])
    at_centre, per_arm = push(y, p, slope)
    force = at_centre * sums[0] + per_arm * sums[1]
    moment = at_centre * sums[1] + per_arm * sums[2]
    dy[0] = y[3]
    dy[1] = y[4]
    dy[2] = y[5]
    dy[3] = -slope * force / p[MASS]
    dy[4] = force / p[MASS] - p[GRAVITY]
    dy[5] = -(1.0 + slope * slope) * moment / p[INERTIA]


@kept_njit(error_model="numpy")
def fill_force_row(
    y: FloatArray, p: FloatArray, s0: float, s1: float, row: FloatArray
) -> None:
    """Fill the gradient, (6,), of sum(F_i w_i), with s0 = sum(w), s1 = sum(w a)."""
    slope = math.tan(y[2])
    k = p[STIFFNESS]
    c = p[DAMPING]
    grow = 1.0 + slope * slope  # derivative of the slope with respect to the angle
    row[0] = push(y, p, slope)[1] * s0
    row[1] = -k * s0
    row[2] = grow * (c * y[3] * s0 + (k + 2.0 * c * slope * y[5]) * s1)
    row[3] = c * slope * s0
    row[4] = -c * s0
    row[5] = c * grow * s1


@kept_njit(error_model="numpy")
def fill_jacobian(y: FloatArray, p: FloatArray, sums: Sums, jac: FloatArray) -> None:
    """Fill the derivative of the rates by the state, (6, 6), initially zero."""
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
COUNT = N_PARAMS
NUMBERS = N_PARAMS + 1
SQUARES = N_PARAMS + 2
N_MEMORY = 3


@kept_njit(error_model="numpy")
def sums_of_arms(y: FloatArray, p: FloatArray) -> Sums:
    """Return the sums over the contacts of 1, a and a^2, where a = x - x_i."""
    arm = y[0] - p[FIRST]
    step = p[SPACING]
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
    slope = math.tan(y[2])
    arm = y[0] - params[FIRST] - k * params[SPACING]
    h[k] = params[REST_LENGTH] + slope * arm - y[1]
    hdot[k] = slope * dy[0] - dy[1] + (1.0 + slope * slope) * dy[2] * arm


@rate_bound
def plate_rate_bound(
    t: float, y: FloatArray, dy: FloatArray, mode: IntArray, params: FloatArray
) -> float:
    """Return the largest rate of any compression, m/s: of the first or last spring."""
    slope = math.tan(y[2])
    rate = slope * dy[0] - dy[1]
    per_arm = (1.0 + slope * slope) * dy[2]
    first = y[0] - params[FIRST]
    last = first - (len(mode) - 1) * params[SPACING]
    return max(abs(rate + per_arm * first), abs(rate + per_arm * last))


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
    height = params[REST_LENGTH] - y[1]
    rate = slope * dy[0] - dy[1]
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
        n = self.n_contacts
        first = 0.0
        spacing = 0.0
        if n > 1:
            first = -self.half_width_m
            spacing = 2 * self.half_width_m / (n - 1)
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
        if sums:
            return _system_of_sums(self.n_contacts, sparse=False)
        return _system(self.n_contacts)

    def memory(self, y0: ArrayLike) -> tuple[float, ...]:
        """Return the sums over the contacts for a start that may be in contact."""
        touching = np.flatnonzero(self.compressions(y0) > 0).astype(np.float64)
        return float(len(touching)), float(touching.sum()), float((touching**2).sum())

    def initial_states(self, count: int, seed: int) -> FloatArray:
        """Return random states at rest over the bed, (count, 6), as in section 4.4.4.

        Heights are drawn from (2, 3) m and angles from (-0.1, 0.1) rad.
        """
        states = np.zeros((count, 6))
        lowest = (2.0, -0.1)
        highest = (3.0, 0.1)
        rng = np.random.default_rng(seed)
        states[:, 1:3] = rng.uniform(lowest, highest, (count, 2))
        return states

    def compressions(self, y: ArrayLike) -> FloatArray:
        """Return h_i for states (6, ...): (n_contacts, ...), m; positive in contact."""
        x, z, angle, *_ = np.asarray(y, dtype=np.float64)
        # The springs are the first axis; those of the states follow.
        beside = (1,) * np.ndim(x)
        arms = x - self.spring_places_m.reshape(-1, *beside)
        return self.rest_length_m + np.tan(angle) * arms - z

    def gradients(self, y: ArrayLike) -> FloatArray:
        """Return Dh_i by x, z and angle at a state (6,): (n_contacts, 3)."""
        x, _, angle, *_ = np.asarray(y, dtype=np.float64)
        arms = x - self.spring_places_m
        rows = np.empty((self.n_contacts, 3))
        rows[:, 0] = np.tan(angle)
        rows[:, 1] = -1.0
        rows[:, 2] = arms / np.cos(angle) ** 2
        return rows

    def energy(self, y: ArrayLike) -> FloatArray:
        """Return the energy of states (6, ...), J; the floor is at height 0."""
        y = np.asarray(y, dtype=np.float64)
        motion = self.mass_kg * (y[3] ** 2 + y[4] ** 2) + self.inertia_kg_m2 * y[5] ** 2
        pressed = np.maximum(self.compressions(y), 0.0)
        squares = np.sum(pressed**2, axis=0)
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


# A fall of the plate on 35 springs. Within the span it bounces once: each spring is
# touched and left once.
PLATE_START = (0.0, 2.5, 0.05, 0.0, 0.0, 0.0)
PLATE_SPAN = (0.0, 1.0)


def plate_end() -> FloatArray:
    """Return the state (6,) `PLATE_SPAN` after `PLATE_START`; it has no closed form.

    The numbers come from heyoka in extended precision at a tolerance of 1e-18; at 1e-17
    they change by 1e-19. In double precision, heyoka reaches them within 2e-15 and
    SciPy's DOP853 within 1e-13 (``work_precision.csv``).
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
