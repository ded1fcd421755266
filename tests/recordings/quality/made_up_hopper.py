"""A simple made-up hopper: a rigid body, three feet that rest in stance, and a post."""

import numpy as np

MARKERS = ("hip1", "hip2", "hip3", "toe1", "toe2", "toe3", "post")
BODY = np.array([[0.13, 0.03, 0.30], [-0.08, 0.11, 0.33], [-0.07, -0.14, 0.31]])
FEET = np.array([[0.38, 0.0, 0.0], [-0.19, 0.33, 0.0], [-0.19, -0.33, 0.0]])
POST = np.array([1.5, 1.0, 0.8])
GRAVITY, FLIGHT_S, STANCE_S = 9.81, 0.3, 0.3


def hopping(seed, *, n_frames=2000, rate_hz=100.0, noise_m=6e-4):
    """Return time (N,), s, and positions (N, 7, 3), m, z up, of hops of random speed and tilt."""
    rng = np.random.default_rng(seed)
    time = np.arange(n_frames) / rate_hz
    height, tilt = _height_and_tilt(time, rng)
    drift = np.cumsum(rng.normal(0, 0.002, (n_frames, 2)), axis=0) * np.sqrt(
        100 / rate_hz
    )
    drift = _smooth(drift, max(3, int(0.3 * rate_hz)))
    yaw = _smooth(
        np.cumsum(rng.normal(0, 0.004, (n_frames, 1)), axis=0), int(0.3 * rate_hz) + 3
    )
    turn = np.stack([np.cos(yaw[:, 0]), -np.sin(yaw[:, 0])], axis=1)
    positions = np.empty((n_frames, 7, 3))
    for m, place in enumerate(np.concatenate([BODY, FEET])):
        positions[:, m, 0] = turn @ place[:2] + drift[:, 0]
        positions[:, m, 1] = turn @ np.array([place[1], -place[0]]) + drift[:, 1]
        rise = height + tilt @ place[:2]
        positions[:, m, 2] = place[2] + (rise if m < 3 else np.maximum(rise, 0.0))
    positions[:, 6] = POST
    return time, positions + rng.normal(0, noise_m, positions.shape)


def _height_and_tilt(time, rng):
    """Return height (N,) above the stance, in flight and springy stance, and tilt (N, 2)."""
    height, tilt = np.empty(len(time)), np.zeros((len(time), 2))
    start = 0.0
    while start <= time[-1]:
        flight, stance = (
            FLIGHT_S * rng.uniform(0.85, 1.15),
            STANCE_S * rng.uniform(0.9, 1.1),
        )
        up, down = (start <= time) & (time < start + flight), start + flight <= time
        s = time[up] - start
        height[up] = 0.5 * GRAVITY * s * (flight - s)
        tilt[up] = rng.normal(0, 0.03, 2) * np.sin(np.pi * s / flight)[:, None] ** 2
        depth = 0.5 * GRAVITY * flight * stance / np.pi
        s = time[down] - start - flight
        height[down] = -depth * np.sin(np.pi * np.minimum(s / stance, 1.0))
        start += flight + stance
    return height, tilt


def _smooth(walk, width):
    kernel = np.hanning(width + 2)[1:-1]
    kernel /= kernel.sum()
    padded = np.pad(walk, ((width, width), (0, 0)), mode="edge")
    columns = [np.convolve(c, kernel, "same")[width:-width] for c in padded.T]
    return np.stack(columns, axis=1)


def with_gap(positions, marker, start, stop):
    changed = positions.copy()
    changed[start:stop, MARKERS.index(marker)] = np.nan
    return changed


def with_swap(positions, one, other, start, stop):
    changed = positions.copy()
    a, b = MARKERS.index(one), MARKERS.index(other)
    changed[start:stop, [a, b]] = positions[start:stop, [b, a]]
    return changed


def with_spike(positions, marker, frame, size, *, seed=0, n_frames=1):
    changed = positions.copy()
    way = np.random.default_rng(seed).normal(size=3)
    changed[frame : frame + n_frames, MARKERS.index(marker)] += (
        size * way / np.linalg.norm(way)
    )
    return changed


def with_frozen(positions, marker, start, stop):
    changed = positions.copy()
    changed[start:stop, MARKERS.index(marker)] = positions[start, MARKERS.index(marker)]
    return changed
