"""A simulated hopper with a swinging boom, and its true pose, boom angle and landings."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from hopdata.recording import Recording
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.synthesis.camera import track_markers
from hopdata.synthesis.trial import MarkerOptions, run_trial

SWING = np.deg2rad(67.5)


@dataclass(frozen=True)
class Steered:
    """A recording and its truth; `hop` marks landings that are one hop before the next."""

    recording: Recording
    yaw: np.ndarray
    middle: np.ndarray
    boom_angle: np.ndarray
    lowest_s: np.ndarray
    hop: np.ndarray


@cache
def _trial(hops, rate_hz, angle, seed):
    hopper = HopperParameters(
        mass_kg=2.6,
        counterweight_mass_kg=0.1,
        inertia_z_kg_m2=0.04,
        damping_n_s_m=5.5,
        boom_angle_rad=angle,
        boom_swing_rad=SWING,
        boom_duration_s=0.25,
    )
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    trial = run_trial(hopper, hops=hops, rate_hz=rate_hz, rng=rng)
    return hopper, trial, track_markers(trial, hopper, MarkerOptions())


def steered(*, hops=40, rate_hz=100.0, angle=np.pi, seed=1, noise_m=0.0006):
    """Simulate a recording; all markers are seen."""
    hopper, trial, tracks = _trial(hops, rate_hz, angle, seed)
    rng = np.random.default_rng(np.random.SeedSequence([seed, 1]))
    noise = noise_m * rng.standard_normal(tracks.positions.shape)
    time = np.arange(len(noise)) / rate_hz
    recording = Recording(
        "steered", time, tracks.positions + noise, tracks.names, tracks.roles, rate_hz
    )
    x, y = trial.boom[:, 0] - hopper.boom_offset_m, trial.boom[:, 1]
    middle = tracks.positions[:, :3].mean(axis=1)
    return Steered(
        recording,
        trial.states[:, 3],
        middle,
        np.arctan2(y, x),
        *_landings(hops, angle, seed),
    )


def _landings(hops, angle, seed):
    """Return lowest points, read at 1000 Hz, and whether nobody carries the hopper afterwards."""
    _, trial, tracks = _trial(hops, 1000.0, angle, seed)
    height = tracks.positions[:, :3, 2].mean(axis=1)
    ends = trial.hop_start_s + [hop.end_time_s for hop in trial.hops]
    assert all(hop.all_stood() and not hop.fell for hop in trial.hops)
    lowest = [
        (int(1000 * a) + 1 + np.argmin(height[int(1000 * a) + 1 : int(1000 * b)]))
        / 1000
        for a, b in zip(trial.hop_start_s, ends, strict=True)
    ]
    on = np.append(np.abs(ends[:-1] - trial.hop_start_s[1:]) < 1e-6, False)
    return np.array(lowest), on


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def heights(hopper, noise_m=0.00035, seed=1):
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    return hopper.middle[:, 2] + noise_m * rng.standard_normal(len(hopper.middle))


def as_landings(instants, hopper, within=0.05):
    near = np.abs(instants[..., None] - hopper.lowest_s).argmin(axis=-1)
    assert np.abs(instants - hopper.lowest_s[near]).max(initial=0.0) < within
    return near


def true_pairs(hopper):
    first = np.flatnonzero(hopper.hop)
    return np.column_stack([first, first + 1])
