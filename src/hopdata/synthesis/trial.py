"""A trial: hop after hop, each kicked at its apex, with an operator who keeps it in the arena."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.scenes.hopper_control import HopperControl
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.synthesis.control_hops import control_hop
from hopdata.synthesis.hops import fly_hop, level_state
from hopdata.synthesis.options import Kicks, Operator
from hopdata.synthesis.tape import Tape, Trial

FloatArray = NDArray[np.float64]
_TO_AND_FRO = np.array([1.0, -1.0])


def run_trial(
    parameters: HopperParameters,
    *,
    hops: int,
    rate_hz: float,
    rng: np.random.Generator,
    kicks: Kicks | None = None,
    operator: Operator | None = None,
    control: HopperControl | None = None,
    duration_s: float = math.inf,
    swings_rad: Iterable[float] | None = None,
    preloads_n: FloatArray | None = None,
) -> Trial:
    """Let the hopper hop so many times, or for so long, whichever ends first.

    If the boom swings, it does so to and fro, hop by hop, unless told otherwise. A control lands
    from the apexes of the hopper's own gait, whatever became of its last landing; see
    `hopdata.synthesis.control_hops`.

    Parameters
    ----------
    parameters : HopperParameters
    hops : int
        Number of hops.
    rate_hz : float
        Frame rate at which states are kept, Hz.
    rng : numpy Generator
        Source of the kicks and of the places of release.
    kicks, operator : optional
        Disturbances and handling; the defaults of their classes if absent.
    control : HopperControl, optional
        What lands; by default the hopper itself.
    duration_s : float
        Cut the trial at this time, s.
    swings_rad : iterable of float, optional
        Swing of the boom in the flight of each hop, rad; the trial ends with them.
    preloads_n : (n,) array, optional
        Preload of each leg but for chance, N; by default that of the parameters.
    """
    kicks, operator = kicks or Kicks(), operator or Operator()
    if swings_rad is None:
        swings_rad = itertools.cycle(_TO_AND_FRO * parameters.boom_swing_rad)
    preloads = parameters.preload_n if preloads_n is None else preloads_n
    tape = Tape(rate_hz)
    state = _release_state(parameters, operator, rng, yaw_rad=0.0)
    for swing in itertools.islice(swings_rad, hops):
        if tape.clock >= duration_s:
            break
        frames: dict[str, Any] = {
            "frame_times_s": tape.frames_within(operator.hop_limit_s),
            "limit_s": operator.hop_limit_s,
        }
        parameters = replace(parameters, boom_swing_rad=swing)
        chance = rng.standard_normal(parameters.n_legs)
        hop = fly_hop(
            parameters,
            kicked(state, kicks, rng),
            preloads_n=preloads * (1 + kicks.preload_fraction * chance),
            **frames,
        )
        shown = hop if control is None else control_hop(parameters, control, hop, **frames)
        tape.add_hop(shown)
        state = hop.end_state
        parameters = replace(parameters, boom_angle_rad=hop.boom_angle_rad)
        if hop.fell or np.max(np.abs(state[:2])) > operator.arena_m:
            state = _release_state(parameters, operator, rng, yaw_rad=hop.end_state[3])
            tape.carry(shown, state, operator.carry_s, parameters)
        elif shown is not hop and not np.array_equal(shown.end_state, state):
            tape.carry(shown, state, operator.carry_s, parameters)
    return tape.trial(duration_s)


def kicked(state: FloatArray, kicks: Kicks, rng: np.random.Generator) -> FloatArray:
    """Return the state after a random kick to velocity and angular velocity, (12,)."""
    kick = np.zeros(12)
    kick[6:9] = kicks.velocity_m_s * rng.standard_normal(3)
    kick[9:12] = kicks.angular_velocity_rad_s * rng.standard_normal(3)
    return state + kick


def _release_state(
    parameters: HopperParameters, operator: Operator, rng: np.random.Generator, *, yaw_rad: float
) -> FloatArray:
    state = level_state(parameters, operator.release_height_m)
    state[:2] = operator.release_spread_m * rng.uniform(-1.0, 1.0, 2)
    state[3] = yaw_rad
    return state
