"""Polynomials through the frames near an instant, which need not be evenly spaced."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class LocalFit:
    """A polynomial in the time from `middle_s`.

    Parameters
    ----------
    middle_s : float
    first_s, last_s : float
        Times of the outermost frames.
    coefficients : (d + 1,) or (d + 1, m) array
        From the constant on; a column for each of m quantities.
    """

    middle_s: float
    first_s: float
    last_s: float
    coefficients: FloatArray

    def at(self, time_s: float, derivative: int = 0) -> FloatArray:
        """Value, or a derivative, at a time, () or (m,)."""
        found = np.polynomial.polynomial.polyder(self.coefficients, derivative)
        return np.asarray(np.polynomial.polynomial.polyval(time_s - self.middle_s, found))

    def lowest(self) -> float | None:
        """Instant of the minimum of a parabola or cubic, s; None unless it is within the frames."""
        c, b, a = np.polynomial.polynomial.polyder(np.append(self.coefficients, [0.0, 0.0])[:4])
        square = b * b - 4 * a * c  # of the curvature at the extrema
        if square <= 0:
            return None
        bend = np.sqrt(square)
        if b + bend > 0:
            instant = self.middle_s - 2 * c / (b + bend)
        elif a != 0:
            instant = self.middle_s + (bend - b) / (2 * a)
        else:
            return None
        return float(instant) if self.first_s <= instant <= self.last_s else None


def local_fit(
    time: FloatArray, values: FloatArray, begin_s: float, end_s: float, *, degree: int
) -> LocalFit | None:
    """Fit polynomials by least squares to the frames between two times.

    Parameters
    ----------
    time : (N,) array
        In order, s.
    values : (N,) or (N, m) array
        All known.
    begin_s, end_s : float
        Ends of the window, s; frames on them count.
    degree : int

    Returns
    -------
    LocalFit or None
        None if there are too few frames.
    """
    first, last = np.searchsorted(time, [begin_s - 1e-9, end_s + 1e-9])
    if last - first < degree + 1:
        return None
    half_s, middle_s = 0.5 * (end_s - begin_s), 0.5 * (begin_s + end_s)
    powers = np.arange(degree + 1)
    design = ((time[first:last] - middle_s) / half_s)[:, None] ** powers
    found = np.linalg.lstsq(design, values[first:last], rcond=None)[0]
    scaled = (found.T * half_s ** -powers.astype(float)).T
    return LocalFit(middle_s, float(time[first]), float(time[last - 1]), scaled)
