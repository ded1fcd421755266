"""Guards of 31 kinds at two tolerances: no flip is missed, none is spurious."""

from __future__ import annotations

import numpy as np
import pytest
from families import ALL, FAMILIES, judged

RTOLS = (1e-3, 1e-9)


# All others of `ALL` are in benchmarks/proofs.py.
@pytest.mark.parametrize("name", [*FAMILIES, "polygon", "jagged spline"])
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
