"""Several events within one step of a classical solver: Algorithms 5 and 6.

The candidate whose Hermite spline has the earliest root is crossed first; the state
there is interpolated, and one third-order step in the new mode leads to the end of the
step again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid.printed.one_step import heun3_step
from hopdata.hybrid.printed.options import PrintedOptions
from hopdata.hybrid.printed.region import Region
from hopdata.hybrid.printed.roots import FINDERS
from hopdata.hybrid.printed.spline import Cubic, coefficients, hermite


@dataclass(frozen=True)
class Step:
    """One step of a mesh: times, s, states (n,) and slopes (n,) at its ends."""

    t0: float
    y0: FloatArray
    f0: FloatArray
    t1: float
    y1: FloatArray
    f1: FloatArray

    @property
    def length(self) -> float:
        """Length of the step, s."""
        return self.t1 - self.t0


@dataclass(frozen=True)
class Crossing:
    """Crossing of a guard: instant, s, number, state (n,), and locks (m,) after it."""

    time: float
    guard: int
    state: FloatArray
    locks: IntArray


@dataclass(frozen=True)
class Resolution:
    """Where a step with events ends: time, s, state (n,), locks (m,); its crossings."""

    t: float
    y: FloatArray
    locks: IntArray
    crossings: tuple[Crossing, ...]


def resolve_contacts(
    region: Region,
    t0: float,
    y0: FloatArray,
    t1: float,
    y1: FloatArray,
    locks: IntArray,
    options: PrintedOptions | None = None,
) -> Resolution:
    """Integrate through all events between two points of a mesh (Algorithm 5).

    The guard whose spline has the earliest root is crossed first. The state there is
    interpolated, and one third-order step in the new mode leads to the end again. This
    repeats until no guard remains that has changed sign. That step has no error
    control: the caller bounds its length, or sets ``tail="restart"``, with which the
    step ends at its first crossing.

    Parameters
    ----------
    region : Region
        Field and event functions.
    t0, t1 : float
        Ends of the step, s.
    y0, y1 : (n,) array
        States at the ends; the second follows from the mode at the start.
    locks : (m,) array of int
        -1 for guards that are not crossed at t0, +1 for those that are, 0 for those
        that belong to no mode.
    options : PrintedOptions, optional
        Choices within the method.

    Returns
    -------
    Resolution
        Where the step ends, with the true state and locks there. There are at most m
        crossings, as each sets one lock for good.

    Raises
    ------
    ArithmeticError
        Without `cross_at_surface`, if a candidate has no bracket.
    """
    options = options or PrintedOptions()
    locks = locks.copy()
    crossings: list[Crossing] = []
    step = _step(region, t0, y0, t1, y1, locks)
    first_slopes = step.f0, step.f1
    candidates = region.crossed(t1, y1, locks)
    while len(candidates) > 0:
        parts = impact_fractions(region, step, locks, candidates, options)
        earliest = int(np.argmin(parts))
        theta = parts[earliest]
        f0, f1 = step.f0, step.f1
        if not options.refresh_slopes:
            f0, f1 = first_slopes
        state = hermite(theta, step.y0, step.y1, f0, f1, step.length)
        time = step.t0 + theta * step.length
        guard = int(candidates[earliest])
        locks[guard] = 1
        crossings.append(Crossing(time, guard, state, locks.copy()))
        if options.tail == "restart":
            return Resolution(time, state, locks, tuple(crossings))
        end = heun3_step(region.slope_in(locks), time, state, t1 - time)
        step = _step(region, time, state, t1, end, locks)
        candidates = region.crossed(t1, end, locks)
    return Resolution(t1, step.y1, locks, tuple(crossings))


def _step(
    region: Region,
    t0: float,
    y0: FloatArray,
    t1: float,
    y1: FloatArray,
    locks: IntArray,
) -> Step:
    f0 = region.slope(t0, y0, locks)
    f1 = region.slope(t1, y1, locks)
    return Step(t0, y0, f0, t1, y1, f1)


def impact_fractions(
    region: Region,
    step: Step,
    locks: IntArray,
    candidates: IntArray,
    options: PrintedOptions,
) -> list[float]:
    """Return where in the step each candidate is crossed, 0 to 1 (Algorithm 6).

    A candidate that is already at or beyond zero at the start has no bracket. This
    happens to guards that cross together when rounding moves one of them. With
    `cross_at_surface` it is crossed there.

    Raises
    ------
    ArithmeticError
        Without `cross_at_surface`, if a candidate has no bracket.
    """
    find = FINDERS[options.root_finder]
    h0, rates0 = region.events(step.t0, step.y0, step.f0, locks)
    h1, rates1 = region.events(step.t1, step.y1, step.f1, locks)
    splines = coefficients(h0, h1, step.length * rates0, step.length * rates1)
    parts = []
    for k in candidates:
        if h0[k] < 0.0:
            parts.append(find(_cubic(splines, k)))
        elif options.cross_at_surface:
            parts.append(0.0)
        else:
            name = region.system.guard_names[k]
            raise ArithmeticError(
                f"no bracket for the root of {name}: it is {h0[k]:g}, not below 0, "
                f"at t = {step.t0}, before it is crossed"
            )
    return parts


def _cubic(splines: tuple[FloatArray, ...], k: int) -> Cubic:
    a, b, c, d = (float(part[k]) for part in splines)
    return a, b, c, d
