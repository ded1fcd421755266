"""A recorded trial with commanded boom swings, and its true stances."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, one_blas_thread, pd
from hopdata.errors import AnalysisError, RecordingError, require
from hopdata.recording import Recording
from hopdata.rigid import relative
from hopdata.steering import CORRECTED, EXCITATION, PRINTED, TRIAL, child
from hopdata.steering import robot as plant
from hopdata.steering.control.objectives import is_finite
from hopdata.steering.excitation import (
    ControlGrid,
    eulerian_excitation,
    random_excitation,
)
from hopdata.steering.strides import CHANGE
from hopdata.synthesis.camera import MotionCapture, draw_floor, track_markers
from hopdata.synthesis.simulate import observed
from hopdata.synthesis.trial import Operator, Trial, run_trial

# The trial: the hopper makes these swings, and is recorded.

POSE = ["x_m", "y_m", "heading_rad"]


@dataclass(frozen=True)
class SteeredTrial:
    """A recording of a steered hopper, with the truth.

    Parameters
    ----------
    recording : Recording
    stances : DataFrame
        One row per hop with a stance: the ``frame`` in which the mean height of the
        body markers is lowest, its ``time_s``, the pose in it (`POSE`: floor position
        of the body markers' mean, m, and yaw, rad), the unwrapped ``boom_angle_rad``,
        and ``follows``: whether the previous row is the previous hop, with no handling
        in between.
    motion : DataFrame
        One row per frame: ``time_s``, the pose, ``boom_angle_rad, tilt_rad``.
    """

    recording: Recording
    stances: pd.DataFrame
    motion: pd.DataFrame


def record_trial(
    robot: plant.SteeredHopper,
    swings_rad: Iterable[float],
    *,
    seed: int | Sequence[int],
    camera: MotionCapture | None = None,
    name: str = "steered",
) -> SteeredTrial:
    """Record a hopper that makes these swings.

    Parameters
    ----------
    robot : SteeredHopper
    swings_rad : iterable of float
        Swing in the flight of each hop, rad, clipped to the limit of the robot.
    seed : int or sequence of int
        Seed of kicks, floor, noise and gaps, each of which has its own stream.
    camera : MotionCapture, optional
        How the hopper is recorded.
    name : str
        Name of the recording.

    Raises
    ------
    ConfigError
        If there are no swings, or one is not a finite number.
    """
    camera = camera or MotionCapture()
    operator = Operator(
        release_height_m=robot.release_height_m, hop_limit_s=robot.hop_limit_s
    )
    limit = robot.swing_limit_rad
    swings = np.clip(_numbers(swings_rad), -limit, limit)
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(4)]
    kicks_rng, floor_rng, noise_rng, gaps_rng = streams
    trial = run_trial(
        replace(robot.hopper, boom_start_s=0.0),
        hops=len(swings),
        rate_hz=camera.rate_hz,
        rng=kicks_rng,
        kicks=robot.kicks,
        operator=operator,
        changes=[{"boom_swing_rad": swing} for swing in swings.tolist()],
        preloads_n=robot.preloads_n,
    )
    tracks = track_markers(trial, robot.hopper, camera.markers)
    floor = draw_floor(camera.floor, floor_rng)
    recording = observed(tracks, floor, camera, name, noise_rng, gaps_rng)
    robot = replace(robot, markers=camera.markers)
    motion = pd.DataFrame({"time_s": recording.time})
    motion[POSE] = plant.marker_poses(robot, trial.states)
    tilt = np.arccos(np.cos(trial.states[:, 4]) * np.cos(trial.states[:, 5]))
    motion = motion.assign(boom_angle_rad=_boom_angles(robot, trial), tilt_rad=tilt)
    return SteeredTrial(recording, true_stances(robot, trial, motion), motion)


def _numbers(swings_rad: Iterable[float]) -> FloatArray:
    swings = list(swings_rad) if isinstance(swings_rad, Iterable) else swings_rad
    count = len(swings) if isinstance(swings, list) else 0
    is_sound = count > 0 and is_finite(swings, (count,))
    wanted = "a list of at least one finite number"
    require(is_sound, "swings_rad", wanted, str(swings)[:60])
    return np.array(swings, dtype=float)


def true_stances(
    robot: plant.SteeredHopper, trial: Trial, motion: pd.DataFrame
) -> pd.DataFrame:
    """Return the stances of the hops in which all legs stood; see `SteeredTrial`."""
    height = plant.mean_marker_height(robot, trial.states)
    start_s = trial.hop_start_s
    end_s = start_s + [hop.end_time_s for hop in trial.hops]
    first = np.ceil(start_s * trial.rate_hz).astype(int)
    last = np.ceil(end_s * trial.rate_hz).astype(int)
    stood = np.array([hop.all_stood() and not hop.fell for hop in trial.hops])
    stood &= last <= len(height)
    spans = zip(first[stood], last[stood], strict=True)
    frame = np.array([a + np.argmin(height[a:b]) for a, b in spans], dtype=np.int64)
    # A hop follows the one before if nobody handled the hopper in between.
    follows = np.zeros(len(start_s), dtype=bool)
    follows[1:] = np.isclose(start_s[1:], end_s[:-1], rtol=0, atol=1e-9) & stood[:-1]
    poses = motion[[*POSE, "boom_angle_rad"]].iloc[frame].reset_index(drop=True)
    table = pd.DataFrame({"frame": frame + 1, "time_s": frame / trial.rate_hz})
    return table.join(poses).assign(follows=follows[stood])


def _boom_angles(robot: plant.SteeredHopper, trial: Trial) -> FloatArray:
    """Return the boom angle at every frame, (N,), from the counterweight."""
    ahead_m = trial.boom[:, 0] - robot.hopper.boom_offset_m
    angle = np.unwrap(np.arctan2(trial.boom[:, 1], ahead_m))
    turns = np.round((robot.hopper.boom_angle_rad - angle[0]) / (2 * np.pi))
    return np.asarray(angle + 2 * np.pi * turns)


# The true frame change of the simulated hopper on a grid, without disturbances.
#
# A hop depends on more than boom angle and swing, since motion left over from the last
# hop continues. So the map is measured on a hopper that has settled with the boom at
# rest, has since made one swing, and makes the next. Averaged over that one swing, it
# is a function of boom angle and swing alone.

#: Hops with the boom at rest, before the first swing.
#: Unit: 1. Origin: chosen.
SETTLING_HOPS = 10


@dataclass(frozen=True)
class TrueFrameChanges:
    """True frame changes on a grid.

    Parameters
    ----------
    boom_angle_rad : (A,) array
        Boom angle at the first stance, evenly spaced over a turn without its end.
    swing_rad, previous_swing_rad : (S,) and (P,) arrays
        Swing between the stances, and the swing before it.
    change : (A, S, P, 3) array
        Frame change between the stances, in the frame of the first; m, m, rad.
    """

    boom_angle_rad: FloatArray
    swing_rad: FloatArray
    previous_swing_rad: FloatArray
    change: FloatArray

    def average(self) -> FloatArray:
        """Mean over the previous swing, (A, S, 3)."""
        return np.asarray(self.change.mean(axis=2))


@one_blas_thread()
def true_frame_changes(
    robot: plant.SteeredHopper, *, boom_angles: int = 24, swings: int = 7
) -> TrueFrameChanges:
    """Measure the frame changes of an undisturbed hopper.

    Parameters
    ----------
    robot : SteeredHopper
        Its kicks are ignored.
    boom_angles, swings : int
        Number of boom angles over a turn, and of swings (and previous swings) from
        limit to limit.

    Raises
    ------
    AnalysisError
        If the hopper falls.
    """
    angles = 2 * np.pi * np.arange(boom_angles) / boom_angles
    grid = np.linspace(-robot.swing_limit_rad, robot.swing_limit_rad, swings)
    still = robot.still()
    changes = np.empty((boom_angles, swings, swings, 3))

    @cache
    def settled(boom_angle_rad: float) -> plant.Apex:
        apex = plant.released(still, np.zeros(3), boom_angle_rad)
        for _ in range(SETTLING_HOPS):
            apex = _whole(still, apex, 0.0).end
        return apex

    for a, angle in enumerate(angles):
        for p, previous in enumerate(grid):
            # Rounded, so that equal angles share a settled hopper.
            begun = round((angle - previous) % (2 * np.pi), 9)
            before = _whole(still, settled(begun), previous)
            for s, swing in enumerate(grid):
                after = _whole(still, before.end, swing)
                changes[a, s, p] = relative(before.stance.pose, after.stance.pose)
    return TrueFrameChanges(angles, grid, grid, changes)


def _whole(
    robot: plant.SteeredHopper, apex: plant.Apex, swing_rad: float
) -> plant.SteeredHop:
    """Make one hop; it must not end in a fall."""
    hop = plant.steer_hop(robot, apex, swing_rad, rng=np.random.default_rng(0))
    if hop.stance.fell:
        swung = f"a swing of {swing_rad:.2f} rad from {apex.boom_angle_rad:.2f} rad"
        found = f"one that fell after {swung}: {hop.hop.ending}"
        raise AnalysisError.at("true map", "a hopper that does not fall", found)
    return hop


# The trial that a model is learned from if there is no recording.

NAME = "excitation"


@one_blas_thread()
def simulate_excitation(
    steering: Mapping[str, Any],
    motion_capture: Mapping[str, Any],
    *,
    seed: np.random.SeedSequence,
    observation: str = CORRECTED,
) -> SteeredTrial:
    """Simulate a robot that executes an excitation and is recorded by motion capture.

    Parameters
    ----------
    steering, motion_capture : mapping
        Blocks ``steering`` and ``motion_capture`` of the configuration.
    seed : SeedSequence
        Seed of everything random.
    observation : {"corrected", "printed"}
        Whether the swings are an Eulerian tour of all moves, or drawn at random.
    """
    robot, camera = plant.robot_and_camera(steering["robot"], motion_capture)
    rng = np.random.default_rng(child(seed, EXCITATION))
    grid = ControlGrid(**steering["excitation"])
    if observation == PRINTED:
        swings = random_excitation(grid, rng)
    else:
        swings = eulerian_excitation(grid, rng)
    of_trial = child(seed, TRIAL).generate_state(4).tolist()
    return record_trial(robot, swings, seed=of_trial, camera=camera, name=NAME)


# The true frame changes as a table, and back.

INPUTS = ["boom_angle_rad", "swing_rad", "previous_swing_rad"]


def true_map_table(true: TrueFrameChanges) -> pd.DataFrame:
    """Return one row for each boom angle, swing and previous swing, in this order."""
    axes = (true.boom_angle_rad, true.swing_rad, true.previous_swing_rad)
    rows = pd.MultiIndex.from_product(axes, names=INPUTS)
    return pd.DataFrame(true.change.reshape(-1, 3), rows, CHANGE).reset_index()


def true_map_of(table: pd.DataFrame) -> TrueFrameChanges:
    """Read the table that `true_map_table` made.

    Raises
    ------
    RecordingError
        If its rows do not form a grid.
    """
    axes = [table[name].drop_duplicates().to_numpy(dtype=float) for name in INPUTS]
    shape = tuple(len(axis) for axis in axes)
    if len(table) != np.prod(shape):
        raise RecordingError.at("true map", f"a grid of {shape}", f"{len(table)} rows")
    change = table[CHANGE].to_numpy(dtype=float).reshape(*shape, 3)
    return TrueFrameChanges(axes[0], axes[1], axes[2], change)
