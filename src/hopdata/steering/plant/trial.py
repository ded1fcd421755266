"""A recorded trial in which the boom is told where to go, with the stances as they truly were."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import ConfigError
from hopdata.recordings.recording import Recording
from hopdata.steering.plant.robot import SteeredHopper, marker_poses
from hopdata.synthesis.floor import draw_floor
from hopdata.synthesis.markers import fixed_markers, track_markers
from hopdata.synthesis.options import Operator
from hopdata.synthesis.simulate import MotionCapture, observed
from hopdata.synthesis.tape import Trial
from hopdata.synthesis.trial import run_trial

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class TrueStances:
    """Stances of a trial as they truly were, one a hop.

    Parameters
    ----------
    frame : (S,) array of int
        Frame in which the body markers are lowest on the mean.
    time_s : (S,) array
        Time of that frame, s.
    pose : (S, 3) array
        Mean of the body markers on the floor, m, and yaw, rad, in that frame.
    boom_angle_rad : (S,) array
        Angle of the boom there; not wrapped.
    follows : (S,) bool array
        Whether the stance before is that of the hop before, with no handling between.
    """

    frame: IntArray
    time_s: FloatArray
    pose: FloatArray
    boom_angle_rad: FloatArray
    follows: BoolArray

    def pairs(self) -> IntArray:
        """Frames of consecutive stances, (P, 2)."""
        second = np.flatnonzero(self.follows)
        return np.column_stack([self.frame[second - 1], self.frame[second]])


@dataclass(frozen=True)
class SteeredTrial:
    """A recording of a steered hopper, and its truth.

    `poses` (N, 3), `boom_angle_rad` (N,) and `tilt_rad` (N,) are the true ones at every frame.
    """

    recording: Recording
    stances: TrueStances
    poses: FloatArray
    boom_angle_rad: FloatArray
    tilt_rad: FloatArray


def record_trial(
    robot: SteeredHopper,
    swings_rad: Iterable[float],
    *,
    seed: int | Sequence[int],
    camera: MotionCapture | None = None,
    operator: Operator | None = None,
    name: str = "steered",
) -> SteeredTrial:
    """Let the hopper hop with these swings, and record it.

    Parameters
    ----------
    robot : SteeredHopper
    swings_rad : iterable of float
        Swing in the flight of each hop, rad, cut to the limit of the robot; one hop each.
    seed : int or sequence of int
        Seed of kicks, floor, noise and gaps, which have streams of their own.
    camera : MotionCapture, optional
        How the hopper is seen.
    operator : Operator, optional
        Who carries it back when it strays, and lets it go as the robot says if not given.
    name : str
        Name of the recording.

    Raises
    ------
    ConfigError
        If a swing is not a finite number, or there is none.
    """
    camera = camera or MotionCapture()
    operator = operator or Operator(
        release_height_m=robot.release_height_m, hop_limit_s=robot.hop_limit_s
    )
    swings = np.clip(_numbers(swings_rad), -robot.swing_limit_rad, robot.swing_limit_rad)
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(4)]
    kicks_rng, floor_rng, noise_rng, gaps_rng = streams
    trial = run_trial(
        replace(robot.hopper, boom_start_s=0.0),
        hops=len(swings),
        rate_hz=camera.rate_hz,
        rng=kicks_rng,
        kicks=robot.kicks,
        operator=operator,
        swings_rad=swings.tolist(),
        preloads_n=robot.preloads_n,
    )
    tracks = track_markers(trial, robot.hopper, camera.markers)
    floor = draw_floor(camera.floor, floor_rng)
    recording = observed(tracks, floor, camera, name, noise_rng, gaps_rng)
    robot = replace(robot, markers=camera.markers)
    return SteeredTrial(
        recording=recording,
        stances=true_stances(robot, trial),
        poses=marker_poses(robot, trial.states),
        boom_angle_rad=_boom_angles(robot, trial),
        tilt_rad=np.arccos(np.cos(trial.states[:, 4]) * np.cos(trial.states[:, 5])),
    )


def _numbers(swings_rad: Iterable[float]) -> FloatArray:
    swings = list(swings_rad) if isinstance(swings_rad, Iterable) else swings_rad
    try:
        numbers = np.array(swings, dtype=float)
    except (TypeError, ValueError):
        numbers = np.array([np.nan])
    if numbers.ndim != 1 or not len(numbers) or not np.isfinite(numbers).all():
        shown = str(swings)[:60]
        raise ConfigError(
            f"swings_rad: expected a list of one finite number or more, found {shown}"
        )
    return numbers


def true_stances(robot: SteeredHopper, trial: Trial) -> TrueStances:
    """Return the stances of the hops in which all legs stood."""
    body = fixed_markers(trial.states, np.array(robot.markers.body_m))
    height = body[..., 2].mean(axis=1)
    ends = trial.hop_start_s + [hop.end_time_s for hop in trial.hops]
    stood = np.array([hop.all_stood() and not hop.fell for hop in trial.hops])
    first, last = (np.ceil(t * trial.rate_hz).astype(int) for t in (trial.hop_start_s, ends))
    stood &= last <= len(height)
    spans = zip(first[stood], last[stood], strict=True)
    frame = np.array([a + np.argmin(height[a:b]) for a, b in spans], dtype=np.int64)
    joined = np.append(False, np.isclose(trial.hop_start_s[1:], ends[:-1], rtol=0, atol=1e-9))
    joined[1:] &= stood[:-1]
    return TrueStances(
        frame=frame,
        time_s=frame / trial.rate_hz,
        pose=marker_poses(robot, trial.states[frame]),
        boom_angle_rad=_boom_angles(robot, trial)[frame],
        follows=joined[stood],
    )


def _boom_angles(robot: SteeredHopper, trial: Trial) -> FloatArray:
    """Angle of the boom at every frame, (N,), from the places of the counterweight."""
    x = trial.boom[:, 0] - robot.hopper.boom_offset_m
    angle = np.unwrap(np.arctan2(trial.boom[:, 1], x))
    turns = np.round((robot.hopper.boom_angle_rad - angle[0]) / (2 * np.pi))
    return np.asarray(angle + 2 * np.pi * turns)
