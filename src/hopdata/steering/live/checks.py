"""What is wrong with the frames that come: markers, coordinates, units and rate.

The checks keep what they need of earlier frames, and nothing else: they know neither
threads nor the state of the drive.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TypeAlias

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.messages import Message
from hopdata.rigid import wrapped
from hopdata.steering.live.buffer import Frame
from hopdata.steering.live.limits import Limits
from hopdata.steering.live.packets import RATE_SLACK
from hopdata.steering.observation.geometry import HopperGeometry
from hopdata.steering.observation.tracking import (
    KNOWN,
    MISFIT,
    MISFIT_NOISES,
    SEEN,
    Observation,
    observe_frame,
)

#: Frames in a row that cannot be used, or whose coordinates are those of the frame
#: before, after which that is a fault.
#: Unit: frames. Origin: chosen: 20 ms at 100 Hz from the first to the third.
IN_A_ROW = 3
#: Noise of a coordinate above which two frames are never the same to the bit.
#: Unit: m. Origin: derived: single precision resolves 1e-6 m at 10 m, in mm.
LEAST_NOISE_M = 1e-6
#: Travel of the mean marker within `MOVED_S` above which a robot moves.
#: Unit: m. Origin: chosen: a hop moves it by ten times this in half that time.
MOVED_M = 0.005
#: Time before frozen coordinates in which the robot is looked at for motion.
#: Unit: s. Origin: chosen.
MOVED_S = 0.1
#: Frames over which the rate is measured.
#: Unit: frames. Origin: chosen.
RATE_FRAMES = 20
#: Time between two looks for what is wrong with markers that do not fit.
#: Unit: s. Origin: chosen: one look takes some ms.
DIAGNOSED_S = 0.1
#: Age of a pose with which one is compared that could be the next.
#: Unit: s. Origin: chosen.
RECENT_S = 0.5
#: Distance that counts as much as a turn of one radian, in that comparison.
#: Unit: m. Origin: chosen: the size of the robot.
TURN_M = 0.3
#: Factor between the units that are mistaken for each other, m and mm.
#: Unit: 1. Origin: convention.
MILLI = 1000.0


@dataclass(frozen=True)
class Findings:
    """What the checks found in a frame.

    Parameters
    ----------
    is_usable : bool
        Whether the frame may be used for a pose.
    lasting : dict
        Cause by source of each check; None where nothing is wrong.
    over : Message or None
        Why the drive must end.
    """

    is_usable: bool
    lasting: dict[str, Message | None]
    over: Message | None = None


class _Frozen:
    """Counts frames whose coordinates are all those of the frame before.

    Noise makes that impossible. Without noise, as in a simulation, a robot that stands
    shows the same coordinates for ever, so there it must have moved just before.
    """

    def __init__(self) -> None:
        self._last: bytes | None = None
        self._since_s = 0.0
        self._repeats = 0
        self._has_moved = False
        # Camera time and mean marker of the last frames that differed.
        self._path: deque[tuple[float, FloatArray]] = deque()

    def feed(self, frame: Frame, *, is_noisy: bool) -> Message | None:
        """Take a frame; return the cause once `IN_A_ROW` of them are the same."""
        coordinates = frame.markers.tobytes()
        is_same = coordinates == self._last
        self._last = coordinates
        if not (is_same and np.isfinite(frame.markers).any()):
            self._repeats = 0
            self._since_s = frame.time_s
            if not is_noisy:
                self._note(frame)
            return None
        self._repeats += 1
        if self._repeats < IN_A_ROW or not (is_noisy or self._has_moved):
            return None
        for_s = frame.time_s - self._since_s
        values = {"frames": self._repeats, "for_s": for_s}
        return Message("steering.markers_frozen", values)

    @property
    def is_repeat(self) -> bool:
        """Whether the last frame had the coordinates of the one before."""
        return self._repeats > 0

    def _note(self, frame: Frame) -> None:
        seen = frame.markers[np.isfinite(frame.markers).all(axis=1)]
        path = self._path
        while path and not 0 <= frame.time_s - path[0][0] <= MOVED_S:
            path.popleft()
        if len(seen) == len(frame.markers):
            path.append((frame.time_s, seen.mean(axis=0)))
        self._has_moved = False
        if path:
            away_m = np.linalg.norm(path[-1][1] - path[0][1])
            self._has_moved = bool(away_m > MOVED_M)


@dataclass
class FrameChecks:
    """Checks each frame, with what is seen in it.

    Parameters
    ----------
    limits : Limits
    geometry : HopperGeometry, optional
        The robot's; without it, markers that do not fit are not looked at more closely.
    names : sequence of str
        Names of the markers of a frame, in order.
    rate_hz : float, optional
        Expected frame rate; without it, any rate is right.
    """

    limits: Limits
    geometry: HopperGeometry | None = None
    names: Sequence[str] = ()
    rate_hz: float | None = None
    _unusable: int = field(default=0, init=False)
    _why: Message | None = field(default=None, init=False)
    _why_s: float = field(default=-math.inf, init=False)
    _lacking: dict[str, float] = field(default_factory=dict, init=False)
    _frozen: _Frozen = field(default_factory=_Frozen, init=False)
    _recent: deque[tuple[int, float]] = field(
        default_factory=lambda: deque(maxlen=RATE_FRAMES), init=False
    )
    # Camera time, pose and boom angle of the last frame that was used.
    _good: tuple[float, FloatArray, float] | None = field(default=None, init=False)

    def feed(self, frame: Frame, seen: Observation) -> Findings:
        """Check a frame."""
        tilt = _tilt(seen)
        is_tilted = tilt > self.limits.tilt_rad
        pose = seen.pose.tolist()
        is_off = seen.status in KNOWN and self._is_boom_off(frame, seen)
        why: Message | None = None
        if seen.status == MISFIT:
            why = self._diagnosed(frame) or self._misfit(seen)
        elif is_tilted or is_off:
            # A body that lies flat looks turned over if two of its markers are
            # exchanged, or all are mirrored.
            why = self._diagnosed(frame)
        over = None
        if why is None:
            self._why_s = -math.inf
            over = self._over(pose, tilt if is_tilted else 0.0)
        is_noisy = self._is_noisy
        frozen = self._frozen.feed(frame, is_noisy=is_noisy)
        # Coordinates that are repeated to the bit are no measurement: a height that
        # stands still would shift the stance.
        is_usable = why is None and not (is_noisy and self._frozen.is_repeat)
        if is_usable and math.isfinite(sum(pose)):
            self._good = (frame.time_s, seen.pose, seen.boom_angle_rad)
        lasting = {
            "fit": self._in_a_row(why),
            "markers": self._unseen(frame, seen),
            "frozen": frozen,
            "rate": self._rate_cause(frame),
        }
        return Findings(is_usable, lasting, over)

    def failed(self, error: Exception) -> Findings:
        """Take a frame whose observation failed."""
        cause = Message("steering.not_understood", {"error": repr(error)})
        return Findings(False, {"fit": self._in_a_row(cause)})

    def _in_a_row(self, why: Message | None) -> Message | None:
        self._unusable = 0 if why is None else self._unusable + 1
        return why if self._unusable >= IN_A_ROW else None

    def _is_boom_off(self, frame: Frame, seen: Observation) -> bool:
        """Return whether the boom's marker is seen where it cannot be."""
        if not math.isnan(seen.boom_angle_rad):
            return False
        if self.geometry is None or self.geometry.boom_name is None:
            return False
        place = self.geometry.boom_place(self.names)
        return bool(np.isfinite(frame.markers[place]).all())

    def _over(self, pose: Sequence[float], tilt_rad: float) -> Message | None:
        """Return why the drive must end: the robot has left the arena, or tips over."""
        away_m = math.hypot(pose[0], pose[1])
        limit_m = self.limits.fence_m
        if away_m > limit_m:
            values = {"away_m": away_m, "limit_m": limit_m}
            return Message("steering.left_arena", values)
        if tilt_rad > 0:
            return Message("steering.tips_over", {"tilt_deg": math.degrees(tilt_rad)})
        return None

    def _unseen(self, frame: Frame, seen: Observation) -> Message | None:
        """Return a cause if needed markers are unseen for `Limits.pose_age_s`."""
        before = self._lacking
        if not before and not seen.lacking:
            return None
        at_s = frame.captured_s
        self._lacking = {what: before.get(what, at_s) for what in seen.lacking}
        too_long = {}
        for what, since_s in self._lacking.items():
            if at_s - since_s > self.limits.pose_age_s:
                too_long[what] = at_s - since_s
        if not too_long:
            return None
        values = {"which": "; ".join(too_long), "for_s": max(too_long.values())}
        return Message("steering.markers_unseen", values)

    @property
    def _is_noisy(self) -> bool:
        """Whether the coordinates of two frames always differ."""
        return self.geometry is not None and self.geometry.noise_m > LEAST_NOISE_M

    def _rate_cause(self, frame: Frame) -> Message | None:
        """Return a cause if numbers and times of the last frames tell another rate."""
        self._recent.append((frame.number, frame.time_s))
        first = self._recent[0]
        span_s = frame.time_s - first[1]
        if self.rate_hz is None or len(self._recent) < RATE_FRAMES or span_s <= 0:
            return None
        found_hz = (frame.number - first[0]) / span_s
        if abs(found_hz - self.rate_hz) <= RATE_SLACK * self.rate_hz:
            return None
        values = {"found_hz": found_hz, "expected_hz": self.rate_hz}
        return Message("steering.other_rate", values)

    # Markers that do not fit.

    def _misfit(self, seen: Observation) -> Message:
        noise_m = math.nan if self.geometry is None else self.geometry.noise_m
        values = {
            "residual_mm": 1e3 * seen.residual_m,
            "limit_mm": 1e3 * MISFIT_NOISES * noise_m,
        }
        return Message("steering.markers_misfit", values)

    def _diagnosed(self, frame: Frame) -> Message | None:
        """Return in which way the markers are mixed up; None if in no known way."""
        if self.geometry is None:
            return None
        if abs(frame.time_s - self._why_s) < DIAGNOSED_S:
            return self._why
        found = []
        for cause, put_right in _mix_ups(self.names):
            seen = self._seen_in(put_right(frame.markers))
            if seen is not None:
                found.append((self._jump(frame.time_s, seen), cause))
        self._why = min(found, key=lambda one: one[0])[1] if found else None
        self._why_s = frame.time_s
        return self._why

    def _seen_in(self, markers: FloatArray) -> Observation | None:
        """Observe markers; None if they are not those of a robot that stands."""
        geometry = self.geometry
        assert geometry is not None
        place = geometry.boom_place(self.names)
        boom = None if place is None else markers[place]
        seen = observe_frame(geometry, markers[geometry.body_places(self.names)], boom)
        is_whole = boom is None or np.isnan(boom).any()
        if not is_whole:
            is_whole = math.isfinite(seen.boom_angle_rad)
        if seen.status != SEEN or not is_whole:
            return None
        if _tilt(seen) > self.limits.tilt_rad or seen.height_m < 0:
            return None
        return seen

    def _jump(self, time_s: float, seen: Observation) -> float:
        """Return how far a pose is from the last one, m; 0 if that is not recent."""
        if self._good is None or abs(time_s - self._good[0]) > RECENT_S:
            return 0.0
        _, pose, boom_rad = self._good
        turns = [seen.pose[2] - pose[2]]
        if math.isfinite(boom_rad) and math.isfinite(seen.boom_angle_rad):
            turns.append(seen.boom_angle_rad - boom_rad)
        away_m = math.hypot(*(seen.pose[:2] - pose[:2]))
        return away_m + TURN_M * float(np.abs(wrapped(np.array(turns))).sum())


def _tilt(seen: Observation) -> float:
    """Return by how much the body leans, rad; 0 if unknown."""
    upright = seen.rotation.item(2, 2)
    if math.isnan(upright):
        return 0.0
    return math.acos(max(-1.0, min(1.0, upright)))


Change: TypeAlias = Callable[[FloatArray], FloatArray]


def _mix_ups(names: Sequence[str]) -> Iterator[tuple[Message, Change]]:
    """Yield each way in which markers may be mixed up, and what puts them right."""
    for first, second in itertools.combinations(range(len(names)), 2):
        order = np.arange(len(names))
        order[[first, second]] = [second, first]
        pair = {"first": names[first], "second": names[second]}
        exchanged = Message("steering.markers_exchanged", pair)
        yield exchanged, partial(np.take, indices=order, axis=0)
    for index, axis in enumerate("xyz"):
        signs = np.ones(3)
        signs[index] = -1.0
        mirrored = Message("steering.markers_mirrored", {"axis": axis})
        yield mirrored, partial(np.multiply, signs)
    for factor, unit in ((MILLI, "mm, not m"), (1 / MILLI, "m, not mm")):
        values = {"factor": factor, "unit": unit}
        scaled = Message("steering.markers_scaled", values)
        yield scaled, partial(np.multiply, 1 / factor)
