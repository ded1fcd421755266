"""Where a Hermite cubic of an event function rises through zero, on the unit interval.

Two finders, as the dissertation names them: the Illinois variant of regula falsi
(section 4.3.3 recommends it), and the closed form (section 4.4.1 says it was used). A
cubic is negative at its start and not negative at its end.
"""

from __future__ import annotations

from collections.abc import Callable
from math import acos, cbrt, copysign, cos, pi, sqrt

from hopdata.hybrid.printed.spline import Cubic, derivative, value

#: Most steps of the Illinois method; its bracket is closed long before.
#: Unit: 1. Origin: chosen: no run for ever.
MOST_ITERATIONS = 100
#: Relative width of a bracket at which the Illinois method is done.
#: Unit: 1. Origin: rounding: half the spacing of floating-point numbers at 1.
SPACING = 2.0**-53
#: How far rounding may put a root of the closed form outside the unit interval.
#: Unit: 1 (of a step). Origin: chosen.
OUTSIDE = 1e-6
#: Newton steps that refine a root of the closed form.
#: Unit: 1. Origin: chosen: they end as soon as the residual grows no smaller.
NEWTON_STEPS = 4


def illinois(cubic: Cubic) -> float:
    """Return a root by the Illinois method (Dowell and Jarratt 1971)."""
    return illinois_root(lambda x: value(cubic, x), 0.0, 1.0)


def illinois_root(function: Callable[[float], float], low: float, high: float) -> float:
    """Return a root in [low, high], where `function` stops being negative.

    If an end is kept twice in a row, its value is halved, so that both ends close in.
    """
    f_low = function(low)
    f_high = function(high)
    if f_low >= 0.0:
        return low
    if f_high <= 0.0:
        return high
    kept = 0  # end kept by the last step: -1 for low, +1 for high
    for _ in range(MOST_ITERATIONS):
        x = (low * f_high - high * f_low) / (f_high - f_low)
        if not low < x < high:
            x = 0.5 * (low + high)
        fx = function(x)
        if fx == 0.0:
            return x
        if fx < 0.0:
            if kept > 0:
                f_high *= 0.5
            low = x
            f_low = fx
            kept = 1
        else:
            if kept < 0:
                f_low *= 0.5
            high = x
            f_high = fx
            kept = -1
        if high - low <= 2.0 * SPACING * high:
            break
    return high


def closed_form(cubic: Cubic) -> float:
    """Return the first root by Cardano's and Viete's formulas, refined by Newton steps.

    On a short step the cubic is nearly linear, so its leading coefficient is nearly
    zero. The formulas are then applied to the cubic of the reciprocal root, whose
    leading coefficient is not. Only roots where the cubic rises count: a guard that has
    just left zero has a falling root directly before the step.
    """
    inside = [
        x
        for x in _real_roots(cubic)
        if -OUTSIDE <= x <= 1.0 + OUTSIDE and derivative(cubic, x) >= 0.0
    ]
    if not inside:
        # Rounding moved all roots out: near an end, or nearly double.
        return illinois(cubic)
    return _polished(cubic, min(max(min(inside), 0.0), 1.0))


def _real_roots(cubic: Cubic) -> list[float]:
    """Return the real roots of a cubic whose leading coefficient may be nearly zero."""
    a, b, c, d = cubic
    if abs(d) < abs(a):
        reciprocal = _monic_roots(b / a, c / a, d / a)
        return [1.0 / x for x in reciprocal if x != 0.0]
    if d == 0.0:
        return []
    return _monic_roots(c / d, b / d, a / d)


def _monic_roots(b: float, c: float, d: float) -> list[float]:
    """Return the real roots of x^3 + b x^2 + c x + d."""
    shift = b / 3.0
    p = c / 3.0 - shift * shift  # x = z - shift: z^3 + 3 p z + 2 q
    q = 0.5 * (2.0 * shift * shift * shift - shift * c + d)
    discriminant = q * q + p * p * p
    if discriminant < 0.0:
        radius = sqrt(-p)
        angle = acos(max(-1.0, min(1.0, q / (p * radius)))) / 3.0
        return [
            2.0 * radius * cos(angle - k * 2.0 * pi / 3.0) - shift for k in range(3)
        ]
    u = -cbrt(q + copysign(sqrt(discriminant), q))
    partner = 0.0
    if u != 0.0:
        partner = u - p / u
    return [partner - shift]


def _polished(cubic: Cubic, x: float) -> float:
    """Take Newton steps within the interval while they reduce the size of the cubic."""
    residual = value(cubic, x)
    for _ in range(NEWTON_STEPS):
        slope = derivative(cubic, x)
        new = x
        if slope != 0.0:
            new = min(max(x - residual / slope, 0.0), 1.0)
        if abs(value(cubic, new)) >= abs(residual):
            break
        x = new
        residual = value(cubic, new)
    return x


FINDERS: dict[str, Callable[[Cubic], float]] = {
    "illinois": illinois,
    "cubic": closed_form,
}
