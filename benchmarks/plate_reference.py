"""Where the plate truly ends: DOP853 at its tightest, started anew at each event.

Nothing of the integrator under test is used: numpy for the field, scipy for steps and roots. The
step that meets an event is taken again to the event's instant.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from plate_scene import Plate
from scipy.integrate import DOP853
from scipy.optimize import brentq

FloatArray = NDArray[np.float64]

RTOL, ATOL = 3e-14, 1e-15
LOOKS = 16  # at each guard, within a step
LONGEST_STEP_S = 0.01  # so that no pair of crossings hides between two looks
SAME_S = 1e-13  # instants nearer than this are one


def reference_end(plate: Plate, start: FloatArray, until_s: float) -> FloatArray:
    """Return the state at the end, (6,), from a start at time 0 off all guards."""
    now, state = 0.0, np.array(start)
    touching = plate.compressions(state) > 0
    while now < until_s:
        solver = begin(plate, touching, now, state, until_s)
        instant, flips = until_s, np.zeros_like(touching)
        while solver.status == "running" and not flips.any():
            solver.step()
            instant, flips = first_flips(plate, touching, solver)
        if flips.any():
            state = taken_to(plate, touching, solver.t_old, solver_start(solver), instant)
        else:
            state = solver.y
        now, touching = instant, touching ^ flips
    return state


def begin(plate: Plate, touching: Any, now: float, state: FloatArray, until_s: float) -> DOP853:
    """Return a solver in this mode."""
    arms = plate.spring_places_m[touching]
    sums = np.array([len(arms), arms.sum(), (arms**2).sum()])
    gravity, mass, inertia, rest, stiffness, damping, *_ = plate.params

    def slope_of(_t: float, y: FloatArray) -> FloatArray:
        x, z, angle, vx, vz, spin = y
        slope, grow = np.tan(angle), 1 + np.tan(angle) ** 2
        along = np.array(
            [sums[0], x * sums[0] - sums[1], x * x * sums[0] - 2 * x * sums[1] + sums[2]]
        )
        at_centre = stiffness * (rest - z) + damping * (slope * vx - vz)
        per_arm = stiffness * slope + damping * grow * spin
        force = at_centre * along[0] + per_arm * along[1]
        moment = at_centre * along[1] + per_arm * along[2]
        return np.array(
            [vx, vz, spin, -slope * force / mass, force / mass - gravity, -grow * moment / inertia]
        )

    return DOP853(
        slope_of, now, state, until_s, rtol=RTOL, atol=ATOL, max_step=LONGEST_STEP_S
    )  # fmt: skip


def solver_start(solver: Any) -> FloatArray:
    """Return the state at the start of the last step."""
    return np.asarray(solver.dense_output()(solver.t_old))


def taken_to(
    plate: Plate, touching: Any, now: float, state: FloatArray, instant: float
) -> FloatArray:
    """Return the state at an instant not far away, in an unchanged mode."""
    solver = begin(plate, touching, now, state, instant)
    while solver.status == "running":
        solver.step()
    return np.asarray(solver.y)


def first_flips(plate: Plate, touching: Any, solver: Any) -> tuple[float, Any]:
    """Return the first instant within the last step at which springs touch or let go, and which."""
    dense, times = solver.dense_output(), np.linspace(solver.t_old, solver.t, LOOKS + 1)
    side = np.where(touching, 1.0, -1.0)
    margins = side[:, None] * plate.compressions(dense(times))
    past = margins[:, 1:] < 0
    instants = np.full(len(side), np.inf)
    for k in np.flatnonzero(past.any(axis=1)):
        at = int(np.argmax(past[k]))
        instants[k] = brentq(
            lambda t, k=k: side[k] * plate.compressions(dense(t))[k],
            times[at], times[at + 1], xtol=1e-16, rtol=1e-15,
        )  # fmt: skip
    if not np.isfinite(instants).any():
        return solver.t, np.zeros_like(touching)
    return float(instants.min()), instants < instants.min() + SAME_S
