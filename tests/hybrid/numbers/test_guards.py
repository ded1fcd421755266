"""Which guards are compiled for ranges, and why some are not."""

from __future__ import annotations

import math
from ctypes import CFUNCTYPE, c_double, c_int64
from pathlib import Path

import numpy as np
import pytest
from guard_sources import BRANCHING, reads_a_table, smooth

from hopdata.code_cache import kept_njit
from hopdata.hybrid import System, field, guard, guards
from hopdata.hybrid.derived import backward, with_parameters
from hopdata.hybrid.numbers import answers
from hopdata.hybrid.numbers.guards import NO_CODE, guards_for_ranges


@field
def still(t, y, mode, params, dy):
    dy[0] = 0.0


@guards
def determinant(t, y, dy, mode, params, h, hdot):
    h[0] = np.linalg.det(np.diag(params - abs(y[0])))
    hdot[0] = 0.0


@guard
def one_of_many(t, y, dy, mode, params, k, h, hdot):
    h[k], hdot[k] = abs(y[0]) - k, dy[0]


def test_code_for_ranges():
    assert guards_for_ranges(guards(smooth)).address > 0
    assert guards_for_ranges(None).address == 0
    for function in BRANCHING:
        if function is not reads_a_table:
            made = guards_for_ranges(guards(function))
            assert made.address > 0, made.reason
    assert guards_for_ranges(one_of_many).address > 0


def test_why_there_is_none_for_guards_with_unknown_functions():
    made = guards_for_ranges(determinant)
    assert made.address == NO_CODE
    assert "Range" in made.reason
    system = System(still, determinant, n_states=1, guard_names=("det",))
    assert system.branches.address == NO_CODE


@guards
def of_all(t, y, dy, mode, params, h, hdot):
    h[0] = 2.0 * y[0] + t + params[0] * dy[1]
    h[1] = t * t if mode[0] > 0 else params[1]
    hdot[:] = 0.0


@guard
def of_each(t, y, dy, mode, params, k, h, hdot):
    if k == 0:
        h[k] = 2.0 * y[0] + t + params[0] * dy[1]
    else:
        h[k] = t * t if mode[0] > 0 else params[1]
    hdot[k] = 0.0


def ranges_of(callback, states, params):
    """Return the four rows of two guards, for t from 1 to 2."""
    made = guards_for_ranges(callback)
    assert made.address > 0, made.reason
    call = CFUNCTYPE(None, *(3 * [c_double]), *(12 * [c_int64]))(made.address)
    rows = np.array(states, dtype=float)
    numbers = np.array(params, dtype=float)
    mode, listed = np.array([1, 1]), np.array([0, 1])
    room, told = np.zeros((4, 2)), np.zeros(answers.N_SLOTS, np.int64)
    call(
        1.0, 2.0, 1.0, rows.ctypes.data, rows[2:].ctypes.data, rows.shape[1], mode.ctypes.data, 2,
        numbers.ctypes.data, len(numbers), room.ctypes.data, 2, listed.ctypes.data, 2,
        told.ctypes.data,
    )  # fmt: skip
    return room


STATES = np.array([[0.0, 1.0], [0.5, 2.0], [-1.0, 3.0], [-0.5, 4.0]])


@pytest.mark.parametrize("given", [{"guards": of_all}, {"guard": of_each}])
def test_derived_guards_have_code_for_ranges(given):
    system = System(still, n_states=2, guard_names=("a", "b"), **given)
    (plain,) = given.values()
    forward = ranges_of(plain, STATES, (10.0, 7.0))
    np.testing.assert_allclose(forward[:, 1], [1.0, 4.0, 2.0, 4.0])
    np.testing.assert_allclose(forward[:2, 0], [31.0, 43.0])

    # Time runs backward: t is from -2 to -1, and falls; so dy has the other sign.
    turned = backward(system)
    back = ranges_of(turned.guards or turned.guard, STATES, (10.0, 7.0))
    np.testing.assert_allclose(back[:, 1], [1.0, 4.0, 2.0, 4.0])
    np.testing.assert_allclose(back[:2, 0], [-42.0, -30.0])

    # Parameters are states, which follow the others.
    longer = np.hstack([STATES, [[10.0, 7.0], [10.0, 7.0], [0.0, 0.0], [0.0, 0.0]]])
    extended = with_parameters(system, 2)
    np.testing.assert_array_equal(
        ranges_of(extended.guards or extended.guard, longer, ()), forward
    )


def test_a_rate_of_the_state_backward():
    system = System(still, one_rate, n_states=1, guard_names=("a",))
    rows = [[0.0], [1.0], [2.0], [3.0]]
    found = ranges_of(backward(system).guards, rows, ())
    np.testing.assert_allclose(found[:, 0], [0.0, 1.0, 2.0, 3.0], atol=1e-15)


@guards
def one_rate(t, y, dy, mode, params, h, hdot):
    h[0] = y[0]
    hdot[0] = dy[0]


@guards
def uses_a_determinant(t, y, dy, mode, params, h, hdot):
    h[0] = np.linalg.det(np.outer(y, y))
    hdot[0] = dy[0]


def test_the_reason_names_the_line():
    made = guards_for_ranges(uses_a_determinant)
    assert made.address == NO_CODE
    assert "det" in made.reason
    assert "h[0] = np.linalg.det(" in made.reason


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
