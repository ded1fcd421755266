"""A small rigid-body scene with springy, preloaded legs: landings with exact contact instants.

It is independent of `hopdata.scenes`: small tilt angles, any number of feet, a fixed
fine step, contact instants by interpolation within a step. Only the tests of this
folder use it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hopdata.landings.contacts.descents import Transitions, find_transitions
from hopdata.recording import Recording

FloatArray = NDArray[np.float64]

GRAVITY = 9.81
MASS, INERTIA = 2.7, 0.08
STIFFNESS, DAMPING, PRELOAD, EXTENSION = 90.0, 4.8, 22.0, 0.125
FOOT_RADIUS, LEG_LENGTH, RETRACT_S = 0.38, 0.27, 0.08
DROP_M, CYCLE_S = 0.241, 0.64
BODY_RADIUS, BODY_UP = 0.1, 0.05
PRE_HEIGHT_M = LEG_LENGTH + BODY_UP + 0.06
POST_HEIGHT_M = LEG_LENGTH + BODY_UP - 0.065


@dataclass(frozen=True)
class Scene:
    """A recording of independent landings, and its truth."""

    recording: Recording
    contact_times: FloatArray  # (L, n) s
    clean: Recording  # without noise
    velocities: FloatArray  # (N, B, 3) m/s, true velocities of the body markers


def transitions_of(scene: Scene, pre_height_m: float = PRE_HEIGHT_M) -> Transitions:
    """Return the transitions of the body through the sections of these scenes."""
    recording = scene.recording
    return find_transitions(
        recording.time,
        recording.body_height,
        pre_height_m=pre_height_m,
        post_height_m=POST_HEIGHT_M,
    )


def _circle(n: int, radius: float, turn: float = 0.0) -> FloatArray:
    angle = 2 * np.pi * np.arange(n) / n + turn
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def simulate(
    landings: int,
    *,
    feet: int = 3,
    body: int = 3,
    rate_hz: float = 100.0,
    noise_m: float = 0.0006,
    tilt_rate: float = 0.25,
    drop_m: float = DROP_M,
    seed: int = 0,
    name: str = "synthetic",
) -> Scene:
    """Simulate `landings` cycles, each from a fresh random apex state."""
    rng = np.random.default_rng(seed)
    sub = max(1, int(np.ceil(4000 / rate_hz)))
    dt = 1 / (rate_hz * sub)
    n_frames = round(CYCLE_S * rate_hz)
    phase = rng.integers(0, sub, landings)
    foot_xy, body_xy = _circle(feet, FOOT_RADIUS), _circle(body, BODY_RADIUS, 0.3)
    lever = np.column_stack([np.ones(feet), foot_xy[:, 1], -foot_xy[:, 0]])
    q = np.zeros((landings, 3))
    q[:, 0] = drop_m + rng.normal(0, 0.004, landings)
    q[:, 1:] = rng.normal(0, 0.01, (landings, 2))
    v = np.zeros((landings, 3))
    v[:, 1:] = rng.normal(0, tilt_rate, (landings, 2))
    frames_q, frames_v, frames_foot, touched = _fall(
        q, v, phase, lever, n_frames, sub, dt
    )
    return _observe(
        frames_q, frames_v, frames_foot, touched - phase[:, None] * dt, foot_xy, body_xy,
        rate_hz=rate_hz, noise_m=noise_m, rng=rng, name=name,
    )  # fmt: skip


@njit(cache=True)
def _fall(q, v, phase, lever, n_frames, sub, dt):
    """Return states and foot heights at each landing's frames, and when each foot touched."""
    landings, feet = len(q), len(lever)
    frames_q, frames_v = (
        np.empty((landings, n_frames, 3)),
        np.empty((landings, n_frames, 3)),
    )
    frames_foot = np.empty((landings, n_frames, feet))
    touched = np.full((landings, feet), np.nan)
    mid, speed_mid, pull = np.empty(3), np.empty(3), np.empty(3)
    gap, gap_mid, gap_new = np.empty(feet), np.empty(feet), np.empty(feet)
    for one in range(landings):
        down, lifted = np.zeros(feet, np.bool_), np.full(feet, np.nan)
        landed = False
        now, speed = q[one].copy(), v[one].copy()
        for step in range(phase[one] + n_frames * sub):
            t = step * dt
            _accelerate(now, speed, down, lever, gap, pull)
            k, rest = divmod(step - phase[one], sub)
            if rest == 0 and k >= 0:
                frames_q[one, k], frames_v[one, k] = now, speed
                for f in range(feet):
                    since = min(t - lifted[f], RETRACT_S) / RETRACT_S
                    leg = (
                        EXTENSION * (1 - since**2 * (3 - 2 * since))
                        if lifted[f] > 0
                        else 0.0
                    )
                    frames_foot[one, k, f] = 0.0 if down[f] else gap[f] - leg
            for a in range(3):
                mid[a] = now[a] + 0.5 * dt * speed[a]
                speed_mid[a] = speed[a] + 0.5 * dt * pull[a]
            _accelerate(mid, speed_mid, down, lever, gap_mid, pull)
            for a in range(3):
                now[a] += dt * speed_mid[a]
                speed[a] += dt * pull[a]
            n_down = 0
            for f in range(feet):
                gap_new[f] = _along(lever, f, now)
                if (
                    not down[f]
                    and gap[f] > 0
                    and gap_new[f] <= 0
                    and np.isnan(lifted[f])
                ):
                    touched[one, f] = t + dt * gap[f] / (gap[f] - gap_new[f])
                    down[f] = True
                n_down += down[f]
            landed |= n_down == feet
            for f in range(feet):
                if down[f] and touched[one, f] < t and gap_new[f] >= EXTENSION * landed:
                    lifted[f] = t + dt
                    down[f] = False
    return frames_q, frames_v, frames_foot, touched


@njit(cache=True)
def _along(lever, f, state):
    return lever[f, 0] * state[0] + lever[f, 1] * state[1] + lever[f, 2] * state[2]


@njit(cache=True)
def _accelerate(now, speed, down, lever, gap, pull):
    """Fill in the heights of the feet above the floor, and the accelerations."""
    pull[:] = 0.0
    for f in range(len(lever)):
        gap[f] = _along(lever, f, now)
        if down[f]:
            force = PRELOAD - STIFFNESS * gap[f] - DAMPING * _along(lever, f, speed)
            for a in range(3):
                pull[a] += force * lever[f, a]
    for a in range(3):
        pull[a] *= 3.0 / len(lever) / (MASS if a == 0 else INERTIA)
    pull[0] -= GRAVITY


def _observe(
    q: FloatArray, v: FloatArray, foot_z: FloatArray, touched: FloatArray, foot_xy: FloatArray,
    body_xy: FloatArray, *, rate_hz: float, noise_m: float, rng: np.random.Generator, name: str,
) -> Scene:  # fmt: skip
    landings, n_frames, feet = foot_z.shape
    body = len(body_xy)
    time = np.arange(landings * n_frames) / rate_hz
    local = np.arange(n_frames) / rate_hz
    drift = rng.normal(0, 0.1, (landings, 2))
    spin, start = rng.normal(0, 0.3, landings), rng.uniform(0, 2 * np.pi, landings)
    yaw = start[:, None] + spin[:, None] * local
    where = drift[:, None, :] * local[:, None]
    cos, sin = np.cos(yaw), np.sin(yaw)

    def turned(xy: FloatArray) -> FloatArray:
        return np.stack([cos * xy[0] - sin * xy[1], sin * xy[0] + cos * xy[1]], axis=-1)

    positions = np.empty((landings, n_frames, body + feet, 3))
    velocities = np.empty((landings, n_frames, body, 3))
    for b, xy in enumerate(body_xy):
        arm = np.array([1.0, xy[1], -xy[0]])
        positions[:, :, b, :2] = where + turned(xy)
        positions[:, :, b, 2] = LEG_LENGTH + BODY_UP + q @ arm
        side = turned(np.array([-xy[1], xy[0]]))
        velocities[:, :, b, :2] = drift[:, None, :] + spin[:, None, None] * side
        velocities[:, :, b, 2] = v @ arm
    for f, xy in enumerate(foot_xy):
        positions[:, :, body + f, :2] = where + turned(xy)
        positions[:, :, body + f, 2] = foot_z[:, :, f]
    markers = tuple(f"body{i + 1}" for i in range(body)) + tuple(
        f"foot{i + 1}" for i in range(feet)
    )
    roles = ("body",) * body + ("foot",) * feet
    flat = positions.reshape(-1, body + feet, 3)
    clean = Recording(name, time, flat, markers, roles, rate_hz)
    noisy = flat + rng.normal(0, noise_m, flat.shape)
    return Scene(
        Recording(name, time, noisy, markers, roles, rate_hz),
        touched + (np.arange(landings) * n_frames / rate_hz)[:, None],
        clean,
        velocities.reshape(-1, body, 3),
    )
