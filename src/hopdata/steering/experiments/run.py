"""One run: a controller steers the hopper that motion capture sees, from a start to the end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import BoolArray, FloatArray
from hopdata.steering.control.objectives import Controller, PlanningError
from hopdata.steering.experiments.tasks import Outcome, Start, Task, decided, errors_of, judged
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.live_stances import StanceDetector
from hopdata.steering.observation.tracking import HopperTracker, Observation
from hopdata.steering.robot import Apex, Board, SteeredHop, SteeredHopper, released, steer_past
from hopdata.synthesis.camera import CurvedFloor, draw_gaps, observe
from hopdata.synthesis.simulate import MotionCapture

# The simulated hopper as a controller knows it: through motion capture, frame by frame.

Frames: TypeAlias = list[tuple[float, FloatArray]]  # time, s, and markers (M, 3), m
_Frame: TypeAlias = tuple[float, FloatArray, Observation | None]

NEAR_S = 0.05  # a pose so far from the lowest point is that of the stance


@dataclass(frozen=True)
class Sight:
    """How the hopper is seen in all runs of an experiment.

    Parameters
    ----------
    camera : MotionCapture
        Rate, noise, resolution and gaps.
    geometry : HopperGeometry
        What calibration has found out about the markers.
    floor : CurvedFloor
        The floor as the cameras see it.
    """

    camera: MotionCapture
    geometry: HopperGeometry
    floor: CurvedFloor


@dataclass(frozen=True)
class WatchedStance:
    """One stance, as it was and as it was seen.

    Parameters
    ----------
    hop : SteeredHop
        The hop that ended in it, with its true stance.
    seen : Observation or None
        What the frame nearest to the lowest point told, or the nearest with a pose; None if no
        stance was recognised or no frame near it had a pose.
    time_s : float
        Instant of the stance as it was recognised; NaN if it was not.
    board : Board or None
        The board as the hop left it.
    """

    hop: SteeredHop
    seen: Observation | None
    time_s: float
    board: Board | None

    @property
    def fell(self) -> bool:
        """Whether the hopper fell."""
        return self.hop.stance.fell


class WatchedHopper:
    """A hopper that is released, told its swings, and watched.

    Parameters
    ----------
    robot : SteeredHopper
    sight : Sight
    start : (3,) array
        Pose at the release, m, m, rad.
    most_hops : int
        Gaps are drawn for so many hops.
    kicks, noise, gaps : numpy Generator
        Streams of chance of their own.
    board : Board, optional
        What stands in the way.
    frames : list, optional
        Takes time, s, and markers (M, 3), m, of each frame as the cameras saw it.
    """

    def __init__(
        self,
        robot: SteeredHopper,
        sight: Sight,
        start: ArrayLike,
        *,
        most_hops: int,
        kicks: np.random.Generator,
        noise: np.random.Generator,
        gaps: np.random.Generator,
        board: Board | None = None,
        frames: Frames | None = None,
    ) -> None:
        self.robot, self.sight, self.board = robot, sight, board
        self._kicks, self._noise, self._frames = kicks, noise, frames
        self._apex: Apex = released(robot, start, robot.hopper.boom_angle_rad)
        camera, body = sight.camera, robot.markers.body_m
        markers = [f"body{i + 1}" for i in range(len(body))] + ["boom"]
        self._hidden: BoolArray = draw_gaps(
            camera.gaps,
            frames=round(most_hops * robot.hop_limit_s * camera.rate_hz),
            markers=len(markers),
            rate_hz=camera.rate_hz,
            rng=gaps,
        )
        self._tracker = HopperTracker(sight.geometry, markers)
        self._body = sight.geometry.body_places(markers)
        self._detector = StanceDetector.of(sight.geometry, rate_hz=camera.rate_hz)

    def hop(self, swing_rad: float) -> WatchedStance:
        """Make one hop with this swing of the boom, rad, and watch it."""
        rate, apex = self.sight.camera.rate_hz, self._apex
        first = int(np.ceil(apex.time_s * rate - 1e-9))
        frames = np.arange(first, first + int(self.robot.hop_limit_s * rate))
        hop, self.board = steer_past(
            self.robot,
            apex,
            swing_rad,
            self.board,
            rng=self._kicks,
            frame_times_s=frames / rate,
        )
        self._apex = hop.end
        time_s, seen = self._watched(hop)
        return WatchedStance(hop, seen, time_s, self.board)

    def _watched(self, hop: SteeredHop) -> tuple[float, Observation | None]:
        """Return the time of the stance, and the frame with a pose that was nearest to it then."""
        past: list[_Frame] = []
        found: tuple[float, Observation | None] = (np.nan, None)
        for now, markers in zip(hop.frame_time_s.tolist(), self._seen(hop), strict=True):
            if self._frames is not None:
                self._frames.append((now, markers))
            height, told = self._height(now, markers, past)
            past.append((now, markers, told))
            stance = self._detector.feed(now, height)
            if stance is not None:
                found = (stance.time_s, self._nearest(past, stance.time_s))
        return found

    def _height(
        self, now: float, markers: FloatArray, past: list[_Frame]
    ) -> tuple[float, Observation | None]:
        """Height of the body, m; what the tracker said, if it had to be asked.

        Where all body markers are seen their mean is the height, whatever the attitude.
        """
        if np.isfinite(markers[self._body]).all():
            return float(markers[self._body, 2].mean()), None
        if past and past[-1][2] is None:  # to lean on
            self._tracker.feed(*past[-1][:2])
        told = self._tracker.feed(now, markers)
        return told.height_m, told

    def _nearest(self, past: list[_Frame], time_s: float) -> Observation | None:
        """Return the nearest frame with a pose, if one is near."""
        for now, markers, told in sorted(past, key=lambda frame: abs(frame[0] - time_s)):
            if abs(now - time_s) > NEAR_S:
                return None
            frame = told or self._tracker.feed(now, markers)
            if frame.known:
                return frame
        return None

    def _seen(self, hop: SteeredHop) -> FloatArray:
        """Markers (K, M, 3) as the cameras report them."""
        camera = self.sight.camera
        index = np.round(hop.frame_time_s * camera.rate_hz).astype(int) % len(self._hidden)
        return observe(
            hop.markers,
            floor=self.sight.floor,
            noise_m=camera.noise_m,
            resolution_m=camera.resolution_m,
            hidden=self._hidden[index],
            rng=self._noise,
        )


@dataclass(frozen=True)
class Run:
    """What happened at the K + 1 stances of a run, that of the first landing first.

    Parameters
    ----------
    time_s : (K + 1,) array
        Time of each stance since the release, s.
    pose, measured : (K + 1, 3) arrays
        As it truly was, and as it was seen; m, m, rad. NaN where it was not seen.
    boom_angle_rad : (K + 1,) array
        As seen; taken from the swing that was commanded where it was not.
    swing_rad : (K + 1,) array
        Swing that was commanded for the hop after each stance.
    predicted : (K + 1, 3) array
        Pose that the controller's model foretold from the stance before; NaN for the first.
    board_m : (K + 1,) array
        Where the board was along its direction; NaN without one.
    blind : int
        Stances at which nothing was planned, since no pose was known: the boom held still.
    outcome : Outcome
        Judged by the true poses.
    """

    time_s: FloatArray
    pose: FloatArray
    measured: FloatArray
    boom_angle_rad: FloatArray
    swing_rad: FloatArray
    predicted: FloatArray
    board_m: FloatArray
    blind: int
    outcome: Outcome


@dataclass
class _Decision:
    swing_rad: float
    predicted: FloatArray
    boom_angle_rad: float
    blind: bool


def run_task(
    robot: SteeredHopper,
    sight: Sight,
    controller: Controller,
    task: Task,
    start: Start,
    *,
    board: Board | None = None,
    frames: Frames | None = None,
) -> Run:
    """Let a controller steer from a start until the run is decided or the hopper falls.

    Parameters
    ----------
    robot : SteeredHopper
    sight : Sight
        How it is seen.
    controller : Controller
        Knows its goal; is told what was seen, never what is true.
    task : Task
        What counts as success.
    start : Start
    board : Board, optional
        What stands in the way.
    frames : list, optional
        Takes time, s, and markers (M, 3), m, of each frame as the cameras saw it.
    """
    kicks, noise, gaps = start.streams()
    hopper = WatchedHopper(
        robot, sight, start.pose, most_hops=task.most_hops + 2, kicks=kicks, noise=noise,
        gaps=gaps, board=board, frames=frames,
    )  # fmt: skip
    stances: list[WatchedStance] = []
    decisions: list[_Decision] = []
    errors: list[float] = []
    last = _Decision(0.0, np.full(3, np.nan), robot.hopper.boom_angle_rad, False)
    while True:
        stance = hopper.hop(last.swing_rad)
        if stance.fell:
            break
        last = _decide(controller, stance, last, first=not stances)
        stances.append(stance)
        decisions.append(last)
        errors.append(float(errors_of(task.manoeuvre, start.pose, stance.hop.stance.pose)))
        if decided(task, errors):
            break
    return _collected(stances, decisions, judged(task, errors, fell=stance.fell))


def _decide(
    controller: Controller, stance: WatchedStance, before: _Decision, *, first: bool
) -> _Decision:
    """Plan from what was seen; hold the boom still where that is too little."""
    boom = before.boom_angle_rad + before.swing_rad
    nothing = np.full(3, np.nan)
    if stance.seen is None:
        return _Decision(0.0, nothing, boom, True)
    if np.isfinite(stance.seen.boom_angle_rad):
        boom = stance.seen.boom_angle_rad
    try:
        plan = controller.plan(stance.seen.pose, boom, None if first else before.swing_rad)
    except PlanningError:
        return _Decision(0.0, nothing, boom, True)
    return _Decision(plan.swing_rad, plan.poses[1], boom, False)


def _collected(stances: list[WatchedStance], decisions: list[_Decision], outcome: Outcome) -> Run:
    unseen = np.full(3, np.nan)
    measured = [unseen if s.seen is None else s.seen.pose for s in stances]
    foretold = [unseen, *(d.predicted for d in decisions[:-1])][: len(stances)]
    return Run(
        time_s=np.array([s.hop.stance.time_s for s in stances]),
        pose=np.array([s.hop.stance.pose for s in stances]).reshape(-1, 3),
        measured=np.array(measured).reshape(-1, 3),
        boom_angle_rad=np.array([d.boom_angle_rad for d in decisions]),
        swing_rad=np.array([d.swing_rad for d in decisions]),
        predicted=np.array(foretold).reshape(-1, 3),
        board_m=np.array([np.nan if s.board is None else s.board.place_m for s in stances]),
        blind=sum(d.blind for d in decisions),
        outcome=outcome,
    )
