"""The trajectory near the mean landing on which all feet touch at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError
from hopdata.hybrid import System, solve
from hopdata.hybrid.first_order.local import Instant, guards_at, linearise
from hopdata.scenes.hopper import N_STATES, flight_mode
from hopdata.scenes.hopper_control import HopperControl, control_field, control_system
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.rigid_body import rotation_matrices

FloatArray = NDArray[np.float64]

# What may vary of an apex state whose place and heading are left out.
FREE = np.array([2, 4, 5, 6, 7, 8, 9, 10, 11])
RTOL, ATOL = 1e-12, 1e-14
SAME_INSTANT_S = 1e-13
MOST_STEPS = 20


@dataclass(frozen=True)
class SimultaneousLanding:
    """A flight at whose end all feet touch at once.

    Parameters
    ----------
    apex_state, contact_state : (12,) array
        States at the apex (place and heading zero) and just before the contacts.
    contact_time_s : float
        Instant of the contacts, from the apex, s.
    """

    apex_state: FloatArray
    contact_state: FloatArray
    contact_time_s: float


@cache
def flying_system(n_legs: int) -> System:
    """Return the control's field without guards: all legs up (mode -1) or down (+1) for good."""
    return System(field=control_field, n_states=N_STATES, n_extra_modes=n_legs)


def homed(states: FloatArray) -> FloatArray:
    """States (L, 12) moved to the origin and turned to heading zero."""
    moved = states.copy()
    flat = np.zeros((len(states), 3))
    flat[:, 0] = states[:, 3]
    moved[:, [0, 1, 3]] = 0.0
    moved[:, 6:9] = np.einsum("nji,nj->ni", rotation_matrices(flat), states[:, 6:9])
    return moved


def simultaneous_landing(
    hopper: HopperParameters, control: HopperControl, apex_states: FloatArray
) -> SimultaneousLanding:
    """Find the apex state nearest to the mean from which all feet touch at once.

    Newton's method on the contact instants to first order; of all corrections the smallest is
    taken, by the covariance of the landings.

    Parameters
    ----------
    hopper, control
        What lands.
    apex_states : (L, 12) array
        States of the landings at their apexes.

    Raises
    ------
    AnalysisError
        If it does not converge: the landings are far from a simultaneous one.
    """
    moved = homed(apex_states)[:, FREE]
    mean, wide = moved.mean(axis=0), np.cov(moved.T)
    apex, fall = np.zeros(N_STATES), 0.0
    apex[FREE] = mean
    for _ in range(MOST_STEPS):
        contact, jacobian, fall, delays, instants = _contact(hopper, control, apex, fall)
        if np.ptp(instants) < SAME_INSTANT_S:
            return SimultaneousLanding(apex, contact, fall)
        slope = (delays @ jacobian)[:, FREE]
        slope, apart = slope - slope.mean(axis=0), instants - instants.mean()
        # The nearest point of the linearised set to the mean, not to the last guess.
        missing = apart - slope @ (apex[FREE] - mean)
        weights = np.linalg.lstsq(slope @ wide @ slope.T, missing, rcond=1e-10)[0]
        apex[FREE] = mean - wide @ slope.T @ weights
    raise AnalysisError(
        f"simultaneous contact: expected one near the mean landing, found instants "
        f"{1e3 * np.ptp(instants):.3g} ms apart after {MOST_STEPS} corrections"
    )


def _contact(
    hopper: HopperParameters, control: HopperControl, apex: FloatArray, fall: float
) -> tuple[FloatArray, FloatArray, float, FloatArray, FloatArray]:
    """Fly to the mean contact instant.

    Returns the state there, its derivative by the apex state, the instant, the derivatives of the
    contact instants by that state, and these instants relative to it.
    """
    n, vector = hopper.n_legs, control.vector(hopper)
    system = control_system(n)
    fall = fall or float(np.sqrt(2 * (apex[2] - hopper.leg_length_m) / hopper.gravity_m_s2))
    for _ in range(MOST_STEPS):
        flight = solve(
            flying_system(n), (0.0, fall), apex, params=vector, mode=[-1] * n,
            rtol=RTOL, atol=ATOL, jacobian=True,
        )  # fmt: skip
        start = Instant(fall, flight.y_end, flight_mode(n, -1.0), vector)
        here = linearise(system, start, np.ones(N_STATES))
        instants = -(guards_at(system, start, here.rate)[0] / here.guard_rates)[:n]
        if abs(instants.mean()) < SAME_INSTANT_S:
            break
        fall += float(instants.mean())
    delays = -here.gradients[:n] / here.guard_rates[:n, None]
    return flight.y_end, np.asarray(flight.jacobian), fall, delays, instants
