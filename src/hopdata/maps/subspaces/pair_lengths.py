"""Arc lengths of pairs of draws within and across classes: some pairs, or all of them."""

from __future__ import annotations

import sys
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hopdata.maps.subspaces.all_pairs import all_arc_lengths
from hopdata.maps.subspaces.dyads import PairSums
from hopdata.maps.subspaces.grassmann import arc_length

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


class PairLengths:
    """Measures the pairs that are asked for, and keeps what a summary of each kind needs.

    Parameters
    ----------
    bases
        Schedule -> (R, D, k) orthonormal bases.
    all_pairs
        Whether to measure all pairs; else only those that are returned.
    workers
        Threads, for all pairs.
    progress
        Whether to say on stderr how far it is.
    """

    def __init__(
        self,
        bases: Mapping[str, Floats],
        *,
        all_pairs: bool = False,
        workers: int = 1,
        progress: bool = False,
    ) -> None:
        self._bases, self._all, self._workers = bases, all_pairs, workers
        starts = np.cumsum([0, *map(len, bases.values())])
        self._start = dict(zip(bases, starts[:-1].tolist(), strict=True))
        kinds = ("in_class", "cross_class")
        self.sums = {kind: PairSums(int(starts[-1])) for kind in kinds}
        self._lengths: dict[str, list[Floats]] = {kind: [] for kind in kinds}
        self._progress = progress and all_pairs

    def in_class(self, generator: np.random.Generator, name: str, pairs: int) -> Floats:
        """Return lengths of up to `pairs` different pairs of different draws of a class."""
        draws, start, sums = self._bases[name], self._start[name], self.sums["in_class"]
        first, second = in_class_pairs(generator, len(draws), pairs)
        if not self._all:
            lengths = arc_length(draws[first], draws[second])
            sums.add(lengths, first + start, second + start)
            return self._keep("in_class", lengths)
        table = all_arc_lengths(draws, workers=self._workers)
        sums.add_triangle(table, start)
        self._keep("in_class", table[np.triu_indices(len(table), 1)])
        return table[first, second]

    def cross_class(self, generator: np.random.Generator, a: str, b: str, pairs: int) -> Floats:
        """Return lengths of up to `pairs` different pairs, one draw from each of two classes."""
        one, two, sums = self._bases[a], self._bases[b], self.sums["cross_class"]
        first, second = cross_class_pairs(generator, len(one), len(two), pairs)
        if not self._all:
            lengths = arc_length(one[first], two[second])
            sums.add(lengths, first + self._start[a], second + self._start[b])
            return self._keep("cross_class", lengths)
        table = all_arc_lengths(one, two, workers=self._workers)
        sums.add_table(table, self._start[a], self._start[b])
        self._keep("cross_class", table.ravel())
        return table[first, second]

    def lengths(self, kind: str) -> Floats:
        """Return all lengths of a kind that were measured."""
        return np.concatenate([np.zeros(0), *self._lengths[kind]])

    def _keep(self, kind: str, lengths: Floats) -> Floats:
        self._lengths[kind].append(lengths)
        if self._progress:
            done = sum(sums.count for sums in self.sums.values())
            print(f"distances: {done:,} of {self._total():,} pairs", file=sys.stderr)
        return lengths

    def _total(self) -> int:
        draws = sum(map(len, self._bases.values()))
        return draws * (draws - 1) // 2


def in_class_pairs(
    generator: np.random.Generator, draws: int, pairs: int
) -> tuple[Indices, Indices]:
    """Choose up to `pairs` different pairs of different draws."""
    first, second = np.triu_indices(draws, 1)
    chosen = _some(generator, len(first), pairs)
    return first[chosen], second[chosen]


def cross_class_pairs(
    generator: np.random.Generator, first: int, second: int, pairs: int
) -> tuple[Indices, Indices]:
    """Choose up to `pairs` different pairs of one draw from each of two sets."""
    return np.divmod(_some(generator, first * second, pairs), second)


def _some(generator: np.random.Generator, population: int, count: int) -> Indices:
    return np.sort(generator.choice(population, min(count, population), replace=False))
