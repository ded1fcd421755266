"""Cubic Hermite splines on one step (Definition 4.2.2), as values and as coefficients.

The formula is that of Hairer, Norsett and Wanner I, equation II.6.7, which the
dissertation cites.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Value = TypeVar("Value", float, NDArray[np.float64])
# Coefficients of 1, theta, theta^2 and theta^3.
Cubic = tuple[float, float, float, float]


def hermite(
    theta: float, y0: Value, y1: Value, f0: Value, f1: Value, dt: float
) -> Value:
    """Return the cubic with values y0, y1 and slopes f0, f1 at the ends of a step.

    Parameters
    ----------
    theta : float
        Position in the step, 0 to 1.
    y0, y1 : float or (n,) array
        Values at the start and end of the step.
    f0, f1 : float or (n,) array
        Slopes at the start and end, per second.
    dt : float
        Length of the step, s.
    """
    rise = y1 - y0
    bend = (1.0 - 2.0 * theta) * rise + dt * ((theta - 1.0) * f0 + theta * f1)
    return (1.0 - theta) * y0 + theta * y1 + theta * (theta - 1.0) * bend


def coefficients(
    y0: Value, y1: Value, d0: Value, d1: Value
) -> tuple[Value, Value, Value, Value]:
    """Return the cubic's coefficients of 1, theta, theta^2 and theta^3.

    Parameters
    ----------
    y0, y1 : float or (n,) array
        Values at the start and end of the step.
    d0, d1 : float or (n,) array
        Slopes there, per step (not per second).
    """
    rise = y1 - y0
    return y0, d0, 3.0 * rise - 2.0 * d0 - d1, d0 + d1 - 2.0 * rise


def value(cubic: Cubic, x: float) -> float:
    """Return a + b x + c x^2 + d x^3."""
    a, b, c, d = cubic
    return a + x * (b + x * (c + x * d))


def derivative(cubic: Cubic, x: float) -> float:
    """Return b + 2 c x + 3 d x^2."""
    _, b, c, d = cubic
    return b + x * (2.0 * c + x * 3.0 * d)
