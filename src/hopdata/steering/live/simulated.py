"""The simulated hopper in place of a robot: it takes swings and returns markers."""

import asyncio
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.steering.live.buffer import Frame, Stream
from hopdata.steering.robot import (
    Apex,
    Stance,
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
    stance: Stance


class LiveHopper:
    """A source of frames: a hopper whose hops are integrated when they are asked for.

    Driven in real time, it is thus at most one hop ahead of the clock. The swing of a
    flight is the last one commanded before the apex at which the flight begins, or 0 if
    there was none since the previous apex.

    Parameters
    ----------
    robot : SteeredHopper
    swings : callable
        Returns the last swing commanded since the last call, rad, or None; must not
        block.
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
        self.robot = robot
        self.rate_hz = rate_hz
        self.noise_m = noise_m
        self.hops: list[TrueHop] = []
        self._swings = swings
        self._apex = released(robot, pose, boom_angle_rad)
        kicks, noise = np.random.SeedSequence(seed).spawn(2)
        self._kicks = np.random.default_rng(kicks)
        self._noise = np.random.default_rng(noise)
        # Compile beforehand, so that the first hop is in time.
        steer_hop(robot.still(), self._apex, 0.0, rng=np.random.default_rng(0))

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the markers, in the order of the frames."""
        n_body = len(self.robot.markers.body_m)
        return (*(f"body{k + 1}" for k in range(n_body)), "boom")

    def __iter__(self) -> Iterator[tuple[float, FloatArray]]:
        """Hop for ever: yield the time, s, and the markers (M, 3), m, of each frame."""
        while True:
            hop = self._next_hop()
            for time_s, markers in zip(hop.frame_time_s, hop.markers, strict=True):
                noise = self.noise_m * self._noise.standard_normal(markers.shape)
                yield float(time_s), markers + noise

    def _next_hop(self) -> SteeredHop:
        swing = self._swings() or 0.0
        hop = steer_hop(
            self.robot, self._apex, swing, rng=self._kicks, rate_hz=self.rate_hz
        )
        self.hops.append(TrueHop(hop.start.time_s, hop.swing_rad, hop.stance))
        self._apex = self._put_up(hop) if hop.stance.fell else hop.end
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

    def newest(self) -> float | None:
        """Return the swing received since the last call, rad, or None."""
        swing = self._swing
        self._swing = None
        return swing


class SimulatedStream(Stream):
    """Streams a hopper in real time; the loop uses it like a `MarkerStream`.

    Parameters
    ----------
    hopper : LiveHopper
    speed : float
        Speed relative to real time.
    """

    def __init__(self, hopper: LiveHopper, *, speed: float = 1.0) -> None:
        super().__init__("hopdata-simulated", self._hop, 4096)
        self._hopper = hopper
        self._speed = speed

    async def _hop(self) -> None:
        begun = time.monotonic()
        try:
            for number, (time_s, markers) in enumerate(self._hopper):
                due = begun + time_s / self._speed
                await asyncio.sleep(max(0.0, due - time.monotonic()))
                now = time.monotonic()
                self.counts.frames += 1
                if number == 0:
                    self.states.report("streaming")
                self.buffer.write(Frame(0, number, time_s, now, due, markers))
        except Exception as error:
            self.states.report("lost", f"the simulation failed: {error!r}")
