"""Cubic Hermite interpolation on one step (Hairer, Norsett, Wanner I, equation II.6.7)."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

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
