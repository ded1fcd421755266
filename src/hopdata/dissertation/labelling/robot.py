"""The robot: boom, preload, drop test and markers (items 11 and 15 to 17)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.dissertation.labelling.agreement import agrees, built
from hopdata.dissertation.rows import Agreement, Row

if TYPE_CHECKING:
    from hopdata.dissertation.labelling.sample_by_both import Both

# What the dissertation prints, with its section.
DROP_SHARE = 0.4  # 2.2.1
BODY_MARKERS = 3  # 2.2.1

#: Share by which the preload of one leg is raised, to steer by contact forces.
#: Unit: 1. Origin: chosen.
PUSHED = 0.2

#: Swing of the boom in flight: the largest of the steering's robot.
#: Unit: rad. Origin: derived: the default of steering.robot.swing_limit_rad.
SWING_RAD = 1.1780972450961724


def boom() -> Row:
    """Item 11: the boom moves in flight, and turns the body by conservation."""
    from hopdata.scenes.hopper_parameters import HopperParameters
    from hopdata.synthesis.hops import fly_hop, level_state

    still = HopperParameters()
    swung = replace(still, boom_swing_rad=SWING_RAD)
    start = level_state(swung, 0.24)
    times = np.arange(0.0, swung.boom_duration_s + 0.05, 0.005)
    hop = fly_hop(swung, start, frame_times_s=times)
    rest = fly_hop(still, start)
    kept, moved = _angular_momentum(swung, times, hop.states)
    by_boom = np.abs(kept).max() / np.abs(moved).max()
    yaw_deg = float(np.degrees(hop.states[-1, 3]))
    drift_m = hop.end_state[:2] - rest.end_state[:2]
    turns_back = yaw_deg * SWING_RAD < 0
    values = {
        "swing": float(np.degrees(SWING_RAD)),
        "yaw": yaw_deg,
        "momentum": float(by_boom),
        "drift": 1e3 * float(np.hypot(*drift_m)),
    }
    # The same by contact forces: one leg pushes more than the others.
    preloads = still.preload_n * np.array([1 + PUSHED, *[1.0] * (still.n_legs - 1)])
    pushed = fly_hop(still, start, preloads_n=preloads)
    values["pushed"] = 100 * PUSHED
    values["pushed_yaw"] = abs(float(np.degrees(pushed.end_state[3])))
    pushed_m = pushed.end_state[:2] - rest.end_state[:2]
    values["pushed_drift"] = 1e3 * float(np.hypot(*pushed_m))
    agreement = Agreement.DIFFERS
    if turns_back and by_boom < 1e-6 and values["drift"] > 1:
        turns_more = abs(yaw_deg) > values["pushed_yaw"]
        moves_more = values["drift"] > values["pushed_drift"]
        agreement = agrees(turns_more and moves_more, Agreement.PARTLY)
    return Row(11, agreement, values, "forces")


def _angular_momentum(
    hopper: Any, times: FloatArray, states: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the angular momentum about the centre of mass, and the boom's share.

    Both (K, 3), kg m^2/s, in body axes.
    """
    from hopdata.scenes.hopper import boom_motion

    mass = hopper.counterweight_mass_kg
    reduced = mass * (1 - mass / (mass + hopper.mass_kg))
    inertia = np.array(
        [hopper.inertia_x_kg_m2, hopper.inertia_y_kg_m2, hopper.inertia_z_kg_m2]
    )
    whole = []
    of_boom = []
    for time, state in zip(times, states, strict=False):
        place, velocity, _ = boom_motion.py_func(time, hopper.vector())
        turning = state[9:12]
        by_swing = reduced * np.cross(place, velocity)
        carried = reduced * np.cross(place, np.cross(turning, place))
        whole.append(inertia * turning + carried + by_swing)
        of_boom.append(by_swing)
    return np.array(whole), np.array(of_boom)


def preload() -> Row:
    """Item 15: the force at contact jumps to the preload, and is affine."""
    from hopdata.scenes.body import rotation_entries
    from hopdata.scenes.hopper import leg_wrench
    from hopdata.scenes.hopper_parameters import HopperParameters
    from hopdata.synthesis.hops import level_state

    hopper = HopperParameters()
    numbers = hopper.vector()
    upright = rotation_entries(0.0, 0.0, 0.0)
    laws = []
    forces = []
    for gap in np.linspace(-0.1, 0.0, 5):
        for climb in np.linspace(-2.0, 2.0, 5):
            state = level_state(hopper, gap)
            state[8] = climb
            force, _ = leg_wrench(0, state, upright, numbers)
            laws.append((1.0, gap, climb))
            forces.append(force[2])
    law = np.array(laws)
    normal = np.array(forces)
    fitted = np.linalg.lstsq(law, normal, rcond=None)[0]
    residual = float(np.abs(law @ fitted - normal).max())
    is_affine = residual < 1e-9 and fitted[0] > 0
    values = {"jump": float(fitted[0]), "residual": residual}
    return Row(15, built(is_affine), values)


def drop_test() -> Row:
    """Item 16: legs without release, dropped from the hopping height."""
    from hopdata.scenes.hopper_parameters import HopperParameters
    from hopdata.synthesis.hops import rebound

    hopper = HopperParameters()
    height_m = 0.24
    passive = rebound(replace(hopper, release_extension_m=0.0), height_m)
    damped = replace(hopper, release_extension_m=0.0, damping_n_s_m=30.0)
    deadbeat = rebound(damped, height_m)
    values = {
        "height": 1e3 * height_m,
        "share": 100 * passive,
        "hopping": 100 * rebound(hopper, height_m),
        "damped": 100 * deadbeat,
    }
    return Row(16, agrees(passive > DROP_SHARE > deadbeat), values)


def markers(both: Both) -> Row:
    """Item 17: markers of the body, and one a foot."""
    roles = both.recording.roles
    body = roles.count("body")
    feet = roles.count("foot")
    legs = both.truth.contact_times.shape[1]
    values = {"body": body, "feet": feet, "legs": legs}
    return Row(17, built(body == BODY_MARKERS and feet == legs), values)
