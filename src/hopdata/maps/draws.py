"""Random draws of the bootstraps: one independent, named stream for each thing that is drawn."""

import zlib
from collections.abc import Mapping

import numpy as np

from hopdata.arrays import IntArray

#: Working set of one chunk of draws.
_CHUNK_BYTES = 2 * 2**20


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
) -> tuple[IntArray, ...]:
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
    # The first steps of a shuffle (Fisher and Yates): each swaps one of the items that are left.
    left = np.arange(population, population - total, -1)
    steps = generator.integers(0, left, size=(count, total))
    drawn = [_shuffled(steps[some], population) for some in chunks(count, population)]
    parts = np.split(np.concatenate([steps[:0], *drawn]), np.cumsum(sizes)[:-1], axis=1)
    return tuple(np.sort(part, axis=1) for part in parts)


def chunks(count: int, floats_each: int) -> list[slice]:
    """Return slices of draws that are worked on together, each of which takes so many floats."""
    step = max(1, _CHUNK_BYTES // (8 * max(1, floats_each)))
    return [slice(start, min(start + step, count)) for start in range(0, count, step)]


def _shuffled(steps: IntArray, population: int) -> IntArray:
    """Return the (R, m) items that the steps of R shuffles draw, all rows a step at a time."""
    drawn = np.empty_like(steps)
    items = np.tile(np.arange(population), (len(steps), 1))
    row = np.arange(len(steps))
    for k in range(steps.shape[1]):
        place = k + steps[:, k]
        drawn[:, k] = items[row, place]
        items[row, place] = items[:, k]  # what step k leaves behind; it is not looked at again
    return drawn


# What is said of schedules with too few landings: one by one, or together where they are many.

Notes = list[dict[str, str]]

MOST_ONE_BY_ONE = 6


def rare_notes(what: str, sizes: Mapping[str, int], wanted: str) -> Notes:
    """Note the schedules that are left out.

    Parameters
    ----------
    what
        What they do not have, such as ``"subspaces"``.
    sizes
        Schedule -> number of its landings.
    wanted
        How many it takes, in words.

    Returns
    -------
    list
        ``{"what", "reason"}`` of each schedule, or, of more than six, of all together: six feet may
        show hundreds of schedules of a landing or two.
    """
    if len(sizes) <= MOST_ONE_BY_ONE:
        return [
            {"what": f"{what} of schedule {name}", "reason": f"{size} touchdowns, {wanted}"}
            for name, size in sizes.items()
        ]
    counts = sizes.values()
    reason = f"{min(counts)} to {max(counts)} touchdowns each, {sum(counts)} in all, {wanted}"
    return [{"what": f"{what} of {len(sizes)} schedules", "reason": reason}]
