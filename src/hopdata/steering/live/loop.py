"""The control loop: a thread that plans at each stance and commands the boom (Fig. 3.4).

No event ends the loop: if the controller fails, a pose is too old or a plan is late, it
sends the safe command, which leaves the boom where it is, and logs the reason.
"""

from __future__ import annotations

import math
import threading
import time
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
        Newest pose up to the frame that revealed the stance, later frames of the batch
        excluded; NaN if there was none.
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
    """Return a maker of tracker and stance detector; the boom marker comes after the body's."""
    names = (*geometry.body_names, str(geometry.boom_name))
    return lambda: (
        HopperTracker(geometry, names),
        StanceDetector(geometry, rate_hz=rate_hz),
    )


LOOK_UP_S = 0.5
SAME_CLOCK_S = 0.5
MISFITS = 3  # consecutive frames whose markers do not fit together: some are swapped
# Measured swings are compared with those sent. Cameras of 0.6 mm see the angle of a
# boom of 0.25 m to some 5 mrad, a tenth of what counts. A boom that is wired backwards,
# dead or at half gain is off by 2, 1 and 0.5 of its command.
LEAST_SWING_RAD = 0.05  # differences below this are not seen
SWING_SHARE = 0.3  # largest difference, as a share of the swing that was sent


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

    def __init__(
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
        self.limits, self.counts = limits or Limits(), LoopCounts()
        self.last_failure = ""
        self.watch = Watch(boom, self._cause, clock, patience_s=self.limits.command_s)
        self._clock = clock
        self._fault, self._told_to_stop = fault, stop or threading.Event()
        self._over = self._failing = (
            ""  # why the drive is over; why the last frame is unusable
        )
        self._misfits, self._due_s = (
            0,
            math.inf,
        )  # when a plan is too late, monotonic clock
        self._buffer, self._observers = buffer, observers
        self._controller, self._on_decision, self._on_frames = (
            controller,
            on_decision,
            on_frames,
        )
        self._tracker, self._detector = observers()
        self._decisions: list[Decision] = []
        self._last: Frame | None = None
        self._pose, self._boom_angle = _Newest(), _Newest()
        self._last_stance: tuple[float, float] | None = (
            None  # monotonic time, and boom angle
        )
        self._lacking: dict[
            str, float
        ] = {}  # what frames lack -> capture time of the first, s
        self._sent_rad = (
            math.nan
        )  # swing sent at the last stance; NaN if it is not certain
        self._rests_then = 0  # rests up to that stance
        self._boom_failure = ""  # what the boom raised at the last stance
        self._wrong: list[
            tuple[float, float]
        ] = []  # swings sent and measured that differ
        self._is_sending = not isinstance(
            boom, NoBoom
        )  # else no boom can be expected to follow

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
        newest, now, limit = (
            self._buffer.newest(),
            self._clock(),
            self.limits.pose_age_s,
        )
        silent_s = -math.inf if newest is None else now - newest.captured_s
        if self._over or self._failing:
            return self._over or self._failing
        if self._misfits >= MISFITS:
            return "the markers do not fit together: exchanged?"
        if silent_s > limit:
            return f"no frame for {silent_s:.3f} s, beyond {limit:g} s"
        if lacking := self._lacking_too_long():
            return lacking
        if now > self._due_s:
            return f"planned too late: no plan {self.limits.command_s:g} s after the stance"
        return self._boom_failure or self._fault()

    def _lacking_too_long(self) -> str:
        """Return which markers that are needed have not been seen for `Limits.pose_age_s`."""
        last = self._last
        if last is None:
            return ""
        ages = {
            what: last.captured_s - since
            for what, since in self._lacking.copy().items()
        }
        too_long = {
            what: age for what, age in ages.items() if age > self.limits.pose_age_s
        }
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
        told = [
            (s, f, self._pose, self._boom_angle)
            for f in frames
            if (s := self._observed(f))
        ]
        for k, seen in enumerate(told):
            self._decide(*seen, overtaken=k + 1 < len(told))

    def _observed(self, frame: Frame) -> Stance | None:
        """Process a frame, and return the stance it reveals, if any."""
        self.counts.frames += 1
        try:
            if self._last is not None and not _same_clock(self._last, frame):
                self._tracker, self._detector = self._observers()
            self._last = frame
            seen = self._tracker.feed(frame.time_s, frame.markers)
            self._heed(seen)
            if np.isfinite(seen.pose).all():
                self._pose = _Newest(tuple(seen.pose.tolist()), frame.captured_s)
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

    def _heed(self, seen: Observation) -> None:
        """Check whether the hopper left the arena or tips over, and whether markers are misfits."""
        self._misfits = self._misfits + 1 if seen.status == MISFIT else 0
        since_s = self._lacking
        captured_s = self._last.captured_s if self._last is not None else math.nan
        self._lacking = {what: since_s.get(what, captured_s) for what in seen.lacking}
        away, limits = math.hypot(*seen.pose[:2]), self.limits
        if away > limits.fence_m:
            self.rest(
                f"left the arena: {away:.2f} m from the origin, beyond {limits.fence_m:g} m"
            )
        if seen.rotation[2, 2] < math.cos(limits.tilt_rad):
            tilt = math.degrees(math.acos(max(-1.0, seen.rotation[2, 2])))
            self.rest(f"tips over: leans by {tilt:.0f} degrees")

    def _decide(
        self,
        stance: Stance,
        frame: Frame,
        pose: _Newest,
        boom: _Newest,
        *,
        overtaken: bool,
    ) -> None:
        self._boom_failure = ""  # it is tried again
        self.watch.look()  # an earlier cause may be gone
        stance_s = frame.captured_s - (
            frame.time_s - stance.time_s
        )  # on the monotonic clock
        asked_s = self._clock()
        ages = (asked_s - pose.captured_s, asked_s - boom.captured_s)
        in_date = ages[1] <= self.limits.pose_age_s
        swung = self._swung(stance_s, boom.values[0] if in_date else math.nan)
        self._compare(swung)
        planned, planning_s = math.nan, math.nan
        outcome, reason = self._refusal(*ages, asked_s - stance_s, overtaken=overtaken)
        command = math.nan if outcome == "overtaken" else 0.0
        if outcome == "planned":
            planned, reason = self._plan(pose, boom, swung, stance_s)
            planning_s = self._clock() - asked_s
            outcome, command, reason = self._permitted(planned, reason, stance_s)
        self._sent_rad, self._rests_then = math.nan, len(self.watch.rests)
        if outcome != "overtaken":
            try:
                refused = self.watch.swing(command)
                self._sent_rad = math.nan if refused else command
            except Exception as error:
                refused, reason = "", f"the boom failed: {error!r}"
                self._boom_failure = reason  # it may have begun to move
            if refused:
                outcome, command, reason = "held", 0.0, refused
        sent_s = self._clock()
        self._log(
            Decision(
                stance_s=stance.time_s, told_s=frame.time_s, epoch=frame.epoch,
                pose=pose.values if len(pose.values) == 3 else (math.nan,) * 3,
                boom_angle_rad=boom.values[0], swung_rad=math.nan if swung is None else swung,
                asked_s=asked_s, pose_age_s=ages[0], boom_age_s=ages[1],
                outcome=outcome, planned_rad=planned, command_rad=command,
                planning_s=planning_s, latency_s=sent_s - frame.arrival_s,
                since_stance_s=sent_s - stance_s, reason=reason,
            )
        )  # fmt: skip

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
            return (
                "held",
                f"the stance was reported too late, {stance_age_s:.3f} s after it",
            )
        for name, age in (("pose", pose_age_s), ("boom angle", boom_age_s)):
            if not math.isfinite(age):
                return "held", f"no {name} yet"
            if age > self.limits.pose_age_s:
                return (
                    "held",
                    f"stale {name}: {age:.3f} s old, beyond {self.limits.pose_age_s:g} s",
                )
        return "planned", ""

    def _swung(self, stance_s: float, boom_angle_rad: float) -> float | None:
        """Return the measured swing since the previous stance, if that was one hop before."""
        before, self._last_stance = self._last_stance, (stance_s, boom_angle_rad)
        if before is None or stance_s - before[0] > self.limits.hop_s:
            return None
        swing = float(wrapped(boom_angle_rad - before[1]))
        return swing if math.isfinite(swing) else None

    def _compare(self, swung: float | None) -> None:
        """Compare the last hop's swing with the one sent; wrong ones in a row end the drive."""
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
        """Return outcome and command for a planned swing, and the reason for any difference."""
        late, limit = self._clock() - stance_s, self.limits.swing_rad
        if self._stop.is_set():
            return "held", 0.0, "the drive ended while it was planned"
        if not math.isfinite(swing):
            return "held", 0.0, failure or f"the controller's swing is {swing}"
        if late > self.limits.command_s:
            return "held", 0.0, f"planned too late, {late:.3f} s after the stance"
        if abs(swing) > limit:
            return (
                "cut",
                math.copysign(limit, swing),
                f"{swing:.3f} rad cut to {limit:.3f} rad",
            )
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


LEAST_GAIN = 0.15  # share of its swings below which a boom counts as not moving


@dataclass(frozen=True)
class _Newest:
    """A measurement, and its capture time on the monotonic clock, s."""

    values: tuple[float, ...] = (math.nan,)
    captured_s: float = -math.inf


def _same_clock(old: Frame, new: Frame) -> bool:
    """Return whether the camera time of a frame continues that of another."""
    if new.epoch == old.epoch:
        return True
    passed, told = new.arrival_s - old.arrival_s, new.time_s - old.time_s
    return told > 0 and abs(told - passed) < SAME_CLOCK_S
