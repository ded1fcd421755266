"""Monte-Carlo error of a mean over pairs of draws.

A mean over pairs is a U-statistic: pairs that share a draw are not independent, and a million
pairs of a thousand draws tell hardly more than a thousand numbers would. The variance is that of
Aronow, Samii and Assenova (2015): two pairs with a draw in common are taken to covary, no others.
For all pairs of a set it agrees with the jackknife over draws and with Hoeffding's
4 var(mean of a draw) / R (1948); for pairs without a draw in common it is the usual one.
"""

from __future__ import annotations

import numpy as np

from hopdata.arrays import FloatArray, IntArray


class PairSums:
    """Sums over pairs of numbered draws, gathered block by block.

    Parameters
    ----------
    draws
        How many draws there are, in all sets together.
    """

    def __init__(self, draws: int) -> None:
        self.count, self.total, self.squares = 0, 0.0, 0.0
        self._counts, self._sums = np.zeros(draws), np.zeros(draws)

    def add(self, values: FloatArray, first: IntArray, second: IntArray) -> None:
        """Add (N,) pairs of draws `first` and `second`."""
        self._add(values)
        for index in (first, second):
            size = len(self._sums)
            self._counts += np.bincount(index, minlength=size)
            self._sums += np.bincount(index, values, size)

    def add_table(self, values: FloatArray, first: int, second: int) -> None:
        """Add all pairs of draws from `first` on (rows) and from `second` on (columns)."""
        self._add(values.ravel())
        for start, axis in ((first, 1), (second, 0)):
            place = slice(start, start + values.shape[1 - axis])
            self._counts[place] += values.shape[axis]
            self._sums[place] += values.sum(axis=axis)

    def add_triangle(self, values: FloatArray, first: int) -> None:
        """Add all pairs of draws from `first` on; `values` (R, R) is zero but for i < j."""
        place = slice(first, first + len(values))
        self._add(values[np.triu_indices(len(values), 1)])
        self._counts[place] += len(values) - 1
        self._sums[place] += values.sum(axis=0) + values.sum(axis=1)

    @property
    def mean(self) -> float:
        """Mean over the pairs; NaN of none."""
        return self.total / self.count if self.count else float("nan")

    @property
    def standard_error(self) -> float:
        """Standard error of the mean, from the draws at hand to all draws; NaN of one pair.

        Not less than if the pairs were independent, which a sample can make it seem.
        """
        if self.count < 2:
            return float("nan")
        independent = max(self.squares - self.count * self.mean**2, 0.0)
        of_draws = self._sums - self._counts * self.mean
        shared = float(of_draws @ of_draws) - independent
        return float(np.sqrt(max(shared, independent))) / self.count

    def _add(self, values: FloatArray) -> None:
        self.count += values.size
        self.total += float(values.sum())
        self.squares += float(values @ values)
