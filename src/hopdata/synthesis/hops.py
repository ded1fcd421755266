"""Single hops from apex to apex, computed by an event-driven integrator."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.errors import AnalysisError, require_choice
from hopdata.hybrid import System
from hopdata.scenes.body import (
    CLIMB,
    N_STATES,
    PITCH,
    ROLL,
    euler_rates,
    flight_mode,
    rotation_matrices,
)
from hopdata.scenes.scene import Control, Scene, Variant
from hopdata.synthesis.integrators import INTEGRATORS, Flown


@dataclass(frozen=True)
class Hop:
    """One hop: its inputs, its outcome, and the contacts on the way.

    States are those of the body, see `hopdata.scenes.body`. `ending` is "apex", "tipped
    over", "no apex in time", or "stuck". A stuck hopper rests on legs that have not
    been released, whose force jumps at the very place where they would stand (a sliding
    mode, or contacts without end).

    Times count from the apex at which the hop began, s. Contact events in order of
    time: `event_time` (E,), `event_leg` (E,), `event_down` (E,) True for a touchdown
    and False for a lift-off, `event_state` (E, 12). `states` (K, 12) are those at the
    requested frame times, up to the end, and `boom` (K, 3) the places of the boom then,
    body frame, m; (K, 0) without one. `longer_m` (n,) is how much longer than usual
    each leg is, m; None if legs do not scatter. `touched_s` is when a standing hopper
    first touched a board in its way; NaN if it never did.
    """

    start_state: FloatArray
    preloads_n: FloatArray
    states: FloatArray
    boom: FloatArray
    end_time_s: float
    end_state: FloatArray
    ending: str
    event_time: FloatArray
    event_leg: IntArray
    event_down: BoolArray
    event_state: FloatArray
    touched_s: float = np.nan
    longer_m: FloatArray | None = None

    @property
    def fell(self) -> bool:
        """Tell whether the hop ended in any other way than at an apex."""
        return self.ending != "apex"

    def first_contacts(self) -> IntArray:
        """Return the event index of each leg's first touchdown, (n,); -1 if none."""
        first = np.full(len(self.preloads_n), -1)
        for k in np.flatnonzero(self.event_down)[::-1]:
            first[self.event_leg[k]] = k
        return first

    def legs_down(self) -> IntArray:
        """Return the legs still in contact at the end."""
        steps = np.where(self.event_down, 1, -1)
        return np.flatnonzero(np.bincount(self.event_leg, steps, len(self.preloads_n)))

    def all_stood(self) -> bool:
        """Tell whether all legs were in contact at once."""
        n_standing = np.cumsum(np.where(self.event_down, 1, -1))
        return bool(np.any(n_standing == len(self.preloads_n)))


def fly_hop(  # noqa: PLR0913 - the parts of a hop and its options, by name
    scene: Scene,
    state: FloatArray,
    *,
    variant: Variant | None = None,
    preloads_n: FloatArray | None = None,
    longer_m: FloatArray | None = None,
    frame_times_s: FloatArray | None = None,
    limit_s: float = 3.0,
    integrator: str = "driver",
    rtol: float | None = None,
    shows_boom: bool = True,
) -> Hop:
    """Integrate one hop from flight to the next apex.

    Parameters
    ----------
    scene : Scene
    state : (12,) array
        State in flight, at or near the apex.
    variant : Variant, optional
        A `Control` or other variant that flies and lands instead of the scene; by
        default the scene itself.
    preloads_n : (n,) array, optional
        Preload of each leg in this hop, N.
    longer_m : (n,) array, optional
        How much longer than usual each leg is in this hop, m.
    frame_times_s : (K,) array, optional
        Times after the start at which states are returned, s.
    limit_s : float
        Time after which to give up if there has been no apex, s.
    integrator : str
        A name of `hopdata.synthesis.integrators.INTEGRATORS`: "driver", or "printed"
        for scenes whose events do not reset the state (`Scene.resets_state`).
    rtol : float, optional
        Relative tolerance of the integrator, by default its own.
    shows_boom : bool
        Whether the places of the boom are returned; without them it is quicker.

    Raises
    ------
    AnalysisError
        If the integrator fails, or the scene lacks guards with the names listed in
        `Scene`.
    ConfigError
        If no integrator has this name.
    """
    require_choice("simulation.integrator", integrator, INTEGRATORS)
    n = scene.n_legs
    if preloads_n is None:
        preloads_n = np.full(n, scene.preload_n)
    if frame_times_s is None:
        frame_times_s = np.empty(0)
    params = scene.vector(preloads_n, variant)
    if longer_m is not None:
        params = scene.lengthened(params, longer_m)
    system = scene.system(variant)
    first = _first_foot(tuple(system.guard_names), n)
    has_board = first > 0
    mode = flight_mode(system, state[CLIMB])
    if has_board and variant is not None:  # it may have passed the front already
        _, x, y, front = variant.numbers
        mode[0] = 1 if x * state[0] + y * state[1] > front else -1
    flown = INTEGRATORS[integrator](
        system,
        padded(state, system),
        params=params,
        mode=mode,
        frame_times_s=frame_times_s,
        limit_s=limit_s,
        rtol=rtol,
    )
    events = flown.events
    guard = events.guard - first
    contact = (guard >= 0) & (guard < n)
    touched_s = np.nan
    if has_board:
        touched_s = _first_touch(events, contact, beyond=mode[0] > 0)
    boom = np.empty((len(flown.frame_times_s), 0))
    if shows_boom:
        boom = scene.boom_places(flown.frame_times_s)
    return Hop(
        start_state=state,
        preloads_n=preloads_n,
        states=flown.states[:, :N_STATES],
        boom=boom,
        end_time_s=flown.end_time_s,
        end_state=flown.end_state[:N_STATES],
        ending=_ending(flown, first + n),
        event_time=events.time[contact],
        event_leg=guard[contact],
        event_down=events.direction[contact] > 0,
        event_state=events.after[contact, :N_STATES],
        touched_s=touched_s,
        longer_m=longer_m,
    )


@cache
def _first_foot(guard_names: Sequence[str], n_legs: int) -> int:
    """Return the index of the first foot's guard; the apex comes after the last foot.

    Raises
    ------
    AnalysisError
        If the scene lacks a guard.
    """
    wanted = [*(f"foot{leg + 1}" for leg in range(n_legs)), "apex", "fallen"]
    if not set(wanted) <= set(guard_names):
        guards = "guards of the scene"
        raise AnalysisError.at(guards, ", ".join(wanted), guard_names)
    return guard_names.index("foot1")


def _first_touch(events: Any, contact: BoolArray, *, beyond: bool) -> float:
    """Return when a leg first stood beyond the board's front; NaN if never."""
    standing = np.cumsum(np.where(contact, events.direction, 0))
    past = int(beyond) + np.cumsum(np.where(events.guard == 0, events.direction, 0))
    touched = (standing > 0) & (past > 0)
    if not touched.any():
        return np.nan
    return float(events.time[touched.argmax()])


def padded(states: FloatArray, system: System) -> FloatArray:
    """Append zeros to flight states (..., 12) for the system's memory of its feet."""
    memory = np.zeros((*states.shape[:-1], system.n_states - N_STATES))
    return np.concatenate([states, memory], axis=-1)


def _ending(flown: Flown, apex: int) -> str:
    """Return how a hop ended, given the index of the guard of the apex."""
    if flown.is_stuck:
        return "stuck"
    if flown.has_ended:
        return "apex" if flown.events.guard[-1] == apex else "tipped over"
    return "no apex in time"


def place_of(point_m: FloatArray, states: Any) -> Any:
    """Return the world place, (..., 3), m, of a point (3,) in the body frame."""
    return states[..., :3] + rotation_matrices(states[..., 3:6]) @ point_m


def rest_foot(
    scene: Scene, states: FloatArray, leg: int, longer_m: FloatArray | float = 0.0
) -> FloatArray:
    """Return the place of one leg's foot at rest length, world frame, (..., 3), m.

    `longer_m` (...), m, is how much longer than usual the leg is.
    """
    usual = place_of(scene.rest_feet()[leg], states)
    along = rotation_matrices(states[..., 3:6])[..., :, 2]
    return np.asarray(usual - np.asarray(longer_m)[..., None] * along)


def rest_foot_climb(
    scene: Scene, states: FloatArray, leg: int, longer_m: FloatArray | float = 0.0
) -> FloatArray:
    """Return the rate of height of one leg's foot at rest length, (...), m/s."""
    down = np.array([0.0, 0.0, -1.0])
    foot = scene.rest_feet()[leg] + np.asarray(longer_m)[..., None] * down
    turning = np.cross(states[..., 9:12], foot)
    up = rotation_matrices(states[..., 3:6])[..., 2, :]
    return np.asarray(states[..., 8] + np.sum(up * turning, axis=-1))


def level_state(scene: Scene, height_m: float) -> FloatArray:
    """Return a level state at rest with the feet at this height, (12,)."""
    state = np.zeros(N_STATES)
    state[2] = scene.leg_length_m + height_m
    return state


def rebound(scene: Scene, height_m: float) -> float:
    """Drop a scene level from rest, and return how high it bounces back.

    This is the dissertation's drop test (Sec. 2.2.1): more than 40 % of the height, so
    the landing does not annihilate the dynamical state. A scene that adds energy in its
    stance should have that taken away first, such as the hopper with
    ``release_extension_m=0``.

    Parameters
    ----------
    scene : Scene
    height_m : float
        Height of the feet above the floor at release, m, > 0.

    Returns
    -------
    float
        Height of the feet at the next apex, relative to that at release. It may be
        negative for a scene that stays on its legs.

    Raises
    ------
    AnalysisError
        If it falls over, or reaches no apex.
    """
    hop = fly_hop(scene, level_state(scene, height_m))
    if hop.fell:
        expected = "a bounce up to an apex"
        raise AnalysisError.at(f"drop from {height_m:g} m", expected, hop.ending)
    return float((hop.end_state[2] - scene.leg_length_m) / height_m)


# A control that hops on from its own landings soon hops differently from the scene, and
# their landings can no longer be compared. Each of its hops therefore begins in an apex
# state of the scene's gait. In the flight after its last lift-off it is led to the next
# apex state, so that the recording continues.

#: Shortest flight in which a control is led to the next apex; a shorter one would
#: visibly pull the body about.
#: Unit: s. Origin: chosen.
LEAST_FLIGHT_S = 0.05


def control_hop(
    scene: Scene,
    control: Control,
    gait: Hop,
    *,
    frame_times_s: FloatArray,
    limit_s: float,
    integrator: str = "driver",
) -> Hop:
    """Let a control hop from the apex at which a hop of the gait began.

    Parameters
    ----------
    scene : Scene
    control : Control
    gait : Hop
        The scene's own hop.
    frame_times_s, limit_s, integrator
        See `fly_hop`.

    Returns
    -------
    Hop
        It ends in the final state of the gait's hop, unless either fell or the
        control's flight is too short to be led there.
    """
    hop = fly_hop(
        scene,
        gait.start_state,
        variant=control,
        preloads_n=gait.preloads_n,
        longer_m=gait.longer_m,
        frame_times_s=frame_times_s,
        limit_s=limit_s,
        integrator=integrator,
    )
    if hop.fell or gait.fell or hop.end_time_s - hop.event_time[-1] < LEAST_FLIGHT_S:
        return hop
    return led_to(hop, gait.end_state, frame_times_s[: len(hop.states)])


def led_to(hop: Hop, end_state: FloatArray, times_s: FloatArray) -> Hop:
    """Lead a hop to another end state during the flight after its last lift-off.

    A quintic blends the pose into the flight that ends in that state, so that position,
    velocity and acceleration are continuous at both ends. Contacts do not change.
    """
    take_off = hop.event_time[-1]
    flight = hop.end_time_s - take_off
    s = np.clip((times_s - take_off) / flight, 0.0, 1.0)[:, None]
    before_end = (times_s - hop.end_time_s)[:, None]
    share = smooth_step(s)
    growth = smooth_step_rate(s) / flight
    # Both fly under gravity, so to first order their difference changes at a constant
    # rate.
    rate = pose_rate(end_state) - pose_rate(hop.end_state)
    apart = end_state[:6] - hop.end_state[:6] + rate * before_end
    states = hop.states.copy()
    states[:, :6] += share * apart
    states[:, 6:9] += (share * rate + growth * apart)[:, :3]
    states[:, 9:12] += share * (end_state - hop.end_state)[9:12]
    return replace(hop, states=states, end_state=end_state)


def pose_rate(state: FloatArray) -> FloatArray:
    """Return the rates of position and of yaw, pitch and roll, (6,), m/s and rad/s."""
    turning = euler_rates.py_func(state[PITCH], state[ROLL], state[9:12])
    return np.concatenate([state[6:9], turning])


def smooth_step(s: FloatArray) -> FloatArray:
    """Return a quintic from 0 to 1 on [0, 1], with two derivatives of 0 at the ends."""
    s = np.clip(s, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


def smooth_step_rate(s: FloatArray) -> FloatArray:
    """Return the derivative of `smooth_step` on [0, 1]."""
    return 30.0 * (s * (1.0 - s)) ** 2
