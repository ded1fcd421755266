"""Where the cubic through two values and two slopes of an event function turns, or vanishes.

All functions work on the unit interval: slopes are per step, not per second.
"""

from __future__ import annotations

from math import sqrt

from hopdata.hybrid.compiled.kernel import kernel

NOWHERE = 2.0
ITERATIONS, ACCURACY = 40, 1e-4  # of the last root but one: Newton doubles the digits


@kernel
def cubic(g0: float, d0: float, g1: float, d1: float, x: float) -> float:
    """Return the value at `x` of the cubic with values g0, g1 and slopes d0, d1 at 0 and 1."""
    rise = g1 - g0
    return g0 + x * (d0 + x * (3.0 * rise - 2.0 * d0 - d1 + x * (d0 + d1 - 2.0 * rise)))


@kernel
def turning_points(g0: float, d0: float, g1: float, d1: float) -> tuple[float, float]:
    """Return where in (0, 1) the cubic has its maximum and its minimum; NOWHERE if it has none."""
    rise = g1 - g0
    a = 3.0 * (d0 + d1 - 2.0 * rise)
    b = 3.0 * rise - 2.0 * d0 - d1  # slope = d0 + 2 b x + a x^2
    root = b * b - a * d0
    if root <= 0.0:
        return NOWHERE, NOWHERE
    # At the minimum the slope rises, 2 b + 2 a x = +2 sqrt(root); at the maximum it falls.
    q = -(b + sqrt(root)) if b >= 0.0 else sqrt(root) - b
    near, far = d0 / q, NOWHERE
    if a != 0.0:
        far = q / a
    minimum, maximum = (near, far) if b >= 0.0 else (far, near)
    if not 0.0 < minimum < 1.0:
        minimum = NOWHERE
    if not 0.0 < maximum < 1.0:
        maximum = NOWHERE
    return maximum, minimum


@kernel
def falling_root(g0: float, d0: float, g1: float, d1: float) -> float:
    """Return about where a function that falls from g0 > 0 to g1 < 0 vanishes; else NOWHERE.

    By the cubic through places and slopes of the inverse function: no iteration.
    """
    if d0 < 0.0 and d1 < 0.0 and g1 < 0.0 < g0:
        rise = g1 - g0
        return cubic(0.0, rise / d0, 1.0, rise / d1, -g0 / rise)
    return NOWHERE


@kernel
def cubic_root(g0: float, d0: float, g1: float, d1: float, low: float, high: float) -> float:
    """Return a root in [low, high], where the cubic falls from above to below zero."""
    rise = g1 - g0
    b, a = 3.0 * rise - 2.0 * d0 - d1, 3.0 * (d0 + d1 - 2.0 * rise)
    x = falling_root(g0, d0, g1, d1)
    if not low < x < high:
        x = 0.5 * (low + high)
    for _ in range(ITERATIONS):
        value, slope = cubic(g0, d0, g1, d1, x), d0 + x * (2.0 * b + x * a)
        if value > 0.0:
            low = x
        else:
            high = x
        new = x - value / slope if slope < 0.0 else NOWHERE  # a rise leads away from the root
        inside = low < new < high
        if abs(new - x) <= ACCURACY * x:
            return new if inside else x
        x = new if inside else 0.5 * (low + high)
    return x
