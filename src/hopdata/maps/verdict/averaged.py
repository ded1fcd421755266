"""Kinks and steps, averaged over what nobody foretells of the contact instants.

A foot touches at the instant expected from the state and the feet before the landing,
and a rest r that neither foretells: posture that was not seen, or noise of the state.
A kink h placed at the expected instants is rounded by that rest. Its mean
E h(t + r), with r normal, is what the outcomes show, so its coefficient is that of the
kink itself, whatever rounds it.
"""

from itertools import combinations

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.maps.coordinates import kinks
from hopdata.maps.verdict.linear import symmetric_root

#: Half of the number of nodes of the mean over what is not foretold. They are points of
#: a Halton sequence and their mirror images.
#: Unit: nodes. Origin: measured: four times as many change no kink by more than 1 % of
#: its rms where contacts are rounded by as much as they are apart
#: (tests/maps/verdict/test_averaged.py).
HALF_OF_NODES = 128

#: A rest below this share of the instants' rms rounds nothing.
#: Unit: 1. Origin: rounding.
NOTHING = 1e-6


def nodes(covariance: FloatArray) -> FloatArray:
    """Return fixed points (m, feet) of a normal distribution with this covariance."""
    from scipy.special import ndtri
    from scipy.stats import qmc

    uniform = qmc.Halton(len(covariance), scramble=False).random(HALF_OF_NODES + 1)
    # The first point of the sequence is the origin.
    half = ndtri(uniform[1:])
    standard = np.vstack([half, -half])
    # The nodes have exactly this covariance.
    square = standard.T @ standard / len(standard)
    standard = np.linalg.solve(np.linalg.cholesky(square), standard.T).T
    return np.asarray(standard @ symmetric_root(covariance))


def mean_kinks(instants: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the mean kinks (n, K) over a rest with this covariance.

    Parameters
    ----------
    instants
        (n, feet) expected contact instants.
    covariance
        (feet, feet) covariance of what is not foretold of them.
    """
    if is_nothing(instants, covariance):
        return kinks(instants)
    points = nodes(covariance)
    total = kinks(instants + points[0])
    for point in points[1:]:
        total += kinks(instants + point)
    return np.asarray(total / len(points))


def is_nothing(instants: FloatArray, covariance: FloatArray) -> bool:
    """Return whether a rest with this covariance is rounding beside the instants."""
    return bool(np.trace(covariance) <= NOTHING**2 * np.mean(instants**2))


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
