"""Rhythmic systems as a chain of one-shot regions.

A region has no way back: its locks are set once. A system whose guards are crossed to
and fro is therefore integrated region by region. `integrate_alternating` is the
dissertation's way (Algorithm 7): two regions, chosen by the sign of a velocity. For
many guards see `hopdata.hybrid.printed.both_ways`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.hybrid.arguments import check_shape
from hopdata.hybrid.printed.integrate import (
    Ended,
    default_solver,
    locks_at,
    run_region,
)
from hopdata.hybrid.printed.options import PrintedOptions
from hopdata.hybrid.printed.region import Region, Slope
from hopdata.hybrid.printed.roots import FINDERS
from hopdata.hybrid.printed.solvers import ClassicalSolver, Mesh
from hopdata.hybrid.printed.spline import coefficients, hermite
from hopdata.hybrid.printed.trajectory import PrintedSolution, Trail


def integrate_alternating(
    falling: Region,
    rising: Region,
    t_span: tuple[float, float],
    y0: ArrayLike,
    *,
    velocity: int = 1,
    solver: ClassicalSolver | None = None,
    options: PrintedOptions | None = None,
) -> PrintedSolution:
    """Integrate a hopper by its touchdown and take-off regions in turn (Algorithm 7).

    Parameters
    ----------
    falling, rising : Region
        For negative and positive velocity, of one system: a guard that is crossed in
        both directions has opposite orientations in them.
    t_span : tuple of float
        Start and end, s.
    y0 : (n,) array_like
        Initial state.
    velocity : int
        Number of the component whose sign parts the regions.
    solver, options
        As for `integrate`. Of the options, `boundary`, `rest` and `end` are this
        algorithm's.

    Returns
    -------
    PrintedSolution
        Mesh and events of all regions.

    Raises
    ------
    ArithmeticError
        If the classical solver fails; or if the loop does not end, as printed
        (``end="at"``).
    """
    options = options or PrintedOptions()
    solver = solver or default_solver()
    t, t_end = float(t_span[0]), float(t_span[1])
    y = check_shape("y0", y0, falling.system.n_states)
    trail = Trail(falling.system, [Mesh(np.array([t]), y[None])])
    sign = heading(falling, t, y, velocity, options)
    region = falling
    locks = locks_at(region, t, y, options)
    while goes_on(t, t_end, options):
        region = falling
        if sign > 0:
            region = rising
        stop = turned(sign, velocity)
        locks = run_region(trail, region, (t, t_end), solver, options, stop)
        has_turned = False
        if options.boundary == "localised":
            slope = region.slope_in(locks)
            has_turned = cut_at_turn(trail, slope, sign, velocity, options)
        t = float(trail.legs[-1].t[-1])
        y = trail.legs[-1].y[-1]
        if has_turned:
            sign = -sign
        else:
            sign = heading(region, t, y, velocity, options)
    return trail.solution(region.mode(locks))


def goes_on(t: float, t_end: float, options: PrintedOptions) -> bool:
    """Return whether the loop over the regions goes on.

    Raises
    ------
    ArithmeticError
        As printed (``end="at"``), once the time has reached the end: from there, no
        region advances it further.
    """
    if options.end == "at" and t == t_end:
        raise ArithmeticError(
            f"Algorithm 7 as printed (end='at') does not end: it goes on while "
            f"t <= t_end, and t = t_end = {t_end:g} is reached"
        )
    return t < t_end


def heading(
    region: Region, t: float, y: FloatArray, velocity: int, options: PrintedOptions
) -> int:
    """Return the sign of a velocity; +1 where it, and at rest its rate, is zero."""
    value = float(y[velocity])
    if value == 0.0 and options.rest == "acceleration":
        locks = locks_at(region, t, y, options)
        value = float(region.slope(t, y, locks)[velocity])
    if value < 0.0:
        return -1
    return 1


def turned(sign: int, velocity: int) -> Ended:
    """Return the test whether a velocity has lost its sign."""

    def has_turned(_t: float, y: FloatArray) -> bool:
        return bool(sign * y[velocity] <= 0.0)

    return has_turned


def cut_at_turn(
    trail: Trail, slope: Slope, sign: int, velocity: int, options: PrintedOptions
) -> bool:
    """Let a trail end where a velocity turns in its last step; return whether it does.

    The instant is the root of the velocity's Hermite spline, as in Algorithm 6. Events
    are mesh points, so that there is none within the last step.
    """
    last = trail.last_step()
    t0, t1 = (float(time) for time in last.t)
    y0, y1 = last.y
    v0, v1 = (-sign * float(y[velocity]) for y in (y0, y1))
    if not v0 < 0.0 <= v1:
        return False
    dt = t1 - t0
    f0, f1 = slope(t0, y0), slope(t1, y1)
    d0, d1 = (-sign * dt * float(f[velocity]) for f in (f0, f1))
    theta = FINDERS[options.root_finder](coefficients(v0, v1, d0, d1))
    trail.cut(t0 + theta * dt, hermite(theta, y0, y1, f0, f1, dt))
    return True
