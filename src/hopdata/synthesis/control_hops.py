"""Hops of a control that keep to the hopper's own gait.

A control that hops on from where it lands soon hops otherwise than the hopper, and its landings
cannot be compared. So each of its hops begins in an apex state of the hopper's gait; in the flight
after its last lift-off it is led to the next one, so that the recording stays continuous.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hopdata.scenes.hopper_control import HopperControl
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.rigid_body import euler_rates
from hopdata.synthesis.hops import Hop, fly_hop

FloatArray = NDArray[np.float64]

LEAST_FLIGHT_S = 0.05  # in a shorter one the hopper would be pulled about visibly


def control_hop(
    parameters: HopperParameters,
    control: HopperControl,
    gait: Hop,
    *,
    frame_times_s: FloatArray,
    limit_s: float,
) -> Hop:
    """Let a control hop from the apex at which a hop of the gait began.

    Parameters
    ----------
    parameters : HopperParameters
    control : HopperControl
    gait : Hop
        The hopper's own hop.
    frame_times_s, limit_s
        As for `fly_hop`.

    Returns
    -------
    Hop
        It ends in the state in which the hop of the gait ended, unless either fell or the control's
        flight is too short to lead it there.
    """
    hop = fly_hop(
        parameters,
        gait.start_state,
        variant=control,
        preloads_n=gait.preloads_n,
        frame_times_s=frame_times_s,
        limit_s=limit_s,
    )
    if hop.fell or gait.fell or hop.end_time_s - hop.event_time[-1] < LEAST_FLIGHT_S:
        return hop
    return led_to(hop, gait.end_state, frame_times_s[: len(hop.states)])


def led_to(hop: Hop, end_state: FloatArray, times_s: FloatArray) -> Hop:
    """Lead a hop to another end state within the flight after its last lift-off.

    The pose is blended by a quintic into the flight that ends in that state, so that position,
    velocity and acceleration go on without a jump at either end. Contacts stay as they are.
    """
    take_off = hop.event_time[-1]
    flight = hop.end_time_s - take_off
    s = np.clip((times_s - take_off) / flight, 0.0, 1.0)[:, None]
    before_end = (times_s - hop.end_time_s)[:, None]
    share, growth = smooth_step(s), smooth_step_rate(s) / flight
    # Both fly under gravity, so to first order their distance changes at a constant rate.
    rate = pose_rate(end_state) - pose_rate(hop.end_state)
    apart = end_state[:6] - hop.end_state[:6] + rate * before_end
    states = hop.states.copy()
    states[:, :6] += share * apart
    states[:, 6:9] += (share * rate + growth * apart)[:, :3]
    states[:, 9:12] += share * (end_state - hop.end_state)[9:12]
    return replace(hop, states=states, end_state=end_state)


def pose_rate(state: FloatArray) -> FloatArray:
    """Rate of position and of yaw, pitch and roll, (6,), m/s and rad/s."""
    return np.concatenate([state[6:9], euler_rates.py_func(state[4], state[5], *state[9:12])])


def smooth_step(s: FloatArray) -> FloatArray:
    """Quintic from 0 to 1 on [0, 1] whose first two derivatives vanish at both ends."""
    s = np.clip(s, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


def smooth_step_rate(s: FloatArray) -> FloatArray:
    """Return the derivative of `smooth_step` on [0, 1]."""
    return 30.0 * (s * (1.0 - s)) ** 2
