"""A made-up walker's heel that dips as it touches, and a toe that tilts as its heel does.

Both then stand higher than where they were lowest. A leg slows the heel in a tenth of a
second, to a glide; the toe is stopped by the floor.
"""

import numpy as np

from hopdata.recording import Recording

PERIOD_S = 1.1
FINE_S = 1e-4
RISES_S = 0.12


def dipping(seed, *, is_toe=False, rate_hz=100.0, noise_m=1e-4, depth_m=0.008, steps=5):
    """Return a recording of one foot, and when it touched, s."""
    rng = np.random.default_rng(seed)
    n_frames = int((steps * PERIOD_S + 1.0) * rate_hz)
    time = np.arange(n_frames) / rate_hz
    height = np.zeros(n_frames)
    truth = []
    for step in range(steps):
        contact_s = 0.8 + step * PERIOD_S + rng.uniform(0.0, 0.02)
        truth.append(contact_s)
        since, curve = _step(rng, depth_m, is_toe=is_toe)
        own = (time >= contact_s + since[0]) & (time < contact_s + since[-1])
        height[own] = np.interp(time[own] - contact_s, since, curve)
    positions = np.zeros((n_frames, 4, 3))
    positions[:, :3] = [[0.0, 0.0, 1.0], [0.1, 0.0, 1.0], [0.0, 0.1, 1.0]]
    sway = 0.02 * np.sin(4 * np.pi * time / PERIOD_S)
    positions[:, :3, 2] += sway[:, None]
    positions[:, 3, 2] = height
    positions[:, :, 0] += 1.3 * time[:, None]
    positions += rng.normal(0, noise_m, positions.shape)
    names = ["a", "b", "c", "foot"]
    recording = Recording.from_arrays(
        time, positions, names, feet=["foot"], body=names[:3]
    )
    return recording, np.array(truth)


def _step(rng, depth_m, *, is_toe):
    """Return times about a contact (n,), s, and heights above the later rest, m."""
    since = np.arange(-0.45, 0.5, FINE_S)
    swing_m_s = rng.uniform(1.0, 1.4)
    if is_toe:
        velocity = np.where(since < 0, -swing_m_s, 0.0)
        # From 3 mm above where it later stands it tilts to the depth below.
        tilts = (since > 0.02) & (since < 0.08)
        velocity[tilts] = -(depth_m + 0.003) / 0.06
        lowest_s = 0.08
    else:
        sinks_m_s = rng.uniform(0.16, 0.24)
        lasts_s = (depth_m + 0.003) / sinks_m_s
        glides_from = -1.3 * lasts_s - rng.uniform(0.02, 0.04)
        slowed_in = rng.uniform(0.1, 0.13)
        share = np.clip((since - glides_from) / slowed_in + 1, 0, 1)
        velocity = -swing_m_s * (0.5 + 0.5 * np.cos(np.pi * share))
        sinks = np.clip((since + 1.3 * lasts_s) / (0.6 * lasts_s), 0, 1)
        velocity -= np.where(since < 0, sinks_m_s * sinks, 0.0)
        lowest_s = 0.01
    rises = (since - lowest_s) / RISES_S
    is_rising = (rises > 0) & (rises < 1)
    velocity[is_rising] += (
        depth_m / RISES_S * (1 - np.cos(2 * np.pi * rises[is_rising]))
    )
    height = np.cumsum(velocity) * FINE_S
    height -= height[-1]
    # Before, it swings at 0.15 m and has left from rest.
    return since, np.minimum(height, 0.15)
