"""The system in every combination of the locks of some guards."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from hopdata.hybrid.first_order.local import (
    FloatArray,
    Instant,
    Linearisation,
    cross,
    linearise,
)
from hopdata.hybrid.system import System

ALL_COMBINATIONS_UP_TO = 8
Combination = tuple[int, ...]


def lock_combinations(guards: Sequence[int], seed: int = 0) -> Iterator[Combination]:
    """Yield the sets of guards that may have been crossed, as increasing numbers.

    All 2^n up to n = 8; beyond, 256: none, each one, all, and others drawn.
    """
    chosen = tuple(sorted(guards))
    n = len(chosen)
    if n <= ALL_COMBINATIONS_UP_TO:
        for size in range(n + 1):
            yield from combinations(chosen, size)
        return
    seen = {(), chosen, *((guard,) for guard in chosen)}
    rng = np.random.default_rng(seed)
    while len(seen) < 2**ALL_COMBINATIONS_UP_TO:
        seen.add(
            tuple(k for k, crossed in zip(chosen, rng.random(n) < 0.5, strict=True) if crossed)
        )
    yield from sorted(seen, key=lambda combination: (len(combination), combination))


def after_crossing(system: System, start: Instant, crossed: Combination) -> Instant:
    """Return the hybrid state once these guards have been crossed, one after the other."""
    for guard in crossed:
        start = cross(system, start, guard)
    return start


def mode_fields(
    system: System, start: Instant, guards: Sequence[int], scale: FloatArray, seed: int = 0
) -> dict[Combination, Linearisation]:
    """Return field and guards in each combination of locks, by the guards crossed."""
    return {
        crossed: linearise(system, after_crossing(system, start, crossed), scale)
        for crossed in lock_combinations(guards, seed)
    }
