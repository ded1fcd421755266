# ruff: noqa: ARG001 (the integrator prescribes the signatures of field and guards)
"""A plate that falls onto a bed of springs (dissertation, section 4.4.4): many contacts.

State (6): place x, z of the centre of mass, m, angle theta of the plate, rad, and their rates. The
plate is a rigid line, long enough to stand above every spring; `plate_forces` has the mechanics.
One two-way guard a spring: its compression h_i rises through zero at touchdown (lock +1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from hopdata.hybrid import System, field, guards, jacobian
from hopdata.hybrid.solution import FloatArray, IntArray
from hopdata.scenes import plate_forces as pf
from hopdata.scenes.plate_incremental import (
    N_MEMORY,
    plate_field_of_sums,
    plate_guard,
    plate_jacobian,
    plate_rate_bound,
    update_sums,
)


@field
def plate_field(
    t: float, y: FloatArray, mode: IntArray, params: FloatArray, dy: FloatArray
) -> None:
    """Return gravity, and the push of every spring in contact."""
    pf.fill_rates(y, params, pf.added_up(y, mode, params), dy)


@jacobian
def plate_field_jacobian(
    t: float, y: FloatArray, mode: IntArray, params: FloatArray, jac: FloatArray
) -> None:
    """Return the derivative of the field with respect to the state."""
    pf.fill_jacobian(y, params, pf.added_up(y, mode, params), jac)


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
    """Return the compression of every spring: positive in contact."""
    slope = math.tan(y[2])
    steepening = (1.0 + slope * slope) * dy[2]
    arm = y[0] - params[pf.FIRST]
    height, rate = params[pf.REST_LENGTH] - y[1], slope * dy[0] - dy[1]
    for i in range(len(h)):
        a = arm - i * params[pf.SPACING]
        h[i] = height + slope * a
        hdot[i] = rate + steepening * a


@dataclass(frozen=True)
class Plate:
    """Parameters of the plate and its bed, in SI units.

    Parameters
    ----------
    n_contacts : int
        Number of springs, evenly spaced over the bed; a single one stands in the middle.
    mass_kg, inertia_kg_m2 : float
        Mass of the plate and its moment of inertia about the centre of mass.
    stiffness_n_m, damping_n_s_m : float
        Stiffness and damping of all springs together, shared evenly.
    rest_length_m : float
        Height of a relaxed spring's end above the floor (L0).
    half_width_m : float
        The bed reaches from minus this to this.
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
            raise ValueError(f"n_contacts: expected at least 1, found {self.n_contacts}")
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
        """Parameters as the compiled functions take them."""
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

        With `sums`, the field reads sums over the contacts, which the handler keeps in the system's
        memory; a start in contact needs ``solve(..., memory=plate.memory(y0))``. With `sparse`, for
        hundreds of springs and more, guards are evaluated one by one as well, and far ones sleep.
        """
        if sparse:
            return _system_of_sums(self.n_contacts, sparse=True)
        return _system_of_sums(self.n_contacts, sparse=False) if sums else _system(self.n_contacts)

    def memory(self, y0: ArrayLike) -> tuple[float, ...]:
        """Return the sums over the contacts for a start that may be in contact."""
        touching = np.flatnonzero(self.compressions(y0) > 0).astype(np.float64)
        return float(len(touching)), float(touching.sum()), float((touching**2).sum())

    def initial_states(self, count: int, seed: int) -> FloatArray:
        """Return random states at rest, centred over the bed, (count, 6), as in section 4.4.4.

        Heights are drawn from (2, 3) m, angles from (-0.1, 0.1) rad.
        """
        states = np.zeros((count, 6))
        states[:, 1:3] = np.random.default_rng(seed).uniform((2.0, -0.1), (3.0, 0.1), (count, 2))
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
