"""What the kink fits of a recording say about its feet: noise, laws of flight and stance.

Empirical Bayes: the distribution of an entry of the law over all landings is the prior of its value
in each.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.landings.approach import LEAST_NOISE_M
from hopdata.landings.kink import FlightPriors, KinkFits

FloatArray = NDArray[np.float64]
Part = tuple[FloatArray, FloatArray, float, float]  # posteriors of an entry, and its prior
Distribution = tuple[float, float] | None  # mean and sd; None where too little is known

TELLING, TELLING_ALONE = 0.9, 0.5  # posterior over prior variance from which data say nothing
FEW = 8  # landings below which an entry is not learned on its own
OUTLYING = 4.0  # standard deviations at which an outlier is drawn in
LEAST_SHARE = 1e-3  # of the prior's sd: as sharp as one step of learning makes it
CANDIDATES = 60  # values of the sd that are tried


def pooled_noise(fits: KinkFits) -> float:
    """Estimate the standard deviation of a height about its fit, m, by the median of all fits.

    Never less than `LEAST_NOISE_M`.
    """
    use = fits.dof > 1
    if not use.any():
        return float("nan")
    dof = fits.dof[use]
    median = dof * (1 - 2 / (9 * dof)) ** 3  # Wilson and Hilferty's median of chi-squared
    return max(float(np.sqrt(np.median(fits.misfit[use] / median))), LEAST_NOISE_M)


def learn(
    fits: KinkFits,
    *,
    noise_m: float,
    prior: FlightPriors,
    own: bool = True,
    sharpen: bool = False,
) -> FlightPriors:
    """Take one step towards the distributions behind the laws of flight and stance.

    Pushes take a step of expectation maximisation, which comes down from wide priors slowly and
    safely: they are confounded with one another. All else, and the pushes in a last step that is
    to `sharpen` them, goes at once to the distribution of largest restricted likelihood. A foot's
    own acceleration is learned from the landings in which it was the first to touch, as no leg has
    pushed there. Entries with few telling landings take what all entries of their kind say
    together, or stay as they were.

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
        Whether to bring the pushes to their largest likelihood.

    Returns
    -------
    FlightPriors
    """
    value, variance = fits.flight, (fits.unit_flight_se * noise_m) ** 2
    first = np.where(np.isnan(fits.instant), np.inf, fits.instant).argmin(axis=1)
    not_first = first[:, None] != np.arange(len(prior.mean))
    variance[:, :, 0] = np.where(not_first | (not own), np.inf, variance[:, :, 0])
    mean, sd = prior.mean.copy(), prior.sd.copy()
    last = mean.shape[1] - 1
    for columns in ([0], range(1, last, 2), range(2, last, 2), [last]):  # own, change, jerk, creep
        pushes = 0 < columns[0] < last
        entries = [(i, j) for i in range(len(mean)) for j in columns]
        parts = [
            (value[:, i, j], variance[:, i, j], prior.mean[i, j], prior.sd[i, j])
            for i, j in entries
        ]
        found = _mixtures(parts) if pushes and not sharpen else _likeliest(parts, wider=pushes)
        for (i, j), behind in zip(entries, found, strict=True):
            if behind:
                mean[i, j], sd[i, j] = behind[0], max(behind[1], LEAST_SHARE * prior.sd[i, j])
    return FlightPriors(mean, sd)


def _mixtures(parts: list[Part]) -> list[Distribution]:
    """One step of expectation maximisation for each entry of a kind: mixtures of posteriors."""
    telling = []
    for value, variance, _, sd in parts:
        use = (variance < TELLING * sd**2) & np.isfinite(value)
        telling.append((value[use], variance[use]))
    pooled = _mixture(*(np.concatenate(part) for part in zip(*telling, strict=True)))
    return [_mixture(*part) or pooled for part in telling]


def _likeliest(parts: list[Part], *, wider: bool) -> list[Distribution]:
    """Distributions behind the entries of a kind, from what the data say without the prior."""
    telling = []
    for value, variance, mean, sd in parts:
        use = (variance < TELLING_ALONE * sd**2) & np.isfinite(value)
        alone = 1 / (1 / variance[use] - 1 / sd**2)
        telling.append((alone * (value[use] / variance[use] - mean / sd**2), alone))
    pooled = _restricted(*(np.concatenate(p) for p in zip(*telling, strict=True)), wider=wider)
    return [_restricted(*part, wider=wider) or pooled for part in telling]


def _mixture(value: FloatArray, variance: FloatArray) -> Distribution:
    """Mean and sd of a mixture of normals, outliers drawn in; None if there are few."""
    if len(value) < FEW:
        return None
    reach = OUTLYING * float(np.std(value))
    middle = float(np.median(value))
    clipped = np.clip(value, middle - reach, middle + reach)
    return float(np.mean(clipped)), float(np.sqrt(np.mean(variance) + np.var(clipped)))


def _restricted(value: FloatArray, variance: FloatArray, *, wider: bool) -> Distribution:
    """Mean and sd behind values known to within their variances; None if there are few.

    Restricted maximum likelihood over a grid of the sd, one standard error `wider` if so asked;
    outliers are drawn in first.
    """
    if len(value) < FEW:
        return None
    middle = float(np.median(value))
    reach = OUTLYING * np.sqrt(variance + (np.median(np.abs(value - middle)) / 0.6745) ** 2)
    value = np.clip(value, middle - reach, middle + reach)
    widest = float(np.std(value)) or float(np.sqrt(variance.max()))
    trial = np.concatenate([[0.0], widest * np.geomspace(1e-3, 2.0, CANDIDATES)])
    weight = 1 / (trial[:, None] ** 2 + variance)
    total = weight.sum(axis=1)
    mean = weight @ value / total
    misfit = (weight * (value - mean[:, None]) ** 2).sum(axis=1)
    best = int(np.argmin(misfit - np.log(weight).sum(axis=1) + np.log(total)))
    doubt = np.sqrt(2 / (weight[best] ** 2).sum()) if wider else 0.0
    return float(mean[best]), float(np.sqrt(trial[best] ** 2 + doubt))
