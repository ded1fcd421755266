"""A made-up robot that draws in its feet during flight, so that its body falls faster."""

import numpy as np

GRAVITY = 9.81
FLIGHT_S, STANCE_S = 0.3, 0.25
STROKE_M = 0.06
ON_TORSO = 7
ON_FEET = 2


def robot(seed, *, strength_g, mass_share=0.2, rate_hz=250.0, seconds=8.0):
    """Return positions (N, 9, 3), m, z up: seven markers of the torso, then two feet.

    The centre of mass falls freely. The feet, which have `mass_share` of the mass, are
    accelerated towards the torso by `strength_g`, in g, and extended again likewise.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * rate_hz)) / rate_hz
    centre = np.zeros(len(time))
    drawn_in = np.zeros(len(time))
    start = 0.0
    while start < time[-1]:
        flight = FLIGHT_S * rng.uniform(0.85, 1.15)
        stance = STANCE_S * rng.uniform(0.9, 1.1)
        strength = strength_g * GRAVITY * rng.uniform(0.9, 1.1)
        since = time - start
        flies = (since >= 0) & (since < flight)
        stands = (since >= flight) & (since < flight + stance)
        rise = 0.5 * GRAVITY * since * (flight - since)
        depth = 0.5 * GRAVITY * flight * stance / np.pi
        sunk = depth * np.sin(np.pi * (since - flight) / stance)
        centre = np.where(flies, rise, np.where(stands, -sunk, centre))
        stroke_s = 2 * np.sqrt(STROKE_M / strength)
        inwards = _stroke(since / stroke_s)
        outwards = _stroke((since - flight + stroke_s) / stroke_s)
        drawn_in = np.where(flies, STROKE_M * (inwards - outwards), drawn_in)
        start += flight + stance
    torso = centre - mass_share * drawn_in
    feet = np.maximum(torso + drawn_in, 0.0)
    heights = np.stack([torso] * ON_TORSO + [feet] * ON_FEET, axis=1)
    places = rng.uniform(-0.15, 0.15, (ON_TORSO + ON_FEET, 3))
    places[:ON_TORSO, 2] += 0.3
    places[ON_TORSO:, 2] = 0.0
    positions = places + heights[:, :, None] * [0.0, 0.0, 1.0]
    return positions + rng.normal(0, 4e-4, positions.shape)


def _stroke(progress):
    """Return how far, from 0 to 1, after speeding up and then slowing down evenly."""
    progress = np.clip(progress, 0, 1)
    return np.where(progress < 0.5, 2 * progress**2, 1 - 2 * (1 - progress) ** 2)
