"""Frozen markers: the same position again and again, which noise makes all but impossible."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.recordings.quality.runs import IntArray, runs

FloatArray = NDArray[np.float64]

LEAST_REPEATS = 3
CHANCE = 1e-3  # of any false alarm in a recording


@dataclass(frozen=True)
class Frozen:
    """A stretch in which a marker repeats one position.

    Parameters
    ----------
    marker : str
        Its name.
    start, stop : int
        First frame with the repeated position, and the frame after the last.
    """

    marker: str
    start: int
    stop: int


def frozen_markers(positions: FloatArray, markers: tuple[str, ...]) -> tuple[Frozen, ...]:
    """Find stretches of exact repeats that are too long to be chance.

    A coarse file repeats positions by chance while a foot rests. How often a repeat is followed by
    another is therefore estimated from all other runs of repeats of the same marker.

    Parameters
    ----------
    positions : (N, M, 3) array
        As in the file, not smoothed.
    markers : tuple of str
        The M names.
    """
    n_tests = max(len(positions) - 1, 0) * len(markers)
    found = []
    for m, name in enumerate(markers):
        stretches = runs(np.all(np.diff(positions[:, m], axis=0) == 0, axis=1))
        for start, stop in stretches[_too_long(stretches, n_tests)]:
            found.append(Frozen(name, int(start), int(stop) + 1))
    return tuple(found)


def _too_long(stretches: IntArray, n_tests: int) -> NDArray[np.bool_]:
    """Which runs of repeats, (K,), are longer than the other runs let expect."""
    length = np.diff(stretches, axis=1)[:, 0]
    is_long = length >= LEAST_REPEATS
    if not is_long.any():
        return is_long
    others, again = max(len(length) - 1, 1), np.sum(length > 1) - 1
    chance_again = np.clip(again / others, 1e-9, 1 - 1e-9)
    longest = 1 + np.log(CHANCE / n_tests) / np.log(chance_again)
    result: NDArray[np.bool_] = is_long & (length > longest)
    return result
