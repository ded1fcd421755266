"""Polynomials through the frames near an instant, which need not be evenly spaced."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class LocalFit:
    """A polynomial in the time from `middle_s`, coefficients (d + 1,) from the constant on.

    `first_s` and `last_s` are the times of the outermost frames.
    """

    middle_s: float
    first_s: float
    last_s: float
    coefficients: FloatArray

    def at(self, time_s: float) -> tuple[float, float, float]:
        """Value and first two derivatives at a time."""
        polynomial = np.polynomial.Polynomial(self.coefficients)
        s = time_s - self.middle_s
        value, slope, bend = (
            float(polynomial.deriv(n)(s)) if n else float(polynomial(s)) for n in range(3)
        )
        return value, slope, bend

    def extremum(self) -> float | None:
        """Instant of the minimum within the frames, s; None if there is none."""
        slope = np.polynomial.Polynomial(self.coefficients).deriv()
        roots = slope.roots()
        real = roots.real[np.abs(roots.imag) < 1e-12]
        low = real[slope.deriv()(real) > 0] + self.middle_s
        low = low[(low >= self.first_s) & (low <= self.last_s)]
        return float(low[np.argmin(np.abs(low - self.middle_s))]) if low.size else None


def local_fit(
    time: FloatArray, values: FloatArray, middle_s: float, half_s: float, *, degree: int
) -> LocalFit | None:
    """Fit a polynomial by least squares to frames within a time of an instant.

    Parameters
    ----------
    time, values : (N,) array
        In order of time; all known.
    middle_s, half_s : float
        Middle and half length of the window, s.
    degree : int

    Returns
    -------
    LocalFit or None
        None if there are too few frames, or none on one side of the middle.
    """
    first = np.searchsorted(time, middle_s - half_s - 1e-9)
    last = np.searchsorted(time, middle_s + half_s + 1e-9)
    s = time[first:last] - middle_s
    if len(s) < degree + 1 or s[0] >= 0 or s[-1] <= 0:
        return None
    scale = half_s ** -np.arange(degree + 1.0)
    design = s[:, None] ** np.arange(degree + 1) * scale
    found = np.linalg.lstsq(design, values[first:last], rcond=None)[0]
    return LocalFit(middle_s, float(time[first]), float(time[last - 1]), found * scale)
