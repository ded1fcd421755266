"""Random draws of the bootstraps, from an independent stream for each kind of draw."""

import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import IntArray

# Memory that one chunk of draws may use. It changes no result.
CHUNK_BYTES = 2 * 2**20


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
    remaining = np.arange(population, population - total, -1)
    steps = generator.integers(0, remaining, size=(count, total))
    drawn = np.empty_like(steps)
    for chunk in chunks(count, population):
        drawn[chunk] = _shuffled(steps[chunk], population)
    ends = np.cumsum(sizes)
    sets = np.split(drawn, ends[:-1], axis=1)
    return tuple(np.sort(one, axis=1) for one in sets)


def resampled_draws(
    generator: np.random.Generator, population: int, sizes: tuple[int, ...], count: int
) -> tuple[IntArray, ...]:
    """Draw random sets of the given sizes with replacement, `count` times.

    Each time, the population is first divided at random in proportion to the sizes, and
    each set is drawn from its own part. An item may thus occur several times in a set,
    but never in two sets.

    Parameters
    ----------
    generator
        Source of randomness.
    population
        Number of items to draw from.
    sizes
        Size of each set.
    count
        Number of draws.

    Returns
    -------
    tuple of ndarray
        One (count, size) array of increasing indices per set.

    Raises
    ------
    ValueError
        If the population is too small for one item in each part.

    Examples
    --------
    >>> fitted, tested = resampled_draws(named_generator(1, "split"), 8, (5, 3), 1)
    >>> fitted, tested
    (array([[0, 2, 2, 4, 7]]), array([[1, 1, 6]]))
    """
    ends = np.rint(population * np.cumsum(sizes) / sum(sizes)).astype(int)
    widths = np.diff(ends, prepend=0)
    if widths.min() < 1:
        raise ValueError(f"{population} items do not suffice for {len(sizes)} parts")
    sets = []
    shuffled = np.tile(np.arange(population), (count, 1))
    shuffled = generator.permuted(shuffled, axis=1)
    for size, width, end in zip(sizes, widths, ends, strict=True):
        chosen = generator.integers(0, width, size=(count, size)) + end - width
        drawn = np.take_along_axis(shuffled, chosen, axis=1)
        sets.append(np.sort(drawn, axis=1))
    return tuple(sets)


def draws_together(
    generator: np.random.Generator, population: int, sizes: tuple[int, ...], count: int
) -> tuple[IntArray, ...]:
    """Draw random sets with replacement, all from the whole population.

    As `resampled_draws`, but an item may also occur in two sets.
    """
    sets = []
    for size in sizes:
        drawn = generator.integers(0, population, size=(count, size))
        sets.append(np.sort(drawn, axis=1))
    return tuple(sets)


def chunks(count: int, floats_each: int) -> list[slice]:
    """Return slices of `count` draws of `floats_each` floats, within `CHUNK_BYTES`."""
    bytes_each = 8 * max(1, floats_each)
    step = max(1, CHUNK_BYTES // bytes_each)
    return [slice(start, min(start + step, count)) for start in range(0, count, step)]


def _shuffled(steps: IntArray, population: int) -> IntArray:
    """Return the (R, m) items drawn by the steps of R shuffles at once."""
    drawn = np.empty_like(steps)
    items = np.tile(np.arange(population), (len(steps), 1))
    row = np.arange(len(steps))
    for k in range(steps.shape[1]):
        chosen = k + steps[:, k]
        drawn[:, k] = items[row, chosen]
        # Half a swap suffices: column k is not read again.
        items[row, chosen] = items[:, k]
    return drawn


# Landings by schedule, and notes on schedules with too few of them.

Notes = list[dict[str, Any]]


def grouped(
    schedule: NDArray[np.str_], least: int
) -> tuple[dict[str, IntArray], dict[str, int]]:
    """Return rows of each schedule with `least` landings or more, and sizes of others.

    Landings without a schedule (empty) are left out.
    """
    common = {}
    rare = {}
    for name in np.unique(schedule).tolist():
        if not name:
            continue
        rows = np.flatnonzero(schedule == name)
        if len(rows) < least:
            rare[name] = len(rows)
        else:
            common[name] = rows
    return common, rare


# With more schedules than this, one note tells of all of them.
MOST_ONE_BY_ONE = 6


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
    if len(sizes) > MOST_ONE_BY_ONE:
        counts = sizes.values()
        each = f"{min(counts)} to {max(counts)} touchdowns each"
        reason = f"{each}, {sum(counts)} in all, {wanted}"
        return [{"what": f"{what} of {len(sizes)} schedules", "reason": reason}]
    notes = []
    for name, size in sizes.items():
        reason = f"{size} touchdowns, {wanted}"
        notes.append({"what": f"{what} of schedule {name}", "reason": reason})
    return notes
