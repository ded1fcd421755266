"""The control loop: a thread that plans at each stance and commands the robot.

This is the loop of the dissertation's Fig. 3.4. What happens is told to the state
machine of the drive (`hopdata.steering.live.machine`) by way of the watch. If a fault
comes, the robot is told to rest, and stays at rest until the operator arms the drive
again.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol, Self, TypeAlias

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.messages import Message
from hopdata.rigid import wrapped
from hopdata.steering.control.interface import Controller
from hopdata.steering.frame_changes import HOPPER
from hopdata.steering.live.actuator import Driven, NoActuator, NoBoom
from hopdata.steering.live.buffer import Frame, FrameBuffer, LoopCounts, Worker
from hopdata.steering.live.checks import Findings, FrameChecks
from hopdata.steering.live.decisions import (
    Decision,
    DecisionOutcome,
    Numbers,
    is_hopper,
    moved_part,
    planned_inputs,
)
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.machine import DriveState, Machine, Told
from hopdata.steering.live.watch import Watch
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.stances import DetectedStance, StanceDetector
from hopdata.steering.observation.tracking import HopperTracker, Observation
from hopdata.steering.strides import StrideAxes, at_rest


class Detector(Protocol):
    """Recognises stances in one height after the other."""

    def feed(self, time_s: float, height_m: float) -> DetectedStance | None:
        """Take the next frame; return the stance it reveals, if any."""
        ...


Observers: TypeAlias = Callable[[], tuple[HopperTracker, Detector]]


def observers_of(geometry: HopperGeometry, rate_hz: float) -> Observers:
    """Return a maker of tracker and stance detector.

    The boom marker comes after the body's.
    """
    names = (*geometry.body_names, str(geometry.boom_name))
    return lambda: (
        HopperTracker(geometry, names),
        StanceDetector(geometry, rate_hz=rate_hz),
    )


def checks_of(
    geometry: HopperGeometry, rate_hz: float, limits: Limits
) -> Callable[[], FrameChecks]:
    """Return a maker of the checks of frames that `observers_of` observes."""
    names = geometry.body_names
    if geometry.boom_name is not None:
        names = (*names, geometry.boom_name)
    return lambda: FrameChecks(limits, geometry, names, rate_hz)


LOOK_UP_S = 0.5  # longest wait for a frame before the loop looks whether it is to end
#: Most frames of a batch.
#: Unit: frames. Origin: chosen: some 20 ms of work.
MOST_AT_ONCE = 64
#: Largest difference between the camera's and our time between two frames for the
#: camera's clock to have gone on over a lost connection.
#: Unit: s. Origin: chosen.
SAME_CLOCK_S = 0.5
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

    Use it as a context manager, or with `start` and `close`. Without threads, on a
    clock of your own, call `step` when frames have come and `watch.look` every
    `hopdata.steering.live.watch.WATCH_S`, as `hopdata.steering.live.clocked` does.

    Parameters
    ----------
    buffer : FrameBuffer
        Source of the frames.
    observers : callable
        Returns a new tracker and a new stance detector; called when a camera clock
        begins.
    controller : Controller
    boom : Boom or Actuator
        What is commanded at each stance.
    axes : StrideAxes, optional
        States and inputs of the robot; by default the hopper's. No input beyond its
        limits there is sent.
    limits : Limits
    checks : callable, optional
        Returns new checks of frames; called with `observers`. By default they know
        neither geometry nor rate.
    machine : Machine, optional
        State machine of the drive. By default, it waits until it is armed; with
        `Machine(is_armed=True)` the first swing is sent at the first stance.
    on_decision : callable, optional
        Called with each decision, in the loop's thread.
    on_frames : callable, optional
        Called with each batch of frames, before it is processed, in the thread of the
        loop or of the watch.
    fault : callable, optional
        Returns another cause to bring the boom to rest, or None.
    stop : threading.Event, optional
        Set when the drive is over: the hopper left the arena or tips over, or the loop
        failed.
    clock : callable
        Returns the time, s, on the clock of `Frame.captured_s`.
    """

    def __init__(  # noqa: PLR0913 - its parts, and what may listen to it, by name
        self,
        buffer: FrameBuffer,
        observers: Observers,
        controller: Controller,
        boom: Driven,
        *,
        axes: StrideAxes | None = None,
        limits: Limits | None = None,
        checks: Callable[[], FrameChecks] | None = None,
        machine: Machine | None = None,
        on_decision: Callable[[Decision], None] | None = None,
        on_frames: Callable[[Sequence[Frame]], None] | None = None,
        fault: Callable[[], Message | None] = lambda: None,
        stop: threading.Event | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__("hopdata-control", self._run)
        self.limits = limits or Limits()
        self.axes = axes or HOPPER
        self._lower, self._upper = input_limits(self.axes, self.limits)
        self._at_rest: Numbers = tuple(at_rest(self.axes).tolist())
        self._unknown: Numbers = (math.nan,) * len(self._at_rest)
        # Whether each state is measured; others are known from what was sent.
        self._is_measured = tuple(not state.set_by for state in self.axes.states)
        self.counts = LoopCounts()
        self.last_failure = ""
        self._clock = clock
        self._fault = fault
        self._drive_is_over = stop or threading.Event()
        self.watch = Watch(
            boom,
            machine or Machine(),
            self._ask,
            clock,
            limits=self.limits,
            on_stop=self._drive_is_over.set,
            rest=self._at_rest,
            what=moved_part(self.axes),
        )
        self._buffer = buffer
        self._observers = observers
        self._controller = controller
        self._on_decision = on_decision
        self._on_frames = on_frames
        self._new_checks = checks or (lambda: FrameChecks(self.limits))
        self._tracker, self._detector = observers()
        self._checks = self._new_checks()
        self._decisions: list[Decision] = []
        # Frames are observed by the thread of the loop or, while that is planning, of
        # the watch. What follows is theirs while they hold the lock.
        self._observing = threading.RLock()
        self._seen = buffer.written
        # The last frame, and the newest measurements up to it.
        self._last: Frame | None = None
        self._pose = _Newest()
        # The last poses, with their camera times: a stance may have been at any.
        self._poses: deque[tuple[float, _Newest]] = deque(maxlen=POSES_KEPT)
        self._state = _Newest((math.nan,) * len(self.axes.states))
        # Stances that were seen and wait for a decision.
        self._undecided: list[_SeenStance] = []
        # Monotonic time of the last stance, and the states there.
        self._last_stance: tuple[float, Numbers] | None = None
        # Whether the controller was asked for a plan there.
        self._was_asked = False
        # The inputs sent there, NaN if that is not certain, and the rests up to it.
        self._sent_then = self._unknown
        self._rests_then = 0
        # The inputs that the robot has now, NaN if that is not certain.
        self._in_force = self._at_rest
        # Swings sent and measured, one after the other, that differ.
        self._wrong: list[tuple[float, float]] = []
        # A boom that gets nothing cannot be expected to follow.
        self._is_sending = not isinstance(boom, NoBoom | NoActuator)
        if not self.watch.machine.is_armed:
            self.watch.report("frames", Message("steering.no_frame_yet"))

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

    @property
    def state(self) -> DriveState:
        """State of the drive."""
        return self.watch.machine.state

    def arm(self) -> Message | None:
        """Arm the drive, as the operator does; return what forbids it, if anything.

        The first swing is sent at the next stance.
        """
        return self.watch.arm()

    def end(self, cause: Message) -> None:
        """Bring the boom to rest for good, at once."""
        self.watch.end(cause)

    def decisions(self) -> tuple[Decision, ...]:
        """Return all decisions so far."""
        return tuple(self._decisions)

    def _ask(self) -> dict[str, Message | None]:
        """Observe what has come, and return what else is wrong; for the watch."""
        # If the loop is observing, the watch does not wait for it.
        if self._observing.acquire(blocking=False):
            try:
                self._observe_new()
            finally:
                self._observing.release()
        return {"outside": self._fault()}

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                self._buffer.wait(self._seen, LOOK_UP_S, unless=self._is_awaited)
                self.step()
        except BaseException as error:
            self.end(Message("steering.loop_failed", {"error": repr(error)}))

    def _is_awaited(self) -> bool:
        return self._stop.is_set() or bool(self._undecided)

    def step(self) -> None:
        """Process the frames that have come, and plan at the last stance among them."""
        self._observe_new()
        self._decide_all()

    def take(self, frames: Sequence[Frame]) -> None:
        """Process frames as one batch, and plan at the last stance among them.

        Those in the buffer count as processed.
        """
        with self._observing:
            self._seen = self._buffer.written
            self._observe(frames)
        self._decide_all()

    # Observing.

    def _observe_new(self) -> None:
        """Observe the frames of the buffer that have not been observed."""
        if self._buffer.written == self._seen:
            return
        with self._observing:
            # A slow machine may have got far behind, and may be told to end.
            while self._buffer.written != self._seen and not self._stop.is_set():
                frames = self._buffer.since(self._seen)[:MOST_AT_ONCE]
                if not frames:
                    return
                self.counts.overrun += frames[0].index - self._seen
                self._seen = frames[-1].index + 1
                self._observe(frames)

    def _observe(self, frames: Sequence[Frame]) -> None:
        if not frames:
            return
        if self._on_frames is not None:
            self._on_frames(frames)
        is_stance_seen = False
        for frame in frames:
            stance = self._observed(frame)
            if stance is not None:
                # Later frames must not change what was known then.
                at_stance = self._pose_at(stance)
                seen = _SeenStance(stance, frame, at_stance, self._pose, self._state)
                self._undecided.append(seen)
                is_stance_seen = True
        newest = frames[-1].captured_s
        self.watch.expect(
            "frames", newest + self.limits.pose_age_s, self._no_frame_since(newest)
        )
        if is_stance_seen:
            self._buffer.wake()  # the loop may wait for the next frame

    def _no_frame_since(self, captured_s: float) -> Callable[[float], Message]:
        limit_s = self.limits.pose_age_s

        def why(now: float) -> Message:
            values = {"age_s": now - captured_s, "limit_s": limit_s}
            return Message("steering.no_frame", values)

        return why

    def _observed(self, frame: Frame) -> DetectedStance | None:
        """Process a frame, and return the stance it reveals, if any."""
        self.counts.frames += 1
        if self._last is not None and not _same_clock(self._last, frame):
            self._tracker, self._detector = self._observers()
            self._checks = self._new_checks()
            self._poses.clear()
        self._last = frame
        try:
            seen = self._tracker.feed(frame.time_s, frame.markers)
            findings = self._checks.feed(frame, seen)
            self._heed(findings)
            if not findings.is_usable:
                return self._detector.feed(frame.time_s, math.nan)
            pose = tuple(seen.pose.tolist())
            if math.isfinite(sum(pose)):
                self._pose = _Newest(pose, frame.captured_s)
                self._poses.append((frame.time_s, self._pose))
            self._note_state(seen, frame)
            return self._detector.feed(frame.time_s, seen.height_m)
        except Exception as error:
            self.counts.failed += 1
            self.last_failure = repr(error)
            self._heed(self._checks.failed(error))
            return None

    def _note_state(self, seen: Observation, frame: Frame) -> None:
        """Keep the states that a frame shows, if it shows all that are measured."""
        state = seen.state
        for is_measured, number in zip(self._is_measured, state, strict=True):
            if is_measured and not math.isfinite(number):
                return
        self._state = _Newest(state, frame.captured_s)

    def _pose_at(self, stance: DetectedStance) -> _Newest:
        """Return the pose of the frame nearest to a stance, for which models are made.

        When the stance is recognised, the hopper has moved on for two or three frames.
        """
        if not self._poses:
            return _Newest()
        return min(self._poses, key=lambda one: abs(one[0] - stance.time_s))[1]

    def _heed(self, findings: Findings) -> None:
        """Pass on what the checks have found in a frame."""
        lasting = self.watch.machine.lasting
        for source, cause in findings.lasting.items():
            if cause is not None or source in lasting:
                self.watch.report(source, cause)
        if findings.over is not None:
            self.end(findings.over)

    # Deciding.

    def _decide_all(self) -> None:
        """Decide at the stances that wait; only the last one is planned for."""
        while self._undecided:
            seen = self._undecided.pop(0)
            self._decide(seen, overtaken=bool(self._undecided))

    def _decide(self, seen: _SeenStance, *, overtaken: bool) -> None:
        """Decide at a stance, send the command, and log both."""
        self.watch.look()
        known = self._known_at(seen)
        self._compare(known)
        ages_s = {"pose": known.pose_age_s, **known.state_ages_s}
        stance_age_s = known.asked_s - known.stance_s
        outcome, reason = self._admitted(ages_s, stance_age_s, overtaken=overtaken)
        planned = self._unknown
        planning_s = math.nan
        command = self._at_rest if outcome == "held" else self._unknown
        is_asked = outcome == "planned"
        if is_asked:
            planned, failure = self._plan(known)
            planning_s = self._clock() - known.asked_s
            outcome, command, reason = self._permitted(planned, failure, known.stance_s)
        self._was_asked = is_asked
        self._in_force = self._inputs_in_force()
        self._sent_then = self._unknown
        self._rests_then = len(self.watch.rests)
        if math.isfinite(sum(command)):
            outcome, command, reason = self._sent(outcome, command, reason)
        sent_s = self._clock()
        pose = known.pose
        decision = Decision(
            stance_s=seen.stance.time_s,
            told_s=seen.frame.time_s,
            epoch=seen.frame.epoch,
            pose=pose if len(pose) == 3 else (math.nan,) * 3,
            state=known.state,
            previous=self._unknown if known.previous is None else known.previous,
            asked_s=known.asked_s,
            pose_age_s=known.pose_age_s,
            state_age_s=known.state_age_s,
            outcome=outcome,
            planned=planned,
            command=command,
            planning_s=planning_s,
            latency_s=sent_s - seen.frame.arrival_s,
            since_stance_s=sent_s - known.stance_s,
            reason=reason,
        )
        self._log(decision)

    def _known_at(self, seen: _SeenStance) -> _Known:
        """Return what is known at a stance now."""
        asked_s = self._clock()
        state_age_s = asked_s - seen.state.captured_s
        state = list(seen.state.values)
        ages_s = {}
        for k, axis in enumerate(self.axes.states):
            if axis.set_by:
                place = self.axes.input_names.index(axis.set_by)
                state[k] = self._inputs_in_force()[place]
            if math.isfinite(state[k]) or not axis.set_by:
                is_measured = not axis.set_by
                age_s = state_age_s if is_measured else 0.0
                ages_s[axis.name.replace("_", " ")] = age_s
            else:
                ages_s[axis.name.replace("_", " ")] = math.inf
        known = _Known(
            stance_s=seen.stance_s,
            asked_s=asked_s,
            pose=seen.pose_at_stance.values,
            pose_age_s=asked_s - seen.newest_pose.captured_s,
            state=tuple(state),
            state_age_s=state_age_s,
            state_ages_s=ages_s,
        )
        return replace(known, previous=self._advance_to(known))

    def _inputs_in_force(self) -> Numbers:
        """Return the inputs that the robot has; after a rest, those at rest."""
        if len(self.watch.rests) != self._rests_then:
            return self._at_rest
        return self._in_force

    def _sent(
        self, outcome: DecisionOutcome, command: Numbers, reason: Message | None
    ) -> tuple[DecisionOutcome, Numbers, Message | None]:
        """Send a command; return outcome, command and reason as they then are."""
        try:
            refused = self.watch.send(command)
        except Exception as error:
            values = {"what": self.watch.what, "error": repr(error)}
            failed = Message("steering.boom_failed", values)
            self.watch.fail("boom", failed)
            self._in_force = self._unknown
            return outcome, command, failed  # it may have begun to move
        if refused is not None:
            return "held", self._at_rest, reason or refused
        self._sent_then = command
        self._in_force = command
        return outcome, command, reason

    def _admitted(
        self, ages: Mapping[str, float], stance_age_s: float, *, overtaken: bool
    ) -> tuple[DecisionOutcome, Message | None]:
        """Tell the watch of a stance that can be planned for, and obey what it says.

        Return the outcome so far, "planned" if there is to be a plan, and otherwise the
        reason.
        """
        if overtaken:
            return "overtaken", Message("steering.overtaken")
        if self.watch.machine.may_swing:
            brief = self._brief_fault(ages, stance_age_s)
            if brief is not None:
                return "held", brief
        told = self.watch.stance()
        if told is Told.NOTHING:
            return "waiting", self.watch.cause or Message("steering.not_armed")
        if told is Told.REST:
            return "held", self.watch.cause
        return "planned", None

    def _brief_fault(
        self, ages: Mapping[str, float], stance_age_s: float
    ) -> Message | None:
        """Return why there is no plan at this stance, though the drive goes on."""
        if stance_age_s > self.limits.command_s:
            return Message("steering.stance_late", {"late_s": stance_age_s})
        limit_s = self.limits.pose_age_s
        for what, age_s in ages.items():
            if not math.isfinite(age_s):
                return Message("steering.none_yet", {"what": what})
            if age_s > limit_s:
                values = {"what": what, "age_s": age_s, "limit_s": limit_s}
                return Message("steering.stale", values)
        return None

    def _advance_to(self, known: _Known) -> Numbers | None:
        """Return the inputs of the stride that led to a stance, if they are known.

        The stance is then the last one. The inputs are measured if a state shows them:
        one that an input moves. Otherwise they are those that were sent.
        """
        before = self._last_stance
        is_fresh = known.state_age_s <= self.limits.pose_age_s
        state = known.state if is_fresh else (math.nan,) * len(known.state)
        self._last_stance = (known.stance_s, state)
        if before is None:
            return None
        before_s, before_state = before
        if known.stance_s - before_s > self.limits.hop_s:
            return None
        previous = list(self._inputs_in_force())
        for k, axis in enumerate(self.axes.states):
            if axis.moved_by:
                moved = float(state[k] - before_state[k])
                if self.axes.is_periodic[k]:
                    moved = float(wrapped(moved))
                previous[self.axes.input_names.index(axis.moved_by)] = moved
        return tuple(previous) if math.isfinite(sum(previous)) else None

    def _compare(self, known: _Known) -> None:
        """Compare the last stride's inputs with those sent; wrong ones end the drive.

        Only an angle that an input moves shows by how much it was moved.
        """
        moved_by = [axis.moved_by for axis in self.axes.periodic if axis.moved_by]
        if not self._is_sending or not moved_by:
            return
        place = self.axes.input_names.index(moved_by[0])
        sent = self._sent_then[place]
        is_certain = math.isfinite(sent) and len(self.watch.rests) == self._rests_then
        if known.previous is None or not is_certain:
            return
        swung = known.previous[place]
        if max(abs(sent), abs(swung)) < LEAST_SWING_RAD:
            return
        difference = abs(float(wrapped(swung - sent)))
        if difference <= max(LEAST_SWING_RAD, SWING_SHARE * abs(sent)):
            self._wrong = []
            return
        self._wrong = [*self._wrong, (sent, swung)]
        if len(self._wrong) >= self.limits.wrong_swings:
            self.end(_does_not_follow(self.watch.what, self._wrong))

    def _plan(self, known: _Known) -> tuple[Numbers, Message | None]:
        """Return the controller's inputs, or NaN and the error."""
        limit_s = self.limits.command_s
        late = Message("steering.plan_late", {"limit_s": limit_s})
        self.watch.expect("plan", known.stance_s + limit_s, lambda _: late)
        # A controller that learns compares the pose with that of its last plan: two
        # strides must not be taken for one.
        previous = known.previous if self._was_asked else None
        try:
            here = np.array(known.pose)
            inputs = planned_inputs(
                self._controller, self.axes, here, known.state, previous
            )
        except Exception as error:
            values = {"error": repr(error)}
            return self._unknown, Message("steering.controller_failed", values)
        finally:
            self.watch.met("plan")
        if len(inputs) != len(self._unknown):
            wrong = f"expected {len(self._unknown)} inputs, found {len(inputs)}"
            values = {"error": wrong}
            return self._unknown, Message("steering.controller_failed", values)
        for name, number in zip(self.axes.input_names, inputs, strict=True):
            if not math.isfinite(number):
                named = {"what": name.replace("_", " "), "swing": number}
                return self._unknown, Message("steering.no_number", named)
        return inputs, None

    def _permitted(
        self, planned: Numbers, failure: Message | None, stance_s: float
    ) -> tuple[DecisionOutcome, Numbers, Message | None]:
        """Return outcome and command for planned inputs, and why they differ."""
        late_s = self._clock() - stance_s
        if self._stop.is_set():
            return "held", self._at_rest, Message("steering.ended_meanwhile")
        if failure is None and late_s > self.limits.command_s:
            failure = Message("steering.plan_came_late", {"late_s": late_s})
        if failure is not None:
            self.watch.fail("plan", failure)
            return "held", self._at_rest, failure
        within = np.clip(planned, self._lower, self._upper)
        command: Numbers = tuple(within.tolist())
        if command != planned:
            return "cut", command, self._cut(planned, command)
        return "planned", planned, None

    def _cut(self, planned: Numbers, command: Numbers) -> Message:
        """Say which input was beyond its limits."""
        if is_hopper(self.axes):
            values = {"planned_rad": planned[0], "limit_rad": self.limits.swing_rad}
            return Message("steering.cut", values)
        both = zip(self.axes.inputs, planned, command, strict=True)
        cut = [(one, wanted, sent) for one, wanted, sent in both if wanted != sent]
        axis, wanted, sent = cut[0]
        named = {"input": axis.column, "planned": wanted, "limit": sent}
        return Message("steering.cut_input", named)

    def _log(self, decision: Decision) -> None:
        self._decisions.append(decision)
        if self._on_decision is not None:
            try:
                self._on_decision(decision)
            except Exception as error:
                self.last_failure = repr(error)


def input_limits(axes: StrideAxes, limits: Limits) -> tuple[FloatArray, FloatArray]:
    """Return the least and the largest inputs (U,) that are sent.

    The hopper's swing has the limit of the drive, and others those of their axes.
    """
    if is_hopper(axes):
        largest = np.array([limits.swing_rad])
        return -largest, largest
    return axes.lower, axes.upper


def _does_not_follow(what: str, wrong: Sequence[tuple[float, float]]) -> Message:
    """Say how swings that were measured differ from those sent."""
    pairs = ", ".join(
        f"{sent:+.2f} rad sent and {swung:+.2f} measured" for sent, swung in wrong
    )
    values = {"what": what, "how": _how_off(wrong), "pairs": pairs}
    return Message("steering.does_not_follow", values)


def _how_off(wrong: Sequence[tuple[float, float]]) -> Message:
    sent, swung = np.array(wrong).T
    if np.abs(sent).max() < LEAST_SWING_RAD:
        return Message("steering.moves_unbidden")
    gain = float(sent @ swung / (sent @ sent))
    if gain < -LEAST_GAIN:
        return Message("steering.other_way")
    if gain < LEAST_GAIN:
        return Message("steering.does_not_move")
    return Message("steering.moves_by", {"percent": 100 * gain})


class _Newest(NamedTuple):
    """A measurement, and its capture time on the monotonic clock, s."""

    values: tuple[float, ...] = (math.nan,)
    captured_s: float = -math.inf


@dataclass(frozen=True)
class _Known:
    """What is known at a stance: pose and states there, and how old they are, s."""

    stance_s: float  # on the monotonic clock
    asked_s: float
    pose: Numbers
    pose_age_s: float
    state: Numbers
    state_age_s: float
    state_ages_s: dict[str, float]  # by the name of each state
    previous: Numbers | None = None


@dataclass(frozen=True)
class _SeenStance:
    """A stance, the frame that revealed it, and the newest measurements up to it."""

    stance: DetectedStance
    frame: Frame
    pose_at_stance: _Newest  # of the frame nearest to it
    newest_pose: _Newest
    state: _Newest

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
