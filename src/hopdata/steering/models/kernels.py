"""Covariance functions of boom angle, swing and what came before.

A kernel is a function of the scaled squared distance between two hops,
``s = sum of (difference / length scale)^2``. In the boom angle the difference is that of the angles
themselves, or the chord between their points on the unit circle, which makes all predictions
periodic without any copies of the data.

The Matern family (Rasmussen and Williams 2006, Sec. 4.2) is here for smoothness 1/2, 3/2, 5/2 and,
as its limit, the Gaussian kernel ("rbf", infinity).
"""

from __future__ import annotations

from math import exp, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.code_cache import kept_njit
from hopdata.errors import ConfigError

FloatArray = NDArray[np.float64]

SMOOTHNESSES = (0.5, 1.5, 2.5, np.inf)

_ROOT3, _ROOT5 = sqrt(3.0), sqrt(5.0)


def kernel_code(smoothness: float) -> int:
    """Return the number by which compiled code knows a smoothness: its place in SMOOTHNESSES.

    Raises
    ------
    ConfigError
        If it is none of them.
    """
    if smoothness not in SMOOTHNESSES:
        raise ConfigError(
            f"smoothness: expected one of {', '.join(map(str, SMOOTHNESSES))}, found {smoothness}"
        )
    return SMOOTHNESSES.index(smoothness)


def embedded(inputs: ArrayLike, periodic: bool) -> FloatArray:
    """Return inputs (n, d) with the boom angle, the first, as a point on the circle: (n, d + 1).

    Left as they are unless `periodic`.
    """
    inputs = np.asarray(inputs, dtype=float)
    if not periodic:
        return inputs
    angle = inputs[:, :1]
    return np.concatenate([np.cos(angle), np.sin(angle), inputs[:, 1:]], axis=1)


def embedded_scales(length_scales: ArrayLike, periodic: bool) -> FloatArray:
    """Return the length scales (..., d) of the embedded inputs: cosine and sine share theirs."""
    scales = np.asarray(length_scales, dtype=float)
    return np.concatenate([scales[..., :1], scales], axis=-1) if periodic else scales


def squared_distances(a: FloatArray, b: FloatArray, scales: FloatArray) -> FloatArray:
    """Return scaled squared distances (n, m) of embedded inputs (n, e) and (m, e)."""
    squared = np.zeros((len(a), len(b)))
    for column_a, column_b in zip((a / scales).T, (b / scales).T, strict=True):
        squared += (column_a[:, None] - column_b) ** 2
    return squared


def correlation(squared: FloatArray, smoothness: float) -> FloatArray:
    """Return the kernel, 1 at distance zero, of scaled squared distances."""
    if smoothness == np.inf:
        return np.asarray(np.exp(-squared / 2))
    r = np.sqrt(2 * smoothness * squared)
    polynomial = {0.5: 1.0, 1.5: 1 + r, 2.5: 1 + r + r**2 / 3}[smoothness]
    return np.asarray(polynomial * np.exp(-r))


@kept_njit(error_model="numpy")
def correlation_and_slope(squared, code):  # type: ignore[no-untyped-def]
    """Return the kernel and its derivative by the squared distance; `code` is `kernel_code`.

    At distance zero the kernel of smoothness 1/2 has a kink, and its derivative is given as 0.
    """
    if code == 1:
        r = _ROOT3 * sqrt(squared)
        decay = exp(-r)
        return (1.0 + r) * decay, -1.5 * decay
    if code == 2:
        r = _ROOT5 * sqrt(squared)
        decay = exp(-r)
        return (1.0 + r + r * r / 3.0) * decay, -(5.0 / 6.0) * (1.0 + r) * decay
    if code == 3:
        decay = exp(-0.5 * squared)
        return decay, -0.5 * decay
    r = sqrt(squared)
    decay = exp(-r)
    return decay, (-0.5 * decay / r if r > 0.0 else 0.0)
