"""The simulated hopper in place of a robot: it takes swings and returns markers."""

import asyncio
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.steering.live.buffer import CAPACITY, Frame, Stream
from hopdata.steering.robot import (
    Apex,
    Board,
    HopperStance,
    SteeredHop,
    SteeredHopper,
    released,
    steer_hop,
)


@dataclass(frozen=True)
class TrueHop:
    """A true hop: its start, s, the swing executed in its flight, rad, and its stance.

    After a fall, an operator releases the hopper again where it was.
    """

    start_s: float
    swing_rad: float
    stance: HopperStance


# What cameras show of the true markers (K, M, 3) of K frames, m, given their times, s.
View: TypeAlias = Callable[[FloatArray, FloatArray], FloatArray]


class SimulatedHopper:
    """A hopper whose hops are integrated one by one, when they are asked for.

    The swing of a flight is the last one commanded before the apex at which the flight
    begins, or 0 if there was none since the previous apex.

    Parameters
    ----------
    robot : SteeredHopper
    swings : callable
        Returns the last swing commanded since the last call, rad, or None; must not
        block.
    view : callable
        What the cameras show.
    kicks : numpy Generator
        Source of the random kicks.
    pose : (3,)
        Pose at the release, m and rad.
    boom_angle_rad : float
    rate_hz : float
        Frame rate, Hz.
    board : Board, optional
        Board in the way.

    Attributes
    ----------
    last : SteeredHop or None
        The last hop.
    board : Board or None
        The board where it is now.
    rtol : float or None
        Relative tolerance of the integrator, None for its own.
    """

    def __init__(
        self,
        robot: SteeredHopper,
        swings: Callable[[], float | None],
        view: View,
        kicks: np.random.Generator,
        *,
        pose: ArrayLike,
        boom_angle_rad: float,
        rate_hz: float,
        board: Board | None = None,
    ) -> None:
        self.robot = robot
        self.rate_hz = rate_hz
        self.last: SteeredHop | None = None
        self.board = board
        self.rtol: float | None = None
        self._swings = swings
        self._view = view
        self._kicks = kicks
        self._apex = released(robot, pose, boom_angle_rad)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the markers, in the order of the frames."""
        n_body = len(self.robot.markers.body_m)
        return (*(f"body{k + 1}" for k in range(n_body)), "boom")

    @property
    def apex_s(self) -> float:
        """Time of the apex at which the next hop begins, s."""
        return self._apex.time_s

    def next_frames(self) -> list[tuple[float, FloatArray]]:
        """Make the next hop; return time, s, and markers (M, 3), m, of its frames."""
        hop = self._next_hop(self._swings() or 0.0)
        seen = self._view(hop.frame_time_s, hop.markers)
        return list(zip(hop.frame_time_s.tolist(), seen, strict=True))

    def _next_hop(self, swing_rad: float) -> SteeredHop:
        hop = steer_hop(
            self.robot,
            self._apex,
            swing_rad,
            rng=self._kicks,
            rate_hz=self.rate_hz,
            board=self.board,
            rtol=self.rtol,
        )
        if self.board is not None:
            self.board = self.board.pushed(hop)
        self.last = hop
        self._apex = hop.end
        return hop


class LiveHopper(SimulatedHopper):
    """A source of frames that hops for ever: after a fall it is released again.

    Driven in real time, it is at most one hop ahead of the clock.

    Parameters
    ----------
    robot, swings
        As in `SimulatedHopper`.
    pose : (3,)
        Pose at the release, m and rad.
    boom_angle_rad : float
    rate_hz : float
        Frame rate, Hz.
    noise_m : float
        Standard deviation of the noise on each coordinate, m.
    seed : int or sequence of int
        Seed of kicks and noise.
    """

    def __init__(
        self,
        robot: SteeredHopper,
        swings: Callable[[], float | None],
        *,
        pose: ArrayLike = (0.0, 0.0, 0.0),
        boom_angle_rad: float = np.pi,
        rate_hz: float = 100.0,
        noise_m: float = 0.0006,
        seed: int | Sequence[int] = 0,
    ) -> None:
        kicks, noise = np.random.SeedSequence(seed).spawn(2)
        super().__init__(
            robot,
            swings,
            self._noisy,
            np.random.default_rng(kicks),
            pose=pose,
            boom_angle_rad=boom_angle_rad,
            rate_hz=rate_hz,
        )
        self.noise_m = noise_m
        self.hops: list[TrueHop] = []
        self._noise = np.random.default_rng(noise)
        # Compile beforehand, so that the first hop is in time.
        steer_hop(robot.still(), self._apex, 0.0, rng=np.random.default_rng(0))

    def __iter__(self) -> Iterator[tuple[float, FloatArray]]:
        """Hop for ever: yield the time, s, and the markers (M, 3), m, of each frame."""
        while True:
            yield from self.next_frames()

    def _noisy(self, _: FloatArray, markers: FloatArray) -> FloatArray:
        noise = self.noise_m * self._noise.standard_normal(markers.shape)
        return np.asarray(markers + noise)

    def _next_hop(self, swing_rad: float) -> SteeredHop:
        hop = super()._next_hop(swing_rad)
        self.hops.append(TrueHop(hop.start.time_s, hop.swing_rad, hop.stance))
        if hop.stance.fell:
            self._apex = self._put_up(hop)
        return hop

    def _put_up(self, hop: SteeredHop) -> Apex:
        """Release the hopper again where it was before it fell."""
        anew = released(self.robot, hop.start.state[[0, 1, 3]], hop.end.boom_angle_rad)
        return replace(anew, time_s=hop.end.time_s)


class SimulatedBoom:
    """Keeps the newest swing until its flight begins."""

    def __init__(self) -> None:
        self._swing: float | None = None

    def swing(self, rad: float) -> None:
        """Replace the last swing."""
        self._swing = rad

    @property
    def waiting_rad(self) -> float:
        """Swing of the next flight as it stands now, rad; 0 if none was received."""
        return self._swing or 0.0

    def newest(self) -> float | None:
        """Return the swing received since the last call, rad, or None."""
        swing = self._swing
        self._swing = None
        return swing


class SimulatedStream(Stream):
    """Streams a robot in real time; the loop uses it like a `MarkerStream`.

    Parameters
    ----------
    hopper : iterable of (float, (M, 3) array)
        Yields time, s, and markers of each frame, as a `LiveHopper` and a `SeenRobot`.
    speed : float
        Speed relative to real time.

    Attributes
    ----------
    source : iterable
        The robot.
    """

    def __init__(
        self, hopper: Iterable[tuple[float, FloatArray]], *, speed: float = 1.0
    ) -> None:
        super().__init__("hopdata-simulated", self._hop, CAPACITY)
        self.source = hopper
        self._speed = speed

    async def _hop(self) -> None:
        begun = time.monotonic()
        try:
            for number, (time_s, markers) in enumerate(self.source):
                due = begun + time_s / self._speed
                await asyncio.sleep(max(0.0, due - time.monotonic()))
                now = time.monotonic()
                self.counts.frames += 1
                if number == 0:
                    self.states.report("streaming")
                self.buffer.write(Frame(0, number, time_s, now, due, markers))
        except Exception as error:
            self.states.report("lost", f"the simulation failed: {error!r}")
