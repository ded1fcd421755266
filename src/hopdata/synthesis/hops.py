"""Single hops, from apex to apex, by the event-driven integrator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError
from hopdata.hybrid import Solution, System, solve
from hopdata.hybrid.status import SLIDING, TERMINATED, ZENO
from hopdata.scenes.boom import boom_angle, counterweight_places
from hopdata.scenes.hopper import flight_mode, hopper_system
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.rigid_body import rotation_matrices

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

RTOL, ATOL = 1e-10, 1e-12


class Variant(Protocol):
    """A hopper that differs from the plain one by a few parameters more."""

    def system(self, n_legs: int) -> System:
        """Return the hybrid system; guards and modes are those of `hopper_system`."""
        ...

    def vector(self, hopper: HopperParameters, preloads_n: FloatArray | None = None) -> FloatArray:
        """Flat parameter vector: the hopper's, then the variant's own."""
        ...


@dataclass(frozen=True)
class Hop:
    """One hop: what was put in, what came out, and the contacts on the way.

    `ending` is "apex", "tipped over", "no apex in time", or "stuck": at rest on legs that have not
    been released, whose force jumps at the very place where they would stand (a sliding mode).

    Times count from the apex at which the hop began, in s. Contact events, in order of time:
    `event_time` (E,), `event_leg` (E,), `event_down` (E,) True for a touchdown and False for a
    lift-off, `event_state` (E, 12). `states` (K, 12) are those at the frame times asked for, up to
    the end, and `boom` (K, 3) the places of the counterweight then, body frame, m.
    `boom_angle_rad` is the angle of the boom at the end.
    """

    start_state: FloatArray
    preloads_n: FloatArray
    states: FloatArray
    boom: FloatArray
    boom_angle_rad: float
    end_time_s: float
    end_state: FloatArray
    ending: str
    event_time: FloatArray
    event_leg: IntArray
    event_down: BoolArray
    event_state: FloatArray

    @property
    def fell(self) -> bool:
        """Whether the hop ended otherwise than at an apex."""
        return self.ending != "apex"

    def first_contacts(self) -> IntArray:
        """Index of each leg's first touchdown among the events, (n,); -1 if it did not touch."""
        first = np.full(len(self.preloads_n), -1)
        for k in np.flatnonzero(self.event_down)[::-1]:
            first[self.event_leg[k]] = k
        return first

    def legs_down(self) -> IntArray:
        """Legs still in contact at the end."""
        count = np.zeros(len(self.preloads_n), dtype=int)
        np.add.at(count, self.event_leg, np.where(self.event_down, 1, -1))
        return np.flatnonzero(count)

    def all_stood(self) -> bool:
        """Whether all legs were in contact at once."""
        count = np.cumsum(np.where(self.event_down, 1, -1))
        return bool(np.any(count == len(self.preloads_n)))


def fly_hop(
    parameters: HopperParameters,
    state: FloatArray,
    *,
    variant: Variant | None = None,
    preloads_n: FloatArray | None = None,
    frame_times_s: FloatArray | None = None,
    limit_s: float = 3.0,
    rtol: float = RTOL,
    atol: float = ATOL,
) -> Hop:
    """Integrate one hop from flight until the next apex.

    Parameters
    ----------
    parameters : HopperParameters
    state : (12,) array
        State in flight, at or near the apex.
    variant : Variant, optional
        What flies and lands in its place, as a `HopperControl`; by default the hopper itself.
    preloads_n : (n,) array, optional
        Preload of each leg in this hop, N.
    frame_times_s : (K,) array, optional
        Times after the start at which the state is wanted, s.
    limit_s : float
        Give up if no apex has come by then, s.
    rtol, atol : float
        Tolerances of the integration, as for `hopdata.hybrid.solve`.

    Raises
    ------
    AnalysisError
        If the integrator fails.
    """
    n = parameters.n_legs
    preloads = np.full(n, parameters.preload_n) if preloads_n is None else preloads_n
    frames = np.empty(0) if frame_times_s is None else frame_times_s
    system, vector = hopper_system(n), parameters.vector(preloads)
    if variant is not None:
        system, vector = variant.system(n), variant.vector(parameters, preloads)
    solution = solve(
        system,
        (0.0, limit_s),
        state,
        params=vector,
        mode=flight_mode(n, state[8]).tolist(),
        rtol=rtol,
        atol=atol,
        t_eval=frames[frames < limit_s],
    )
    events = solution.events
    contact = events.guard < n
    return Hop(
        start_state=state,
        preloads_n=preloads,
        states=solution.y.T,
        boom=counterweight_places(solution.t, vector),
        boom_angle_rad=float(boom_angle.py_func(solution.t_end, vector)[0]),
        end_time_s=solution.t_end,
        end_state=solution.y_end,
        ending=_ending(solution, n),
        event_time=events.time[contact],
        event_leg=events.guard[contact],
        event_down=events.direction[contact] > 0,
        event_state=events.after[contact],
    )


def _ending(solution: Solution, n_legs: int) -> str:
    if solution.status in (SLIDING, ZENO):
        return "stuck"
    if not solution.success:
        raise AnalysisError(f"hop: the integration failed: {solution.message}")
    if solution.status == TERMINATED:
        return "apex" if solution.events.guard[-1] == n_legs else "tipped over"
    return "no apex in time"


def rest_foot(parameters: HopperParameters, states: FloatArray, leg: int) -> FloatArray:
    """Place of one leg's foot at rest length, world frame, (..., 3), m."""
    arm = rotation_matrices(states[..., 3:6]) @ parameters.rest_feet()[leg]
    return states[..., :3] + arm


def rest_foot_climb(parameters: HopperParameters, states: FloatArray, leg: int) -> FloatArray:
    """Rate of the height of one leg's foot at rest length, (...), m/s."""
    turning = np.cross(states[..., 9:12], parameters.rest_feet()[leg])
    up = rotation_matrices(states[..., 3:6])[..., 2, :]
    return np.asarray(states[..., 8] + np.sum(up * turning, axis=-1))


def level_state(parameters: HopperParameters, height_m: float) -> FloatArray:
    """State of a level hopper at rest whose feet are this high above the floor, (12,)."""
    state = np.zeros(12)
    state[2] = parameters.leg_length_m + height_m
    return state
