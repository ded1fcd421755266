"""An event on a trajectory that is known in closed form, to measure errors against."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hopdata.hybrid.solution import FloatArray


@dataclass(frozen=True)
class KnownEvent:
    """A trajectory known in closed form, and a quadratic event function that it crosses.

    Parameters
    ----------
    slope : callable
        Field ``slope(t, y) -> (n,)``.
    derivative : callable
        ``derivative(k, t) -> (n, ...)``: k-th derivative of the solution at times t (...).
    hessian : (n, n) array
        Symmetric H of h(y) = y H y / 2 + gradient y + offset.
    gradient : (n,) array
        See there.
    offset : float
        See there.
    time : float
        Instant t* of the event, s.
    """

    slope: Callable[[float, FloatArray], FloatArray]
    derivative: Callable[[int, FloatArray], FloatArray]
    hessian: FloatArray
    gradient: FloatArray
    offset: float
    time: float

    def height(self, y: FloatArray) -> float:
        """Return h at a state (n,)."""
        return float(0.5 * y @ self.hessian @ y + self.gradient @ y + self.offset)

    def rate(self, y: FloatArray, dy: FloatArray) -> float:
        """Return the rate of h at a state that moves at dy, 1/s."""
        return float((self.hessian @ y + self.gradient) @ dy)


def turning_point() -> KnownEvent:
    """Return a point on a helix that closes in on a plane, and a paraboloid that it crosses."""
    time, instant = 0.7, np.array(0.7)
    hessian = np.array([[0.6, 0.2, 0.0], [0.2, -0.4, 0.3], [0.0, 0.3, 0.5]])
    gradient = np.array([-0.3, 1.5, -0.4])
    y = turning_derivative(0, instant)
    offset = -float(0.5 * y @ hessian @ y + gradient @ y)
    return KnownEvent(turning_slope, turning_derivative, hessian, gradient, offset, time)


def turning_slope(_: float, y: FloatArray) -> FloatArray:
    """Return the field of the helix: a rotation of two components, the decay of the third."""
    return np.array([-y[1], y[0], -y[2]])


def turning_derivative(k: int, t: FloatArray) -> FloatArray:
    """Return the k-th derivative (3, ...) of (cos t, sin t, exp(-t))."""
    turned = t + k * np.pi / 2
    return np.array([np.cos(turned), np.sin(turned), (-1) ** k * np.exp(-t)])
