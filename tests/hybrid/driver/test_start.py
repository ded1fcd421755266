"""Locks at the start."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import ladder, throw

from hopdata.hybrid import System, field, guards, solve


@pytest.mark.parametrize(("place", "lock"), [(0.4, -1), (0.6, 1), (0.5, 1)])
def test_by_h_and_on_the_surface_by_its_rate(place, lock):
    solution = solve(ladder(1), (0, 0.01), [place, 0.0], params=(0.5, 1.0))
    assert solution.mode.tolist() == [lock]
    assert len(solution.events) == 0


@pytest.mark.parametrize(("speed", "expected"), [(2.0, [-1]), (-2.0, [])])
def test_on_the_surface(speed, expected):
    """Thrown up from the surface, the ball comes back; thrown down, it does not."""
    solution = solve(throw(), (0, 3), [0.5, speed], params=(2.0, 0.5))
    assert solution.events.direction.tolist() == expected
    if expected:
        assert solution.events.time[0] == pytest.approx(2.0, abs=1e-14)


@pytest.mark.parametrize(("gravity", "lock"), [(2.0, -1), (-2.0, 1)])
def test_at_rest_on_the_surface(gravity, lock):
    """Neither h nor its rate decides: the way the rate bends does."""
    solution = solve(throw(), (0, 1), [0.5, 0.0], params=(gravity, 0.5))
    assert solution.status == 0
    assert solution.mode.tolist() == [lock]
    assert len(solution.events) == 0


@pytest.mark.parametrize("before", [1e-12, 1e-15, 1e-17])
def test_just_before_the_surface(before):
    solution = solve(ladder(1), (0, 1), [-before, 0.0], params=(0.0, 1.0))
    assert solution.events.direction.tolist() == [1]
    assert solution.events.time[0] == pytest.approx(before, abs=1e-16)
    assert solution.y_end[0] == pytest.approx(2.0 * (1.0 - before), abs=1e-14)


def test_a_given_lock_is_kept_until_it_is_violated():
    on_surface = solve(ladder(1), (0, 1), [0.5, 0.0], params=(0.5, 1.0), mode=[1])
    assert len(on_surface.events) == 0
    beyond = solve(ladder(1), (0, 1), [0.7, 0.0], params=(0.5, 1.0), mode=[-1])
    assert beyond.events.time.tolist() == [0.0]
    assert beyond.y_end[0] == pytest.approx(2.7, abs=1e-14)


def test_given_locks_against_the_rate_fire_at_once():
    solution = solve(ladder(1), (0, 1), [0.5, 0.0], params=(0.5, 1.0), mode=[-1])
    assert solution.events.time.tolist() == [0.0]
    assert solution.y_end[0] == pytest.approx(2.5, abs=1e-14)


@field
def root_field(t, y, mode, params, dy):
    dy[0] = np.sqrt(y[0]) if mode[0] > 0 else -np.sqrt(-y[0])


@guards
def root_guard(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = y[0], dy[0]


@pytest.mark.parametrize("side", [-1, 1])
def test_a_field_that_only_its_own_side_has(side):
    """The sign of h decides the lock, whatever the field would be in the other mode."""
    system = System(root_field, root_guard, n_states=1, guard_names=("zero",))
    solution = solve(system, (0, 1), [1.0 * side])
    assert solution.status == 0
    assert solution.y_end == pytest.approx([2.25 * side], rel=1e-8)
