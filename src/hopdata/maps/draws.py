"""Random draws of the bootstraps: one independent, named stream for each thing that is drawn."""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray

_CHUNK_BYTES = 4 * 2**20

Indices = NDArray[np.int64]


def named_generator(seed: int, *names: str) -> np.random.Generator:
    """Return the generator that `names` own under `seed`.

    The stream depends on the seed and the names only, so results do not change when other
    models or schedules are added, left out or taken in another order.

    Parameters
    ----------
    seed
        Non-negative seed of the study.
    names
        What is drawn, e.g. ``("prediction", "schedule 2>3>1")``.
    """
    key = tuple(zlib.crc32(name.encode()) for name in names)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def distinct_draws(
    generator: np.random.Generator, population: int, sizes: tuple[int, ...], count: int
) -> tuple[Indices, ...]:
    """Draw `count` times disjoint random sets of the given sizes, without replacement.

    Parameters
    ----------
    generator
        Source of randomness.
    population
        Number of items to draw from.
    sizes
        Size of each set; together at most `population`.
    count
        Number of draws.

    Returns
    -------
    tuple of ndarray
        One (count, size) array of increasing indices per set. In a row of the first and the
        same row of the second no index occurs twice.

    Raises
    ------
    ValueError
        If the sets together are larger than the population.
    """
    total = sum(sizes)
    if total > population:
        raise ValueError(f"cannot draw {total} distinct items from {population}")
    # The first steps of a shuffle (Fisher and Yates): each swaps one of the items that are left.
    left = np.arange(population, population - total, -1)
    steps = generator.integers(0, left, size=(count, total))
    rows = max(1, _CHUNK_BYTES // (8 * population))
    chunks = [_shuffled(steps[start : start + rows], population) for start in range(0, count, rows)]
    parts = np.split(np.concatenate([steps[:0], *chunks]), np.cumsum(sizes)[:-1], axis=1)
    return tuple(np.sort(part, axis=1) for part in parts)


def _shuffled(steps: Indices, population: int) -> Indices:
    """Return the (R, m) items that the steps of R shuffles draw, all rows a step at a time."""
    drawn = np.empty_like(steps)
    items = np.tile(np.arange(population), (len(steps), 1))
    row = np.arange(len(steps))
    for k in range(steps.shape[1]):
        place = k + steps[:, k]
        drawn[:, k] = items[row, place]
        items[row, place] = items[:, k]  # what step k leaves behind; it is not looked at again
    return drawn
