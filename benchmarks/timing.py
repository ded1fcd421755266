"""Times of several functions in turn, as medians with quartiles.

Time is the processor time of this thread: that on the clock of an idle machine, and less disturbed
by others on a shared one. What is measured must run in this thread alone.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import TypeVar

import numpy as np

Result = TypeVar("Result")

LONGEST_S = 0.25  # of one function's repeats, beyond the fewest


def timed(run: Callable[[], Result]) -> tuple[float, Result]:
    """Return the time of one run, s, and its result."""
    start = time.thread_time()
    result = run()
    return time.thread_time() - start, result


def quartiles(
    runs: Mapping[str, Callable[[], object]], *, fewest: int = 3, most: int = 15
) -> dict[str, tuple[float, float, float]]:
    """Return quartile, median and quartile of each function's time, s; see `in_turn`."""
    times = in_turn(runs, fewest=fewest, most=most)
    return {name: tuple(np.percentile(sample, [25, 50, 75])) for name, sample in times.items()}


def in_turn(
    runs: Mapping[str, Callable[[], object]], *, fewest: int = 3, most: int = 15
) -> dict[str, list[float]]:
    """Return the times of each function, s, turn by turn.

    All run equally often, `most` times if the slowest takes so little, but `fewest` at least. The
    first run, which warms up, does not count.
    """
    slowest = max(timed(run)[0] for run in runs.values())
    times: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(int(np.clip(LONGEST_S / slowest, fewest, most))):
        for name, run in runs.items():
            times[name].append(timed(run)[0])
    return times


def columns_ms(times: Mapping[str, tuple[float, float, float]]) -> dict[str, float]:
    """Return the columns of a table, ms, that `quartiles` fill: ``<name>_median_ms`` and so on."""
    return {
        f"{name}_{level}_ms": 1e3 * seconds
        for name, levels in times.items()
        for level, seconds in zip(("q25", "median", "q75"), levels, strict=True)
    }
