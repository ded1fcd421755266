"""Which guards are compiled for ranges, and why some are not."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from guard_sources import BRANCHING, reads_a_table, smooth

from hopdata.code_cache import kept_njit
from hopdata.hybrid import System, field, guard, guards
from hopdata.hybrid.numbers.guards import NO_CODE, branches_of, guards_for_ranges


@field
def still(t, y, mode, params, dy):
    dy[0] = 0.0


@guards
def sums(t, y, dy, mode, params, h, hdot):
    h[0] = np.sum(np.where(params > y[0], 1.0, 0.0))
    hdot[0] = 0.0


@guard
def one_of_many(t, y, dy, mode, params, k, h, hdot):
    h[k], hdot[k] = abs(y[0]) - k, dy[0]


def test_code_for_ranges():
    assert branches_of(guards(smooth)).address == 0
    assert branches_of(None).address == 0
    for function in BRANCHING:
        if function is not reads_a_table:
            made = branches_of(guards(function))
            assert made.address > 0, made.reason
    assert branches_of(one_of_many).address > 0


def test_why_there_is_none_for_guards_that_use_arrays():
    made = branches_of(sums)
    assert made.address == NO_CODE
    assert "Range" in made.reason
    system = System(still, sums, n_states=1, guard_names=("sum",))
    assert system.branches.address == NO_CODE


@kept_njit()
def halved(x):
    return 0.5 * math.sin(x) * x


@guards
def with_helper(t, y, dy, mode, params, h, hdot):
    h[0] = halved(y[0]) - params[0]
    hdot[0] = dy[0]


def test_helpers_keep_no_code_for_ranges():
    """It calls operations that may change while the helper does not: a process would abort."""
    assert guards_for_ranges(with_helper).address > 0
    assert halved(1.0) == pytest.approx(0.5 * math.sin(1.0))  # may be kept
    kept = list(Path(halved.stats.cache_path).glob("*.nbc"))
    assert not any(b"hopdata_ranges" in path.read_bytes() for path in kept)
