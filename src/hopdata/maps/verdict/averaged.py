"""Kinks and steps, averaged over what nobody foretells of the contact instants.

A foot touches at the instant expected from the state and the feet before the landing,
and a rest r that neither foretells: posture that was not seen, or noise of the state.
A kink h placed at the expected instants is rounded by that rest. Its mean
E h(t + r), with r normal, is what the outcomes show, so its coefficient is that of the
kink itself, whatever rounds it.

Kinks are latest contacts of two or three feet, and the mean of the largest of normal
variables is known in closed form (Afonja 1972, *J. R. Stat. Soc. B* 34, 251-259).
"""

from itertools import combinations

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.maps.coordinates import foot_sets, kinks

#: A rest below this share of the instants' rms rounds nothing. Beside a larger one, a
#: rest of this size is added for each foot, so that no two feet err exactly alike.
#: Unit: 1. Origin: chosen: it moves a kink by less than a thousandth of the spread.
NOTHING = 1e-3


def mean_kinks(instants: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the mean kinks (n, K) over a rest with this covariance.

    Parameters
    ----------
    instants
        (n, feet) expected contact instants.
    covariance
        (feet, feet) covariance of what is not foretold of them.
    """
    size = float(np.mean(instants**2))
    if np.trace(covariance) <= NOTHING**2 * size:
        return kinks(instants)
    rest = covariance + NOTHING**2 * size * np.eye(len(covariance))
    relative = instants - instants.mean(axis=1, keepdims=True)
    columns = []
    for feet in foot_sets(instants.shape[1]):
        among = np.array(feet)
        latest = _mean_latest(relative[:, among], rest[np.ix_(among, among)])
        columns.append(latest)
    return np.column_stack(columns)


def _mean_latest(means: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the mean largest (n,) of two or three normal variables with these means.

    It is the sum of each mean times the probability that it is the largest, and for
    each pair of a term for how near the two are to each other where both are largest.
    """
    from scipy.special import ndtr

    number = len(covariance)
    total = np.zeros(len(means))
    for i in range(number):
        total += means[:, i] * _largest(i, means, covariance)
    for i, j in combinations(range(number), 2):
        scale, apart = _apart(i, j, means, covariance)
        density = scale * np.exp(-0.5 * apart**2) / np.sqrt(2.0 * np.pi)
        for k in set(range(number)) - {i, j}:
            _, beyond = _apart(i, k, means, covariance)
            alike = _correlation(i, j, k, covariance)
            density *= ndtr((beyond - alike * apart) / np.sqrt(1.0 - alike**2))
        total += density
    return total


def _largest(i: int, means: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the probability (n,) that variable i is the largest."""
    from scipy.special import ndtr

    others = [j for j in range(len(covariance)) if j != i]
    beyond = [_apart(i, j, means, covariance)[1] for j in others]
    if len(others) == 1:
        return np.asarray(ndtr(beyond[0]))
    j, k = others
    return both_below(beyond[0], beyond[1], _correlation(i, j, k, covariance))


def _apart(
    i: int, j: int, means: FloatArray, covariance: FloatArray
) -> tuple[float, FloatArray]:
    """Return the sd of a difference of two variables, and its mean (n,) in sds."""
    variance = covariance[i, i] + covariance[j, j] - 2.0 * covariance[i, j]
    sd = float(np.sqrt(variance))
    return sd, np.asarray((means[:, i] - means[:, j]) / sd)


def _correlation(i: int, j: int, k: int, covariance: FloatArray) -> float:
    """Return the correlation of the differences of variable i from j and from k."""
    minus_j = np.zeros(len(covariance))
    minus_j[[i, j]] = 1.0, -1.0
    minus_k = np.zeros(len(covariance))
    minus_k[[i, k]] = 1.0, -1.0
    product = minus_j @ covariance @ minus_k
    squares = (minus_j @ covariance @ minus_j) * (minus_k @ covariance @ minus_k)
    return float(product / np.sqrt(squares))


def both_below(h: FloatArray, k: FloatArray, correlation: float) -> FloatArray:
    """Return the probability that two standard normal variables lie below h and k.

    Parameters
    ----------
    h, k
        (n,) limits.
    correlation
        Of the two variables, between -1 and 1.

    Notes
    -----
    By Owen's T function (Owen 1956, *Ann. Math. Stat.* 27, 1075-1090).
    """
    from scipy.special import ndtr, owens_t

    smallest = np.finfo(float).tiny
    h = np.where(h == 0.0, smallest, h)
    k = np.where(k == 0.0, smallest, k)
    rest = np.sqrt(1.0 - correlation**2)
    with np.errstate(over="ignore"):
        of_h = owens_t(h, (k / h - correlation) / rest)
        of_k = owens_t(k, (h / k - correlation) / rest)
    opposite = np.where(h * k < 0.0, 0.5, 0.0)
    return np.asarray(0.5 * (ndtr(h) + ndtr(k)) - of_h - of_k - opposite)


def steps(
    instants: FloatArray, covariance: FloatArray, pairs: list[tuple[int, int]]
) -> FloatArray:
    """Return the mean steps (n, pairs), of sign(t_i - t_j), over a rest.

    Parameters
    ----------
    instants, covariance
        As for `mean_kinks`.
    pairs
        Pairs (i, j) of feet.
    """
    from scipy.special import ndtr

    columns = [np.zeros((len(instants), 0))]
    for i, j in pairs:
        apart = instants[:, i] - instants[:, j]
        variance = covariance[i, i] + covariance[j, j] - 2.0 * covariance[i, j]
        if variance <= NOTHING**2 * np.mean(instants**2):
            step = np.sign(apart)
        else:
            step = 2.0 * ndtr(apart / np.sqrt(variance)) - 1.0
        columns.append(step[:, None])
    return np.hstack(columns)


def pairs_that_exchange(instants: FloatArray, least: int) -> list[tuple[int, int]]:
    """Return the pairs of feet of which each comes first in `least` landings."""
    pairs = []
    for i, j in combinations(range(instants.shape[1]), 2):
        step = np.sign(instants[:, i] - instants[:, j])
        # Twice the number of landings in the rarer of the two orders.
        twice_rarer = len(step) - np.abs(step.sum())
        if twice_rarer >= 2 * least:
            pairs.append((i, j))
    return pairs
