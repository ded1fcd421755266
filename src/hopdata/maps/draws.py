"""Random draws of the bootstraps, with an independent named stream for each kind of draw."""

import zlib
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import IntArray

#: Memory that one chunk of draws may use, bytes.
_CHUNK_BYTES = 2 * 2**20


def named_generator(seed: int, *names: str) -> np.random.Generator:
    """Return the random generator of these names under `seed`.

    The stream depends only on the seed and the names, so results do not change when
    other models or schedules are added, omitted or reordered.

    Parameters
    ----------
    seed
        Non-negative seed of the study.
    names
        Names of what is drawn, e.g. ``("prediction", "schedule 2>3>1")``.
    """
    key = tuple(zlib.crc32(name.encode()) for name in names)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def schedule_stream(rows: IntArray) -> str:
    """Return the name of a schedule's random stream: its first landing.

    A schedule's own name has the numbers of the feet, which depend on their order in a
    file.
    """
    return f"schedule from landing {rows[0]}"


def distinct_draws(
    generator: np.random.Generator, population: int, sizes: tuple[int, ...], count: int
) -> tuple[IntArray, ...]:
    """Draw disjoint random sets of the given sizes without replacement, `count` times.

    Parameters
    ----------
    generator
        Source of randomness.
    population
        Number of items to draw from.
    sizes
        Size of each set; their sum is at most `population`.
    count
        Number of draws.

    Returns
    -------
    tuple of ndarray
        One (count, size) array of increasing indices per set. No index occurs twice in
        the same row, within a set or in two sets.

    Raises
    ------
    ValueError
        If the sets together are larger than the population.
    """
    total = sum(sizes)
    # The first steps of a Fisher-Yates shuffle: each step swaps in one of the remaining
    # items.
    left = np.arange(population, population - total, -1)
    steps = generator.integers(0, left, size=(count, total))
    drawn = [_shuffled(steps[some], population) for some in chunks(count, population)]
    parts = np.split(np.concatenate([steps[:0], *drawn]), np.cumsum(sizes)[:-1], axis=1)
    return tuple(np.sort(part, axis=1) for part in parts)


def chunks(count: int, floats_each: int) -> list[slice]:
    """Return slices of `count` draws of `floats_each` floats; each slice fits in `_CHUNK_BYTES`."""
    step = max(1, _CHUNK_BYTES // (8 * max(1, floats_each)))
    return [slice(start, min(start + step, count)) for start in range(0, count, step)]


def _shuffled(steps: IntArray, population: int) -> IntArray:
    """Return the (R, m) items drawn by the steps of R shuffles, which advance together."""
    drawn = np.empty_like(steps)
    items = np.tile(np.arange(population), (len(steps), 1))
    row = np.arange(len(steps))
    for k in range(steps.shape[1]):
        place = k + steps[:, k]
        drawn[:, k] = items[row, place]
        items[row, place] = items[
            :, k
        ]  # half a swap suffices: column k is not read again
    return drawn


# Landings by schedule, and notes on schedules with too few of them.

Notes = list[dict[str, str]]


def grouped(
    schedule: NDArray[np.str_], least: int
) -> tuple[dict[str, IntArray], dict[str, int]]:
    """Return the rows of each schedule with at least `least` landings, and the sizes of the others.

    Landings without a schedule (empty) are left out.
    """
    rows = {
        str(name): np.flatnonzero(schedule == name)
        for name in np.unique(schedule)
        if name
    }
    rare = {name: len(own) for name, own in rows.items() if len(own) < least}
    return {name: own for name, own in rows.items() if name not in rare}, rare


MOST_ONE_BY_ONE = 6  # schedules; more than these share one note


def rare_notes(what: str, sizes: Mapping[str, int], wanted: str) -> Notes:
    """Return notes on the schedules that are left out.

    Parameters
    ----------
    what
        What these schedules lack, such as ``"subspaces"``.
    sizes
        Schedule -> number of its landings.
    wanted
        Number of landings needed, in words.

    Returns
    -------
    list
        ``{"what", "reason"}`` for each schedule, or one note for all if there are more
        than six: six feet may show hundreds of schedules with one or two landings each.
    """
    if len(sizes) <= MOST_ONE_BY_ONE:
        return [
            {
                "what": f"{what} of schedule {name}",
                "reason": f"{size} touchdowns, {wanted}",
            }
            for name, size in sizes.items()
        ]
    counts = sizes.values()
    reason = f"{min(counts)} to {max(counts)} touchdowns each, {sum(counts)} in all, {wanted}"
    return [{"what": f"{what} of {len(sizes)} schedules", "reason": reason}]
