"""Times of several functions that take turns on one thread.

A time is the processor time of this thread. On an idle machine it equals the time on
the clock, and on a shared machine other work disturbs it less. What is measured must
run in this thread alone. The machine's speed may change within seconds: compare times
of one turn, never times of different runs.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import TypeVar

import numpy as np

Result = TypeVar("Result")
Name = TypeVar("Name")

#: Longest duration of one function's repeats beyond the fewest.
#: Unit: s. Origin: chosen.
LONGEST_S = 0.25


def timed(run: Callable[[], Result]) -> tuple[float, Result]:
    """Return the time of one run, s, and its result."""
    start = time.thread_time()
    result = run()
    return time.thread_time() - start, result


def in_turn(
    runs: Mapping[Name, Callable[[], object]], *, fewest: int = 3, most: int = 15
) -> dict[Name, list[float]]:
    """Return the times of each function, s, turn by turn.

    Parameters
    ----------
    runs : mapping
        Functions without arguments, by name.
    fewest, most : int
        All functions run equally often: `most` times if the slowest is quick enough,
        but at least `fewest` times. The first run is a warm-up and does not count.
    """
    slowest = max(timed(run)[0] for run in runs.values())
    times: dict[Name, list[float]] = {name: [] for name in runs}
    for _ in range(int(np.clip(LONGEST_S / slowest, fewest, most))):
        for name, run in runs.items():
            times[name].append(timed(run)[0])
    return times


#: Largest ratio of two times, either way, that is called on par. In Table 4.4 the
#: printed method takes 1.452 ms and MuJoCo 2.054 ms, a factor of 1.41, which section
#: 1.3.7 calls nearly on par. Machine and versions are others here, so the same factor
#: is allowed once more.
#: Unit: 1. Origin: derived: (2.054 / 1.452)^2.
ON_PAR = (2.054 / 1.452) ** 2


def on_par(ratio: float) -> bool:
    """Return whether two times of this ratio are on par, as the text uses the word."""
    return 1.0 / ON_PAR <= ratio <= ON_PAR
