"""One-step methods in plain NumPy: Heun's third-order, Runge and Kutta's, and DOPRI5.

Each takes a slope, a time, s, a state (n,) and the length of the step, s, as
`hopdata.hybrid.printed.FixedSteps` asks for it.
"""

from __future__ import annotations

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.hybrid.methods.explicit import DOPRI5
from hopdata.hybrid.printed.region import Slope


def heun3_step(slope: Slope, t: float, y: FloatArray, dt: float) -> FloatArray:
    """Return the state after one step of Heun's third-order method.

    It is the tail of Algorithm 5 (Hairer, Norsett and Wanner I, table II.1.1).
    """
    first = slope(t, y)
    second = slope(t + dt / 3.0, y + dt / 3.0 * first)
    third = slope(t + 2.0 * dt / 3.0, y + 2.0 * dt / 3.0 * second)
    return y + 0.25 * dt * (first + 3.0 * third)


def rk4_step(slope: Slope, t: float, y: FloatArray, dt: float) -> FloatArray:
    """Return the state after one step of the classical fourth-order method."""
    first = slope(t, y)
    second = slope(t + 0.5 * dt, y + 0.5 * dt * first)
    third = slope(t + 0.5 * dt, y + 0.5 * dt * second)
    fourth = slope(t + dt, y + dt * third)
    return y + dt / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)


def dopri5_step(slope: Slope, t: float, y: FloatArray, dt: float) -> FloatArray:
    """Return the state after one step of Dormand and Prince's fifth-order method.

    Without its error estimate. It is the classical solver of section 4.4.1.
    """
    slopes = [slope(t, y)]
    for row, node in zip(DOPRI5.stages, DOPRI5.nodes, strict=True):
        inside = y + dt * (np.array(row) @ np.array(slopes))
        slopes.append(slope(t + node * dt, inside))
    return y + dt * (np.array(DOPRI5.weights) @ np.array(slopes))
