"""Draws of the statistic of a size, from random signs of the landings' contributions.

Each landing's contribution to the error of the kinks is equally likely to have either
sign, so random signs simulate that error whatever the scatter of the landings
(Hemerik, Goeman and Finos 2020). If successive landings have similar errors,
`IN_A_ROW` of them get the same sign.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.maps.verdict.model import KinkFit

#: Number of successive landings that share a random sign if successive landings err
#: alike.
#: Unit: landings. Origin: chosen.
IN_A_ROW = 40

#: Size at which the search for a crossing stops: whatever is larger is unbounded.
#: Unit: share of the map. Origin: chosen.
LARGEST = 1e3

# Signs in memory at once. It changes no result.
SIGNS_AT_ONCE = 8_000_000

# Halvings of the interval that holds a crossing: more than a double has digits.
BISECTIONS = 50


@dataclass(frozen=True)
class SignedErrors:
    """Random errors of the kinks of a fit, (draws, K q) each.

    Both are randomly signed sums of the landings' contributions: for no kinks, and for
    the kinks found. For an assumed size in between, they are mixed in proportion to it.
    """

    null: FloatArray
    full: FloatArray


def level_of(confidence: float) -> float:
    """Return the level of tests: for a confidence of 0.95 0.05, not slightly more."""
    return round(1.0 - confidence, 12)


def signed_errors(
    fits: Sequence[KinkFit], count: int, generator: np.random.Generator, *, alike: bool
) -> list[SignedErrors]:
    """Return random errors of fits to the same landings, with the same random signs.

    Parameters
    ----------
    fits
        Kinks, and steps.
    count
        Number of random sign patterns.
    generator
        Source of the random signs.
    alike
        Whether successive landings err alike; `IN_A_ROW` of them then get one sign.
    """
    both = np.hstack([part for fit in fits for part in (fit.null_scores, fit.scores)])
    if alike:
        both = np.add.reduceat(both, np.arange(0, len(both), IN_A_ROW))
    sums = np.empty((count, both.shape[1]))
    draws_at_once = max(1, SIGNS_AT_ONCE // len(both))
    for first in range(0, count, draws_at_once):
        chunk = sums[first : first + draws_at_once]
        zeros_and_ones = generator.integers(0, 2, size=(len(chunk), len(both)))
        chunk[:] = (2.0 * zeros_and_ones - 1.0) @ both
    widths = [part.shape[1] for fit in fits for part in (fit.null_scores, fit.scores)]
    parts = np.split(sums, np.cumsum(widths)[:-1], axis=1)
    nulls = parts[::2]
    fulls = parts[1::2]
    return [SignedErrors(*pair) for pair in zip(nulls, fulls, strict=True)]


class Draws:
    """Draws of the statistic T for kinks of any size along those found.

    Parameters
    ----------
    fit
        The kinks found.
    root
        (m, K q) root of their squared size: see `squared_size`.
    errors
        Random errors of the kinks.
    alike
        Whether successive landings err alike: see `signed_errors`.
    """

    def __init__(
        self, fit: KinkFit, root: FloatArray, errors: SignedErrors, *, alike: bool
    ) -> None:
        self.found = root @ fit.coefficients.ravel()
        self.statistic = float(self.found @ self.found)
        self.size = float(np.sqrt(self.statistic))
        scores = fit.scores @ root.T
        if alike:
            scores = np.add.reduceat(scores, np.arange(0, len(scores), IN_A_ROW))
        self.of_noise = float(np.sum(scores**2))

        along = self.found / self.size
        self.null_errors = errors.null @ root.T
        full_errors = errors.full @ root.T
        self.along_error = float(np.std(full_errors @ along))
        # T is a polynomial of the size and of the share of the errors that are mixed.
        self._null_null = np.sum(self.null_errors**2, axis=1)
        self._null_full = np.sum(self.null_errors * full_errors, axis=1)
        self._full_full = np.sum(full_errors**2, axis=1)
        self._along_null = self.null_errors @ along
        self._along_full = full_errors @ along

    def statistics(self, true: float) -> FloatArray:
        """Return the draws (draws,) of T for kinks of this size."""
        full = min(1.0, true / self.size)
        null = 1.0 - full
        of_errors = (
            null * null * self._null_null
            + 2.0 * null * full * self._null_full
            + full * full * self._full_full
        )
        along = null * self._along_null + full * self._along_full
        return np.asarray(of_errors + 2.0 * true * along + true * true)

    def p_value(self, true: float) -> float:
        """Return the share of draws, and the data, with a T as large at this size."""
        as_large = int(np.sum(self.statistics(true) >= self.statistic))
        return (1 + as_large) / (1 + len(self._null_null))

    def size_below(self, least: float, share: float) -> float:
        """Return the size at which only this share of the draws is at most `least`."""
        return crossing(lambda true: _share(self.statistics(true) <= least) - share)


def _share(holds: BoolArray) -> float:
    return np.count_nonzero(holds) / len(holds)  # the mean, in a third of the time


def crossing(decreasing: Callable[[float], float]) -> float:
    """Return where a decreasing function crosses zero; 0 if it starts below zero."""
    if decreasing(0.0) <= 0.0:
        return 0.0
    low = 0.0
    high = 1e-3
    while decreasing(high) > 0.0 and high < LARGEST:
        low = high
        high = 2.0 * high
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if decreasing(middle) > 0.0:
            low = middle
        else:
            high = middle
    return high
