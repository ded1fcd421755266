"""A made-up runner: a pelvis whose skin moves, and two feet that land together."""

import numpy as np

RATE_HZ = 150.0
NAMES = ("R.ASIS", "L.ASIS", "R.PSIS", "L.PSIS")
# A runner's pelvis, m: the two PSIS are 91 mm apart, and the largest distance is 273
# mm.
PELVIS = np.array(
    [[0.1, -0.1365, 0], [0.1, 0.1365, 0], [-0.1, -0.0455, 0.05], [-0.1, 0.0455, 0.05]]
)
SHORTEST_M, SIZE_M, STANDS_M = 0.091, 0.273, 0.95
FLIGHT_S, STANCE_S = 0.12, 0.24
SINE = (
    0.961  # robust standard deviation of a sine of amplitude 1, from its outer fifths
)


def runner(seed, *, skin_m=0.0, wobble_m=0.0, noise_m=3e-4, n_frames=1500):
    """Return a pelvis (N, 4, 3) and two feet (N, 2, 3), m, of a runner with soft tissue.

    The skin of each marker moves with the stride, by the amplitude `skin_m` in some
    direction, and wobbles by up to `wobble_m` after each landing.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(n_frames) / RATE_HZ
    phase = time % (FLIGHT_S + STANCE_S)
    in_flight = phase < FLIGHT_S
    since_landing = phase - FLIGHT_S
    rise = 0.5 * 9.81 * phase * (FLIGHT_S - phase)
    sunk = -0.06 * np.sin(np.pi * np.clip(since_landing, 0, None) / STANCE_S)
    height = np.where(in_flight, rise, sunk)
    pelvis = PELVIS + np.array([0, 0, STANDS_M]) + height[:, None, None] * [0, 0, 1]
    for m in range(len(NAMES)):
        way = rng.normal(size=3)
        way *= skin_m / np.linalg.norm(way)
        stride = np.sin(
            np.pi * time / (FLIGHT_S + STANCE_S) + rng.uniform(0, 2 * np.pi)
        )
        pelvis[:, m] += stride[:, None] * way
        shaken = rng.normal(size=3)
        shaken *= wobble_m / np.linalg.norm(shaken)
        ring = np.exp(-since_landing / 0.06) * np.sin(2 * np.pi * 12 * since_landing)
        pelvis[:, m] += np.where(in_flight, 0.0, ring)[:, None] * shaken
    feet = np.zeros((n_frames, 2, 3))
    feet[:, :, 1] = [-0.1, 0.1]
    feet[:, :, 2] = np.maximum(height, 0.0)[:, None]
    noise = rng.normal(0, noise_m, (n_frames, 6, 3))
    return pelvis + noise[:, :4], feet + noise[:, 4:]
