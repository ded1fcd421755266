"""Whether the kinks are zero: a sign-flipping score test.

If the map has one derivative, each landing's contribution to the kinks is as likely to have the
other sign. Flipping the signs at random gives the distribution of the statistic whatever the
scatter of the landings, equal or not (Hemerik, Goeman and Finos 2020). Smooth terms beyond those
fitted enter as random contributions of the size that was estimated for them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.maps.verdict.estimate import KinkFit

_AT_ONCE = 4000  # sign patterns in memory

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class KinkTest:
    """Result of the test.

    Attributes
    ----------
    statistic
        Squared length of the kinks in units of their null covariance.
    degrees_of_freedom
        Number of coefficients: its expectation if there are no kinks.
    p_value
        Share of the sign flips with a statistic as large, the data's own included.
    flips
        Number of random sign patterns.
    """

    statistic: float
    degrees_of_freedom: int
    p_value: float
    flips: int

    @property
    def p_text(self) -> str:
        """The p-value as printed: a bound where no random sign pattern came as far."""
        least = self.p_value * (1 + self.flips) < 1.5
        return f"p {'<=' if least else '='} {self.p_value:.2g}"


def flip_signs(fit: KinkFit, *, generator: np.random.Generator, flips: int = 1999) -> KinkTest:
    """Test the hypothesis that there are no kinks.

    Parameters
    ----------
    fit
        Kinks of the chosen window.
    generator
        Source of the signs.
    flips
        Number of random sign patterns.
    """
    scores = fit.null_scores
    root = np.linalg.cholesky(scores.T @ scores + fit.curvature)
    statistic = float(np.sum(np.linalg.solve(root, fit.coefficients.ravel()) ** 2))
    drawn = _signed_sums(scores, flips, generator) + draws(fit.curvature, flips, generator)
    null = np.sum(np.linalg.solve(root, drawn.T) ** 2, axis=0)
    p_value = (1 + int(np.sum(null >= statistic))) / (1 + flips)
    return KinkTest(statistic, fit.coefficients.size, p_value, flips)


def _signed_sums(scores: Floats, count: int, generator: np.random.Generator) -> Floats:
    """Return sums of the scores (n, m) with random signs, (count, m)."""
    sums = np.empty((count, scores.shape[1]))
    for first in range(0, count, _AT_ONCE):
        some = sums[first : first + _AT_ONCE]
        signs = 2.0 * generator.integers(0, 2, size=(len(some), len(scores))) - 1.0
        some[:] = signs @ scores
    return sums


def draws(covariance: Floats, count: int, generator: np.random.Generator) -> Floats:
    """Return normal draws (count, m) of a covariance that may be singular."""
    normal = generator.standard_normal((count, len(covariance)))
    drawn: Floats = normal @ symmetric_root(covariance)
    return drawn


def symmetric_root(covariance: Floats) -> Floats:
    """Return the symmetric root (m, m) of a covariance that may be singular.

    It is the only one, whereas signs and turns of eigenvectors are left to rounding: with it the
    same seed gives the same draws wherever the code runs, but for the root of rounding.
    """
    values, vectors = np.linalg.eigh(covariance)
    root: Floats = vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    return root
