"""Simulated robots of any axes as cameras see them, frame by frame.

A stride begins at an apex. Its inputs count from `DECIDED_S` later, while the robot
still flies: up to then its path is the same for all inputs.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.errors import AnalysisError
from hopdata.steering.robots.interface import PathRobot, SimulatedRobot, Stance
from hopdata.steering.strides import at_rest
from hopdata.synthesis.camera import in_world

#: Time after the apex at which a stride takes its inputs.
#: Unit: s. Origin: chosen: the legs of both robots touch down later, after some 0.2 s.
DECIDED_S = 0.12
#: Markers on the body, in its axes.
#: Unit: m. Origin: chosen: four, none of which can take the place of another.
BODY_M = np.array(
    [[0.15, 0.02, 0.0], [-0.07, 0.12, 0.01], [-0.08, -0.13, -0.01], [0.01, -0.04, 0.05]]
)
LABELS = ("body1", "body2", "body3", "body4")
#: Longest stride whose frames are asked for.
#: Unit: s. Origin: chosen: the time after which a stride counts as a fall.
LONGEST_S = 3.0


class HeldInputs:
    """An actuator that keeps the newest inputs, and answers heartbeats.

    Attributes
    ----------
    inputs : (U,) array
        What the next stride is made with.
    sent : list of arrays
        All that was commanded.
    is_silent : bool
        Whether the robot answers no heartbeats, and takes no inputs.
    """

    def __init__(self, rest: FloatArray) -> None:
        self.inputs = rest
        self.sent: list[FloatArray] = []
        self.is_silent = False
        self._rest = rest
        self._beats = 0

    def command(self, inputs: FloatArray, /) -> None:
        """Keep inputs."""
        self.sent.append(inputs)
        if not self.is_silent:
            self.inputs = inputs

    def alive(self, number: int) -> None:
        """Take a heartbeat."""
        if not self.is_silent:
            self._beats = number

    def heard(self) -> int:
        """Return the highest number of a heartbeat that was answered."""
        return self._beats

    def silence(self) -> None:
        """Hear nothing any more; a robot then rests by itself."""
        self.is_silent = True
        self.inputs = self._rest


class SeenRobot:
    """Frames of a simulated robot's body; a `HoppingSource`.

    Parameters
    ----------
    robot : PathRobot
    actuator : HeldInputs
    pose : (3,)
        Pose at the release.
    seed : int or sequence of int
        Seed of what disturbs the strides and of the noise of the markers.
    rate_hz : float
        Frame rate, Hz.
    noise_m : float
        Standard deviation of the noise on each coordinate, m.

    Attributes
    ----------
    stances : list of Stance
        The true stances so far.
    """

    def __init__(
        self,
        robot: PathRobot,
        actuator: HeldInputs,
        *,
        pose: ArrayLike = (0.0, 0.0, 0.0),
        seed: int | Sequence[int] = 0,
        rate_hz: float = 100.0,
        noise_m: float = 6e-4,
    ) -> None:
        kicks, noise = np.random.SeedSequence(seed).spawn(2)
        self.rate_hz = rate_hz
        self.noise_m = noise_m
        self._robot = robot
        self._actuator = actuator
        self._kicks = np.random.default_rng(kicks)
        self._noise = np.random.default_rng(noise)
        self.stances: list[Stance] = [robot.release(pose)]
        self._flight: _Flight | None = None

    @property
    def apex_s(self) -> float:
        """Time at which the next frames can be known: an apex, or `DECIDED_S` later."""
        begun_s = self.stances[-1].time_s
        return begun_s if self._flight is None else begun_s + DECIDED_S

    def next_frames(self) -> list[tuple[float, FloatArray]]:
        """Go on to the decision, or from there to the next stance.

        Return time, s, and markers (M, 3), m, of the frames on the way.
        """
        if self._flight is None:
            self._flight = self._begun()
            is_first = self._flight.times_s < self.stances[-1].time_s + DECIDED_S
            return self._seen(self._flight, is_first)
        first = self._flight
        self._flight = None
        flown = self._flown(self._actuator.inputs, first.rng)
        begun_s = self.stances[-1].time_s
        is_first = flown.times_s < begun_s + DECIDED_S
        n_first = int(is_first.sum())
        # One that lands before the decision has landed with the inputs it had.
        is_same = np.allclose(flown.states[:n_first], first.states[:n_first], atol=1e-6)
        if not is_same or flown.end.time_s < begun_s + DECIDED_S:
            flown = first
            is_first = flown.times_s < begun_s + DECIDED_S
        self._kicks = flown.after
        self._land(flown.end)
        return self._seen(flown, ~is_first)

    def __iter__(self) -> Iterator[tuple[float, FloatArray]]:
        """Go on for ever: yield the time, s, and the markers (M, 3), m, of each frame.

        Inputs count for a stride if they are commanded before the first frame after its
        decision is asked for.
        """
        while True:
            yield from self.next_frames()

    def _begun(self) -> _Flight:
        return self._flown(self._actuator.inputs, self._kicks)

    def _flown(self, inputs: FloatArray, kicks: np.random.Generator) -> _Flight:
        """Return the next stride with these inputs; the kicks are not used up."""
        stance = self.stances[-1]
        first = int(np.ceil(stance.time_s * self.rate_hz - 1e-9))
        numbers = first + np.arange(int(LONGEST_S * self.rate_hz) - 1)
        times_s = numbers / self.rate_hz
        own = copy.deepcopy(kicks)
        axes = self._robot.axes
        within = np.clip(inputs, axes.lower, axes.upper)
        found = self._robot.path(stance, within, own, times_s - stance.time_s)
        end, states = _checked_path(found, times_s)
        n_frames = min(len(states), int(np.sum(times_s < end.time_s)))
        return _Flight(times_s[:n_frames], states[:n_frames], end, kicks, own)

    def _land(self, end: Stance) -> None:
        if end.fell:
            end = self._robot.release(self.stances[-1].pose)
            end = replace(end, time_s=self.stances[-1].time_s + LONGEST_S)
        self.stances.append(end)

    def _seen(
        self, flown: _Flight, which: np.ndarray[Any, np.dtype[np.bool_]]
    ) -> list[tuple[float, FloatArray]]:
        states = bodies(flown.states[which])
        markers = in_world(states, (BODY_M - BODY_M.mean(axis=0))[None])
        noise = self.noise_m * self._noise.standard_normal(markers.shape)
        return list(zip(flown.times_s[which].tolist(), markers + noise, strict=True))


def _checked_path(found: Any, times_s: FloatArray) -> tuple[Stance, FloatArray]:
    """Return what a robot's `path` gave, if cameras can see it.

    A fall may end it early.
    """
    is_pair = isinstance(found, tuple) and len(found) == 2
    if not is_pair or not isinstance(found[0], Stance):
        kind = type(found).__name__
        raise AnalysisError.at(
            "path", "the next Stance and the states on the way", kind
        )
    end, states = found
    n_frames = int(np.sum(times_s < end.time_s))
    shape = np.shape(states)
    has_rows = len(shape) == 2 and (end.fell or shape[0] >= n_frames)
    if not has_rows or shape[1] < 2:
        wanted = (
            f"states (K, N), with a row for each of the {n_frames} times before the "
            "next stance, and two columns or more"
        )
        raise AnalysisError.at("path", wanted, f"the shape {shape}")
    return end, np.asarray(states, dtype=float)


@dataclass(frozen=True)
class _Flight:
    """A stride: its frames, its end, and the source of its kicks before and after."""

    times_s: FloatArray
    states: FloatArray
    end: Stance
    rng: np.random.Generator
    after: np.random.Generator


def bodies(states: FloatArray) -> FloatArray:
    """Return place and attitude (K, 6) of bodies; a point mass keeps its heading."""
    if states.shape[1] >= 6 + 6:
        return states[:, :6]
    level = np.zeros((len(states), 6))
    level[:, 0] = states[:, 0]
    level[:, 2] = states[:, 1]
    return level


def released(robot: SimulatedRobot) -> HeldInputs:
    """Return an actuator for a simulated robot, at rest."""
    return HeldInputs(at_rest(robot.axes))
