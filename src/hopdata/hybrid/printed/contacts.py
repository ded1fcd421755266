"""All events of one step, one after the other (Algorithms 5 and 6, with their errata)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import acos, cbrt, copysign, cos, pi, sqrt
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid.printed.classical import PrintedOptions, Region, Slope

# Cubic Hermite interpolation on one step (Hairer, Norsett, Wanner I, equation II.6.7).

Value = TypeVar("Value", float, NDArray[np.float64])


def hermite(theta: float, y0: Value, y1: Value, f0: Value, f1: Value, dt: float) -> Value:
    """Return the cubic with values y0, y1 and slopes f0, f1 at the ends of a step.

    Parameters
    ----------
    theta : float
        Where in the step, 0 to 1.
    y0, y1 : float or (n,) array
        Values at its start and end.
    f0, f1 : float or (n,) array
        Slopes there, per second.
    dt : float
        Length of the step, s.
    """
    rise = y1 - y0
    bend = (1.0 - 2.0 * theta) * rise + dt * ((theta - 1.0) * f0 + theta * f1)
    return (1.0 - theta) * y0 + theta * y1 + theta * (theta - 1.0) * bend


def coefficients(y0: Value, y1: Value, d0: Value, d1: Value) -> tuple[Value, Value, Value, Value]:
    """Return the same cubic's coefficients of 1, theta, theta^2, theta^3; slopes are per step."""
    rise = y1 - y0
    return y0, d0, 3.0 * rise - 2.0 * d0 - d1, d0 + d1 - 2.0 * rise


# Root of a cubic on the unit interval, at whose ends it is negative and not negative.

MOST_ITERATIONS = 100
SPACING = 2.0**-53
OUTSIDE = 1e-6  # by so much may rounding put a root of the closed form outside the interval

Cubic = tuple[float, float, float, float]


def value(cubic: Cubic, x: float) -> float:
    """Return a + b x + c x^2 + d x^3."""
    a, b, c, d = cubic
    return a + x * (b + x * (c + x * d))


def derivative(cubic: Cubic, x: float) -> float:
    """Return b + 2 c x + 3 d x^2."""
    _, b, c, d = cubic
    return b + x * (2.0 * c + x * 3.0 * d)


def illinois(cubic: Cubic) -> float:
    """Return a root by the Illinois variant of regula falsi (Dowell and Jarratt 1971)."""
    return illinois_root(lambda x: value(cubic, x), 0.0, 1.0)


def illinois_root(function: Callable[[float], float], low: float, high: float) -> float:
    """Return a root in [low, high], where `function` goes from negative to not negative.

    An end that is kept twice in a row has its value halved, so that both ends close in.
    """
    f_low, f_high = function(low), function(high)
    if f_low >= 0.0:
        return low
    if f_high <= 0.0:
        return high
    kept = 0  # which end the last step kept: -1 the low one, +1 the high one
    for _ in range(MOST_ITERATIONS):
        x = (low * f_high - high * f_low) / (f_high - f_low)
        if not low < x < high:
            x = 0.5 * (low + high)
        fx = function(x)
        if fx == 0.0:
            return x
        if fx < 0.0:
            low, f_low, f_high = x, fx, 0.5 * f_high if kept > 0 else f_high
            kept = 1
        else:
            high, f_high, f_low = x, fx, 0.5 * f_low if kept < 0 else f_low
            kept = -1
        if high - low <= 2.0 * SPACING * high:
            break
    return high


def closed_form(cubic: Cubic) -> float:
    """Return the first root by Cardano's and Viete's formulas, made accurate by Newton steps.

    On a short step the cubic is nearly a line, so that its leading coefficient is nearly zero; the
    formulas are then applied to the reciprocal of the root, whose leading coefficient is not.
    Only roots where the cubic rises count: a guard that has just left zero has one where it falls,
    directly before the step.
    """
    a, b, c, d = cubic
    if abs(d) >= abs(a):
        roots = _monic_roots(c / d, b / d, a / d) if d != 0.0 else []
    else:
        reciprocal = _monic_roots(b / a, c / a, d / a)
        roots = [1.0 / x for x in reciprocal if x != 0.0]
    inside = [x for x in roots if -OUTSIDE <= x <= 1.0 + OUTSIDE and derivative(cubic, x) >= 0.0]
    if not inside:
        return illinois(cubic)  # rounding has moved all roots out: next to an end, or nearly double
    return _polished(cubic, min(max(min(inside), 0.0), 1.0))


def _monic_roots(b: float, c: float, d: float) -> list[float]:
    """Return the real roots of x^3 + b x^2 + c x + d."""
    shift = b / 3.0
    p = c / 3.0 - shift * shift  # x = z - shift: z^3 + 3 p z + 2 q
    q = 0.5 * (2.0 * shift * shift * shift - shift * c + d)
    discriminant = q * q + p * p * p
    if discriminant < 0.0:
        radius = sqrt(-p)
        angle = acos(max(-1.0, min(1.0, q / (p * radius)))) / 3.0
        return [2.0 * radius * cos(angle - k * 2.0 * pi / 3.0) - shift for k in range(3)]
    u = -cbrt(q + copysign(sqrt(discriminant), q))
    return [(u - p / u if u != 0.0 else 0.0) - shift]


def _polished(cubic: Cubic, x: float) -> float:
    """Take Newton steps within the interval for as long as they make the cubic smaller."""
    residual = value(cubic, x)
    for _ in range(4):
        slope = derivative(cubic, x)
        new = min(max(x - residual / slope, 0.0), 1.0) if slope != 0.0 else x
        if abs(value(cubic, new)) >= abs(residual):
            break
        x, residual = new, value(cubic, new)
    return x


FINDERS: dict[str, Callable[[Cubic], float]] = {"illinois": illinois, "cubic": closed_form}


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
