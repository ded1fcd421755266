"""A made-up heel of a walk: it falls, glides above the floor, and comes down."""

import numpy as np
from scipy.interpolate import CubicHermiteSpline

import hopdata as hd

PERIOD_S = 1.1
BRAKES_S = 0.012  # in which the fall slows to the glide
STANDS_S = 0.62
SWING_M = 0.2


def heel(rng, time, *, glide_m, soft_s=0.005, steps=4):
    """Return heights (N,), m, and the instants (S,) at which the heel comes down, s."""
    height = np.zeros(len(time))
    truth = 0.8 + PERIOD_S * np.arange(steps) + rng.normal(0, 0.01, steps)
    for contact_s in truth:
        lasts_s = 0.1 * rng.uniform(0.8, 1.2)
        fall_m_s = 1.2 * rng.uniform(0.85, 1.15)
        ends_m_s = 0.2 * rng.uniform(0.8, 1.2)
        begins_s = contact_s - lasts_s
        since = time - begins_s
        slows = BRAKES_S * np.exp(-np.maximum(since, 0) / BRAKES_S)
        fall = fall_m_s * np.where(since < 0, BRAKES_S - since, slows)
        # The glide sinks evenly, and falls faster and faster at its end.
        last_s = 0.4 * lasts_s
        dive = np.maximum(time - contact_s + last_s, 0)
        dive_m = 0.5 * ends_m_s * last_s
        even_m = max(glide_m - dive_m, 0.0)
        even = even_m * np.clip((contact_s - time) / (0.7 * lasts_s), 0, 1)
        lands_m_s = ends_m_s + even_m / (0.7 * lasts_s)
        above = lands_m_s * soft_s + even + dive_m - 0.5 * ends_m_s / last_s * dive**2
        gives = np.zeros(len(time))
        if soft_s:
            gives = np.exp(-np.maximum(time - contact_s, 0) / soft_s)
        own = np.where(time < contact_s, fall + above, lands_m_s * soft_s * gives)
        rises_s = contact_s - 0.48
        joins_s = begins_s - 0.02
        middle_s = (rises_s + joins_s) / 2 - 0.03
        joins_m = float(np.interp(joins_s, time, fall + above))
        swing = CubicHermiteSpline(
            [rises_s, middle_s, joins_s], [0, SWING_M, joins_m], [0, 0, -fall_m_s]
        )
        own = np.where(time < joins_s, swing(np.maximum(time, rises_s)), own)
        is_step = (time >= rises_s) & (time <= contact_s + STANDS_S)
        height[is_step] = own[is_step]
    return height, truth


def walk(seed, *, rate_hz=100.0, noise_m=3e-4, steps=4, **options):
    """Return a recording of the heel under a body, and when the heel comes down, s."""
    rng = np.random.default_rng(seed)
    time = np.arange(round((steps * PERIOD_S + 1.0) * rate_hz)) / rate_hz
    height, truth = heel(rng, time, steps=steps, **options)
    positions = np.zeros((len(time), 4, 3))
    positions[:, :3] = [[0.0, 0.0, 1.0], [0.1, 0.0, 1.0], [0.0, 0.1, 1.0]]
    positions[:, :3, 2] += 0.02 * np.sin(4 * np.pi * time / PERIOD_S)[:, None]
    positions[:, 3, 2] = height
    positions[:, :, 0] += 1.3 * time[:, None]
    positions += rng.normal(0, noise_m, positions.shape)
    names = ["a", "b", "c", "heel"]
    recording = hd.Recording.from_arrays(
        time, positions, names, feet=["heel"], body=["a", "b", "c"]
    )
    return recording, truth
