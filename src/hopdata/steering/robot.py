"""The steered hopper, hop by hop: a swing of the boom leads to a stance.

A hop runs from apex to apex. Its swing begins at the apex and ends before the feet
touch down. Its stance is the instant at which the mean height of the body markers is
lowest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import BoolArray, FloatArray
from hopdata.errors import require
from hopdata.scenes.body import HEIGHT, PITCH, ROLL
from hopdata.scenes.hopper_control import HopperDrag
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.scene import Control, Variant
from hopdata.steering.goals import SWING_LIMIT_RAD
from hopdata.synthesis.camera import MotionCapture, fixed_markers, in_world
from hopdata.synthesis.hops import Hop, fly_hop, level_state
from hopdata.synthesis.trial import Kicks, MarkerOptions, from_mapping, kicked

#: Time step of the search for the lowest point, before a parabola refines it.
#: Unit: s. Origin: chosen.
STANCE_SEARCH_S = 0.01


LIGHT_BOOM = HopperParameters(
    mass_kg=2.6,
    counterweight_mass_kg=0.1,
    inertia_z_kg_m2=0.03,
    damping_n_s_m=5.5,
    friction=0.5,
    boom_duration_s=0.2,
)
SOFT_KICKS = Kicks(velocity_m_s=0.02, angular_velocity_rad_s=0.1, preload_fraction=0.02)


@dataclass(frozen=True, kw_only=True)
class SteeredHopper:
    """The steered robot, and what disturbs it.

    Parameters
    ----------
    hopper : HopperParameters
        The body; its boom angle is the boom's initial angle.
    preload_shares : tuple of float
        Preload of each leg as a fraction of the hopper's. No real robot is built
        evenly: with the boom in neutral, the default drifts to the right and turns
        clockwise, as the dissertation's robot did (Sec. 3.4.3).
    kicks : Kicks
        Random disturbances at each apex.
    markers : MarkerOptions
        Positions of the markers.
    swing_limit_rad : float
        Largest swing per hop; the dissertation's robot tips over beyond 90 degrees
        (Sec. 3.3).
    release_height_m : float
        Height of the feet above the floor when the hopper is released.
    hop_limit_s : float
        A hop without an apex after this time counts as a fall.
    """

    hopper: HopperParameters = LIGHT_BOOM
    preload_shares: tuple[float, ...] = (0.99, 1.05, 0.96)
    kicks: Kicks = SOFT_KICKS
    markers: MarkerOptions = field(default_factory=MarkerOptions)
    swing_limit_rad: float = SWING_LIMIT_RAD
    release_height_m: float = 0.24
    hop_limit_s: float = 3.0

    def __post_init__(self) -> None:
        n_legs = self.hopper.n_legs
        n_shares = len(self.preload_shares)
        wanted = f"one for each of {n_legs} legs"
        require(n_shares == n_legs, "preload_shares", wanted, n_shares)
        limit = self.swing_limit_rad
        require(0 < limit <= np.pi, "swing_limit_rad", "more than 0, at most pi", limit)

    @property
    def preloads_n(self) -> FloatArray:
        """Preload of each leg without random disturbances, (n,), N."""
        return self.hopper.preload_n * np.array(self.preload_shares)

    def still(self) -> SteeredHopper:
        """Return the same hopper without disturbances."""
        none = {field.name: 0.0 for field in fields(Kicks)}
        return replace(self, kicks=Kicks(**none))


@dataclass(frozen=True)
class Apex:
    """Start of a hop: time, s, state (12,), and angle of the resting boom, rad."""

    time_s: float
    state: FloatArray
    boom_angle_rad: float


@dataclass(frozen=True)
class HopperStance:
    """The true stance of a hop.

    `time_s` is the time of the lowest point, s. `pose` (3,) is the mean of the body
    markers projected on the floor, m, and the unwrapped yaw, rad. Time and pose are NaN
    if the hop `fell`. `boom_angle_rad` is the boom angle at the end of the hop.
    `touched` says whether the hopper touched a board.
    """

    time_s: float
    pose: FloatArray
    boom_angle_rad: float
    fell: bool
    touched: bool


@dataclass(frozen=True)
class SteeredHop:
    """One hop of a steered hopper.

    `start` and `end` are its apexes, `swing_rad` the executed swing (within the limit)
    and `stance` its landing. `frame_time_s` (K,) are the requested frames, and
    `markers` (K, B + 1, 3) the true positions of the markers in them, m: the body
    markers first, the boom's last.
    """

    start: Apex
    swing_rad: float
    stance: HopperStance
    end: Apex
    frame_time_s: FloatArray
    markers: FloatArray
    hop: Hop


def released(
    robot: SteeredHopper, pose: ArrayLike, boom_angle_rad: float = np.pi
) -> Apex:
    """Return the apex at which an operator releases the hopper at rest.

    Its markers are at `pose` (3,).
    """
    x, y, yaw = np.asarray(pose, dtype=float)
    state = level_state(robot.hopper, robot.release_height_m)
    state[3] = yaw
    offset = marker_poses(robot, state[None])[0]
    state[:2] = x - offset[0], y - offset[1]
    return Apex(0.0, state, boom_angle_rad)


def marker_poses(robot: SteeredHopper, states: FloatArray) -> FloatArray:
    """Return poses (N, 3) of states (N, 12).

    They are the horizontal mean of the body markers, m, and the yaw, rad.
    """
    body = fixed_markers(states, np.array(robot.markers.body_m))
    return np.column_stack([body[..., :2].mean(axis=1), states[:, 3]])


def steer_hop(
    robot: SteeredHopper,
    apex: Apex,
    swing_rad: float,
    *,
    rng: np.random.Generator,
    rate_hz: float = 0.0,
    board: Board | None = None,
    control: Control | None = None,
    rtol: float | None = None,
) -> SteeredHop:
    """Simulate one hop with a swing of the boom.

    Parameters
    ----------
    robot : SteeredHopper
    apex : Apex
        Start of the hop.
    swing_rad : float
        Swing, rad; clipped to the limit of the robot.
    rng : numpy Generator
        Source of the random kicks.
    rate_hz : float
        Frame rate of the markers, Hz; frame k is at k / rate_hz on the clock of the
        apex. No frames by default.
    board : Board, optional
        Board in the hopper's way; `Board.pushed` returns where the hop leaves it.
    control : Control, optional
        Flies and lands in place of the robot, without a board.
    rtol : float, optional
        Relative tolerance of the integrator, by default that of
        `hopdata.synthesis.integrators`.
    """
    variant: Variant | None = control
    if board is not None:
        variant = board.drag
    limit = robot.swing_limit_rad
    swing = min(max(float(swing_rad), -limit), limit)
    parameters = replace(
        robot.hopper,
        boom_angle_rad=apex.boom_angle_rad,
        boom_swing_rad=swing,
        boom_start_s=0.0,
    )
    # The order of the draws is part of the results: legs first, then the body.
    leg_noise = rng.standard_normal(parameters.n_legs)
    preload_factors = 1 + robot.kicks.preload_fraction * leg_noise
    state = kicked(apex.state, robot.kicks, rng)
    searched = _searched_times(robot.hop_limit_s)
    times = searched
    if rate_hz > 0:
        frames = _frame_times(apex.time_s, robot.hop_limit_s, rate_hz)
        times = np.union1d(frames, searched)
    hop = fly_hop(
        parameters,
        state,
        variant=variant,
        preloads_n=robot.preloads_n * preload_factors,
        frame_times_s=times,
        limit_s=robot.hop_limit_s,
        rtol=rtol,
        shows_boom=rate_hz > 0,
    )
    times = times[: len(hop.states)]
    boom = parameters.boom_angle(hop.end_time_s)
    search = hop
    frame_times = np.empty(0)
    markers = np.empty((0, len(robot.markers.body_m) + 1, 3))
    if rate_hz > 0:
        is_frame = _are_among(frames, times)
        frame_times = times[is_frame]
        markers = _markers(robot, hop, is_frame)
        # Frames that nearly coincide with a searched instant would spoil the parabola.
        is_searched = _are_among(searched, times)
        search = replace(hop, states=hop.states[is_searched])
        times = times[is_searched]
    return SteeredHop(
        start=apex,
        swing_rad=swing,
        stance=_stance(robot, search, times, apex.time_s, boom),
        end=Apex(apex.time_s + hop.end_time_s, hop.end_state, boom),
        frame_time_s=apex.time_s + frame_times,
        markers=markers,
        hop=hop,
    )


@cache
def _searched_times(limit_s: float) -> FloatArray:
    """Return the times at which the lowest point is searched, s; not to be changed."""
    times = np.arange(0.0, limit_s, STANCE_SEARCH_S)
    times.flags.writeable = False
    return times


def _are_among(some: FloatArray, times: FloatArray) -> BoolArray:
    """Tell which of the first of all times (K,) are some of all; both increase.

    `numpy.isin` does not know that, and takes more than twice as long.
    """
    places = np.searchsorted(times, some)
    found = np.zeros(len(times), dtype=bool)
    found[places[places < len(times)]] = True
    return found


def _frame_times(start_s: float, limit_s: float, rate_hz: float) -> FloatArray:
    """Return the times of the frames of a hop since its start, up to its limit, s."""
    first, most = np.ceil(np.array([start_s, limit_s]) * rate_hz - 1e-9)
    times = (first + np.arange(most)) / rate_hz - start_s
    return np.asarray(times[(times >= 0) & (times < limit_s)])


def _stance(
    robot: SteeredHopper,
    hop: Hop,
    times: FloatArray,
    start_s: float,
    boom_angle_rad: float,
) -> HopperStance:
    """Return the stance of a hop.

    It is the vertex of the parabola through the three lowest heights.
    """
    touched = hop.touched_s < np.inf
    if hop.fell or len(times) < 3:
        return HopperStance(
            time_s=np.nan,
            pose=np.full(3, np.nan),
            boom_angle_rad=boom_angle_rad,
            fell=True,
            touched=touched,
        )
    height = _heights(hop.states, robot.markers.body_m)
    last = max(1, len(times) - 2)
    k = min(max(int(np.argmin(height)), 1), last)
    near = slice(k - 1, k + 2)
    lowest = _vertex(times[near].tolist(), height[near].tolist())
    body = fixed_markers(hop.states[near], np.array(robot.markers.body_m))
    x, y = body[..., :2].mean(axis=1).T
    yaw = hop.states[near, 3]
    pose = np.array([np.interp(lowest, times[near], column) for column in (x, y, yaw)])
    return HopperStance(
        time_s=start_s + float(lowest),
        pose=pose,
        boom_angle_rad=boom_angle_rad,
        fell=False,
        touched=touched,
    )


def _vertex(times: Sequence[float], heights: Sequence[float]) -> float:
    """Return the time of the vertex of the parabola through three points.

    In plain numbers, since a least-squares fit takes a tenth of the time of a hop.
    """
    before_s, middle_s, after_s = times
    before, middle, after = heights
    fall = (middle - before) / (middle_s - before_s)
    rise = (after - middle) / (after_s - middle_s)
    bend = (rise - fall) / (after_s - before_s)
    if bend == 0.0:  # a line has no vertex
        return middle_s
    slope = fall + bend * (middle_s - before_s)
    return middle_s - slope / (2 * bend)


def _heights(states: FloatArray, body_m: Sequence[Sequence[float]]) -> FloatArray:
    """Return the height (N,) of the mean of points of the body, m.

    Whole places of all points would take four times as long.
    """
    ahead, left, up = np.mean(body_m, axis=0).tolist()
    pitch = states[:, PITCH]
    roll = states[:, ROLL]
    upright = np.sin(roll) * left + np.cos(roll) * up
    return states[:, HEIGHT] - np.sin(pitch) * ahead + np.cos(pitch) * upright


def mean_marker_height(robot: SteeredHopper, states: FloatArray) -> FloatArray:
    """Return the mean height (N,) of the body markers in states (N, 12), m."""
    body = fixed_markers(states, np.array(robot.markers.body_m))
    return np.asarray(body[..., 2].mean(axis=1))


def _markers(robot: SteeredHopper, hop: Hop, is_frame: BoolArray) -> FloatArray:
    """Return the markers (K, B + 1, 3) in the frames, the boom's last, m."""
    states = hop.states[is_frame]
    body_m = robot.markers.body_m
    body = np.broadcast_to(body_m, (len(states), len(body_m), 3))
    boom = hop.boom[is_frame] + robot.markers.boom_m
    return in_world(states, np.concatenate([body, boom[:, None]], axis=1))


# A board that the hopper pushes along (dissertation, Sec. 3.5, Fig. 3.7).


@dataclass(frozen=True, kw_only=True)
class Board:
    """A board across the floor that is pushed along its normal, and stays there.

    The hopper touches it only while it stands beyond the board's front: in flight it is
    above it.

    Parameters
    ----------
    direction : (x, y)
        Unit vector into the board, world frame.
    place_m : float
        Position of the board along this direction, from the world's origin, m.
    reach_m : float
        Distance from the hopper's centre ahead to where it touches the board, m.
    drag_n : float
        Friction of the board on the floor, N.
    """

    direction: tuple[float, float]
    place_m: float
    reach_m: float = 0.38
    drag_n: float = 4.0

    def __post_init__(self) -> None:
        unit = bool(np.isclose(np.hypot(*self.direction), 1.0))
        require(unit, "obstacle.direction", "a unit vector", self.direction)

    @property
    def drag(self) -> HopperDrag:
        """Drag that the hopper meets at the board."""
        front = self.place_m - self.reach_m
        return HopperDrag(drag_n=self.drag_n, direction=self.direction, front_m=front)

    def pushed(self, hop: SteeredHop) -> Board:
        """Return the board where the hop left it: ahead of the farthest contact."""
        if not np.isfinite(hop.hop.touched_s):
            return self
        along = hop.hop.event_state[:, :2] @ self.direction
        front_m = float(along.max()) + self.reach_m
        return replace(self, place_m=max(self.place_m, front_m))


# From the configuration's blocks to the robot and the camera.

Options = Mapping[str, Any]


def robot_and_camera(
    options: Options, motion_capture: Options
) -> tuple[SteeredHopper, MotionCapture]:
    """Return the robot of ``steering.robot`` and the camera, with the same markers."""
    camera = from_mapping(MotionCapture, motion_capture)
    given = dict(options)
    given["hopper"] = replace(LIGHT_BOOM, **options["hopper"])
    given["preload_shares"] = tuple(options["preload_shares"])
    given["kicks"] = from_mapping(Kicks, options["kicks"])
    return SteeredHopper(**given, markers=camera.markers), camera
