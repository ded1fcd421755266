"""Guards that flip together, nearly together, and because of each other."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import (
    fall_field,
    floor_guard,
    ladder,
    ladder_solution,
    relay,
    throw,
)

from hopdata.hybrid import System, field, guards, on_event, solve
from hopdata.hybrid.layout import STATE_NOT_FINITE

GAPS = [1e-3, 1e-6, 1e-9, 1e-12, 1e-14, 1e-15, 1e-16, 0.0]


@pytest.mark.parametrize("gap", GAPS)
@pytest.mark.parametrize("first", [0, 1])
def test_two_guards_this_far_apart(gap, first):
    rungs = np.array([0.3, 0.3 + gap]) if first == 0 else np.array([0.3 + gap, 0.3])
    gains = np.array([2.0, -0.5])
    instants, end = ladder_solution(rungs, gains, 1.0)
    solution = solve(ladder(2), (0, 1), [0.0, 0.0], params=(*rungs, *gains))
    assert solution.status == 0
    assert sorted(solution.events.guard.tolist()) == [0, 1]
    assert (np.diff(solution.events.time) >= 0).all()
    by_guard = solution.events.time[np.argsort(solution.events.guard)]
    assert by_guard == pytest.approx(instants, abs=4e-15)
    assert solution.y_end[0] == pytest.approx(end, abs=1e-14)


def test_coincident_guards_share_their_instant():
    solution = solve(ladder(5), (0, 1), [0.0, 0.0], params=(*[0.3] * 5, *[0.1] * 5))
    assert solution.events.guard.tolist() == [0, 1, 2, 3, 4]
    assert len(set(solution.events.time.tolist())) == 1
    after = [
        [1] * (k + 1) + [-1] * (4 - k) for k in range(5)
    ]  # each event has the mode after it
    assert solution.events.mode.tolist() == after
    assert solution.y_end[0] == pytest.approx(0.3 + 0.7 * 1.5, abs=1e-14)


def test_apart_they_do_not():
    solution = solve(ladder(2), (0, 1), [0.0, 0.0], params=(0.3, 0.3 + 1e-9, 0, 0))
    assert solution.events.time[1] - solution.events.time[0] == pytest.approx(
        1e-9, rel=1e-5
    )
    assert solution.events.mode.tolist() == [[1, -1], [1, 1]]


def test_many_events_in_one_step():
    rng = np.random.default_rng(3)
    rungs = rng.uniform(0, 1, 35)
    gains = rng.uniform(-0.02, 0.05, 35)
    instants, end = ladder_solution(rungs, gains, 2.0)
    solution = solve(
        ladder(35), (0, 2), [0.0, 0.0], params=(*rungs, *gains), first_step=2.0
    )
    assert solution.events.guard.tolist() == np.argsort(rungs).tolist()
    assert solution.events.time == pytest.approx(np.sort(instants), abs=1e-13)
    assert solution.y_end[0] == pytest.approx(end, abs=1e-13)


def test_a_handler_pushes_another_guard_across():
    solution = solve(relay(), (0, 2), [0.0, 0.0], mode=[-1])
    assert solution.events.guard.tolist() == [0, 1]
    assert (
        solution.events.time[0]
        == solution.events.time[1]
        == pytest.approx(1.0, abs=1e-15)
    )
    assert solution.mode.tolist() == [1, 1, 1]
    assert solution.y_end == pytest.approx([2.0, 1.0], abs=1e-13)


def test_the_field_is_refreshed_after_each_flip():
    """Twenty flips in a row would leave 20 stale slopes and put the end off by some percent."""
    rungs = np.linspace(0.01, 0.2, 20)
    gains = np.full(20, 0.5)
    _, end = ladder_solution(rungs, gains, 0.3)
    solution = solve(
        ladder(20), (0, 0.3), [0.0, 0.0], params=(*rungs, *gains), first_step=0.3
    )
    assert solution.y_end[0] == pytest.approx(end, abs=1e-13)


def random_ladder(rng):
    """Return up to 40 rungs, half the time in clusters with gaps down to 1e-17, at any scale."""
    n = int(rng.integers(1, 41))
    rungs = rng.uniform(0, 1, n)
    if rng.random() < 0.5:
        gaps = 10.0 ** rng.integers(-17, -3, n) * rng.integers(0, 2, n)
        rungs = rng.choice(rng.uniform(0, 1, 3), n) + gaps
    return rungs, rng.uniform(-0.5 / n, 1, n), 10.0 ** rng.integers(-6, 7)


@pytest.mark.parametrize("seed", range(12))
def test_random_ladders(seed):
    rng = np.random.default_rng(seed)
    for _ in range(25):
        rungs, gains, scale = random_ladder(rng)
        instants, end = ladder_solution(rungs, gains, 1.0)
        instants = np.sort(instants[instants < 1])
        options = {"first_step": scale} if rng.random() < 0.5 else {}
        solution = solve(
            ladder(len(rungs)), (0, scale), [0.0, 0.0], params=(*(rungs * scale), *gains),
            rtol=10.0 ** -rng.integers(3, 13), atol=0.0, **options,
        )  # fmt: skip
        assert solution.status == 0
        assert solution.events.time / scale == pytest.approx(instants, abs=2e-14)
        assert (solution.events.direction == 1).all()
        assert solution.y_end[0] / scale == pytest.approx(end, abs=1e-13)


# Locks at the start.


@pytest.mark.parametrize(("place", "lock"), [(0.4, -1), (0.6, 1), (0.5, 1)])
def test_by_h_and_on_the_surface_by_its_rate(place, lock):
    solution = solve(ladder(1), (0, 0.01), [place, 0.0], params=(0.5, 1.0))
    assert solution.mode.tolist() == [lock]
    assert len(solution.events) == 0


@pytest.mark.parametrize(("speed", "expected"), [(2.0, [-1]), (-2.0, [])])
def test_on_the_surface(speed, expected):
    """A ball thrown up from the surface comes back; a ball thrown down does not."""
    solution = solve(throw(), (0, 3), [0.5, speed], params=(2.0, 0.5))
    assert solution.events.direction.tolist() == expected
    if expected:
        assert solution.events.time[0] == pytest.approx(2.0, abs=1e-14)


@pytest.mark.parametrize(("gravity", "lock"), [(2.0, -1), (-2.0, 1)])
def test_at_rest_on_the_surface(gravity, lock):
    """Neither h nor its rate decides the lock; the second derivative does."""
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


@on_event
def spoil(t, y, mode, params, guard, direction):
    y[1] = params[2]
    return int(params[3])


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("ends", [0.0, 1.0])
def test_a_state_spoilt_by_a_handler_is_no_success(value, ends):
    """Also at an event that ends the run, after which nothing is evaluated."""
    system = System(fall_field, floor_guard, spoil, n_states=2, guard_names=("floor",))
    solution = solve(system, (0, 2), [1.0, 0.0], params=[9.81, 0.0, value, ends])
    assert solution.status == STATE_NOT_FINITE
    assert not solution.success
    assert "guard 'floor'" in solution.message
    assert solution.t_end == pytest.approx(np.sqrt(2 / 9.81), abs=1e-9)
    sound = solve(system, (0, 2), [1.0, 0.0], params=[9.81, 0.0, 3.0, 1.0])
    assert sound.status == 1
    assert sound.y_end[1] == 3.0


@field
def root_field(t, y, mode, params, dy):
    dy[0] = np.sqrt(y[0]) if mode[0] > 0 else -np.sqrt(-y[0])


@guards
def root_guard(t, y, dy, mode, params, h, hdot):
    h[0] = y[0]
    hdot[0] = dy[0]


@pytest.mark.parametrize("side", [-1, 1])
def test_a_field_that_only_its_own_side_has(side):
    """The sign of h decides the lock, whatever the field would be in the other mode."""
    system = System(root_field, root_guard, n_states=1, guard_names=("zero",))
    solution = solve(system, (0, 1), [1.0 * side])
    assert solution.status == 0
    assert solution.y_end == pytest.approx([2.25 * side], rel=1e-8)
