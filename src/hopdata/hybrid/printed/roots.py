"""Root of a cubic on the unit interval, at whose ends it is negative and not negative."""

from __future__ import annotations

from collections.abc import Callable
from math import acos, cbrt, copysign, cos, pi, sqrt

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
