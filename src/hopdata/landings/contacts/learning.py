"""What the kink fits of a recording reveal about its feet: noise, flight and stance.

This is empirical Bayes: the distribution of a coefficient of the law over all landings
is the prior of its value in each landing.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from functools import partial
from typing import NamedTuple

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.landings.contacts.kink import FlightPriors, KinkFits
from hopdata.landings.contacts.noise import LEAST_NOISE_M

#: Fewest landings from which a coefficient is learned on its own; with fewer, it takes
#: the distribution of all coefficients of its kind.
#: Unit: landings. Origin: chosen.
FEW = 8

#: Where posteriors are mixed, a landing tells of a coefficient if its posterior
#: variance is below this share of the prior's.
#: Unit: 1. Origin: chosen.
TELLING = 0.9

#: The same where the prior is divided out: what is then left of a posterior that
#: hardly differs from its prior is noise.
#: Unit: 1. Origin: chosen.
TELLING_ALONE = 0.5

#: Values further from the median than this are moved to there, so that a few odd
#: landings do not widen the prior of all.
#: Unit: standard deviations. Origin: chosen.
OUTLYING = 4.0

#: Smallest standard deviation that one step of learning may give, as a share of the
#: prior's before it. Zero would be final: a sharp prior reproduces itself.
#: Unit: 1. Origin: chosen.
LEAST_SHARE = 1e-3

#: Number of standard deviations tried for a distribution, evenly in their logarithm.
#: Unit: 1. Origin: chosen.
CANDIDATES = 60

#: Smallest and largest of them, as shares of the values' own; 0 is tried too.
#: Unit: 1. Origin: chosen.
CANDIDATE_SHARES = (1e-3, 2.0)

#: Median absolute deviation of a normal distribution.
#: Unit: standard deviations. Origin: derived: its quartile.
MAD_OF_NORMAL = 0.6745


class Kind(IntEnum):
    """What an entry of the law is; entries of one kind learn from one another."""

    OWN = 0  # a foot's own acceleration
    PUSH = 1  # change of its acceleration when another foot touches
    PUSH_JERK = 2  # change of its jerk then
    HINGE = 3  # the same two if the other is a marker of the same rigid foot,
    HINGE_KINK = 4  # which changes the velocity instead of the jerk
    CREEP = 5  # velocity of the standing foot


PUSHES = (Kind.PUSH, Kind.PUSH_JERK, Kind.HINGE, Kind.HINGE_KINK)


class Entry(NamedTuple):
    """Posteriors of one coefficient in L landings, and the prior that they share."""

    value: FloatArray  # (L,)
    variance: FloatArray  # (L,)
    prior_mean: float
    prior_sd: float


class Normal(NamedTuple):
    """A normal distribution."""

    mean: float
    sd: float


# From values and their variances; None if there are too few.
Estimate = Callable[[FloatArray, FloatArray], Normal | None]


def pooled_noise(fits: KinkFits) -> float:
    """Estimate the noise of a height about its fit, m, from the median of all fits.

    The result is never less than `LEAST_NOISE_M`; it is NaN without a fit.
    """
    use = fits.dof > 1
    if not use.any():
        return float("nan")
    dof = fits.dof[use]
    # Wilson and Hilferty's median of chi-squared.
    median_of_chi_squared = dof * (1 - 2 / (9 * dof)) ** 3
    variance = np.median(fits.misfit[use] / median_of_chi_squared)
    return max(float(np.sqrt(variance)), LEAST_NOISE_M)


def learn(
    fits: KinkFits,
    *,
    noise_m: float,
    prior: FlightPriors,
    own: bool = True,
    sharpen: bool = False,
) -> FlightPriors:
    """Take one step towards the distributions behind the laws of flight and stance.

    Pushes are confounded with one another, so they take a step of expectation
    maximisation, which narrows wide priors slowly and safely. All other entries go
    straight to the distribution of maximum restricted likelihood, and so do the pushes
    in a last step with `sharpen`. A foot's own acceleration is learned from the
    landings in which it touched first, since no leg has pushed there. Entries with few
    informative landings take the pooled distribution of all entries of their kind, or
    stay as they were.

    Parameters
    ----------
    fits : KinkFits
        Fits made under `prior`.
    noise_m : float
        Standard deviation of a foot's height, m.
    prior : FlightPriors
        The prior of those fits.
    own : bool
        Whether to learn the feet's own accelerations as well.
    sharpen : bool
        Whether to take the pushes to their maximum likelihood.

    Returns
    -------
    FlightPriors
    """
    variance = (fits.unit_flight_se * noise_m) ** 2
    own_variance = variance[:, :, 0]  # a view: what is written here changes `variance`
    own_variance[~_touched_first(fits.instant)] = np.inf
    if not own:
        own_variance[:] = np.inf

    mean = prior.mean.copy()
    sd = prior.sd.copy()
    kinds = _kinds(prior.hinged)
    for kind in np.unique(kinds):
        places = np.argwhere(kinds == kind).tolist()
        entries = [
            Entry(
                value=fits.flight[:, i, j],
                variance=variance[:, i, j],
                prior_mean=prior.mean[i, j],
                prior_sd=prior.sd[i, j],
            )
            for i, j in places
        ]
        if kind in PUSHES and not sharpen:
            found = _mixtures(entries)
        else:
            found = _likeliest(entries, wider=kind in PUSHES)
        for (i, j), behind in zip(places, found, strict=True):
            if behind is not None:
                mean[i, j] = behind.mean
                sd[i, j] = max(behind.sd, LEAST_SHARE * prior.sd[i, j])
    return FlightPriors(mean, sd, prior.foot_of)


def _touched_first(instant: FloatArray) -> BoolArray:
    """Mark the foot that touched first in each landing (L, n)."""
    known = np.where(np.isnan(instant), np.inf, instant)
    first = known.argmin(axis=1)
    return first[:, None] == np.arange(instant.shape[1])


def _kinds(hinged: BoolArray) -> IntArray:
    """Return the `Kind` of each entry of `FlightPriors`, (n, 2n), by its `hinged`."""
    n = len(hinged)
    kinds = np.empty((n, 2 * n), dtype=np.int64)
    kinds[:, 0] = Kind.OWN
    kinds[:, 1:-1:2] = np.where(hinged, Kind.HINGE, Kind.PUSH)
    kinds[:, 2:-1:2] = np.where(hinged, Kind.HINGE_KINK, Kind.PUSH_JERK)
    kinds[:, -1] = Kind.CREEP
    return kinds


def _mixtures(entries: list[Entry]) -> list[Normal | None]:
    """Take one step of expectation maximisation: mix the posteriors of each entry."""
    samples = []
    for value, variance, _, prior_sd in entries:
        telling = (variance < TELLING * prior_sd**2) & np.isfinite(value)
        samples.append((value[telling], variance[telling]))
    return _own_or_pooled(samples, _mixture)


def _likeliest(entries: list[Entry], *, wider: bool) -> list[Normal | None]:
    """Return the distribution behind each entry, from the data without the prior."""
    samples = []
    for value, variance, prior_mean, prior_sd in entries:
        telling = (variance < TELLING_ALONE * prior_sd**2) & np.isfinite(value)
        # Precisions of prior and data add up, so the prior's can be taken off again.
        precision_of_data = 1 / variance[telling] - 1 / prior_sd**2
        variance_of_data = 1 / precision_of_data
        weighted = value[telling] / variance[telling] - prior_mean / prior_sd**2
        samples.append((variance_of_data * weighted, variance_of_data))
    return _own_or_pooled(samples, partial(_restricted, wider=wider))


def _own_or_pooled(
    samples: list[tuple[FloatArray, FloatArray]], estimate: Estimate
) -> list[Normal | None]:
    """Estimate each entry from its values and variances, or from all if it has few."""
    values, variances = zip(*samples, strict=True)
    pooled = estimate(np.concatenate(values), np.concatenate(variances))
    found = []
    for value, variance in samples:
        own = estimate(value, variance)
        found.append(pooled if own is None else own)
    return found


def _mixture(value: FloatArray, variance: FloatArray) -> Normal | None:
    """Return the mixture of normals, with outliers clipped; None if there are few."""
    if len(value) < FEW:
        return None
    middle = float(np.median(value))
    reach = OUTLYING * float(np.std(value))
    clipped = np.clip(value, middle - reach, middle + reach)
    total_variance = np.mean(variance) + np.var(clipped)  # within and between landings
    return Normal(float(np.mean(clipped)), float(np.sqrt(total_variance)))


def _restricted(
    value: FloatArray, variance: FloatArray, *, wider: bool
) -> Normal | None:
    """Return the normal behind values with known variances; None if there are few.

    Its sd maximises the restricted likelihood over a grid; where it is to be `wider`,
    its variance is larger by one standard error. Outliers are clipped first.
    """
    if len(value) < FEW:
        return None
    middle = float(np.median(value))
    robust_sd = np.median(np.abs(value - middle)) / MAD_OF_NORMAL
    reach = OUTLYING * np.sqrt(variance + robust_sd**2)
    value = np.clip(value, middle - reach, middle + reach)

    widest = float(np.std(value))
    if widest == 0:
        widest = float(np.sqrt(variance.max()))
    shares = np.geomspace(*CANDIDATE_SHARES, CANDIDATES)
    trial_sd = np.concatenate([[0.0], widest * shares])

    # One row for each sd tried, one column for each value.
    weight = 1 / (trial_sd[:, None] ** 2 + variance)
    total = weight.sum(axis=1)
    mean = weight @ value / total
    misfit = (weight * (value - mean[:, None]) ** 2).sum(axis=1)
    # -2 times the log likelihood; the last term pays for the mean that was estimated.
    deviance = misfit - np.log(weight).sum(axis=1) + np.log(total)
    best = int(np.argmin(deviance))

    doubt_of_variance = 0.0
    if wider:  # from the curvature of the likelihood, half the sum of squared weights
        doubt_of_variance = np.sqrt(2 / (weight[best] ** 2).sum())
    sd = np.sqrt(trial_sd[best] ** 2 + doubt_of_variance)
    return Normal(float(mean[best]), float(sd))
