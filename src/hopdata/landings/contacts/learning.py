"""What the kink fits of a study reveal about its feet: noise, flight and stance.

This is empirical Bayes: the distribution of a coefficient of the law over all landings
is the prior of its value in each landing. Its levels are the study, the recording and
the landing. The variance between recordings is estimated; where it is zero, one
distribution serves them all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from enum import IntEnum
from functools import partial
from typing import NamedTuple

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.landings.contacts.kink import FlightPriors, KinkFits
from hopdata.landings.contacts.law import Trials, taken
from hopdata.landings.contacts.noise import LEAST_NOISE_M

#: Fewest landings from which a coefficient is learned on its own; with fewer, it takes
#: the distribution of all coefficients of its kind. A recording with fewer landings
#: takes what those of the study have in common.
#: Unit: landings. Origin: chosen.
FEW = 8

#: Loss of -2 times the log restricted likelihood at which recordings are no longer
#: taken for alike: then each has its own mean, drawn to that of all.
#: Unit: 1. Origin: derived: it is exceeded by chance in 5 % of studies, since half of
#: the chi-squared of a variance is at zero.
NOT_ALIKE = 2.71

#: Variance of the log of a noise that is estimated by a median, times the degrees of
#: freedom.
#: Unit: 1. Origin: derived: half of 2 / dof for a mean, times pi / 2 for a median.
MEDIAN_VARIANCE = np.pi / 4

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

#: Standard errors by which the pushes of a foot must scatter more, or be others, than
#: those of all feet, to be sure of it.
#: Unit: standard errors. Origin: convention.
SURE_SIGMAS = 3.0

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
BETWEEN_FEET = (Kind.PUSH, Kind.PUSH_JERK)


class Entry(NamedTuple):
    """Posteriors of one coefficient in L landings, and their priors."""

    value: FloatArray  # (L,)
    variance: FloatArray  # (L,)
    prior_mean: FloatArray  # (L,), the same in all landings of a recording
    prior_sd: FloatArray  # (L,)


class Normal(NamedTuple):
    """A normal distribution."""

    mean: float
    sd: float


class Sample(NamedTuple):
    """Values of one coefficient, with known variances."""

    value: FloatArray  # (S,)
    variance: FloatArray  # (S,)
    recording: IntArray  # (S,), in which each was measured


# The distribution in each of the recordings, from a sample; None if that is too small.
Estimate = Callable[[Sample], list[Normal] | None]


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


def pooled_noises(fits: KinkFits, trials: Trials, noise_m: FloatArray) -> FloatArray:
    """Estimate the noise of a height about its fit in each recording, (R,), m.

    Parameters
    ----------
    fits : KinkFits
        Fits of all landings of the recordings `trials`.
    noise_m : (R,) array
        Noise of a height by the frames of each recording, m.

    Returns
    -------
    (R,) array
        What its own fits give, drawn to what all recordings have in common, relative to
        `noise_m`: a recording of a few landings says little. NaN without a fit in any.
    """
    own_m = []
    dof = []
    for rows in _rows_of(trials):
        own = taken(fits, rows)
        own_m.append(pooled_noise(own))
        dof.append(np.where(own.dof > 1, own.dof, 0.0).sum())
    found_m = np.array(own_m)
    if len(found_m) == 1:
        return found_m
    known = np.isfinite(found_m)
    if not known.any():
        return found_m
    ratio = np.log(found_m[known] / noise_m[known])
    variance = MEDIAN_VARIANCE / np.array(dof)[known]
    alike = _restricted(ratio, variance, least=1, wider=False)
    if alike is None:
        return found_m
    weight = alike.sd**2 / (alike.sd**2 + variance)
    shrunk = np.full(len(found_m), alike.mean)
    shrunk[known] = alike.mean + weight * (ratio - alike.mean)
    return np.asarray(np.maximum(noise_m * np.exp(shrunk), LEAST_NOISE_M))


def _rows_of(trials: Trials) -> list[BoolArray]:
    """Mark the landings (L,) of each recording."""
    return [trials.of_landing == number for number in range(len(trials.feet))]


def learn(
    fits: KinkFits,
    *,
    noise_m: FloatArray,
    priors: Sequence[FlightPriors],
    of_landing: IntArray,
    own: bool = True,
    sharpen: bool = False,
) -> tuple[FlightPriors, ...]:
    """Take one step towards the distributions behind the laws of flight and stance.

    Pushes are confounded with one another, so they take a step of expectation
    maximisation, which narrows wide priors slowly and safely. All other entries go
    straight to the distribution of maximum restricted likelihood, and so do the pushes
    in a last step with `sharpen`. A foot's own acceleration is learned from the
    landings in which it touched first, since no leg has pushed there. Entries with few
    informative landings take the pooled distribution of all entries of their kind, or
    stay as they were. So do pushes that scatter more than those of their kind: a foot
    that is taken to be still in flight seems to be pushed by what is its own contact.

    Recordings share the distribution of an entry, unless the variance between them is
    clearly not zero: then the mean of a recording is drawn to that of all, and one of
    few landings has the mean and the variance of all.

    Parameters
    ----------
    fits : KinkFits
        Fits of L landings made under `priors`.
    noise_m : (R,) array
        Standard deviation of a foot's height in each recording, m.
    priors : sequence of FlightPriors
        The prior of those fits in each of the R recordings.
    of_landing : (L,) int array
        Number of the recording of each landing.
    own : bool
        Whether to learn the feet's own accelerations as well.
    sharpen : bool
        Whether to take the pushes to their maximum likelihood.

    Returns
    -------
    tuple of FlightPriors
    """
    variance = (fits.unit_flight_se * noise_m[of_landing][:, None, None]) ** 2
    own_variance = variance[:, :, 0]  # a view: what is written here changes `variance`
    own_variance[~_touched_first(fits.instant)] = np.inf
    if not own:
        own_variance[:] = np.inf

    mean = np.stack([prior.mean for prior in priors])
    sd = np.stack([prior.sd for prior in priors])
    prior_mean = mean[of_landing]
    prior_sd = sd[of_landing]
    least_sd = LEAST_SHARE * sd
    kinds = _kinds(priors[0].hinged)
    for kind in np.unique(kinds):
        places = np.argwhere(kinds == kind).tolist()
        entries = [
            Entry(
                value=fits.flight[:, i, j],
                variance=variance[:, i, j],
                prior_mean=prior_mean[:, i, j],
                prior_sd=prior_sd[:, i, j],
            )
            for i, j in places
        ]
        if kind in PUSHES and not sharpen:
            samples = _of_posteriors(entries, of_landing)
            estimate = partial(_mixture, recordings=len(priors))
        else:
            samples = _of_data(entries, of_landing)
            wider = kind in PUSHES
            estimate = partial(_levels, recordings=len(priors), wider=wider)
        found = _own_or_pooled(samples, estimate, doubted=kind in BETWEEN_FEET)
        for (i, j), behind in zip(places, found, strict=True):
            if behind is None:
                continue
            mean[:, i, j] = [normal.mean for normal in behind]
            sd[:, i, j] = [normal.sd for normal in behind]
            sd[:, i, j] = np.maximum(sd[:, i, j], least_sd[:, i, j])
    return tuple(
        replace(prior, mean=its_mean, sd=its_sd)
        for prior, its_mean, its_sd in zip(priors, mean, sd, strict=True)
    )


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


def _of_posteriors(entries: list[Entry], of_landing: IntArray) -> list[Sample]:
    """Return the posteriors of each entry in the landings that tell of it."""
    samples = []
    for value, variance, _, prior_sd in entries:
        telling = (variance < TELLING * prior_sd**2) & np.isfinite(value)
        samples.append(Sample(value[telling], variance[telling], of_landing[telling]))
    return samples


def _of_data(entries: list[Entry], of_landing: IntArray) -> list[Sample]:
    """Return what the data say of each entry, without the prior."""
    samples = []
    for value, variance, prior_mean, prior_sd in entries:
        telling = (variance < TELLING_ALONE * prior_sd**2) & np.isfinite(value)
        variance = variance[telling]
        prior_variance = prior_sd[telling] ** 2
        # Precisions of prior and data add up, so the prior's can be taken off again.
        precision_of_data = 1 / variance - 1 / prior_variance
        variance_of_data = 1 / precision_of_data
        weighted = value[telling] / variance - prior_mean[telling] / prior_variance
        of_data = variance_of_data * weighted
        samples.append(Sample(of_data, variance_of_data, of_landing[telling]))
    return samples


def _own_or_pooled(
    samples: list[Sample], estimate: Estimate, *, doubted: bool
) -> list[list[Normal] | None]:
    """Estimate each entry from its values and variances, or from those of all.

    The latter if its own are few, or if they scatter as no law does and are `doubted`.
    """
    pooled = estimate(
        Sample(*(np.concatenate(part) for part in zip(*samples, strict=True)))
    )
    found = []
    for sample in samples:
        own = estimate(sample)
        if own is None or (doubted and _only_scatters(own, pooled, len(sample.value))):
            own = pooled
        found.append(own)
    return found


def _only_scatters(own: list[Normal], pooled: list[Normal] | None, number: int) -> bool:
    """Tell whether values scatter surely more than those of their kind, not elsewhere.

    `number` is that of the values behind the normals `own` of the recordings.
    """
    if pooled is None:
        return False
    for mine, of_all in zip(own, pooled, strict=True):
        is_wider = mine.sd > of_all.sd * (1 + SURE_SIGMAS / np.sqrt(2 * number))
        is_elsewhere = abs(mine.mean - of_all.mean) > (
            SURE_SIGMAS * mine.sd / np.sqrt(number)
        )
        if is_wider and not is_elsewhere:
            return True
    return False


def _mixture(sample: Sample, *, recordings: int) -> list[Normal] | None:
    """Return the mixture of normals, with outliers clipped; None if there are few."""
    value = sample.value
    variance = sample.variance
    if len(value) < FEW:
        return None
    middle = float(np.median(value))
    reach = OUTLYING * float(np.std(value))
    clipped = np.clip(value, middle - reach, middle + reach)
    total_variance = np.mean(variance) + np.var(clipped)  # within and between landings
    mixed = Normal(float(np.mean(clipped)), float(np.sqrt(total_variance)))
    return [mixed] * recordings


def _levels(sample: Sample, *, recordings: int, wider: bool) -> list[Normal] | None:
    """Return the normal behind the values in each recording; None if there are few.

    See `_restricted` for one that serves all. Recordings with `FEW` values or more may
    have means of their own.
    """
    alike = _restricted(sample.value, sample.variance, wider=wider)
    if alike is None:
        return None
    count = np.bincount(sample.recording, minlength=recordings)
    if np.count_nonzero(count >= FEW) < 2:
        return [alike] * recordings
    apart = _own_means(sample, recordings, wider=wider)
    return apart or [alike] * recordings


def _own_means(sample: Sample, recordings: int, *, wider: bool) -> list[Normal]:
    """Return a normal for each recording; nothing if they are alike.

    The variances between recordings and between landings maximise the restricted
    likelihood together.
    """
    value, candidates = _clipped_and_candidates(sample.value, sample.variance)
    number = sample.recording
    # One row for each variance between landings tried, one column for each value.
    weight = 1 / (candidates[:, None] ** 2 + sample.variance)
    shape = (len(candidates), recordings)
    of_recording = np.zeros(shape)
    weighted = np.zeros(shape)
    np.add.at(of_recording.T, number, weight.T)
    np.add.at(weighted.T, number, (weight * value).T)
    present = np.flatnonzero(of_recording[0] > 0)
    total = of_recording[:, present]
    means = weighted[:, present] / total
    place = np.searchsorted(present, number)
    misfit = (weight * (value - means[:, place]) ** 2).sum(axis=1)
    within = misfit - np.log(weight).sum(axis=1) + np.log(total).sum(axis=1)
    # One row for each of them, one column for each variance between recordings.
    between = 1 / (candidates[:, None] ** 2 + 1 / total[:, None])
    sums = between.sum(axis=2)
    middle = (between * means[:, None]).sum(axis=2) / sums
    away = (between * (means[:, None] - middle[:, :, None]) ** 2).sum(axis=2)
    deviance = within[:, None] + away - np.log(between).sum(axis=2) + np.log(sums)
    if deviance[:, 0].min() - deviance.min() < NOT_ALIKE:
        return []
    row, column = np.unravel_index(np.argmin(deviance), deviance.shape)
    of_landings = candidates[row] ** 2
    of_recordings = candidates[column] ** 2
    if wider:
        of_landings += np.sqrt(2 / (weight[row] ** 2).sum())

    found = [Normal(middle[row, column], np.sqrt(of_landings + of_recordings))]
    found = found * recordings
    count = np.bincount(number, minlength=recordings)
    for at, recording in enumerate(present.tolist()):
        if count[recording] < FEW:
            # Its mean would repeat what its few landings say themselves.
            continue
        own = of_recordings * between[row, column, at]
        mean = middle[row, column] + own * (means[row, at] - middle[row, column])
        doubt = of_recordings * (1 - own)
        found[recording] = Normal(float(mean), float(np.sqrt(of_landings + doubt)))
    return found


def _restricted(
    value: FloatArray, variance: FloatArray, *, wider: bool, least: int = FEW
) -> Normal | None:
    """Return the normal behind values with known variances; None if fewer than `least`.

    Its sd maximises the restricted likelihood over a grid; where it is to be `wider`,
    its variance is larger by one standard error. Outliers are clipped first.
    """
    if len(value) < least:
        return None
    value, trial_sd = _clipped_and_candidates(value, variance)

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


def _clipped_and_candidates(
    value: FloatArray, variance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return values (S,) without outliers, and standard deviations to try, 0 first."""
    middle = float(np.median(value))
    robust_sd = np.median(np.abs(value - middle)) / MAD_OF_NORMAL
    reach = OUTLYING * np.sqrt(variance + robust_sd**2)
    value = np.clip(value, middle - reach, middle + reach)

    widest = float(np.std(value))
    if widest == 0:
        widest = float(np.sqrt(variance.max()))
    shares = np.geomspace(*CANDIDATE_SHARES, CANDIDATES)
    return value, np.concatenate([[0.0], widest * shares])
