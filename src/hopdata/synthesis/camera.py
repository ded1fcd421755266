"""Where the markers are, given the hopper's motion and its contacts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import BoolArray, FloatArray
from hopdata.scenes.hopper import rotation_matrices
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.synthesis.hops import rest_foot, rest_foot_climb, smooth_step
from hopdata.synthesis.trial import FloorOptions, GapOptions, MarkerOptions, Trial

# A floor that looks curved by a few millimetres, as cameras see it.


@dataclass(frozen=True)
class CurvedFloor:
    """Height of the measured floor: a bowl that levels off, and waves; no polynomial.

    Parameters
    ----------
    bowl_depth_m, bowl_radius_m : float
        See `FloorOptions`.
    wave_vectors : (W, 2) array
        Wave vectors, rad/m.
    phases : (W,) array
        Phase of each wave at the origin, rad.
    wave_amplitude_m : float
        Amplitude of each wave.
    """

    bowl_depth_m: float
    bowl_radius_m: float
    wave_vectors: FloatArray
    phases: FloatArray
    wave_amplitude_m: float

    def height(self, xy: FloatArray) -> FloatArray:
        """Height, (...), m, at points (..., 2), m."""
        square = np.sum(xy**2, axis=-1) / self.bowl_radius_m**2
        waves = np.sin(xy @ self.wave_vectors.T + self.phases).sum(axis=-1)
        return self.bowl_depth_m * square / (1.0 + square) + self.wave_amplitude_m * waves


def draw_floor(options: FloorOptions, rng: np.random.Generator) -> CurvedFloor:
    """Draw the directions, lengths and phases of a floor's waves."""
    angle = rng.uniform(0.0, 2.0 * np.pi, options.waves)
    length = options.wave_length_m * rng.uniform(1.0, 1.5, options.waves)
    number = 2.0 * np.pi / length
    return CurvedFloor(
        bowl_depth_m=options.bowl_depth_m,
        bowl_radius_m=options.bowl_radius_m,
        wave_vectors=np.column_stack([number * np.cos(angle), number * np.sin(angle)]),
        phases=rng.uniform(0.0, 2.0 * np.pi, options.waves),
        wave_amplitude_m=options.wave_amplitude_m,
    )


# Motion capture of marker tracks: curved floor, noise, resolution and drop-outs.


def observe(
    positions: FloatArray,
    *,
    floor: CurvedFloor,
    noise_m: float,
    resolution_m: float,
    hidden: BoolArray,
    rng: np.random.Generator,
) -> FloatArray:
    """Marker positions as the cameras report them.

    Parameters
    ----------
    positions : (N, M, 3) array
        True positions over a flat floor, m.
    floor : CurvedFloor
        Its height at a marker's own x and y is added to that marker's z.
    noise_m : float
        Standard deviation of the independent normal noise on each coordinate, m. A distance
        between two markers then has a standard deviation of sqrt(2) times that.
    resolution_m : float
        Positions are rounded to multiples of this, m; 0 for no rounding.
    hidden : (N, M) bool array
        Markers not seen; their coordinates become NaN.
    rng : numpy Generator

    Returns
    -------
    (N, M, 3) array, m
    """
    seen = positions.copy()
    seen[..., 2] += floor.height(positions[..., :2])
    seen += noise_m * rng.standard_normal(positions.shape)
    if resolution_m > 0:
        seen = np.round(seen / resolution_m) * resolution_m
    seen[hidden] = np.nan
    return seen


# Drop-outs: frames in which a marker is hidden from the cameras.


def draw_gaps(
    options: GapOptions,
    *,
    frames: int,
    markers: int,
    rate_hz: float,
    rng: np.random.Generator,
) -> BoolArray:
    """Draw which markers are hidden in which frames, (N, M).

    Drop-outs of each marker begin at random (Poisson) and last a geometrically distributed number
    of frames, at least one; those that overlap merge.
    """
    hidden = np.zeros((frames, markers), dtype=bool)
    expected = options.rate_per_min / 60.0 * frames / rate_hz
    end_probability = min(1.0, 1.0 / max(1.0, options.mean_s * rate_hz))
    for marker in range(markers):
        count = rng.poisson(expected)
        starts = rng.integers(0, max(frames, 1), count)
        lengths = rng.geometric(end_probability, count)
        for start, length in zip(starts, lengths, strict=True):
            hidden[start : start + length, marker] = True
    return hidden


RUNNING_AHEAD_S = 0.1  # time after the apex in which feet come to run ahead


@dataclass(frozen=True)
class MarkerTracks:
    """True marker positions over a flat floor, with names, roles and contact at each frame.

    `positions` (N, M, 3) m, world frame; body markers first, then feet, then the boom.
    `foot_down` (N, n): whether each foot is in contact.
    """

    positions: FloatArray
    names: tuple[str, ...]
    roles: tuple[str, ...]
    foot_down: BoolArray


def track_markers(
    trial: Trial, parameters: HopperParameters, options: MarkerOptions, *, delay_s: float = 0.0
) -> MarkerTracks:
    """Follow all markers of a trial, at its frames.

    With a control's `delay_s`, contact is where the guard says: the feet run ahead by this time as
    they come down, and so are on the floor at that instant.
    """
    down, feet = _follow_feet(trial, parameters, options.retraction_s, delay_s)
    body = fixed_markers(trial.states, np.array(options.body_m))
    boom = in_world(trial.states, (trial.boom + options.boom_m)[:, None])
    counts = {"body": body.shape[1], "foot": feet.shape[1], "boom": 1}
    names = [f"{role}{i + 1}" for role in ("body", "foot") for i in range(counts[role])]
    return MarkerTracks(
        positions=np.concatenate([body, feet, boom], axis=1),
        names=(*names, "boom"),
        roles=tuple(role for role, count in counts.items() for _ in range(count)),
        foot_down=down,
    )


def fixed_markers(states: FloatArray, points_m: FloatArray) -> FloatArray:
    """World positions, (N, B, 3) m, of points (B, 3) fixed in the body, for states (N, 12)."""
    return in_world(states, np.broadcast_to(points_m, (len(states), *points_m.shape)))


def in_world(states: FloatArray, points_m: FloatArray) -> FloatArray:
    """World positions, (N, B, 3) m, of points (N, B, 3) in body axes, for states (N, 12)."""
    turned = np.einsum("nij,nbj->nbi", rotation_matrices(states[:, 3:6]), points_m)
    return states[:, None, :3] + turned


def _follow_feet(
    trial: Trial, parameters: HopperParameters, retraction_s: float, delay_s: float
) -> tuple[BoolArray, FloatArray]:
    """Contact (N, n) and position (N, n, 3) of every foot at every frame.

    In contact a foot is on the floor under its rest place. In flight it is at its rest place plus
    the extension with which it lifted off, which stays with the body and fades within
    `retraction_s`, with no jump in place, speed or acceleration.
    """
    time = np.arange(len(trial.states)) / trial.rate_hz
    rotations = rotation_matrices(trial.states[:, 3:6])
    down = np.zeros((len(time), parameters.n_legs), dtype=bool)
    feet = np.empty((len(time), parameters.n_legs, 3))
    for leg in range(parameters.n_legs):
        mine = trial.event_leg == leg
        last = np.searchsorted(trial.event_time[mine], time, side="right") - 1
        since, extension, in_contact = _after_last_event(trial, parameters, leg, last, time)
        rest = rest_foot(parameters, trial.states, leg)
        drawn = extension * (1.0 - smooth_step(since / retraction_s))[:, None]
        flying = rest + np.einsum("nij,nj->ni", rotations, drawn)
        if delay_s != 0:
            flying[:, 2] += delay_s * _running_ahead(trial, parameters, leg, since, time)
        standing = rest * [1.0, 1.0, 0.0]
        down[:, leg] = in_contact
        feet[:, leg] = np.where(in_contact[:, None], standing, flying)
    return down, feet


def _running_ahead(
    trial: Trial, parameters: HopperParameters, leg: int, since: FloatArray, time: FloatArray
) -> FloatArray:
    """Vertical speed of a foot that has not touched since the apex, m/s, faded in; else 0; (N,)."""
    apex = np.searchsorted(trial.apex_s, time, side="right") - 1
    falling = time - trial.apex_s[apex]
    share = np.where(since > falling, smooth_step(falling / RUNNING_AHEAD_S), 0.0)
    return np.asarray(share * rest_foot_climb(parameters, trial.states, leg))


def _after_last_event(
    trial: Trial,
    parameters: HopperParameters,
    leg: int,
    last: NDArray[np.int64],
    time: FloatArray,
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Time since the leg's last event, its extension there (body frame), and contact, per frame."""
    mine = np.flatnonzero(trial.event_leg == leg)
    states = trial.event_state[mine]
    gap = rest_foot(parameters, states, leg)[:, 2]
    extension = -gap[:, None] * rotation_matrices(states[:, 3:6])[:, 2]
    # Before the first event: in flight, at rest length.
    when = np.append(trial.event_time[mine], -np.inf)
    extension = np.vstack([extension, np.zeros(3)])
    is_down = np.append(trial.event_down[mine], False)
    return time - when[last], extension[last], is_down[last]
