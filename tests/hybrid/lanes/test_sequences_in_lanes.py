"""Several guards at one instant, in lanes: one after the other, as the driver does it."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import ladder, ladder_solution, row_of_balls

from hopdata.hybrid import System, field, guards, on_event, solve_batch
from hopdata.hybrid.layout import ZENO

COUNT = 60


@pytest.mark.parametrize("n", [2, 3, 5])
def test_balls_that_meet_at_a_point(n):
    """In lanes or not, equal balls pass as if they were free."""
    rng = np.random.default_rng([1, n])
    steps = [
        np.sort(rng.choice(np.arange(-16, 17), n, replace=False)) for _ in range(COUNT)
    ]
    v = -np.array(steps) / 4.0
    x = -v + 1e-16 * rng.integers(-4, 5, v.shape) * rng.integers(0, 2, (COUNT, 1))
    x = np.maximum.accumulate(x, axis=1)
    masses = np.ones((COUNT, n))
    params = np.column_stack([masses, np.ones(COUNT), np.zeros(COUNT)])
    given = {"mode": [1] * (n - 1), "params": params}
    found = solve_batch(
        row_of_balls(n), (0, 3.0), np.hstack([x, v]), lanes=True, **given
    )
    assert found.success, found.message
    assert found.y_end[:, :n] == pytest.approx(np.sort(x + 3.0 * v, axis=1), abs=1e-12)
    assert found.lanes.all() == (n == 2)  # with three, a gap closes twice: the driver's


def test_slow_and_fast_gaps_far_from_the_origin():
    """Where a slow gap's rounding makes the instant unsure, the driver goes on."""
    rng = np.random.default_rng(5)
    n = 3
    v = -np.sort(-rng.uniform(-4, 4, (COUNT, n)), axis=1) * 10.0 ** rng.integers(
        -6, 1, (COUNT, 1)
    )
    v[:, 2] = v[:, 1] - 10.0 ** rng.uniform(-6, 0, COUNT)
    x = 10.0 ** rng.integers(0, 4, (COUNT, 1)) - v * rng.uniform(0.1, 2, (COUNT, 1))
    x = np.maximum.accumulate(x, axis=1)
    given = {"mode": [1, 1], "params": [1.0, 1.0, 1.0, 1.0, 0.0], "lanes": True}
    found = solve_batch(row_of_balls(n), (0, 3.0), np.hstack([x, v]), **given)
    assert found.success, found.message
    right = np.sort(x + 3.0 * v, axis=1)
    size = np.abs(x).max(axis=1) + np.abs(v).max(axis=1)
    assert (np.abs(found.y_end[:, :n] - right).max(axis=1) < 1e-12 * size).all()


@pytest.mark.parametrize(("restitution", "status"), [(0.05, ZENO), (0.08, 0)])
def test_inelastic_collapse(restitution, status):
    start = np.tile([-1.0, 0.0, 1.0, 1.0, 0.0, -1.0], (8, 1))
    given = {"mode": [1, 1], "params": [1.0, 1.0, 1.0, restitution, 0.0], "lanes": True}
    found = solve_batch(row_of_balls(3), (0, 3.0), start, **given)
    assert (found.status == status).all()
    assert not found.lanes.any()  # a guard flips for a third time at one instant


@field
def helped_across(t, y, mode, params, dy):
    dy[0] = -0.5 if mode[0] > 0 and mode[1] < 0 else 1.0
    dy[1] = 1.0


@guards
def two_zeros(t, y, dy, mode, params, h, hdot):
    h[0] = y[0]
    h[1] = y[1]
    hdot[0] = dy[0]
    hdot[1] = dy[1]


def test_a_guard_waits_for_others_before_it_flips_back():
    system = System(helped_across, two_zeros, n_states=2, guard_names=("a", "b"))
    found = solve_batch(system, (0, 1), np.full((8, 2), -0.5), lanes=True)
    assert found.success
    assert found.lanes.all()
    assert found.y_end == pytest.approx(np.full((8, 2), 0.5), abs=1e-14)


def test_pairs_that_meet_together_stay_in_lanes():
    """Two pairs collide at one instant, four flips in all."""
    v = np.random.default_rng(2).integers(1, 9, (COUNT, 2)) / 4.0
    v = np.column_stack([v[:, 0], -v[:, 0], v[:, 1], -v[:, 1]])
    x = np.array([0.0, 0.0, 8.0, 8.0]) - v
    params = [1.0, 1.0, 1.0, 1.0, 1.0, 0.0]
    given = {"mode": [1, 1, 1], "params": params, "lanes": True}
    found = solve_batch(row_of_balls(4), (0, 1.5), np.hstack([x, v]), **given)
    assert found.success
    assert (
        found.lanes.mean() > 0.8
    )  # where they are apart by rounding, the driver goes on
    assert (found.n_events == 4).all()
    assert found.y_end[:, :4] == pytest.approx(np.sort(x + 1.5 * v, axis=1), abs=1e-12)


def test_coincident_rungs_stay_in_lanes():
    rng = np.random.default_rng(3)
    rungs = np.repeat(rng.uniform(0.1, 0.5, (COUNT, 1)), 5, axis=1)
    gains = rng.uniform(-0.1, 0.3, (COUNT, 5))
    params = np.hstack([rungs, gains])
    start = np.zeros((COUNT, 2))
    found = solve_batch(ladder(5), (0, 1), start, params=params, lanes=True)
    assert found.success
    assert found.lanes.all()
    assert (found.n_events == 5).all()
    ends = [ladder_solution(r, g, 1.0)[1] for r, g in zip(rungs, gains, strict=True)]
    assert found.y_end[:, 0] == pytest.approx(np.array(ends), abs=1e-12)


@field
def passing(t, y, mode, params, dy):
    dy[0] = 1.0
    dy[1] = 0.0


@guards
def three_planes(t, y, dy, mode, params, h, hdot):
    for k in range(3):
        h[k] = y[0] - 0.5
        hdot[k] = dy[0]


@on_event
def double_then_add(t, y, mode, params, guard, direction):
    y[1] = 2.0 * y[1] + params[guard]
    return 0


@pytest.mark.parametrize("terminal", [None, (False, True, False)])
def test_resets_in_the_order_of_the_guards(terminal):
    """2 (2 (2 y + a) + b) + c; what is due at a terminal event is an event still."""
    system = System(
        passing, three_planes, double_then_add, n_states=2, guard_names=("a", "b", "c"),
        terminal=terminal,
    )  # fmt: skip
    rng = np.random.default_rng(4)
    start = np.zeros((COUNT, 2))
    params = rng.normal(size=(COUNT, 3))
    start[:, 1] = rng.normal(size=COUNT)
    expected = 8.0 * start[:, 1] + params @ [4.0, 2.0, 1.0]
    for lanes in (True, False):
        found = solve_batch(system, (0, 1), start, params=params, lanes=lanes)
        assert (found.status == (0 if terminal is None else 1)).all()
        assert (found.n_events == 3).all()
        assert found.y_end[:, 1] == pytest.approx(expected, rel=1e-14, abs=1e-14)
        assert found.lanes.all() == (lanes and terminal is None)
