"""Guards in lanes are proven as by the driver: the same events, and no others."""

from __future__ import annotations

import os

import numpy as np
import pytest
from families import FAMILIES, system_of
from numba import njit

from hopdata.hybrid import System, field, guards, solve_batch

MEMBERS = 20
# Kinds that lanes compile, and the least share of members that they do themselves.
KINDS = {
    "two sines": 0.8,
    "cos^400": 0.3,
    "bump 0.02": 0.8,
    "sine of state": 0.8,
    "near roots": 0.8,
    "plate": 0.8,
    "foot": 0.8,
    "terrain": 0.8,
    "flat root": 0.0,
}


#: Each compiles for 2 s. `test_families.py` proves all of them by the driver.
SOME_KINDS = [*KINDS][:: 1 if "ALL" in os.environ else 4]


@pytest.mark.parametrize("name", SOME_KINDS)
def test_as_many_events_as_by_the_driver_and_proven(name):
    rng = np.random.default_rng([12, *map(ord, name)])
    members = [FAMILIES[name].draw(rng) for _ in range(MEMBERS)]
    starts, params, ends = (list(one) for one in zip(*members, strict=True))
    span = (0.0, float(np.median(ends)))
    options = {"params": params, "rtol": 1e-8, "atol": 1e-11, "workers": 1}
    here = solve_batch(system_of(name), span, starts, lanes=True, **options)
    plain = solve_batch(system_of(name), span, starts, method="dop853", **options)
    np.testing.assert_array_equal(here.n_events, plain.n_events)
    assert here.success
    assert here.proven.all()
    assert here.lanes.mean() >= KINDS[name], here.lanes_reason


@field
def turning(t, y, mode, params, dy):
    dy[0] = -y[1]
    dy[1] = y[0]


@njit(error_model="numpy")
def height(t, y, kind):
    """Return functions of every operation that ranges in lanes know."""
    x = 0.5 * y[0] + 1.5
    if kind == 0:
        return 1.0 / x - 0.8
    if kind == 1:
        return np.sqrt(x) - 1.2
    if kind == 2:
        return abs(y[1]) - 0.6
    if kind == 3:
        return y[0] ** 3 - 0.2
    if kind == 4:
        return np.cos(3.0 * t) * y[1] - 0.1
    if kind == 5:
        return np.exp(y[0]) - np.log(x) - np.tan(0.5 * y[1]) - 1.2
    if kind == 6:
        return np.maximum(y[0], np.minimum(y[1], 0.8)) - np.sqrt(0.2 + y[1] ** 2)
    if kind == 7:
        return np.hypot(y[0] - 0.4, y[1] + 0.2) - 0.9
    if kind == 8:
        return y[0] + 0.2 * np.floor(2.5 * y[1]) - 0.1 * np.ceil(y[0]) - 0.1
    if kind == 9:
        return (3.0 * t + y[1]) % 1.7 - 0.8 + 0.3 * y[0]
    return -(y[0] / x) / 2.0 + (0.3 - t / 9.0)


@guards
def one_of_them(t, y, dy, mode, params, h, hdot):
    kind = int(params[0])
    tiny = 1e-6
    h[0] = height(t, y, kind)
    # A rate by differences: the proof does not depend on it.
    ahead = height(t + tiny, (y[0] + tiny * dy[0], y[1] + tiny * dy[1]), kind)
    hdot[0] = (ahead - h[0]) / tiny


@pytest.mark.parametrize("kind", range(11))
def test_every_operation_finds_the_flips_of_a_dense_sampling(kind):
    system = System(turning, one_of_them, n_states=2, guard_names=("h",))
    phases = np.linspace(0.1, 6.0, 20)
    starts = np.column_stack([np.cos(phases), np.sin(phases)])
    found = solve_batch(system, (0.0, 12.0), starts, params=[kind], lanes=True)
    assert found.success
    assert found.proven.all()
    # Steps in which these jump take the driver's proof, which may lose their lanes.
    if kind not in (8, 9):
        assert found.lanes.mean() > 0.8, found.lanes_reason
    t = np.linspace(0.0, 12.0, 200_001)
    for phase, count in zip(phases, found.n_events, strict=True):
        y = (np.cos(t + phase), np.sin(t + phase))
        side = np.signbit(height.py_func(t, y, kind))
        assert count == np.count_nonzero(np.diff(side))


@guards
def an_arc(t, y, dy, mode, params, h, hdot):
    h[0] = np.arctan(0.5 * y[0]) - 0.1
    hdot[0] = 0.5 * dy[0] / (1.0 + 0.25 * y[0] ** 2)


@guards
def two_with_rates(t, y, dy, mode, params, h, hdot):
    h[0], h[1] = y[0] - 0.1 * np.exp(-(y[1] ** 2)), y[1] - params[0] * t
    hdot[0] = dy[0] + 0.2 * np.exp(-(y[1] ** 2)) * y[1] * dy[1]
    hdot[1] = dy[1] - params[0]


def two_values(t, y, params):
    return y[0] - 0.1 * np.exp(-(y[1] ** 2)), y[1] - params[0] * t


@pytest.mark.parametrize("span", [(0.0, 12.0), (12.0, 0.0)])
def test_guards_without_rates_are_those_with_them(span):
    phases = np.linspace(0.1, 6.0, 20)
    starts = np.column_stack([np.cos(phases), np.sin(phases)])
    names = {"n_states": 2, "guard_names": ("first", "second")}
    options = {"params": [0.03], "lanes": True, "workers": 1}
    found = solve_batch(System(turning, two_values, **names), span, starts, **options)
    wanted = solve_batch(
        System(turning, two_with_rates, **names), span, starts, **options
    )
    assert found.lanes.all(), found.lanes_reason
    assert found.proven.all()
    assert found.n_events.sum() > 100
    np.testing.assert_array_equal(found.n_events, wanted.n_events)
    np.testing.assert_array_equal(found.mode, wanted.mode)
    np.testing.assert_allclose(found.y_end, wanted.y_end, rtol=0, atol=1e-9)


@guards
def with_an_array(t, y, dy, mode, params, h, hdot):
    h[0] = np.dot(np.ones(2), np.array([y[0], y[1]]))
    hdot[0] = dy[0] + dy[1]


def test_other_operations_are_proven_in_lanes_and_arrays_by_the_driver():
    starts = [[1.0, 0.0]] * 3
    system = System(turning, an_arc, n_states=2, guard_names=("h",))
    found = solve_batch(system, (0.0, 12.0), starts, lanes=True)
    assert found.lanes.all()
    assert found.proven.all()
    np.testing.assert_array_equal(found.n_events, 4)
    system = System(turning, with_an_array, n_states=2, guard_names=("h",))
    found = solve_batch(system, (0.0, 12.0), starts, lanes=True)
    assert not found.lanes.any()
    assert found.lanes_reason
    assert found.proven.all()
    np.testing.assert_array_equal(found.n_events, 4)


def test_only_dips_far_below_the_tolerance_are_lost():
    """An orbit passes circles whose depth is known: 1e-10 to 1e-2 of their radius.

    Steps that are close are taken again, shorter: without that, dips of 0.34 tolerances
    are lost at this tolerance.
    """
    rtol, atol = 1e-9, 1e-12
    rng = np.random.default_rng([101, *map(ord, "graze")])
    members = [FAMILIES["graze"].draw(rng) for _ in range(60)]
    starts, params, ends = (np.array(one) for one in zip(*members, strict=True))
    options = {"params": params, "rtol": rtol, "atol": atol, "workers": 1}
    span = (0.0, ends[0])
    found = solve_batch(system_of("graze"), span, starts, lanes=True, **options)
    far = np.hypot(params[:, 0], params[:, 1])
    touched = params[:, :2] / far[:, None]
    depth = params[:, 2] ** 2 - (far - 1.0) ** 2
    reach = abs(touched) * 2.0 * (atol + rtol * abs(touched))
    tolerance = 2.0 * (far - 1.0) * reach.sum(axis=1)
    place = np.arctan2(*touched.T[::-1]) - np.arctan2(*starts.T[::-1])
    passes = 1 + (place % (2.0 * np.pi) < ends - 2.0 * np.pi)
    flips = np.where(depth > 0.0, 2 * passes, 0)
    unlike = found.n_events != flips
    assert found.lanes.mean() > 0.9
    assert (abs(depth) / tolerance)[unlike].max(initial=0.0) < 0.05
    assert (found.n_close[unlike] > 0).all()
    # And where they are deeper, they are found.
    assert np.count_nonzero(flips[~unlike]) > 20


def test_a_step_that_is_repeated_up_to_a_flip_does_not_pass_it_and_its_return():
    """Roots nearer to each other than the error of the step lie before its new end."""
    key = [581, *map(ord, "near roots")]
    draw = FAMILIES["near roots"].draw
    members = [draw(np.random.default_rng([*key, number])) for number in range(32)]
    starts, params, _ = (list(one) for one in zip(*members, strict=True))
    options = {"params": params, "rtol": 1e-3, "atol": 1e-6, "workers": 1}
    system = system_of("near roots")
    here = solve_batch(system, (0.0, 7.0), starts, lanes=True, **options)
    plain = solve_batch(system, (0.0, 7.0), starts, method="dop853", **options)
    assert here.lanes.mean() > 0.9
    np.testing.assert_array_equal(here.n_events, plain.n_events)
