"""What compiled code was made from: a change of it counts in the next solve."""

from __future__ import annotations

import gc
import math
import sys
import weakref
from types import ModuleType

import numba
import numpy as np
import pytest

from hopdata.hybrid import (
    System,
    affine,
    field,
    guards,
    jacobian,
    on_event,
    solve,
    solve_batch,
)
from hopdata.hybrid.compiled.constants import Constants, renew_called
from hopdata.hybrid.first_order import check_c1

rate = 2.0
rates = (1.0, (2.0, 3.0))
table = np.array([2.0, 3.0])
pair = (np.array([2.0]), 1)
height = 0.5
kick = 1.0
other = ModuleType("other")
other.inner = ModuleType("other.inner")
other.rate, other.inner.rate = 2.0, 2.0


@numba.njit
def deep(y):
    return -rate * y


@numba.njit
def helper(y):
    return 1.0 * deep(y)


def of_global(t, y, mode, params, dy):
    dy[0] = -rate * y[0]


def of_tuple(t, y, mode, params, dy):
    dy[0] = -rates[1][0] * y[0]


def of_array(t, y, mode, params, dy):
    dy[0] = -table[0] * y[0]


def of_array_in_tuple(t, y, mode, params, dy):
    dy[0] = -pair[0][0] * y[0]


def of_module(t, y, mode, params, dy):
    dy[0] = -other.rate * y[0]


def of_inner_module(t, y, mode, params, dy):
    dy[0] = -other.inner.rate * y[0]


def of_helper(t, y, mode, params, dy):
    dy[0] = helper(y[0])


def of_nested(t, y, mode, params, dy):
    def decay(x):
        return -rate * x

    dy[0] = decay(y[0])


def set_global(value):
    globals()["rate"] = value


def set_tuple(value):
    globals()["rates"] = (1.0, (value, 3.0))


def set_array(value):
    table[0] = value


def set_array_in_tuple(value):
    pair[0][0] = value


def set_module(value):
    other.rate = value


def set_inner_module(value):
    other.inner.rate = value


CHANGES = [
    (of_global, set_global), (of_tuple, set_tuple), (of_array, set_array),
    (of_array_in_tuple, set_array_in_tuple), (of_module, set_module),
    (of_inner_module, set_inner_module), (of_helper, set_global), (of_nested, set_global),
]  # fmt: skip


@pytest.fixture(autouse=True)
def _as_before():
    yield
    for change in {change for _, change in CHANGES}:
        change(2.0)
    globals()["height"], globals()["kick"] = 0.5, 1.0


def found_rate(system, ask=solve, **options):
    return -math.log(ask(system, (0, 1), [1.0], **options).y_end[0])


@pytest.mark.parametrize(("function", "change"), CHANGES, ids=lambda one: one.__name__)
def test_a_change_counts_and_no_change_compiles_nothing(function, change):
    system = System(field(function), n_states=1)
    assert found_rate(system) == pytest.approx(2.0)
    assert system.current() is system
    change(2.0)  # another object of the same value
    assert system.current() is system
    change(5.0)
    assert len(system.constants.changed()) == 1
    assert found_rate(system) == pytest.approx(5.0)
    assert system.current() is system.current() is not system
    change(2.0)
    assert found_rate(system) == pytest.approx(2.0)


def test_a_closure_counts():
    k = 2.0

    @field
    def decay(t, y, mode, params, dy):
        dy[0] = -k * y[0]

    system = System(decay, n_states=1)
    assert found_rate(system) == pytest.approx(2.0)
    k = 5.0
    assert system.constants.changed() == ("k",)
    assert found_rate(system) == pytest.approx(5.0)


def test_a_helper_of_another_text_counts():
    @numba.njit
    def slow(y):
        return -2.0 * y

    @numba.njit
    def fast(y):
        return -5.0 * y

    chosen = slow

    @field
    def decay(t, y, mode, params, dy):
        dy[0] = chosen(y[0])

    system = System(decay, n_states=1)
    assert found_rate(system) == pytest.approx(2.0)
    chosen = fast
    assert found_rate(system) == pytest.approx(5.0)


def test_a_new_system_does_not_take_what_was_compiled_for_an_old_one():
    """Neither the code of the function itself nor that of a function that it calls."""
    old = field(of_helper)
    assert found_rate(System(old, n_states=1)) == pytest.approx(2.0)
    set_global(5.0)
    assert found_rate(System(old, n_states=1)) == pytest.approx(5.0)
    set_global(7.0)
    assert found_rate(System(field(of_helper), n_states=1)) == pytest.approx(7.0)


def test_a_callback_that_was_compiled_by_itself_before():
    alone = field(of_global)
    assert alone.address > 0
    set_global(5.0)
    assert found_rate(System(alone, n_states=1)) == pytest.approx(5.0)


def test_batches_lanes_derivatives_backward_and_debug():
    system = System(field(of_helper), n_states=1)
    asks = {
        "batch": lambda: solve_batch(system, (0, 1), [[1.0]]).y_end[0, 0],
        "lanes": lambda: solve_batch(system, (0, 1), [[1.0]] * 4, lanes=True).y_end[
            3, 0
        ],
        "derivative": lambda: solve(system, (0, 1), [1.0], jacobian=True).jacobian[
            0, 0
        ],
        "backward": lambda: 1.0 / solve(system, (0, -1), [1.0]).y_end[0],
        "debug": lambda: solve(system, (0, 1), [1.0], debug=True).y_end[0],
    }
    for expected in (2.0, 5.0):
        set_global(expected)
        for name, ask in asks.items():
            assert -math.log(ask()) == pytest.approx(expected, rel=1e-6), name


def test_plain_functions_see_what_they_call_compiled_anew():
    system = System(field(of_helper, compiled=False), n_states=1)
    assert found_rate(system) == pytest.approx(2.0)
    set_global(5.0)
    assert found_rate(system) == pytest.approx(5.0)
    live = System(field(of_global, compiled=False), n_states=1)
    assert found_rate(live) == pytest.approx(5.0)
    set_global(2.0)
    assert live.current() is live  # Python reads the global each time
    assert found_rate(live) == pytest.approx(2.0)


@field
def advance(t, y, mode, params, dy):
    dy[0] = 1.0


@guards
def at_height(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = y[0] - height, dy[0]


@on_event
def jump(t, y, mode, params, guard, direction):
    y[0] += kick
    return 0


def test_guards_and_handlers():
    system = System(advance, at_height, jump, n_states=1, guard_names=("g",))
    globals()["height"], globals()["kick"] = 0.5, 1.0
    for wanted in (0.5, 0.25):
        globals()["height"] = wanted
        assert solve(system, (0, 1), [0.0]).events.time == pytest.approx([wanted])
    for wanted in (1.0, 4.0):
        globals()["kick"] = wanted
        assert solve(system, (0, 1), [0.0]).y_end == pytest.approx([1.0 + wanted])


@affine
def decay_form(mode, params, a, b):
    a[0, 0] = -rate
    b[:] = 0.0


@jacobian
def decay_slope(t, y, mode, params, jac):
    jac[0, 0] = -rate


@pytest.mark.parametrize("method", ["taylor", "rosenbrock"])
def test_affine_form_and_jacobian(method):
    system = System(
        field(of_global), affine=decay_form, jacobian=decay_slope, n_states=1
    )
    for wanted in (2.0, 5.0):
        set_global(wanted)
        assert found_rate(system, method=method) == pytest.approx(wanted)


def test_checks_of_an_instant_see_a_changed_helper():
    @guards
    def at_zero(t, y, dy, mode, params, h, hdot):
        h[0], hdot[0] = deep(y[0]) + rate, deep(dy[0])

    system = System(advance, at_zero, n_states=1, guard_names=("g",))
    options = {"params": (), "mode": [1], "guards": ["g"]}
    assert check_c1(system, [1.0], **options).verdict == "C1"
    assert solve(system, (0, 2), [0.0]).events.time == pytest.approx([1.0])
    set_global(5.0)
    assert check_c1(system, [1.0], **options).verdict == "C1"
    assert deep(1.0) == -5.0


def test_what_is_compared():
    def reads(y):
        return np.sin(y) + math.pi * rate + table[0] + abs(y) + sys.maxsize

    frozen = np.array([1.0])
    frozen.flags.writeable = False

    def reads_frozen(y):
        return frozen[0]

    found = Constants([reads])
    assert set(found.values()) == {"rate", "table", "maxsize"}
    assert found.are_current()
    assert found.changed() == ()
    globals()["abs"] = len  # a name that hides a builtin one
    try:
        assert found.changed() == ("abs",)
    finally:
        del globals()["abs"]
    assert found.are_current()
    constants = Constants([reads_frozen])
    frozen.flags.writeable = True
    frozen[0] = 2.0
    assert constants.are_current()  # it could not be written to when it was remembered
    assert set(constants.values()) == {"frozen"}


def test_numbers_in_tuples_have_their_places():
    gains, tables = (2.0, (3, "a")), (np.array([1.0]), np.array([2.0]))

    def reads(y):
        return gains[0] + tables[1][0]

    found = Constants([reads])
    values = found.values()
    assert values["gains[0]"] == 2.0
    assert values["gains[1][1]"] == "a"
    assert values["len(gains)"] == values["len(gains[1])"] == 2
    assert values["tables[0]"] == np.array([1.0]).tobytes()
    assert values["tables[1]"] == np.array([2.0]).tobytes()
    tables[1][0] = 3.0
    assert found.changed() == ("tables[1]",)


def test_a_function_that_is_gone_is_forgotten():
    @numba.njit
    def fading(y):
        return -y

    renew_called(Constants([fading]))
    before = weakref.ref(fading)
    del fading
    gc.collect()
    assert before() is None
