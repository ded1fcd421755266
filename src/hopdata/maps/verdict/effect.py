"""How different the maps of two schedules are: effect size, its interval, and what could be seen.

The kinks give the difference between the derivatives of any two schedules. Its size is the rms
change of the outcome that it makes over the contact instants of the study, relative to the rms
outcome of the map itself: 0.1 means that after a typical deviation from the simultaneous contact
the outcome would be another by a tenth, had the feet come down in another order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.maps.coordinates import Feet, kink_slopes
from hopdata.maps.verdict.estimate import KinkFit
from hopdata.maps.verdict.test import draws, symmetric_root

_BISECTIONS = 60
_LARGEST = 1e3
_KINDS = 400


@dataclass(frozen=True)
class EffectSize:
    """Relative difference between the schedules' derivatives.

    Attributes
    ----------
    estimate
        Rms over all pairs of schedules, what noise adds on average taken off.
    low, high
        Ends of the interval of the given confidence.
    upper_bound
        One-sided bound: no difference larger than this, at the given confidence. Like `high` it
        is never below what the median study without a difference gives.
    detectable
        Difference that the test would have found with the given power.
    """

    estimate: float
    low: float
    high: float
    upper_bound: float
    detectable: float


def outcome_variance(
    fit: KinkFit, x: FloatArray, instants: FloatArray, schedules: list[Feet]
) -> float:
    """Return the mean square outcome of the linear map: the mean of the schedules' derivatives.

    Parameters
    ----------
    fit
        Kinks of the chosen window.
    x, instants
        (N, p) inputs and (N, feet) expected contact instants of the study.
    schedules
        Schedules seen, each as the feet in their order.
    """
    t = instants - instants.mean(axis=1, keepdims=True)
    slopes = np.mean([kink_slopes(order) for order in schedules], axis=0)
    outcome = x @ fit.linear + t @ slopes.T @ fit.seen @ fit.coefficients
    return float(np.sum(np.var(outcome, axis=0, ddof=1)))


def squared_size(
    fit: KinkFit, instants: FloatArray, schedules: list[Feet], outcome: float
) -> FloatArray:
    """Return the matrix (m, m) of the squared effect size as a form in the coefficients.

    Parameters
    ----------
    fit
        Kinks of one window.
    instants
        (N, feet) expected contact instants of the study.
    schedules
        Schedules seen, each as the feet in their order.
    outcome
        See `outcome_variance`.
    """
    spread = np.cov(instants - instants.mean(axis=1, keepdims=True), rowvar=False)
    total = np.zeros((fit.seen.shape[1],) * 2)
    pairs = list(combinations(schedules, 2))
    for a, b in pairs:
        change = fit.seen.T @ (kink_slopes(a) - kink_slopes(b))
        total += change @ spread @ change.T / len(pairs)
    return np.asarray(np.kron(total, np.eye(fit.coefficients.shape[1])) / outcome, float)


def effect_size(
    fit: KinkFit,
    form: FloatArray,
    *,
    generator: np.random.Generator,
    confidence: float = 0.95,
    power: float = 0.8,
    n_draws: int = 4000,
) -> EffectSize:
    """Return the size of the kinks with its interval, by inversion over one family of sizes.

    The estimate's direction is kept and its length varied; an interval holds the lengths from
    which the estimate found is not a rare draw.

    Parameters
    ----------
    fit, form
        Kinks of the chosen window, and their squared size: see `squared_size`.
    generator
        Source of the draws.
    confidence, power
        Of the interval and bound, and of the detectable difference.
    n_draws
        Number of random draws of the estimate's error.
    """
    found = fit.coefficients.ravel()
    square = float(found @ form @ found)
    noise = draws(fit.covariance, n_draws, generator)
    along = noise @ (form @ found) / np.sqrt(square)
    own = np.sum((noise @ form) * noise, axis=1)
    tail = (1.0 - confidence) / 2.0
    # An estimate smaller than noise alone would give is luck, and excludes nothing more for it.
    least = max(square, float(np.median(own)))
    return EffectSize(
        estimate=float(np.sqrt(max(0.0, square - own.mean()))),
        low=_length(square, along, own, 1.0 - tail),
        high=_length(least, along, own, tail),
        upper_bound=_length(least, along, own, 2.0 * tail),
        detectable=detectable_size(fit, form, generator, 1.0 - confidence, power),
    )


def agreeing(effect: EffectSize, p_value: float, level: float) -> EffectSize:
    """Return the size with an interval that begins at zero where the test does not exclude zero.

    The test weighs kinks by how well the data tell them, the size by what they do to the outcome;
    so the two can part near the limit, and the test decides.
    """
    return effect if p_value < level else replace(effect, low=0.0)


def detectable_size(
    fit: KinkFit, form: FloatArray, generator: np.random.Generator, level: float, power: float
) -> float:
    """Return the size at which the test finds kinks of a random kind with this power.

    Random kinds change every output by a like share of its own variation.
    """
    from scipy.special import chdtri, chndtr

    m, outputs = len(form), fit.coefficients.shape[1]
    variation = np.sqrt(np.sum(fit.linear**2, axis=0))
    kinds = generator.standard_normal((_KINDS, m // outputs, outputs)) * variation
    kinds = (np.linalg.pinv(symmetric_root(form[::outputs, ::outputs])) @ kinds).reshape(_KINDS, m)
    kinds /= np.sqrt(np.sum((kinds @ form) * kinds, axis=1))[:, None]
    weights = np.einsum("dm,dm->d", kinds, np.linalg.solve(fit.covariance, kinds.T).T)
    threshold = chdtri(m, level)

    def missed(size: float) -> float:
        return float(np.mean(chndtr(threshold, m, size**2 * weights))) - (1.0 - power)

    return _crossing(missed)


def _length(square: float, along: FloatArray, own: FloatArray, share: float) -> float:
    """Return the true length from which this share of the draws lies below the one found."""

    def excess(length: float) -> float:
        return float(np.mean(length**2 + 2.0 * length * along + own <= square)) - share

    return _crossing(excess)


def _crossing(decreasing: Callable[[float], float]) -> float:
    """Return where a decreasing function of the size falls through zero; 0 if it starts below."""
    low, high = 0.0, 1e-6
    if decreasing(0.0) <= 0.0:
        return 0.0
    while decreasing(high) > 0.0 and high < _LARGEST:
        low, high = high, 2.0 * high
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if decreasing(middle) > 0.0 else (low, middle)
    return high
