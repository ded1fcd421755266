"""The undamped hopper in closed form, at all times."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.scenes.small import VerticalHopper

FloatArray = NDArray[np.float64]


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
