"""What a drawing of the hopper shows: its parts as points, and the force of its legs.

All numbers come from the scene's parameters and the positions of the markers. Only the
outline of the chassis is not theirs, since the scene knows a mass and an inertia: it is
drawn as a plate through the origin that carries the legs.
"""

from __future__ import annotations

import numpy as np

from hopdata.arrays import FloatArray, pd
from hopdata.scenes.body import N_STATES
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.synthesis.trial import MarkerOptions

# Kinds of points; each has its name, and those of a line are in its order.
ORIGIN = "origin"
PLATE = "plate"  # outline of the chassis, drawn only
FOOT = "foot"  # at rest length, which is also where the foot's marker is
BODY_MARKER = "body marker"
BOOM_CENTRE = "boom centre"
COUNTERWEIGHT = "counterweight"
BOOM_MARKER = "boom marker"
CIRCLE = "circle"  # on which the counterweight moves
REACHED = "reached"  # arc of the circle that one swing to either side reaches

# The plate's corners lie on the way from the origin to the feet, at this share of it.
PLATE_SHARE = 0.42
ON_CIRCLE = 73  # points
POINT = ["x_m", "y_m", "z_m"]


def hopper_sketch(
    hopper: HopperParameters,
    markers: MarkerOptions | None = None,
    *,
    swing_limit_rad: float = 0.0,
) -> pd.DataFrame:
    """Return the parts of a hopper as points in the body frame.

    Parameters
    ----------
    hopper : HopperParameters
        Its boom is drawn at its present angle.
    markers : MarkerOptions, optional
    swing_limit_rad : float
        Largest swing, for the arc that it reaches; 0 for none.

    Returns
    -------
    DataFrame
        Columns ``kind, name, x_m, y_m, z_m``.
    """
    markers = markers or MarkerOptions()
    feet = hopper.rest_feet()
    plate = PLATE_SHARE * feet * [1.0, 1.0, 0.0]
    centre = np.array([hopper.boom_offset_m, 0.0, hopper.boom_height_m])
    counterweight = hopper.boom_places(np.zeros(1))[0]
    angles = np.linspace(0.0, 2 * np.pi, ON_CIRCLE)
    parts = [
        _points(ORIGIN, np.zeros((1, 3))),
        _points(PLATE, plate),
        _points(FOOT, feet),
        _points(BODY_MARKER, np.array(markers.body_m)),
        _points(BOOM_CENTRE, centre[None]),
        _points(COUNTERWEIGHT, counterweight[None]),
        _points(BOOM_MARKER, (counterweight + markers.boom_m)[None]),
        _points(CIRCLE, _on_circle(hopper, angles)),
    ]
    if swing_limit_rad > 0:
        limits = np.linspace(-swing_limit_rad, swing_limit_rad, ON_CIRCLE)
        parts.append(
            _points(REACHED, _on_circle(hopper, hopper.boom_angle_rad + limits))
        )
    return pd.concat(parts, ignore_index=True)


def _on_circle(hopper: HopperParameters, angle_rad: FloatArray) -> FloatArray:
    """Return places of the counterweight at boom angles (n,): (n, 3), body frame, m."""
    x = hopper.boom_offset_m + hopper.boom_radius_m * np.cos(angle_rad)
    y = hopper.boom_radius_m * np.sin(angle_rad)
    return np.column_stack([x, y, np.full(len(angle_rad), hopper.boom_height_m)])


def _points(kind: str, places: FloatArray) -> pd.DataFrame:
    """Return points (n, 3) of one kind, with numbers from 1 for names."""
    table = pd.DataFrame(places, columns=POINT)
    names = [str(k + 1) for k in range(len(places))]
    table.insert(0, "name", names)
    table.insert(0, "kind", kind)
    return table


def leg_forces(hopper: HopperParameters, *, points: int = 41) -> pd.DataFrame:
    """Return the normal force of one leg that does not move, over its gap.

    The scene's own law is evaluated, with the level body at rest at each height.

    Parameters
    ----------
    hopper : HopperParameters
    points : int
        Number of gaps in each phase.

    Returns
    -------
    DataFrame
        Columns ``phase, gap_m, force_n``. In "flight" no leg touches, so the force is
        0. In "landing" the leg is compressed, from its rest length to half of it. In
        "push-off" all legs have stood, and it pushes up to its release.
    """
    shortest = -0.25 * hopper.leg_length_m
    release = hopper.release_extension_m
    landing = np.linspace(0.0, shortest, points)
    push_off = np.linspace(shortest, release, points)
    flight = np.linspace(1.5 * release, 0.0, points)
    phases = [
        ("flight", flight, np.zeros(points)),
        ("landing", landing, normal_forces(hopper, landing)),
        ("push-off", push_off, normal_forces(hopper, push_off)),
    ]
    tables = [
        pd.DataFrame({"phase": phase, "gap_m": gap, "force_n": force})
        for phase, gap, force in phases
    ]
    return pd.concat(tables, ignore_index=True)


def normal_forces(hopper: HopperParameters, gap_m: FloatArray) -> FloatArray:
    """Return the floor's normal force on a leg that touches, at rest, (n,), N.

    Parameters
    ----------
    hopper : HopperParameters
    gap_m : (n,) array
        Height of the foot at rest length above the floor; negative if compressed.
    """
    from hopdata.scenes.body import rotation_entries
    from hopdata.scenes.hopper import leg_wrench

    level = rotation_entries.py_func(0.0, 0.0, 0.0)
    vector = hopper.vector()
    forces = np.empty(len(gap_m))
    for k, gap in enumerate(gap_m):
        state = np.zeros(N_STATES)
        state[2] = hopper.leg_length_m + gap
        force, _ = leg_wrench(0, state, level, vector)
        forces[k] = force[2]
    return forces
