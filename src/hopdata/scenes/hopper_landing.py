"""A hopper's landing as the sections cut it out: from one height of a point of the body to another.

The hopper, or a control of it, with one guard more, in the place of that for a fall: the height of
a point of the body (the mean of the body markers) over a section, which ends the integration as it
falls through zero. The instants of the first contacts are kept in further states, so that many
landings can be integrated at once without their events being logged.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from hopdata.hybrid import System, field, guards, on_event
from hopdata.scenes import hopper_parameters as hp
from hopdata.scenes.hopper import N_STATES
from hopdata.scenes.hopper_control import (
    HopperControl,
    control_event,
    control_field,
    control_guards,
    control_system,
)
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.legs import vertical_rate
from hopdata.scenes.rigid_body import rotation_entries

FloatArray = NDArray[np.float64]
ModeArray = NDArray[np.int64]

NOT_YET = -1.0  # instant of a contact that has not been

# Point of the body and height of the section stand before the strengths that end the parameters.
POINT_X, POINT_Y, POINT_Z, HEIGHT = -7, -6, -5, -4

_field = njit(error_model="numpy")(control_field.function)
_guards = njit(error_model="numpy")(control_guards.function)
_event = njit(error_model="numpy")(control_event.function)


def landing_vectors(
    hopper: HopperParameters,
    control: HopperControl,
    preloads_n: FloatArray,
    *,
    point_m: ArrayLike,
    height_m: float,
    boom_time_s: ArrayLike = 0.0,
) -> FloatArray:
    """Return the parameter vectors of L landings, (L, p).

    Parameters
    ----------
    hopper, control
        What lands.
    preloads_n : (L, n) array
        Preload of each leg, N.
    point_m : (3,) array_like
        Point of the body, body frame, m.
    height_m : float
        Height of the section, m.
    boom_time_s : (L,) array_like
        Time since the apex at which the integration begins, s: the boom's swing counts from there.
    """
    section = [*np.asarray(point_m, dtype=float), height_m]
    strengths = [control.coupling, control.impulse, control.delay_s]
    vectors = np.tile([*hopper.vector(), *section, *strengths], (len(preloads_n), 1))
    legs = hp.LEGS + hp.LEG_STRIDE * np.arange(hopper.n_legs)
    vectors[:, legs] = preloads_n
    vectors[:, hp.BOOM_START] -= boom_time_s
    return vectors


@field
def landing_field(t: float, y: FloatArray, mode: ModeArray, p: FloatArray, dy: FloatArray) -> None:
    """Fill `dy` with the rate of the control's state; the instants stay."""
    _field(t, y, mode, p, dy)
    for leg in range(int(p[hp.N_LEGS])):
        dy[N_STATES + leg] = 0.0


@guards
def landing_guards(
    t: float,
    y: FloatArray,
    dy: FloatArray,
    mode: ModeArray,
    p: FloatArray,
    h: FloatArray,
    hdot: FloatArray,
) -> None:
    """Fill `h` and `hdot` as the control does, and the height of the point over the section."""
    _guards(t, y, dy, mode, p, h, hdot)
    n = int(p[hp.N_LEGS])
    rot = rotation_entries(y[3], y[4], y[5])
    tx, ty, tz = vertical_rate(y, dy, rot)
    x, y_, z = p[POINT_X], p[POINT_Y], p[POINT_Z]
    h[n + 1] = y[2] + rot[6] * x + rot[7] * y_ + rot[8] * z - p[HEIGHT]
    hdot[n + 1] = dy[2] + tx * x + ty * y_ + tz * z


@on_event
def landing_event(
    t: float, y: FloatArray, mode: ModeArray, p: FloatArray, guard: int, direction: int
) -> int:
    """Do as the control does, and note the instant of a leg's first contact."""
    if guard < int(p[hp.N_LEGS]) and direction > 0 and y[N_STATES + guard] < 0.0:
        y[N_STATES + guard] = t
    return int(_event(t, y, mode, p, guard, direction))


@cache
def landing_system(n_legs: int = 3) -> System:
    """Return the landing as a hybrid system of 12 + n states, the last n of them instants.

    The guards are ``foot1`` ... ``foot<n>``, ``apex`` (stops after a landing, as the hopper's does)
    and ``section`` (stops). Nothing stops a fall.
    """
    control = control_system(n_legs)
    return System(
        field=landing_field,
        guards=landing_guards,
        on_event=landing_event,
        n_states=N_STATES + n_legs,
        guard_names=(*control.guard_names[: n_legs + 1], "section"),
        directions=(*(0 for _ in range(n_legs)), -1, -1),
        terminal=(*(False for _ in range(n_legs + 1)), True),
        n_extra_modes=control.n_extra_modes,
    )
