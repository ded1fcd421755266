"""Which guards are compiled for ranges, and why some are not."""

from __future__ import annotations

import numpy as np
from guard_sources import BRANCHING, reads_a_table, smooth

from hopdata.hybrid import System, field, guard, guards
from hopdata.hybrid.numbers.guards import NO_CODE, branches_of


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
