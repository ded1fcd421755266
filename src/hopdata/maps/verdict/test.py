"""Whether the kinks are zero: a sign-flipping score test.

If the map has one derivative, each landing's contribution to the kinks is as likely to have the
other sign. Flipping the signs at random gives the distribution of the statistic whatever the
scatter of the landings, equal or not (Hemerik, Goeman and Finos 2020). Smooth terms beyond those
fitted enter as random contributions of the size that was estimated for them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.maps.coordinates import kinks
from hopdata.maps.verdict.estimate import KinkFit, window_kinks
from hopdata.maps.verdict.inputs import expected_contacts

_AT_ONCE = 4000  # sign patterns in memory


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


def _signed_sums(scores: FloatArray, count: int, generator: np.random.Generator) -> FloatArray:
    """Return sums of the scores (n, m) with random signs, (count, m)."""
    sums = np.empty((count, scores.shape[1]))
    for first in range(0, count, _AT_ONCE):
        some = sums[first : first + _AT_ONCE]
        signs = 2.0 * generator.integers(0, 2, size=(len(some), len(scores))) - 1.0
        some[:] = signs @ scores
    return sums


def draws(covariance: FloatArray, count: int, generator: np.random.Generator) -> FloatArray:
    """Return normal draws (count, m) of a covariance that may be singular."""
    normal = generator.standard_normal((count, len(covariance)))
    drawn: FloatArray = normal @ symmetric_root(covariance)
    return drawn


def symmetric_root(covariance: FloatArray) -> FloatArray:
    """Return the symmetric root (m, m) of a covariance that may be singular.

    It is the only one, whereas signs and turns of eigenvectors are left to rounding: with it the
    same seed gives the same draws wherever the code runs, but for the root of rounding.
    """
    values, vectors = np.linalg.eigh(covariance)
    root: FloatArray = vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    return root


# By how much noise in the inputs and instants rounds the kinks off, and its correction.
#
# A kink stands where two feet are expected at once. Noise moves landings across it, so that a fit
# finds it weaker than it is. How much is seen by adding the same noise once more: kinks of known
# height, as the landings would show them, are fitted to landings with noisier inputs and instants
# (simulation-extrapolation, Cook and Stefanski 1994, to first order).

#: Times that noise is added.
_REPEATS = 4
#: Where less than this is left of some kink, noise hides it, and nothing is to be restored.
_LEAST_LEFT = 0.3


def attenuation(
    fit: KinkFit,
    inputs: FloatArray,
    expected: FloatArray,
    input_errors: FloatArray,
    instant_noise_s: FloatArray,
    *,
    generator: np.random.Generator,
) -> FloatArray:
    """Return the matrix (K, K) that takes the true kinks to those that a fit finds.

    Parameters
    ----------
    fit
        Kinks of the chosen window.
    inputs, expected
        (N, p) inputs and (N, feet) expected contact instants, s.
    input_errors
        (p, p) covariance of the errors of the inputs.
    instant_noise_s
        (feet,) standard deviations of the noise in the measured instants, s.
    generator
        Source of the noise.
    """
    heights = kinks(expected) @ fit.seen
    total = np.zeros((fit.seen.shape[1],) * 2)
    for _ in range(_REPEATS):
        noisier = inputs + draws(input_errors, len(inputs), generator)
        instants = expected + instant_noise_s * generator.standard_normal(expected.shape)
        contacts = expected_contacts(noisier, instants)
        seen, coefficients = window_kinks(noisier, heights, contacts, fit.rows, fit.degree)
        total += fit.seen.T @ seen @ coefficients
    return total / _REPEATS


def calibrated(fit: KinkFit, attenuated: FloatArray) -> KinkFit:
    """Return the fit with the kinks as they would be without noise, and their covariance.

    Where noise leaves too little of some kink the fit is returned as it is.
    """
    if np.linalg.svd(attenuated, compute_uv=False).min() < _LEAST_LEFT:
        return fit
    restore = np.linalg.inv(attenuated)
    both = np.kron(restore, np.eye(fit.coefficients.shape[1]))
    return replace(
        fit,
        coefficients=restore @ fit.coefficients,
        covariance=both @ fit.covariance @ both.T,
        curvature=both @ fit.curvature @ both.T,
    )
