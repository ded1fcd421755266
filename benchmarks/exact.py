"""Where the scenes with closed forms truly end."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm
from scipy.optimize import brentq

from hopdata.scenes.small import INITIAL_STATE, T_SPAN, VerticalHopper

FloatArray = NDArray[np.float64]


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
    """Return the end of the plate's first bounce (`peers.problems`), which has no closed form.

    From heyoka in extended precision at 1e-18; it changes by 1e-19 at 1e-17, and is met within
    2e-15 by heyoka and 1e-13 by SciPy's DOP853 in doubles: the benchmark's own rows show it again.
    """
    x, z, angle = -0.03919835492659511175, 1.2427224171290427716, 0.065025766442365411495
    vx, vz, omega = -0.08629287118608017742, -1.1722267053343060242, 0.2288024630480736818
    return np.array([x, z, angle, vx, vz, omega])
