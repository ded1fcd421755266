"""Errors of a map of strides, learned as they appear: a regression with forgetting."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.steering.strides import COMPONENTS, StrideAxes

#: Harmonics of the correction in a periodic state.
#: Unit: 1. Origin: chosen.
HARMONICS = 2
#: Degree of the correction in a linear state and in an input.
#: Unit: 1. Origin: chosen.
DEGREE = 2
#: Prior deviation of the correction's constant, in deviations of a stride.
#: Unit: 1. Origin: chosen.
FIRST_SD = 3.0
#: Factor of the prior deviation with each harmonic and each degree.
#: Unit: 1. Origin: chosen.
FALL_OFF = 0.5
#: Number of strides after which an unconfirmed correction is forgotten.
#: Unit: strides. Origin: chosen.
MEMORY_HOPS = 60.0
#: Largest miss that is learned from, in expected deviations: larger ones come from
#: disturbances, and are clipped to this.
#: Unit: 1. Origin: chosen.
FARTHEST_SD = 8.0


class Correction:
    """Correction added to a map: a Bayesian linear model, updated stride by stride.

    It is a Kalman filter. Its functions are products of waves of the periodic states
    and powers of the linear states and the inputs. Over `MEMORY_HOPS` strides its
    coefficients decay to zero and their covariance returns to its initial value (an
    Ornstein-Uhlenbeck prior). Memory and time per stride stay constant.

    Parameters
    ----------
    axes : StrideAxes
    noise : (3,) array
        Standard deviation of a stride's random part, m, m, rad.
    state_limits : sequence of (float, float)
        Least and largest value of each linear state.
    """

    def __init__(
        self,
        axes: StrideAxes,
        noise: FloatArray,
        state_limits: Sequence[tuple[float, float]] = (),
    ) -> None:
        self.noise = noise
        self._n_periodic = len(axes.periodic)
        spans = [*state_limits, *zip(axes.lower, axes.upper, strict=True)]
        lower, upper = np.array(spans).T
        self._middle = (lower + upper) / 2
        self._half = (upper - lower) / 2
        # The constant wave has order 0, cosine and sine of a harmonic have its order.
        harmonics = (np.arange(2 * HARMONICS + 1) + 1) // 2
        degrees = np.arange(DEGREE + 1)
        orders = np.zeros(1, dtype=int)
        for of_axis in [harmonics] * self._n_periodic + [degrees] * len(spans):
            orders = np.add.outer(of_axis, orders).ravel()
        self._first = np.diag((FIRST_SD * FALL_OFF**orders) ** 2)
        self.covariance = self._first.copy()  # (k, k), the same for all three
        n_functions = len(self._first)
        # In units of the noise.
        self.coefficients = np.zeros((n_functions, len(COMPONENTS)))

    def functions(self, points: FloatArray) -> FloatArray:
        """Return basis functions (..., k) at states and inputs (..., S + U)."""
        products = np.ones((*points.shape[:-1], 1))
        for angle in np.moveaxis(points[..., : self._n_periodic], -1, 0):
            waves = [np.ones_like(angle)]
            for harmonic in range(1, HARMONICS + 1):
                waves += [np.cos(harmonic * angle), np.sin(harmonic * angle)]
            products = _products(np.stack(waves, axis=-1), products)
        shares = (points[..., self._n_periodic :] - self._middle) / self._half
        for share in np.moveaxis(shares, -1, 0):
            powers = share[..., None] ** np.arange(DEGREE + 1)
            products = _products(powers, products)
        return products

    def added(self, functions: FloatArray) -> FloatArray:
        """Return the correction, (..., 3), m, m, rad, by basis functions (..., k)."""
        return np.asarray(functions @ self.coefficients * self.noise)

    def learn(self, point: FloatArray, missed: FloatArray) -> None:
        """Update it with the error (3,) of the uncorrected map in a stride.

        Parameters
        ----------
        point : (S + U,) array
            States and inputs of the stride.
        missed : (3,) array
        """
        kept = np.exp(-1.0 / MEMORY_HOPS)
        self.coefficients *= kept
        self.covariance = kept**2 * self.covariance + (1 - kept**2) * self._first
        functions = self.functions(point)
        gain = self.covariance @ functions
        # Variance of the innovation: of the correction, and of the stride itself.
        variance = float(functions @ gain) + 1.0
        most = FARTHEST_SD * variance**0.5
        innovation = missed / self.noise - functions @ self.coefficients
        innovation = np.clip(innovation, -most, most)
        self.coefficients += np.outer(gain / variance, innovation)
        self.covariance -= np.outer(gain, gain) / variance


def _products(of_axis: FloatArray, others: FloatArray) -> FloatArray:
    """Return all products (..., m k) of functions (..., m) and (..., k)."""
    products = of_axis[..., :, None] * others[..., None, :]
    return np.asarray(products.reshape(*others.shape[:-1], -1))
