"""The hopper that is steered, its boom swinging to and fro, with true poses and landings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.recording import Recording
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.synthesis.camera import MarkerTracks, draw_floor, draw_gaps, observe, track_markers
from hopdata.synthesis.trial import FloorOptions, GapOptions, MarkerOptions, Trial, run_trial

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

SWING_RAD = np.deg2rad(67.5)
N_ANGLES = 8  # recordings start at so many boom angles, and so cover the circle
FLAT = FloorOptions(bowl_depth_m=0.0, waves=0)
FINE_HZ = 1000.0  # rate at which the true lowest points are read off
LEVEL_STRETCH = 40  # frames at rest before the first hop, which the printed boom angle wants


@dataclass(frozen=True)
class Swinging:
    """A trial with its markers, before any camera saw it."""

    hopper: HopperParameters
    trial: Trial
    tracks: MarkerTracks

    @property
    def yaw(self) -> FloatArray:
        """Heading at each frame, rad."""
        return self.trial.states[:, 3]

    @property
    def boom_angle(self) -> FloatArray:
        """Boom angle at each frame, rad."""
        x, y = self.trial.boom[:, 0] - self.hopper.boom_offset_m, self.trial.boom[:, 1]
        return np.arctan2(y, x)


@dataclass(frozen=True)
class Landings:
    """True landings: lowest points, s; which are a hop apart from the next; which stumble."""

    lowest_s: FloatArray
    goes_on: BoolArray
    stumbles: BoolArray


def swinging(number: int, hops: int, rate_hz: float, seed: int) -> Swinging:
    """Simulate one of the recordings; the hops are the same at all rates."""
    hopper = HopperParameters(
        mass_kg=2.6, counterweight_mass_kg=0.1, inertia_z_kg_m2=0.04, damping_n_s_m=5.5,
        boom_angle_rad=2 * np.pi * number / N_ANGLES, boom_swing_rad=SWING_RAD,
        boom_duration_s=0.25,
    )  # fmt: skip
    rng = np.random.default_rng(np.random.SeedSequence([seed, number]))
    trial = run_trial(hopper, hops=hops, rate_hz=rate_hz, rng=rng)
    return Swinging(hopper, trial, track_markers(trial, hopper, MarkerOptions()))


def landings(number: int, hops: int, seed: int) -> Landings:
    """Return the true landings, as they are at a high frame rate.

    A landing stumbles if not all feet stood at once, or if it came from less than half the usual
    height.
    """
    fine = swinging(number, hops, FINE_HZ, seed)
    height = fine.tracks.positions[:, :3, 2].mean(axis=1)
    begins = fine.trial.hop_start_s
    ends = begins + [hop.end_time_s for hop in fine.trial.hops]
    first, last = np.ceil(begins * FINE_HZ).astype(int), (ends * FINE_HZ).astype(int)
    lowest = np.array([i + np.argmin(height[i:j]) for i, j in zip(first, last, strict=True)])
    rise = height[first] - np.median(height[lowest])
    stood = np.array([hop.all_stood() and not hop.fell for hop in fine.trial.hops])
    goes_on = np.append(np.abs(ends[:-1] - begins[1:]) < 1e-6, False)
    return Landings(lowest / FINE_HZ, goes_on, ~stood | (rise < 0.5 * np.median(rise)))


def filmed(
    scene: Swinging,
    seed: int,
    *,
    noise_m: float = 0.0006,
    gaps_per_min: float = 0.0,
    curved: bool = False,
    rest_first: bool = False,
) -> Recording:
    """Return what cameras see of it; with some frames of the hopper at rest before, if wanted."""
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(3)]
    true, rate_hz = scene.tracks.positions, scene.trial.rate_hz
    if rest_first:
        true = np.concatenate([np.repeat(true[:1], LEVEL_STRETCH, axis=0), true])
    hidden = draw_gaps(
        GapOptions(rate_per_min=gaps_per_min),
        frames=len(true), markers=true.shape[1], rate_hz=rate_hz, rng=streams[1],
    )  # fmt: skip
    seen = observe(
        true,
        floor=draw_floor(FloorOptions() if curved else FLAT, streams[0]),
        noise_m=noise_m, resolution_m=0.0, hidden=hidden, rng=streams[2],
    )  # fmt: skip
    time = np.arange(len(true)) / rate_hz
    return Recording("swinging", time, seen, scene.tracks.names, scene.tracks.roles, rate_hz)
