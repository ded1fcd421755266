"""One run: a controller steers a hopper that it sees through motion capture."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, pd
from hopdata.steering import robot as plant
from hopdata.steering.control.objectives import (
    Controller,
    Plan,
    PlanningError,
)
from hopdata.steering.experiments.tasks import (
    Outcome,
    Start,
    Task,
    decided,
    judged,
    progress_of,
)
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.stances import StanceDetector
from hopdata.steering.observation.tracking import HopperTracker, Observation
from hopdata.steering.trial import POSE
from hopdata.synthesis.camera import CurvedFloor, MotionCapture

# The simulated hopper as the controller sees it: through motion capture, frame by
# frame.

Frames = list[tuple[float, FloatArray]]  # time, s, and markers (M, 3), m
_Frame: TypeAlias = tuple[float, FloatArray, Observation | None]

#: Largest time from the lowest point of a pose that is used for the stance.
#: Unit: s. Origin: chosen.
NEAR_S = 0.05


@dataclass(frozen=True)
class Sight:
    """How the hopper is seen in all runs of an experiment.

    Parameters
    ----------
    camera : MotionCapture
        Rate, noise, resolution and gaps.
    geometry : HopperGeometry
        Calibrated geometry of the hopper.
    floor : CurvedFloor
        The floor as the cameras see it.
    """

    camera: MotionCapture
    geometry: HopperGeometry
    floor: CurvedFloor


class WatchedHopper:
    """A hopper that is released, commanded and watched.

    Parameters
    ----------
    robot : plant.SteeredHopper
    sight : Sight
    task : Task
        Success criterion; gaps are drawn for its hops and two more.
    start : Start
        Pose at the release, and the random streams.
    board : plant.Board, optional
        Board in the way.

    Attributes
    ----------
    frames : list
        Time, s, and markers (M, 3), m, of each frame so far, as the cameras saw it.
    """

    def __init__(
        self,
        robot: plant.SteeredHopper,
        sight: Sight,
        task: Task,
        start: Start,
        board: plant.Board | None = None,
    ) -> None:
        self.robot = robot
        self.sight = sight
        self.task = task
        self.start = start
        self.board = board
        self.frames = Frames()
        self._kicks, self._noise, gaps, _ = start.streams()
        boom_angle_rad = robot.hopper.boom_angle_rad
        self._apex: plant.Apex = plant.released(robot, start.pose, boom_angle_rad)
        camera = sight.camera
        n_body = len(robot.markers.body_m)
        markers = [f"body{i + 1}" for i in range(n_body)] + ["boom"]
        most_frames = round((task.hops + 2) * robot.hop_limit_s * camera.rate_hz)
        self._hidden: BoolArray = camera.draw_gaps(most_frames, len(markers), gaps)
        self._tracker = HopperTracker(sight.geometry, markers)
        self._body = sight.geometry.body_places(markers)
        self._detector = StanceDetector(sight.geometry, rate_hz=camera.rate_hz)

    def hop(self, swing_rad: float) -> tuple[plant.Stance, Observation | None]:
        """Make one hop with this swing of the boom, rad, and observe it.

        Returns
        -------
        Stance
            The true stance.
        Observation or None
            From the frame with a pose nearest to the lowest point; None if no stance
            was recognised or no frame near it had a pose.
        """
        hop = plant.steer_hop(
            self.robot,
            self._apex,
            swing_rad,
            rng=self._kicks,
            rate_hz=self.sight.camera.rate_hz,
            board=self.board,
        )
        self._apex = hop.end
        if self.board is not None:
            self.board = self.board.pushed(hop)
        return hop.stance, self._watched(hop)

    def _watched(self, hop: plant.SteeredHop) -> Observation | None:
        """Return the observation with a pose that is nearest to the stance."""
        past: list[_Frame] = []
        found, all_seen = None, self._seen(hop)
        # If all body markers are seen, their mean is the height, whatever the attitude.
        means = all_seen[:, self._body].mean(axis=1)
        heights = np.where(np.isfinite(means).all(axis=1), means[:, 2], np.nan).tolist()
        for now, markers, height in zip(
            hop.frame_time_s.tolist(), all_seen, heights, strict=True
        ):
            told = None
            self.frames.append((now, markers))
            if np.isnan(height):
                if past and past[-1][2] is None:  # so that this frame can lean on it
                    self._tracker.feed(*past[-1][:2])
                told = self._tracker.feed(now, markers)
                height = told.height_m
            past.append((now, markers, told))
            stance = self._detector.feed(now, height)
            if stance is not None:
                found = self._nearest(past, stance.time_s)
        return found

    def _nearest(self, past: list[_Frame], time_s: float) -> Observation | None:
        """Return the nearest observation with a pose, if there is one close enough."""
        near = [frame for frame in past if abs(frame[0] - time_s) <= NEAR_S]
        near.sort(key=lambda frame: abs(frame[0] - time_s))
        seen = (told or self._tracker.feed(now, markers) for now, markers, told in near)
        return next((frame for frame in seen if frame.known), None)

    def _seen(self, hop: plant.SteeredHop) -> FloatArray:
        """Return the markers (K, M, 3) as the cameras report them."""
        camera = self.sight.camera
        frames = np.round(hop.frame_time_s * camera.rate_hz).astype(int)
        hidden = self._hidden[frames % len(self._hidden)]
        return camera.observe(hop.markers, self.sight.floor, hidden, self._noise)


# Columns of the stances of a run: true poses, measured poses (NaN if not seen), and
# poses that the controller's model predicted at the previous stance (NaN for the
# first). The boom angle is the measured one, or else follows from the commanded swing.
# The swing is that of the next hop. The board's place is along its direction, NaN
# without one; `touched` refers to the hop before.
MEASURED = [f"measured_{name}" for name in POSE]
PREDICTED = [f"predicted_{name}" for name in POSE]
COLUMNS = [
    "time_s",
    *POSE,
    *MEASURED,
    "boom_angle_rad",
    "swing_rad",
    *PREDICTED,
    "board_m",
    "touched",
]


@dataclass(frozen=True)
class Run:
    """Record of the K + 1 stances of a run, starting with the first landing.

    Parameters
    ----------
    stances : DataFrame
        One row per stance: `COLUMNS`; times are since the release.
    blind : int
        Number of stances at which the boom was held still, since no pose was known to
        plan from.
    last_error : float
        Error at the last stance, m or rad.
    outcome : Outcome
        Judged by the true poses.
    frames : list
        Time, s, and markers (M, 3), m, of each frame, as the cameras saw it.
    """

    stances: pd.DataFrame
    blind: int
    last_error: float
    outcome: Outcome
    frames: Frames


def run_task(hopper: WatchedHopper, controller: Controller) -> Run:
    """Let a controller steer a hopper until the run is decided or it falls.

    Parameters
    ----------
    hopper : WatchedHopper
    controller : Controller
        Already knows its goal; gets observations only, never the truth.
    """
    task = hopper.task
    has_board = hopper.board is not None
    error_at = progress_of(task, hopper.start.pose)
    unknown = np.full(3, np.nan)
    rows: list[list[float]] = []
    errors: list[float] = []
    swing = 0.0
    boom = hopper.robot.hopper.boom_angle_rad
    predicted = unknown
    blind = 0
    while True:
        stance, seen = hopper.hop(swing)
        if stance.fell:
            break
        boom = boom + swing
        if seen is not None and np.isfinite(seen.boom_angle_rad):
            boom = seen.boom_angle_rad
        plan: Plan | None = None
        previous = swing if rows else None
        with suppress(PlanningError):  # too little was seen: the boom is held still
            if seen is not None:
                plan = controller.plan(seen.pose, boom, previous)
        if plan is None:
            swing = 0.0
            blind += 1
        else:
            swing = plan.swing_rad
        measured = unknown if seen is None else seen.pose
        board_m = np.nan if hopper.board is None else hopper.board.place_m
        row = [stance.time_s, *stance.pose, *measured, boom, swing, *predicted]
        rows.append([*row, board_m, stance.touched])
        predicted = unknown if plan is None else plan.poses[1]
        errors.append(error_at(stance.pose))
        if decided(task, errors):
            break
    stances = pd.DataFrame(rows, columns=COLUMNS, dtype=float)
    touched = not has_board or bool(stances["touched"].any())
    return Run(
        stances=stances,
        blind=blind,
        last_error=errors[-1] if errors else np.nan,
        outcome=judged(task, errors, fell=stance.fell, touched=touched),
        frames=hopper.frames,
    )
