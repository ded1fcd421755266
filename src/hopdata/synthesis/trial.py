"""Trials: hop after hop, each kicked at its apex, with an operator who carries it back.

The operator acts where the body leaves the arena or falls.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, TypeVar

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.errors import told_call
from hopdata.scenes.body import N_STATES
from hopdata.scenes.scene import Control, Scene
from hopdata.synthesis.hops import (
    Hop,
    control_hop,
    fly_hop,
    level_state,
    pose_rate,
    rest_foot,
    smooth_step,
)

# Options of a synthetic recording, as in the configuration.

Options = TypeVar("Options")
Point = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Kicks:
    """Random disturbance at each apex.

    Each value is normal with mean zero and this deviation.

    Parameters
    ----------
    velocity_m_s : float
        Added to each component of the velocity.
    angular_velocity_rad_s : float
        Added to each component of the angular velocity.
    preload_fraction : float
        Relative change of each leg's preload, drawn anew for every hop.
    """

    velocity_m_s: float = 0.05
    angular_velocity_rad_s: float = 0.25
    preload_fraction: float = 0.05


@dataclass(frozen=True, kw_only=True)
class Operator:
    """The person who releases the body and carries it back if it strays or falls.

    Parameters
    ----------
    release_height_m : float
        Height of the feet above the floor at release, at rest and level.
    release_spread_m : float
        Largest distance of the release from the centre, in x and in y.
    arena_m : float
        It is carried back at the first apex further than this from the centre, in x or
        y.
    carry_s : float
        Duration of carrying.
    hop_limit_s : float
        Time without an apex after which it counts as fallen.
    """

    release_height_m: float = 0.24
    release_spread_m: float = 0.1
    arena_m: float = 0.9
    carry_s: float = 1.5
    hop_limit_s: float = 3.0


@dataclass(frozen=True, kw_only=True)
class FloorOptions:
    """Curvature of the measured floor: a bowl and waves of random direction and phase.

    Parameters
    ----------
    bowl_depth_m, bowl_radius_m : float
        Rise of the bowl far from the centre, and the distance at which it reaches half
        of that.
    waves : int
        Number of waves.
    wave_amplitude_m, wave_length_m : float
        Amplitude of each wave, and the shortest wave length; the longest is 1.5 times
        as long.
    """

    bowl_depth_m: float = 0.004
    bowl_radius_m: float = 1.2
    waves: int = 3
    wave_amplitude_m: float = 0.001
    wave_length_m: float = 2.4


@dataclass(frozen=True, kw_only=True)
class GapOptions:
    """Drop-outs: stretches of frames in which a marker is not seen.

    Parameters
    ----------
    rate_per_min : float
        Mean number of drop-outs of each marker per minute; 0 for none.
    mean_s : float
        Mean length of a drop-out (geometric distribution, at least one frame).
    """

    rate_per_min: float = 0.0
    mean_s: float = 0.08


@dataclass(frozen=True, kw_only=True)
class MarkerOptions:
    """Places of the markers, and how fast a leg retracts after lift-off.

    Parameters
    ----------
    body_m : tuple of (x, y, z)
        Body markers, body frame.
    boom_m : (x, y, z)
        Boom marker relative to the end of the boom, body axes.
    retraction_s : float
        Time in which a leg extended at lift-off returns to its rest length.
    """

    body_m: tuple[Point, ...] = (
        (0.13, 0.03, 0.05),
        (-0.08, 0.11, 0.075),
        (-0.07, -0.14, 0.055),
    )
    boom_m: Point = (0.0, 0.0, 0.0)
    retraction_s: float = 0.15


def from_mapping(kind: type[Options], values: Mapping[str, Any] | None) -> Options:
    """Build options, nested ones too, from a mapping; missing ones are default.

    Raises
    ------
    ArgumentError
        If a key is not a field of `kind`.
    """
    options: Any = kind
    known: dict[str, Any] = {one.name: one.default_factory for one in fields(options)}
    built = {}
    for key, value in (values or {}).items():
        if is_dataclass(known.get(key)):
            built[key] = from_mapping(known[key], value)
        else:
            built[key] = _frozen(value)
    return told_call(kind)(**built)


def _frozen(value: Any) -> Any:
    """Return a value with tuples in place of lists, at any depth."""
    if isinstance(value, list | tuple):
        return tuple(_frozen(one) for one in value)
    return value


# Record of a trial while the clock runs: frames, hops and contacts.


@dataclass(frozen=True)
class Trial:
    """States in every frame, all hops and all contacts of a trial, on one clock.

    Parameters
    ----------
    rate_hz : float
        Frame rate, Hz; frame k is at k / rate_hz.
    states : (N, 12) array
        State in each frame.
    boom : (N, 3) array
        Place of the boom in each frame, body frame, m; (N, 0) without one.
    hops : tuple of Hop
        Hops that ended before the last frame, in order.
    hop_start_s : (L,) array
        Time of the apex at which each hop began, s.
    apex_s : (A,) array
        Start times of all hops, including one that was cut off, s.
    event_time, event_leg, event_down, event_state
        All contact events, (E,), (E,), (E,) and (E, 12), in order of time.
    n_carries : int
        Number of times the operator carried the hopper back.
    longer_m : (A, n) array
        How much longer than usual each leg is in every hop, m.
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
    longer_m: FloatArray


class Tape:
    """Collects frames, hops and contact events while the clock runs."""

    def __init__(self, rate_hz: float) -> None:
        self.rate_hz = rate_hz
        self.clock = 0.0
        self.n_frames = 0
        # States and places of the boom.
        self.frames: list[tuple[FloatArray, FloatArray]] = []
        self.hops: list[Hop] = []
        self.starts: list[float] = []
        self.events: list[tuple[FloatArray, IntArray, BoolArray, FloatArray]] = []
        self.n_carries = 0

    def frames_within(self, duration_s: float) -> FloatArray:
        """Return the times, from now, of frames to come within this duration, s."""
        last = math.ceil((self.clock + duration_s) * self.rate_hz)
        times = np.arange(self.n_frames, last) / self.rate_hz
        return np.maximum(times - self.clock, 0.0)

    def add_frames(self, states: FloatArray, boom: FloatArray) -> None:
        """Append the states and boom places of the next frames."""
        self.frames.append((states, boom))
        self.n_frames += len(states)

    def add_hop(self, hop: Hop) -> None:
        """Append a hop that began at the clock, and move the clock to its end."""
        self.add_frames(hop.states, hop.boom)
        self.hops.append(hop)
        self.starts.append(self.clock)
        at = self.clock + hop.event_time
        self.events.append((at, hop.event_leg, hop.event_down, hop.event_state))
        self.clock += hop.end_time_s

    def carry(
        self, hop: Hop, release: FloatArray, carry_s: float, scene: Scene
    ) -> None:
        """Log the operator's handling after a hop; the boom does not move."""
        frames = self.frames_within(carry_s)
        legs = hop.legs_down()
        when = np.full(len(legs), self.clock)
        down = np.zeros(len(legs), dtype=bool)
        lifted = np.tile(hop.end_state, (len(legs), 1))
        self.events.append((when, legs, down, lifted))
        states = carried(hop.end_state, release, carry_s, frames)
        states = off_the_floor(scene, states, frames)
        self.add_frames(states, scene.still().boom_places(frames))
        self.clock += carry_s
        self.n_carries += 1

    def trial(self, duration_s: float) -> Trial:
        """Return the recorded trial, cut at this time."""
        event_time, event_leg, event_down, event_state = map(
            np.concatenate, zip(*self.events, strict=True)
        )
        states, boom = map(np.concatenate, zip(*self.frames, strict=True))
        end_s = min(self.clock, duration_s)
        n_frames = min(self.n_frames, math.ceil(end_s * self.rate_hz))
        starts = np.array(self.starts)
        ends = starts + [hop.end_time_s for hop in self.hops]
        n_whole = int(np.sum(ends <= duration_s))
        return Trial(
            rate_hz=self.rate_hz,
            states=states[:n_frames],
            boom=boom[:n_frames],
            hops=tuple(self.hops[:n_whole]),
            hop_start_s=starts[:n_whole],
            apex_s=starts,
            event_time=event_time,
            event_leg=event_leg,
            event_down=event_down,
            event_state=event_state,
            n_carries=self.n_carries,
            longer_m=np.array([_longer(hop) for hop in self.hops]),
        )


def _longer(hop: Hop) -> FloatArray:
    """Return how much longer than usual each leg of a hop is, (n,), m."""
    if hop.longer_m is None:
        return np.zeros(len(hop.preloads_n))
    return hop.longer_m


def carried(
    state: FloatArray, release: FloatArray, duration_s: float, times_s: FloatArray
) -> FloatArray:
    """Return states, (K, 12), of a body moved by hand: cubics without a jump in speed.

    The motion starts as in `state` and ends as in `release`; `times_s` (K,) count from
    the start. The angular velocity of these states is unused and left at zero.
    """
    from scipy.interpolate import CubicHermiteSpline

    rates = [pose_rate(state), pose_rate(release)]
    moved = CubicHermiteSpline([0.0, duration_s], [state[:6], release[:6]], rates)
    times = np.minimum(times_s, duration_s)
    states = np.zeros((len(times_s), N_STATES))
    states[:, :6] = moved(times)
    states[:, 6:9] = moved(times, 1)[:, :3]
    return states


#: Time in which the operator lifts a fallen body so far that its legs fit under it.
#: Unit: s. Origin: chosen: twice that in which the legs retract; in that time itself,
#: bodies jump by up to 63 mm between frames of 100 Hz.
LIFT_S = 0.3


def off_the_floor(scene: Scene, states: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return the states (K, 12) of a carry, lifted where feet would be in the floor.

    A leg of a fallen body is pressed in, and needs more room as soon as it is released.
    """
    legs = range(scene.n_legs)
    heights = np.array([rest_foot(scene, states, leg)[:, 2] for leg in legs])
    below = np.maximum(-heights.min(axis=0, initial=math.inf), 0.0)
    if not below.any():
        return states
    lift = below * smooth_step(times_s / LIFT_S)
    lifted = states.copy()
    lifted[:, 2] += lift
    if len(lift) > 1:
        lifted[:, 8] += np.gradient(lift, times_s)
    return lifted


def run_trial(  # noqa: PLR0913 (the trial's options)
    scene: Scene,
    *,
    hops: int,
    rate_hz: float,
    rng: np.random.Generator,
    kicks: Kicks | None = None,
    operator: Operator | None = None,
    control: Control | None = None,
    duration_s: float = math.inf,
    changes: Iterable[Mapping[str, Any]] = (),
    preloads_n: FloatArray | None = None,
    longer_m: Iterable[FloatArray] = (),
    integrator: str = "driver",
) -> Trial:
    """Let a body make a number of hops, or hop for a time, whichever ends first.

    A control lands from the apexes of the scene's own gait, whatever the outcome of its
    last landing; see `hopdata.synthesis.hops.control_hop`.

    Parameters
    ----------
    scene : Scene
        What hops. A swinging boom moves to and fro, hop by hop, unless changed.
    hops : int
        Number of hops.
    rate_hz : float
        Rate at which states are recorded, Hz.
    rng : numpy Generator
        Random source for the kicks and places of release.
    kicks, operator : optional
        Disturbances and handling; by default those of their classes.
    control : Control, optional
        System that lands; by default the scene itself.
    duration_s : float
        Cut the trial at this time, s.
    changes : iterable of mapping, optional
        Parameters of the scene that change in the first hop, the second, and so on.
    preloads_n : (n,) array, optional
        Preload of each leg before random changes, N; by default that of the scene.
    longer_m : iterable of (n,) array
        How much longer than usual each leg is in the first hop, the second, and so on,
        m; by default none is.
    integrator : str
        What integrates the hops; see `hopdata.synthesis.hops.fly_hop`.
    """
    kicks = kicks or Kicks()
    operator = operator or Operator()
    still_to_change = iter(changes)
    legs_to_come = iter(longer_m)
    preloads = scene.preload_n if preloads_n is None else preloads_n
    tape = Tape(rate_hz)
    state = _release_state(scene, operator, rng, 0.0)
    for _ in range(hops):
        if tape.clock >= duration_s:
            break
        flight: dict[str, Any] = {
            "frame_times_s": tape.frames_within(operator.hop_limit_s),
            "limit_s": operator.hop_limit_s,
            "integrator": integrator,
        }
        longer = next(legs_to_come, None)
        scene = replace(scene, **next(still_to_change, {}))
        changed = 1 + kicks.preload_fraction * rng.standard_normal(scene.n_legs)
        start = kicked(state, kicks, rng)
        pushing = preloads * changed
        hop = fly_hop(scene, start, preloads_n=pushing, longer_m=longer, **flight)
        shown = hop
        if control is not None:
            shown = control_hop(scene, control, hop, **flight)
        tape.add_hop(shown)
        state = hop.end_state
        scene = scene.after(hop.end_time_s)
        is_astray = hop.fell or np.max(np.abs(state[:2])) > operator.arena_m
        if is_astray:
            state = _release_state(scene, operator, rng, hop.end_state[3])
        # A control may not have been led to where the gait goes on.
        is_elsewhere = shown is not hop and not np.array_equal(shown.end_state, state)
        if is_astray or is_elsewhere:
            tape.carry(shown, state, operator.carry_s, scene)
    return tape.trial(duration_s)


def kicked(state: FloatArray, kicks: Kicks, rng: np.random.Generator) -> FloatArray:
    """Return the state after a random kick to velocity and angular velocity, (12,)."""
    spread = np.repeat([kicks.velocity_m_s, kicks.angular_velocity_rad_s], 3)
    return state + np.append(np.zeros(6), spread * rng.standard_normal(6))


def _release_state(
    scene: Scene, operator: Operator, rng: np.random.Generator, yaw_rad: float
) -> FloatArray:
    state = level_state(scene, operator.release_height_m)
    state[:2] = operator.release_spread_m * rng.uniform(-1.0, 1.0, 2)
    state[3] = yaw_rad
    return state
