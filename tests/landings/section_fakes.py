"""A kinematic hopper with known contacts: quick to make, and purely geometric."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hopdata.recording import Recording

LEG_M, RADIUS_M, STANCE_S, GRAVITY = 0.27, 0.38, 0.245, 9.81


@dataclass(frozen=True)
class Fake:
    """A recording with the true motion of its feet."""

    recording: Recording
    foot_down: np.ndarray  # (N, n) bool
    body_height: np.ndarray  # (N,) without noise


def hopper(
    rng: np.random.Generator,
    *,
    hops: int = 300,
    feet: int = 3,
    rate_hz: float = 100.0,
    noise_m: float = 0.0006,
    tilt_rad: float = 0.03,
    extension_m: float = 0.1,
    arena_m: float = 0.9,
) -> Fake:
    """Hop: flight under gravity, half a sine in stance, and a speed and tilt for each hop.

    The legs are longer by `extension_m` at lift-off than at landing, and retract within
    0.1 s of flight. Each hop lands at a different place in an arena of half-width
    `arena_m`.
    """
    speed = 1.9 * (1 + 0.04 * rng.standard_normal(hops))
    flight = (speed + np.sqrt(speed**2 + 2 * GRAVITY * extension_m)) / GRAVITY
    starts = np.concatenate([[0.0], np.cumsum(flight + STANCE_S)])
    time = np.arange(0.0, starts[-1], 1.0 / rate_hz)
    hop = np.searchsorted(starts, time, side="right") - 1
    phase = time - starts[hop]
    centre, length = _centre_and_leg(phase, speed[hop], flight[hop], extension_m)
    sway = rng.normal(0, tilt_rad, (hops + 1, 2))
    tilt = np.stack([np.interp(time, starts + 0.2, sway[:, k]) for k in (0, 1)], axis=1)
    angle, body_angle = 2 * np.pi * np.arange(feet) / feet, np.array([0.0, 2.0, 4.0])
    arms = RADIUS_M * np.stack([np.cos(angle), np.sin(angle)])
    body_arms = 0.1 * np.stack([np.cos(body_angle), np.sin(body_angle)])
    free = (centre - length)[:, None] + tilt @ arms
    body = centre[:, None] + np.array([0.12, 0.17, 0.22]) + tilt @ body_arms
    place = rng.uniform(-arena_m, arena_m, (hops, 1, 2))[hop]
    positions = np.empty((len(time), 3 + feet, 3))
    positions[:, :3, :2] = place + body_arms.T
    positions[:, 3:, :2] = place + arms.T
    positions[:, :3, 2], positions[:, 3:, 2] = body, np.maximum(free, 0.0)
    positions += noise_m * rng.standard_normal(positions.shape)
    names = ("b1", "b2", "b3", *(f"f{k + 1}" for k in range(feet)))
    roles = ("body",) * 3 + ("foot",) * feet
    recording = Recording("fake", time, positions, names, roles, rate_hz)
    return Fake(recording, free <= 0.0, body.mean(axis=1))


def _centre_and_leg(
    phase: np.ndarray, speed: np.ndarray, flight: np.ndarray, extension_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the height of the chassis and the length of its legs; phase 0 is lift-off."""
    in_flight = phase < flight
    share = np.clip((phase - flight) / STANCE_S, 0.0, 1.0)
    up = extension_m + speed * phase - 0.5 * GRAVITY * phase**2
    deep = (speed + 0.5 * extension_m / STANCE_S) * STANCE_S / np.pi
    centre = LEG_M + np.where(
        in_flight, up, extension_m * share - deep * np.sin(np.pi * share)
    )
    drawn = np.where(in_flight, 1.0 - np.clip(phase / 0.1, 0.0, 1.0), share)
    return centre, LEG_M + extension_m * drawn


def on_floor(
    recording: Recording,
    floor: Callable[[np.ndarray, np.ndarray], np.ndarray],
    mounts_m: np.ndarray,
) -> Recording:
    """Put the recording on an uneven floor, with foot markers mounted at heights."""
    positions = recording.positions.copy()
    positions[:, :, 2] += floor(positions[:, :, 0], positions[:, :, 1])
    positions[:, recording.indices("foot"), 2] += mounts_m
    return replace(recording, positions=positions)
