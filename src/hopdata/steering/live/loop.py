"""The control loop: a thread that plans at each stance and commands the boom.

This is Fig. 3.4. No event ends the loop: if the controller fails, a pose is too old or
a plan is late, it sends the safe command, which leaves the boom where it is, and logs
the reason.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, Self, TypeAlias

import numpy as np

from hopdata.rigid import wrapped
from hopdata.steering.control.objectives import Controller
from hopdata.steering.live.buffer import Frame, FrameBuffer, LoopCounts, Worker
from hopdata.steering.live.safety import Boom, Limits, NoBoom, Watch
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.stances import Stance, StanceDetector
from hopdata.steering.observation.tracking import MISFIT, HopperTracker, Observation

# The decision at each stance, and its reason.

Outcome = Literal["planned", "cut", "held", "overtaken"]


@dataclass(frozen=True)
class Decision:
    """A stance and the resulting command.

    Parameters
    ----------
    stance_s : float
        Time of the stance, camera time, s.
    told_s : float
        Camera time of the frame that revealed it, s.
    epoch : int
        The camera clock of these times; see `hopdata.steering.live.buffer.Frame`.
    pose : (x_m, y_m, heading_rad)
        Pose of the frame nearest to the stance, of those up to the frame that revealed
        it; NaN if there was none.
    boom_angle_rad : float
        Newest boom angle up to that frame.
    swung_rad : float
        Measured swing since the previous stance; NaN if unknown.
    asked_s : float
        Time of the decision on the loop's clock, s.
    pose_age_s, boom_age_s : float
        Their ages at the decision, s.
    outcome : str
        "planned": the controller's command was sent. "cut": so it was, clipped to the
        limit. "held": the boom was commanded to stay, for `reason`. "overtaken":
        nothing was sent, since another stance had been seen in the meantime.
    planned_rad : float
        The controller's swing; NaN if it was not called, or failed.
    command_rad : float
        Swing that was sent, rad; NaN if none.
    planning_s : float
        Time that the controller took, s; NaN if it was not called.
    latency_s : float
        From the arrival of the frame that revealed the stance to the command, s.
    since_stance_s : float
        From the stance itself to the command, s.
    reason : str
        Why the planned swing was not sent as it is.
    """

    stance_s: float
    told_s: float
    epoch: int
    pose: tuple[float, float, float]
    boom_angle_rad: float
    swung_rad: float
    asked_s: float
    pose_age_s: float
    boom_age_s: float
    outcome: Outcome
    planned_rad: float
    command_rad: float
    planning_s: float
    latency_s: float
    since_stance_s: float
    reason: str


Observers: TypeAlias = Callable[[], tuple[HopperTracker, StanceDetector]]


def observers_of(geometry: HopperGeometry, rate_hz: float) -> Observers:
    """Return a maker of tracker and stance detector.

    The boom marker comes after the body's.
    """
    names = (*geometry.body_names, str(geometry.boom_name))
    return lambda: (
        HopperTracker(geometry, names),
        StanceDetector(geometry, rate_hz=rate_hz),
    )


LOOK_UP_S = 0.5  # longest wait for a frame before the loop looks whether it is to end
#: Largest difference between the camera's and our time between two frames for the
#: camera's clock to have gone on over a lost connection.
#: Unit: s. Origin: chosen.
SAME_CLOCK_S = 0.5
#: Consecutive frames whose markers do not fit together, after which some are swapped.
#: Unit: 1. Origin: chosen.
MISFITS = 3
#: Differences between the swings sent and measured below this are not seen.
#: Unit: rad. Origin: derived: cameras of 0.6 mm see the angle of a boom of 0.25 m to
#: some 5 mrad, a tenth of it.
LEAST_SWING_RAD = 0.05
#: Largest difference from the swing that was sent, as a share of it.
#: Unit: 1. Origin: derived: a boom that is wired backwards, dead or at half gain is off
#: by 2, 1 and 0.5 of its command.
SWING_SHARE = 0.3
#: Share of its swings below which a boom counts as not moving.
#: Unit: 1. Origin: chosen.
LEAST_GAIN = 0.15
#: Last poses that are kept, to take that at a stance from them.
#: Unit: 1. Origin: derived: 0.13 s at 500 Hz; a stance is recognised within 0.06 s.
POSES_KEPT = 64


class ControlLoop(Worker):
    """Waits for frames, and plans at each stance.

    Use it as a context manager, or with `start` and `close`.

    Parameters
    ----------
    buffer : FrameBuffer
        Source of the frames.
    observers : callable
        Returns a new tracker and a new stance detector; called when a camera clock
        begins.
    controller : Controller
    boom : Boom
    limits : Limits
    on_decision : callable, optional
        Called with each decision, in the loop's thread.
    on_frames : callable, optional
        Called with each batch of frames, before it is processed.
    fault : callable, optional
        Returns another cause to bring the boom to rest, or an empty string.
    stop : threading.Event, optional
        Set when the drive is over: the hopper left the arena or tips over, or the loop
        failed.
    clock : callable
        Returns the time, s, on the clock of `Frame.captured_s`. With another clock,
        call `take` and `watch.look` instead of starting the threads.
    """

    def __init__(  # noqa: PLR0913 - its parts, and what may listen to it, by name
        self,
        buffer: FrameBuffer,
        observers: Observers,
        controller: Controller,
        boom: Boom,
        *,
        limits: Limits | None = None,
        on_decision: Callable[[Decision], None] | None = None,
        on_frames: Callable[[Sequence[Frame]], None] | None = None,
        fault: Callable[[], str] = lambda: "",
        stop: threading.Event | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__("hopdata-control", self._run)
        self.limits = limits or Limits()
        self.counts = LoopCounts()
        self.last_failure = ""
        self.watch = Watch(boom, self._cause, clock, patience_s=self.limits.command_s)
        self._clock = clock
        self._fault = fault
        self._told_to_stop = stop or threading.Event()
        self._buffer = buffer
        self._observers = observers
        self._controller = controller
        self._on_decision = on_decision
        self._on_frames = on_frames
        self._tracker, self._detector = observers()
        self._decisions: list[Decision] = []
        # Why the drive is over; why the last frame is unusable; what the boom raised
        # at the last stance.
        self._over = ""
        self._failing = ""
        self._boom_failure = ""
        # Consecutive misfits, and the time at which a plan is too late, monotonic.
        self._misfits = 0
        self._due_s = math.inf
        # The last frame, and the newest measurements up to it.
        self._last: Frame | None = None
        # Camera times and poses of the frames in which a stance may have been.
        self._poses: deque[tuple[float, _Newest]] = deque(maxlen=POSES_KEPT)
        self._boom_angle = _Newest()
        # Since when frames lack a marker: capture time of the first, s.
        self._lacking: dict[str, float] = {}
        # Monotonic time of the last stance, and its boom angle.
        self._last_stance: tuple[float, float] | None = None
        # The swing sent at it, NaN if that is not certain, and the rests up to it.
        self._sent_rad = math.nan
        self._rests_then = 0
        # Swings sent and measured, one after the other, that differ.
        self._wrong: list[tuple[float, float]] = []
        # A boom that gets nothing cannot be expected to follow.
        self._is_sending = not isinstance(boom, NoBoom)

    def start(self) -> Self:
        """Start the thread."""
        self._seen = self._buffer.written
        super().start()
        self.watch.start()
        return self

    def close(self) -> None:
        """Stop, and wait until the thread has ended.

        Raises
        ------
        LiveError
            If it does not end because the controller or the boom does not return.
        """
        self._stop.set()
        self._buffer.wake()
        try:
            super().close()
        finally:
            self.watch.close()

    def rest(self, cause: str) -> None:
        """Bring the boom to rest for good, at once."""
        self._over = self._over or cause
        self.watch.look()
        self._told_to_stop.set()

    def _cause(self) -> str:
        """Return why the boom must rest now, or an empty string."""
        newest = self._buffer.newest()
        now = self._clock()
        if self._over:
            return self._over
        if self._failing:
            return self._failing
        if self._misfits >= MISFITS:
            return "the markers do not fit together: exchanged?"
        if newest is not None:
            limit = self.limits.pose_age_s
            silent_s = now - newest.captured_s
            if silent_s > limit:
                return f"no frame for {silent_s:.3f} s, beyond {limit:g} s"
        lacking = self._lacking_too_long()
        if lacking:
            return lacking
        if now > self._due_s:
            most_s = self.limits.command_s
            return f"planned too late: no plan {most_s:g} s after the stance"
        if self._boom_failure:
            return self._boom_failure
        return self._fault()

    def _lacking_too_long(self) -> str:
        """Return which needed markers have not been seen for `Limits.pose_age_s`."""
        last = self._last
        if last is None:
            return ""
        too_long = {}
        for what, since_s in self._lacking.copy().items():
            age = last.captured_s - since_s
            if age > self.limits.pose_age_s:
                too_long[what] = age
        if not too_long:
            return ""
        return f"{'; '.join(too_long)} (for {max(too_long.values()):.2f} s)"

    def decisions(self) -> tuple[Decision, ...]:
        """Return all decisions so far."""
        return tuple(self._decisions)

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                self._buffer.wait(self._seen, LOOK_UP_S, unless=self._stop.is_set)
                frames = self._buffer.since(self._seen)
                if frames:
                    self.counts.overrun += frames[0].index - self._seen
                    self._seen = frames[-1].index + 1
                    self.take(frames)
        except BaseException as error:
            self.rest(f"the control loop failed: {error!r}")

    def take(self, frames: Sequence[Frame]) -> None:
        """Process frames, and plan at the last stance among them."""
        if self._on_frames is not None:
            self._on_frames(frames)
        told = []
        for frame in frames:
            stance = self._observed(frame)
            if stance is not None:
                # Later frames of the batch must not change what was known then.
                pose = self._pose_at(stance)
                told.append(_Told(stance, frame, pose, self._boom_angle))
        for k, one in enumerate(told):
            self._decide(one, overtaken=k + 1 < len(told))

    def _observed(self, frame: Frame) -> Stance | None:
        """Process a frame, and return the stance it reveals, if any."""
        self.counts.frames += 1
        try:
            if self._last is not None and not _same_clock(self._last, frame):
                self._tracker, self._detector = self._observers()
                self._poses.clear()
            self._last = frame
            seen = self._tracker.feed(frame.time_s, frame.markers)
            self._heed(seen)
            if np.isfinite(seen.pose).all():
                pose = _Newest(tuple(seen.pose.tolist()), frame.captured_s)
                self._poses.append((frame.time_s, pose))
            if math.isfinite(seen.boom_angle_rad):
                self._boom_angle = _Newest((seen.boom_angle_rad,), frame.captured_s)
            stance = self._detector.feed(frame.time_s, seen.height_m)
            self._failing = ""
            return stance
        except Exception as error:
            self.counts.failed += 1
            self.last_failure = repr(error)
            self._failing = f"a frame could not be understood: {error!r}"
            return None

    def _pose_at(self, stance: Stance) -> _Newest:
        """Return the pose of the frame nearest to a stance, for which models are made.

        When the stance is recognised, the hopper has moved on for two or three frames.
        """
        if not self._poses:
            return _Newest()
        return min(self._poses, key=lambda one: abs(one[0] - stance.time_s))[1]

    def _heed(self, seen: Observation) -> None:
        """Check whether the hopper left the arena or tips over; note what lacks."""
        self._misfits = self._misfits + 1 if seen.status == MISFIT else 0
        captured_s = self._last.captured_s if self._last is not None else math.nan
        before = self._lacking
        self._lacking = {what: before.get(what, captured_s) for what in seen.lacking}
        away_m = math.hypot(*seen.pose[:2])
        fence_m = self.limits.fence_m
        if away_m > fence_m:
            where = f"{away_m:.2f} m from the origin, beyond {fence_m:g} m"
            self.rest(f"left the arena: {where}")
        upright = seen.rotation[2, 2]  # cosine of the tilt
        if upright < math.cos(self.limits.tilt_rad):
            tilt = math.degrees(math.acos(max(-1.0, upright)))
            self.rest(f"tips over: leans by {tilt:.0f} degrees")

    def _decide(self, told: _Told, *, overtaken: bool) -> None:
        """Decide at a stance, send the command, and log both."""
        self._boom_failure = ""  # it is tried again
        self.watch.look()  # an earlier cause may be gone
        pose = told.pose
        boom = told.boom
        stance_s = told.stance_s
        asked_s = self._clock()
        pose_age_s = asked_s - pose.captured_s
        boom_age_s = asked_s - boom.captured_s
        boom_angle_rad = math.nan
        if boom_age_s <= self.limits.pose_age_s:
            boom_angle_rad = boom.values[0]
        swung = self._swung(stance_s, boom_angle_rad)
        self._compare(swung)
        planned = math.nan
        planning_s = math.nan
        outcome, reason = self._refusal(
            pose_age_s, boom_age_s, asked_s - stance_s, overtaken=overtaken
        )
        command = math.nan if outcome == "overtaken" else 0.0
        if outcome == "planned":
            planned, failure = self._plan(pose, boom, swung, stance_s)
            planning_s = self._clock() - asked_s
            outcome, command, reason = self._permitted(planned, failure, stance_s)
        self._sent_rad = math.nan
        self._rests_then = len(self.watch.rests)
        if outcome != "overtaken":
            outcome, command, reason = self._sent(outcome, command, reason)
        sent_s = self._clock()
        decision = Decision(
            stance_s=told.stance.time_s,
            told_s=told.frame.time_s,
            epoch=told.frame.epoch,
            pose=pose.values if len(pose.values) == 3 else (math.nan,) * 3,
            boom_angle_rad=boom.values[0],
            swung_rad=math.nan if swung is None else swung,
            asked_s=asked_s,
            pose_age_s=pose_age_s,
            boom_age_s=boom_age_s,
            outcome=outcome,
            planned_rad=planned,
            command_rad=command,
            planning_s=planning_s,
            latency_s=sent_s - told.frame.arrival_s,
            since_stance_s=sent_s - stance_s,
            reason=reason,
        )
        self._log(decision)

    def _sent(
        self, outcome: Outcome, command: float, reason: str
    ) -> tuple[Outcome, float, str]:
        """Send a command; return outcome, command and reason as they then are."""
        try:
            refused = self.watch.swing(command)
        except Exception as error:
            self._boom_failure = f"the boom failed: {error!r}"
            return outcome, command, self._boom_failure  # it may have begun to move
        if refused:
            return "held", 0.0, refused
        self._sent_rad = command
        return outcome, command, reason

    def _refusal(
        self,
        pose_age_s: float,
        boom_age_s: float,
        stance_age_s: float,
        *,
        overtaken: bool,
    ) -> tuple[Outcome, str]:
        """Return an outcome, and the reason if there is to be no planning."""
        if overtaken:
            return "overtaken", "another stance has been seen in the meantime"
        if self.watch.cause:
            return "held", self.watch.cause
        if stance_age_s > self.limits.command_s:
            late = f"the stance was reported too late, {stance_age_s:.3f} s after it"
            return "held", late
        limit_s = self.limits.pose_age_s
        for name, age in (("pose", pose_age_s), ("boom angle", boom_age_s)):
            if not math.isfinite(age):
                return "held", f"no {name} yet"
            if age > limit_s:
                stale = f"stale {name}: {age:.3f} s old, beyond {limit_s:g} s"
                return "held", stale
        return "planned", ""

    def _swung(self, stance_s: float, boom_angle_rad: float) -> float | None:
        """Return the measured swing since the last stance, if that was a hop before."""
        before = self._last_stance
        self._last_stance = (stance_s, boom_angle_rad)
        if before is None:
            return None
        before_s, before_rad = before
        if stance_s - before_s > self.limits.hop_s:
            return None
        swing = float(wrapped(boom_angle_rad - before_rad))
        return swing if math.isfinite(swing) else None

    def _compare(self, swung: float | None) -> None:
        """Compare the last hop's swing with the one sent; wrong ones end the drive."""
        if not self._is_sending:
            return
        sent = self._sent_rad
        is_certain = math.isfinite(sent) and len(self.watch.rests) == self._rests_then
        if swung is None or not is_certain:
            return
        if max(abs(sent), abs(swung)) < LEAST_SWING_RAD:
            return
        difference = abs(float(wrapped(swung - sent)))
        if difference <= max(LEAST_SWING_RAD, SWING_SHARE * abs(sent)):
            self._wrong = []
            return
        self._wrong = [*self._wrong, (sent, swung)]
        if len(self._wrong) >= self.limits.wrong_swings:
            self.rest(_does_not_follow(self._wrong))

    def _plan(
        self, pose: _Newest, boom: _Newest, swung: float | None, stance_s: float
    ) -> tuple[float, str]:
        """Return the controller's swing and an empty string, or NaN and the error."""
        self._due_s = stance_s + self.limits.command_s
        try:
            plan = self._controller.plan(np.array(pose.values), boom.values[0], swung)
            return float(plan.swing_rad), ""
        except Exception as error:
            return math.nan, f"the controller failed: {error!r}"
        finally:
            self._due_s = math.inf

    def _permitted(
        self, swing: float, failure: str, stance_s: float
    ) -> tuple[Outcome, float, str]:
        """Return outcome and command for a planned swing, and why they differ."""
        late_s = self._clock() - stance_s
        limit = self.limits.swing_rad
        if self._stop.is_set():
            return "held", 0.0, "the drive ended while it was planned"
        if not math.isfinite(swing):
            return "held", 0.0, failure or f"the controller's swing is {swing}"
        if late_s > self.limits.command_s:
            return "held", 0.0, f"planned too late, {late_s:.3f} s after the stance"
        if abs(swing) > limit:
            cut = f"{swing:.3f} rad cut to {limit:.3f} rad"
            return "cut", math.copysign(limit, swing), cut
        return "planned", swing, ""

    def _log(self, decision: Decision) -> None:
        self._decisions.append(decision)
        if self._on_decision is not None:
            try:
                self._on_decision(decision)
            except Exception as error:
                self.last_failure = repr(error)


def _does_not_follow(wrong: Sequence[tuple[float, float]]) -> str:
    """Say how swings that were measured differ from those sent."""
    pairs = ", ".join(
        f"{sent:+.2f} rad sent and {swung:+.2f} measured" for sent, swung in wrong
    )
    sent, swung = np.array(wrong).T
    if np.abs(sent).max() < LEAST_SWING_RAD:
        how = "it moves though it was told to stay"
    else:
        gain = float(sent @ swung / (sent @ sent))
        how = f"it moves by {100 * gain:.0f} % of its swings"
        if gain < -LEAST_GAIN:
            how = "it turns the other way"
        elif gain < LEAST_GAIN:
            how = "it does not move"
    return f"the boom does not follow: {how} ({pairs})"


@dataclass(frozen=True)
class _Newest:
    """A measurement, and its capture time on the monotonic clock, s."""

    values: tuple[float, ...] = (math.nan,)
    captured_s: float = -math.inf


@dataclass(frozen=True)
class _Told:
    """A stance, the frame that revealed it, and the newest measurements up to it."""

    stance: Stance
    frame: Frame
    pose: _Newest
    boom: _Newest

    @property
    def stance_s(self) -> float:
        """Time of the stance on the monotonic clock, s."""
        return self.frame.captured_s - (self.frame.time_s - self.stance.time_s)


def _same_clock(old: Frame, new: Frame) -> bool:
    """Return whether the camera time of a frame continues that of another."""
    if new.epoch == old.epoch:
        return True
    passed_s = new.arrival_s - old.arrival_s
    told_s = new.time_s - old.time_s
    return told_s > 0 and abs(told_s - passed_s) < SAME_CLOCK_S
