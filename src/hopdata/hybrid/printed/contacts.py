"""All events of one step, one after the other (Algorithms 5 and 6, with their errata)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hopdata.hybrid.printed.classical import Slope
from hopdata.hybrid.printed.hermite import coefficients, hermite
from hopdata.hybrid.printed.options import PrintedOptions
from hopdata.hybrid.printed.region import Region
from hopdata.hybrid.printed.roots import FINDERS
from hopdata.hybrid.solution import FloatArray, IntArray


@dataclass(frozen=True)
class Crossing:
    """One guard crossed: instant, s, number of the guard, state (n,), locks (m,) after it."""

    time: float
    guard: int
    state: FloatArray
    locks: IntArray


@dataclass(frozen=True)
class Resolution:
    """End of a step with its events: state (n,), locks (m,), and the crossings in order."""

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

    The guard with the earliest root of its spline is crossed first, the state there is
    interpolated, and one third-order step in the new mode leads to the end again, until no guard
    is left that has changed sign. That step has no error control: the caller bounds its length.

    Parameters
    ----------
    region : Region
        Field and event functions.
    t0, t1 : float
        Ends of the step, s.
    y0, y1 : (n,) array
        States there; the second is what the mode at the start led to.
    locks : (m,) array of int
        -1 for guards that are not crossed at t0, +1 for those that are.
    options : PrintedOptions, optional
        Root finder, and whether slopes are refreshed.

    Returns
    -------
    Resolution
        True state and locks at t1. As each crossing sets one lock for good, there are at most m.
    """
    options = options or PrintedOptions()
    locks = locks.copy()
    crossings: list[Crossing] = []
    kept = f0, f1 = region.slope(t0, y0, locks), region.slope(t1, y1, locks)
    candidates = region.crossed(t1, y1, locks)
    while len(candidates) > 0:
        dt = t1 - t0
        parts = impact_fractions(region, t0, y0, f0, t1, y1, f1, locks, candidates, options)
        first = int(np.argmin(parts))
        y0 = hermite(parts[first], y0, y1, *(kept if not options.refresh_slopes else (f0, f1)), dt)
        t0 = t0 + parts[first] * dt
        locks[candidates[first]] = 1
        crossings.append(Crossing(t0, int(candidates[first]), y0, locks.copy()))
        f0 = region.slope(t0, y0, locks)
        y1 = heun3_step(region.slope_in(locks), t0, y0, f0, t1 - t0)
        f1 = region.slope(t1, y1, locks)
        candidates = region.crossed(t1, y1, locks)
    return Resolution(y1, locks, tuple(crossings))


def impact_fractions(
    region: Region,
    t0: float,
    y0: FloatArray,
    f0: FloatArray,
    t1: float,
    y1: FloatArray,
    f1: FloatArray,
    locks: IntArray,
    candidates: IntArray,
    options: PrintedOptions,
) -> list[float]:
    """Return where in the step each candidate is crossed, 0 to 1 (Algorithm 6).

    A candidate that is at or beyond zero at the start already, as guards that cross together are
    once rounding has moved one of them, has no bracket: it is crossed at the start.
    """
    find, dt = FINDERS[options.root_finder], t1 - t0
    h0, rates0 = region.events(t0, y0, f0, locks)
    h1, rates1 = region.events(t1, y1, f1, locks)
    splines = coefficients(h0, h1, dt * rates0, dt * rates1)
    return [
        find(tuple(float(part[k]) for part in splines)) if h0[k] < 0.0 else 0.0  # type: ignore[arg-type]
        for k in candidates
    ]


def heun3_step(slope: Slope, t: float, y: FloatArray, f: FloatArray, dt: float) -> FloatArray:
    """Return the state after one step of Heun's third-order method, whose first slope is f."""
    second = slope(t + dt / 3.0, y + dt / 3.0 * f)
    third = slope(t + 2.0 * dt / 3.0, y + 2.0 * dt / 3.0 * second)
    return y + 0.25 * dt * (f + 3.0 * third)
