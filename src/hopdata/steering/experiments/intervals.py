"""Intervals for few runs: of a rate, of a median, of a ratio of medians."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def rate_interval(successes: int, runs: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the interval of a rate after Clopper and Pearson (1934), never too narrow.

    Parameters
    ----------
    successes, runs : int
    confidence : float
        Of the two-sided interval.
    """
    from scipy.special import betaincinv

    tail = (1 - confidence) / 2
    low = 0.0 if successes == 0 else float(betaincinv(successes, runs - successes + 1, tail))
    high = (
        1.0 if successes == runs else float(betaincinv(successes + 1, runs - successes, 1 - tail))
    )
    return low, high


def median_interval(values: ArrayLike, confidence: float = 0.95) -> tuple[float, float]:
    """Return the interval of a median by order statistics, whatever the distribution.

    Parameters
    ----------
    values : (n,) array
    confidence : float
        At least this; NaN if `values` are too few for it.
    """
    from scipy.special import bdtr

    ordered = np.sort(np.asarray(values, dtype=float))
    n = len(ordered)
    outside = bdtr(np.arange(max(n, 1)), max(n, 1), 0.5)  # P(at most r of n are below the median)
    far = np.flatnonzero(outside <= (1 - confidence) / 2)
    if n == 0 or not len(far):
        return float("nan"), float("nan")
    r = int(far[-1])
    return float(ordered[r]), float(ordered[n - 1 - r])


def ratio_interval(
    values: ArrayLike,
    others: ArrayLike,
    *,
    rng: np.random.Generator,
    confidence: float = 0.95,
    draws: int = 2000,
) -> tuple[float, float, float]:
    """Return the ratio of two medians over paired runs, with its bootstrap interval.

    Parameters
    ----------
    values, others : (n,) arrays
        Pairs: both of one start.
    rng : numpy Generator
        Source of the draws of pairs.
    confidence : float
    draws : int

    Returns
    -------
    ratio, low, high : float
        NaN without pairs; the interval, too, if they are so few that the medians have none.
    """
    pairs = np.column_stack([np.asarray(values, dtype=float), np.asarray(others, dtype=float)])
    if not len(pairs):
        return float("nan"), float("nan"), float("nan")
    drawn = np.median(pairs[rng.integers(0, len(pairs), (draws, len(pairs)))], axis=1)
    tail = (1 - confidence) / 2
    low, high = np.quantile(drawn[:, 0] / drawn[:, 1], [tail, 1 - tail])
    medians = np.median(pairs, axis=0)
    if np.isnan(median_interval(pairs[:, 0], confidence)[0]):  # a few draws would look certain
        low = high = np.nan
    return float(medians[0] / medians[1]), float(low), float(high)
