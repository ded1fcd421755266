"""What happens in a trial, written down while the clock runs: frames, hops and contacts."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hopdata.scenes.boom import counterweight_places
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.synthesis.control_hops import pose_rate
from hopdata.synthesis.hops import Hop

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class Trial:
    """States at every frame, all hops, and all contacts, on one clock.

    Parameters
    ----------
    rate_hz : float
        Frame rate, Hz; frame k is at k / rate_hz.
    states : (N, 12) array
        State at each frame.
    boom : (N, 3) array
        Place of the counterweight at each frame, body frame, m.
    hops : tuple of Hop
        Hops that ended before the last frame, in order.
    hop_start_s : (L,) array
        Time of the apex at which each hop began, s.
    apex_s : (A,) array
        The same of every hop, also of one that was cut off, s.
    event_time, event_leg, event_down, event_state
        All contact events, (E,), (E,), (E,) and (E, 12), ordered in time.
    n_carries : int
        How often the operator carried the hopper back.
    """

    rate_hz: float
    states: FloatArray
    boom: FloatArray
    hops: tuple[Hop, ...]
    hop_start_s: FloatArray
    apex_s: FloatArray
    event_time: FloatArray
    event_leg: IntArray
    event_down: BoolArray
    event_state: FloatArray
    n_carries: int


class Tape:
    """Collects frames, hops and contact events while the clock runs."""

    def __init__(self, rate_hz: float) -> None:
        self.rate_hz, self.clock, self.n_frames = rate_hz, 0.0, 0
        self.states: list[FloatArray] = []
        self.boom: list[FloatArray] = []
        self.hops: list[Hop] = []
        self.starts: list[float] = []
        self.events: list[tuple[FloatArray, IntArray, BoolArray, FloatArray]] = []
        self.n_carries = 0

    def frames_within(self, duration_s: float) -> FloatArray:
        """Frame times still to come within this duration, counted from the clock, s."""
        last = math.ceil((self.clock + duration_s) * self.rate_hz)
        return np.maximum(np.arange(self.n_frames, last) / self.rate_hz - self.clock, 0.0)

    def add_frames(self, states: FloatArray, boom: FloatArray) -> None:
        """Keep the states and the places of the counterweight of the next frames."""
        self.states.append(states)
        self.boom.append(boom)
        self.n_frames += len(states)

    def add_hop(self, hop: Hop) -> None:
        """Keep a hop that began at the clock, and set the clock to its end."""
        self.add_frames(hop.states, hop.boom)
        self.hops.append(hop)
        self.starts.append(self.clock)
        at = self.clock + hop.event_time
        self.events.append((at, hop.event_leg, hop.event_down, hop.event_state))
        self.clock += hop.end_time_s

    def lift(self, legs: IntArray, state: FloatArray) -> None:
        """Log that the operator takes these legs off the floor now."""
        when, up = np.full(len(legs), self.clock), np.zeros(len(legs), dtype=bool)
        self.events.append((when, legs, up, np.tile(state, (len(legs), 1))))

    def carry(
        self, hop: Hop, release: FloatArray, carry_s: float, parameters: HopperParameters
    ) -> None:
        """Log the operator's handling after a hop; the counterweight stays where it is."""
        frames = self.frames_within(carry_s)
        boom = counterweight_places(frames, replace(parameters, boom_swing_rad=0.0).vector())
        self.lift(hop.legs_down(), hop.end_state)
        self.add_frames(carried(hop.end_state, release, carry_s, frames), boom)
        self.clock += carry_s
        self.n_carries += 1

    def trial(self, duration_s: float) -> Trial:
        """Return what is on the tape, cut at this time."""
        time, leg, down, state = (np.concatenate(part) for part in zip(*self.events, strict=True))
        frames = min(self.n_frames, math.ceil(min(self.clock, duration_s) * self.rate_hz))
        ends = np.array(self.starts) + [hop.end_time_s for hop in self.hops]
        n_whole = int(np.sum(ends <= duration_s))
        return Trial(
            rate_hz=self.rate_hz,
            states=np.concatenate(self.states)[:frames],
            boom=np.concatenate(self.boom)[:frames],
            hops=tuple(self.hops[:n_whole]),
            hop_start_s=np.array(self.starts[:n_whole]),
            apex_s=np.array(self.starts),
            event_time=time,
            event_leg=leg,
            event_down=down,
            event_state=state,
            n_carries=self.n_carries,
        )


def carried(
    state: FloatArray, release: FloatArray, duration_s: float, times_s: FloatArray
) -> FloatArray:
    """States, (K, 12), of a body moved by hand: cubic in each coordinate, with no jump in speed.

    It starts with the motion of `state` and ends with that of `release`; `times_s` (K,) count from
    the start. The angular velocity of these states is not used by anybody and left at zero.
    """
    s = np.clip(times_s / duration_s, 0.0, 1.0)[:, None]
    start, end = state[:6], release[:6]
    leaving, arriving = pose_rate(state), pose_rate(release)
    blend = s * s * (3.0 - 2.0 * s)
    slide, brake = s * (1.0 - s) ** 2 * duration_s, s * s * (s - 1.0) * duration_s
    states = np.zeros((len(s), 12))
    states[:, :6] = start + (end - start) * blend + leaving * slide + arriving * brake
    speed = (end - start) * 6.0 * s * (1.0 - s) / duration_s
    speed += leaving * (1.0 - s) * (1.0 - 3.0 * s) + arriving * s * (3.0 * s - 2.0)
    states[:, 6:9] = speed[:, :3]
    return states
