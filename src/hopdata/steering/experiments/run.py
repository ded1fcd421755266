"""One run: a controller steers a simulated hopper through the live control loop.

The loop is the one that drives a robot, on a simulated clock and armed from the start.
It sees the hopper through motion capture, and its commands must arrive before the
flight they are for. If a fault brings the boom to rest, an operator arms the drive
again at the next apex, or at the first one after the fault is gone.
"""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import BoolArray, FloatArray, pd
from hopdata.steering import robot as plant
from hopdata.steering.control.interface import Controller, Plan, PlanningError
from hopdata.steering.experiments.tasks import (
    RunOutcome,
    Start,
    Task,
    decided,
    judged,
    progress_of,
)
from hopdata.steering.live.clocked import ClockedDrive, Transport
from hopdata.steering.live.decisions import Decision
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.loop import Detector, checks_of, observers_of
from hopdata.steering.live.machine import DriveState
from hopdata.steering.live.simulated import SimulatedBoom, SimulatedHopper
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.tracking import HopperTracker
from hopdata.steering.trial import POSE
from hopdata.synthesis.camera import CurvedFloor, MotionCapture

# The simulated hopper as the loop sees it: through motion capture, frame by frame.

Frames = list[tuple[float, FloatArray]]  # time, s, and markers (M, 3), m

#: Relative tolerance of the integrator in experiments.
#: Unit: 1. Origin: measured: over 25 random hops, poses differ from those at 1e-12 by
#: at most 2e-8 m and rad and stances by 3e-10 s (8 runs); the cameras' noise is 6e-4 m.
RUN_RTOL = 1e-7


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
    transport : Transport
        Delay and loss of frames on their way to the loop; none by default.
    """

    camera: MotionCapture
    geometry: HopperGeometry
    floor: CurvedFloor
    transport: Transport = field(default_factory=Transport)


class WatchedHopper:
    """A hopper that is released, and filmed until the end of a run.

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
    boom : SimulatedBoom
        What the loop commands.
    hopper : SimulatedHopper
        What the cameras see.
    frames : list
        Time, s, and markers (M, 3), m, of each frame so far, as the cameras saw it.
    tracker : HopperTracker or None
        The loop's tracker. Fitting all frames of a hop at once saves most of the time
        of a run.
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
        self.boom = SimulatedBoom()
        self.frames = Frames()
        self.tracker: HopperTracker | None = None
        kicks, self._noise, gaps, _, self.lost = start.streams()
        camera = sight.camera
        self.hopper = SimulatedHopper(
            robot,
            self.boom.newest,
            self._filmed,
            kicks,
            pose=start.pose,
            boom_angle_rad=robot.hopper.boom_angle_rad,
            rate_hz=camera.rate_hz,
            board=board,
        )
        self.hopper.rtol = RUN_RTOL
        n_markers = len(self.hopper.labels)
        most_frames = round((task.hops + 2) * robot.hop_limit_s * camera.rate_hz)
        self._hidden: BoolArray = camera.draw_gaps(most_frames, n_markers, gaps)

    def _filmed(self, time_s: FloatArray, markers: FloatArray) -> FloatArray:
        """Return the markers (K, M, 3) as the cameras report them."""
        camera = self.sight.camera
        frames = np.round(time_s * camera.rate_hz).astype(int)
        hidden = self._hidden[frames % len(self._hidden)]
        seen = camera.observe(markers, self.sight.floor, hidden, self._noise)
        self.frames += zip(time_s.tolist(), seen, strict=True)
        if self.tracker is not None:
            self.tracker.fit_ahead(seen)
        return seen

    def observers(self) -> tuple[HopperTracker, Detector]:
        """Return a new tracker, told of frames ahead, and a new stance detector."""
        make = observers_of(self.sight.geometry, self.sight.camera.rate_hz)
        self.tracker, detector = make()
        return self.tracker, detector


# Columns of the stances of a run: true poses, measured poses (NaN if not seen), and
# poses that the controller's model predicted at the previous stance (NaN for the first,
# and where the swing of that plan was not made). The boom angle is the measured one, or
# else follows from the swings that were made. The swing is that of the next hop. The
# board's place is along its direction, NaN without one; `touched` refers to the hop
# before.
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
        Number of stances at which the boom was held still, since there was no plan.
    late_commands : int
        Number of stances whose command came only after the flight had begun, so that
        the boom did not swing in it.
    rests : int
        How often the loop brought the boom to rest for a fault.
    last_error : float
        Error at the last stance, m or rad.
    outcome : RunOutcome
        Judged by the true poses.
    frames : list
        Time, s, and markers (M, 3), m, of each frame, as the cameras saw it.
    """

    stances: pd.DataFrame
    blind: int
    late_commands: int
    rests: int
    last_error: float
    outcome: RunOutcome
    frames: Frames


class _RecordedController:
    """Passes what the loop asks on to the controller, and keeps what it answers.

    The loop holds the boom when a controller fails. Here only a `PlanningError` may
    happen; anything else is a fault of the program and must end the run.
    """

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self.failure: Exception | None = None
        self._plan: Plan | None = None

    def plan(
        self,
        pose: ArrayLike,
        state: ArrayLike,
        previous_inputs: ArrayLike | None = None,
        /,
    ) -> Plan:
        """Return the controller's plan."""
        self._plan = None
        try:
            self._plan = self._controller.plan(pose, state, previous_inputs)
        except PlanningError:
            raise
        except Exception as error:
            self.failure = error
            raise
        return self._plan

    def last(self) -> Plan | None:
        """Return the plan since the last call, if there was one."""
        plan = self._plan
        self._plan = None
        return plan


@dataclass
class _AtStance:
    """What the loop knew and did at a stance."""

    pose: FloatArray
    boom_angle_rad: float
    plan: Plan | None
    command_rad: float
    is_late: bool


class _Drive:
    """The drive of a run: the loop, and what it decided in each hop."""

    def __init__(self, watched: WatchedHopper, controller: Controller) -> None:
        sight = watched.sight
        self.controller = _RecordedController(controller)
        self.limits = Limits(
            swing_rad=watched.robot.swing_limit_rad,
            fence_m=math.inf,  # the floor has no end
        )
        self.hopper = watched.hopper
        self.clocked = ClockedDrive(
            watched.hopper,
            watched.observers,
            self.controller,
            watched.boom,
            limits=self.limits,
            checks=checks_of(sight.geometry, sight.camera.rate_hz, self.limits),
            transport=sight.transport,
            lost=watched.lost,
            on_decision=self._note,
        )
        self._begun_s: list[float] = []
        self.seen: dict[int, _AtStance] = {}

    def hop(self) -> plant.SteeredHop:
        """Let the next hop pass, and return it.

        Raises
        ------
        Exception
            What the controller raises, other than a `PlanningError`.
        """
        self._begun_s.append(self.hopper.apex_s)
        loop = self.clocked.loop
        if loop.state is DriveState.RESTING:  # the operator stands by
            loop.arm()
        self.clocked.run_hop()
        if self.controller.failure is not None:
            raise self.controller.failure
        assert self.hopper.last is not None
        return self.hopper.last

    def _note(self, decision: Decision) -> None:
        """Keep a decision with the hop in which its stance was."""
        hop = bisect.bisect_right(self._begun_s, decision.stance_s) - 1
        plan = self.controller.last()
        if decision.outcome not in ("planned", "cut"):
            plan = None
        pose = np.array(decision.pose)
        if not decision.pose_age_s <= self.limits.pose_age_s:
            pose = np.full(3, np.nan)
        is_late = hop < len(self._begun_s) - 1
        self.seen[hop] = _AtStance(
            pose=pose,
            boom_angle_rad=decision.boom_angle_rad,
            plan=plan,
            command_rad=decision.command_rad,
            is_late=is_late,
        )


def run_task(watched: WatchedHopper, controller: Controller) -> Run:
    """Let a controller steer a hopper until the run is decided or it falls.

    Parameters
    ----------
    watched : WatchedHopper
    controller : Controller
        Already knows its goal; gets observations only, never the truth.
    """
    task = watched.task
    error_at = progress_of(task, watched.start.pose)
    drive = _Drive(watched, controller)
    hops: list[plant.SteeredHop] = []
    boards_m: list[float] = []
    errors: list[float] = []
    fell = False
    while not errors or not decided(task, errors):
        hop = drive.hop()
        fell = hop.stance.fell
        if fell:
            break
        hops.append(hop)
        board = watched.hopper.board
        boards_m.append(np.nan if board is None else board.place_m)
        errors.append(error_at(hop.stance.pose))
    swings = [hop.swing_rad for hop in hops[1:]] + [watched.boom.waiting_rad]
    stances = _stances(hops, swings[: len(hops)], drive.seen)
    stances["board_m"] = boards_m
    has_board = watched.hopper.board is not None
    touched = not has_board or bool(stances["touched"].any())
    seen = [drive.seen.get(k) for k in range(len(hops))]
    planned = [one for one in seen if one is not None and one.plan is not None]
    return Run(
        stances=stances,
        blind=len(hops) - len(planned),
        late_commands=sum(one.is_late for one in planned),
        rests=len(drive.clocked.loop.watch.rests),
        last_error=errors[-1] if errors else np.nan,
        outcome=judged(task, errors, fell=fell, touched=touched),
        frames=watched.frames,
    )


def _stances(
    hops: list[plant.SteeredHop], swings: list[float], seen: dict[int, _AtStance]
) -> pd.DataFrame:
    """Return the table of the stances, given the swing that follows each, rad."""
    unknown = np.full(3, np.nan)
    rows: list[list[float]] = []
    predicted = unknown
    boom = hops[0].start.boom_angle_rad if hops else np.nan
    for k, (hop, swing) in enumerate(zip(hops, swings, strict=True)):
        boom += hop.swing_rad
        stance = hop.stance
        known = seen.get(k)
        measured = unknown
        plan: Plan | None = None
        if known is not None:
            measured = known.pose
            if np.isfinite(known.boom_angle_rad):
                boom = known.boom_angle_rad
            # A rest may have followed the command.
            if not known.is_late and known.command_rad == swing:
                plan = known.plan
        row = [stance.time_s, *stance.pose, *measured, boom, swing, *predicted]
        rows.append([*row, np.nan, stance.touched])
        predicted = unknown if plan is None else plan.poses[1]
    return pd.DataFrame(rows, columns=COLUMNS, dtype=float)
