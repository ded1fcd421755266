"""Dormand-Prince 5(4) in plain Python, one step at a time (the solver of section 4.4.1).

Source: Hairer, Norsett, Wanner, *Solving Ordinary Differential Equations I*, table II.5.2, and
section II.4 for the control of the step size.
"""

from __future__ import annotations

import math

import numpy as np

from hopdata.hybrid.printed.classical import Slope
from hopdata.hybrid.solution import FloatArray

C = (0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0)
A = (
    np.array([]),
    np.array([1 / 5]),
    np.array([3 / 40, 9 / 40]),
    np.array([44 / 45, -56 / 15, 32 / 9]),
    np.array([19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729]),
    np.array([9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656]),
)
B = np.array([35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84])
E = np.array([71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])
SAFETY, LEAST, MOST = 0.9, 0.2, 10.0


def dopri5_step(
    slope: Slope, t: float, y: FloatArray, f: FloatArray, dt: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return state and slope after a step whose first slope is f, and the estimated error, (n,)."""
    k = np.empty((7, len(y)))
    k[0] = f
    for stage in range(1, 6):
        k[stage] = slope(t + C[stage] * dt, y + dt * (A[stage] @ k[:stage]))
    end = y + dt * (B @ k[:6])
    k[6] = slope(t + dt, end)
    return end, k[6], dt * (E @ k)


class Dopri5:
    """Dormand-Prince 5(4) with error control, forwards in time.

    Parameters
    ----------
    fun : callable
        Field ``fun(t, y) -> (n,) array``.
    t0, t_bound : float
        Start and end, s.
    y0 : (n,) array
        State at the start.
    rtol, atol : float
        A step's error, component by component, against ``atol + rtol max(|y|)``: root mean square.
    max_step : float
        Longest step, s.
    first_step : float, optional
        First one, s. By default a guess from the slope and the tolerance.
    """

    def __init__(
        self,
        fun: Slope,
        t0: float,
        y0: FloatArray,
        t_bound: float,
        *,
        rtol: float = 1e-6,
        atol: float = 1e-9,
        max_step: float = math.inf,
        first_step: float | None = None,
    ) -> None:
        if not max_step > 0 or not (first_step is None or first_step > 0):
            raise ValueError(f"max_step, first_step: expected > 0, found {max_step}, {first_step}")
        self.t, self.y, self.t_bound = t0, np.array(y0, dtype=np.float64), t_bound
        self.status = "running" if t0 < t_bound else "finished"
        self._fun, self._rtol, self._atol, self._max_step = fun, rtol, atol, max_step
        self._slope = fun(t0, self.y)
        self._next = self._first_guess() if first_step is None else first_step

    def step(self) -> str | None:
        """Take one step that meets the tolerance; say why if there is none."""
        while True:
            dt = min(self._next, self._max_step)
            t = self.t + dt
            if not t < self.t_bound:
                t, dt = self.t_bound, self.t_bound - self.t
            if t <= self.t:
                self.status = "failed"
                return "the step fell below the spacing of floating-point times"
            end, slope, deviation = dopri5_step(self._fun, self.t, self.y, self._slope, dt)
            error = self._norm(deviation, end)
            self._next = dt * _factor(error)
            if error <= 1.0:
                break
        self.t, self.y, self._slope = t, end, slope
        if t >= self.t_bound:
            self.status = "finished"
        return None

    def _norm(self, deviation: FloatArray, end: FloatArray) -> float:
        scale = self._atol + self._rtol * np.maximum(np.abs(self.y), np.abs(end))
        return float(np.sqrt(np.mean((deviation / scale) ** 2)))

    def _first_guess(self) -> float:
        scale = self._atol + self._rtol * np.abs(self.y)
        size, speed = (float(np.max(np.abs(v) / scale)) for v in (self.y, self._slope))
        return 0.01 * size / speed if min(size, speed) > 1e-5 else 1e-6


def _factor(error: float) -> float:
    """Return by what the step may grow; an error that is not a number shrinks it most."""
    if not math.isfinite(error):
        return LEAST
    return MOST if error == 0.0 else min(MOST, max(LEAST, SAFETY * error**-0.2))
