"""Guards of 31 kinds at two tolerances: no flip is missed, none is spurious."""

from __future__ import annotations

import os

import numpy as np
import pytest
from families import ALL, FAMILIES, judged

RTOLS = (1e-3, 1e-9)
# All others of `ALL` are in benchmarks/proofs.py.
NAMES = [*FAMILIES, "polygon", "jagged spline"]
#: Each compiles for a second: every other one, or with `ALL=1` all of them.
SOME_NAMES = NAMES if "ALL" in os.environ else NAMES[::2]


@pytest.mark.parametrize("name", SOME_NAMES)
def test_no_flip_is_missed_or_spurious(name):
    rng = np.random.default_rng([11, *map(ord, name)])
    for rtol in RTOLS:
        verdict = judged(name, rtol, rng, samples=20_000)
        if ALL[name].can_be_proven:
            assert verdict.solution.success
            assert (verdict.missed, verdict.spurious) == (0, 0)
            # This one is nearly zero, and nearly constant.
            assert verdict.solution.proven or name == "constant 0.0001"
        else:
            assert not verdict.solution.proven or not verdict.solution.success


def test_spikes_narrower_than_the_tolerance_are_not_lost():
    """A step that is taken again up to a flip may pass it and the return behind it.

    The guard rises through zero and returns at a pole just behind. Each turn of the
    angle has one such pair.
    """
    for member in range(8):
        rng = np.random.default_rng([7, member])
        verdict = judged("spikes", 1e-3, rng, samples=20_000)
        start, params, _ = ALL["spikes"].draw(np.random.default_rng([7, member]))
        angles = np.array([start[0], verdict.solution.y_end[0]])
        first, last = (angles - 2.0 * np.arctan(params[1])) // (2.0 * np.pi)
        opened = int(last - first)
        first, last = (angles - np.pi) // (2.0 * np.pi)
        closed = int(last - first)
        assert verdict.missed == verdict.spurious == 0
        assert verdict.events == opened + closed > 5
