"""A guard that reaches its surface only between the ends of a step is seen."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import ball, ladder, throw

from hopdata.hybrid import System, affine, field, guards, on_event, solve
from hopdata.hybrid.driver.watch import flip_time

# params: rate of the slow oscillation, rate and size of the fast one, level


@field
def swings(t, y, mode, params, dy):
    dy[0] = y[1]
    dy[1] = -(params[0] ** 2) * y[0]
    dy[2] = y[3]
    dy[3] = -(params[1] ** 2) * y[2]


@affine
def swings_affine(mode, params, a, b):
    a[0, 1] = 1.0
    a[1, 0] = -(params[0] ** 2)
    a[2, 3] = 1.0
    a[3, 2] = -(params[1] ** 2)
    b[:] = 0.0


@guards
def level(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] + params[2] * y[2] - params[3]
    hdot[0] = dy[0] + params[2] * dy[2]


SWINGS = System(swings, level, affine=swings_affine, n_states=4, guard_names=("level",))


def crossings(rate, height, phase, *, method="taylor", span=3.0):
    """Return the instants at which an oscillation of amplitude 1 is found to cross the level."""
    start = [np.cos(phase), -rate * np.sin(phase), 0.0, 0.0]
    params = (rate, 1.0, 0.0, height)
    solution = solve(
        SWINGS, (0, span), start, params=params, method=method, rtol=1e-9, atol=1e-11
    )
    assert solution.status == 0
    return solution.events.time


def exact(rate, height, phase, span=3.0):
    """Return the exact instants: cos(rate t + phase) = height."""
    angle = np.arccos(height)
    turns = 2.0 * np.pi * np.arange(-1, int(rate * span / 6.0) + 3)[:, None]
    angles = (turns + np.array([-angle, angle])).ravel()
    instants = (angles - phase) / rate
    return np.sort(instants[(instants > 0.0) & (instants < span)])


@pytest.mark.parametrize("height", [0.5, 0.9, 0.99, 0.999, -0.9, -0.999])
@pytest.mark.parametrize("rate", [0.7, 1.0, 2.0, 10.0])
def test_every_swing_that_reaches_the_level_is_seen(rate, height):
    for phase in np.linspace(0.05, 6.2, 60):
        wanted = exact(rate, height, phase)
        assert crossings(rate, height, phase) == pytest.approx(wanted, abs=1e-7), phase


def test_a_fast_swing_upon_a_slow_one_is_seen():
    rng = np.random.default_rng(2)
    for _ in range(100):
        slow = rng.uniform(0.5, 2.0)
        fast = rng.uniform(5.0, 30.0)
        size = rng.uniform(0.05, 0.5)
        params = (slow, fast, size, rng.uniform(-0.8, 0.8))
        start = [1.0, 0.0, 1.0, rng.normal()]
        found = [
            solve(
                SWINGS, (0, 3), start, params=params, method=method, rtol=1e-9
            ).events.time
            for method in ("taylor", "dopri5")
        ]
        assert found[0] == pytest.approx(found[1], abs=1e-6), params


def test_a_guard_that_is_far_away_costs_one_look_in_a_step():
    """Three calls at the start, whose locks are settled first; then the step's end, and ranges."""
    for method in ("taylor", "dopri5"):
        solution = solve(
            SWINGS, (0, 2.5), [1.0, 0.0, 0.0, 0.0], params=(1.0, 1.0, 0.0, 5.0),
            method=method,
        )  # fmt: skip
        assert method != "taylor" or solution.n_steps == 1
        looks = 2 * solution.n_steps + solution.n_rejected
        assert 3 <= solution.n_guard_evaluations <= 3 + looks + 5


# Steps end soon after the next event, and are no shorter than necessary.


def test_flip_time_of_parabolas():
    rng = np.random.default_rng(2)
    for _ in range(300):
        value, rate, bend = rng.uniform(0, 2), *rng.normal(size=2)
        roots = np.roots([0.5 * bend, rate, value])
        falling = [
            x.real
            for x in roots
            if x.imag == 0 and x.real > 0 and rate + bend * x.real < 0
        ]
        assert flip_time(value, rate, bend) == pytest.approx(
            min(falling, default=0.0), rel=1e-9
        )


@pytest.mark.parametrize(
    ("rate", "bend", "expected"), [(-2.0, 0.0, 0.5), (2.0, 0.0, 0.0)]
)
def test_flip_time_without_bend(rate, bend, expected):
    assert flip_time(1.0, rate, bend) == expected


@pytest.mark.parametrize(
    ("rate", "bend", "expected"), [(2.0, -1.0, 4.0), (2.0, 1.0, 0.0)]
)
def test_flip_time_on_the_surface(rate, bend, expected):
    assert flip_time(0.0, rate, bend) == expected


def test_a_step_reaches_a_known_event_with_little_to_spare():
    """Without clipping, the step would be repeated: six more evaluations per event."""
    rungs = np.linspace(0.05, 0.95, 10)
    solution = solve(
        ladder(10), (0, 1), [0.0, 0.0], params=(*rungs, *np.zeros(10)),
        first_step=0.1, method="dopri5",
    )  # fmt: skip
    assert len(solution.events) == 10
    assert solution.nfev <= 10 * 8 + 12


def test_the_step_is_as_long_as_before_once_the_event_is_past():
    """Steps of 1, then one clipped to reach the event at 9.97; the following are no shorter."""
    system = throw()
    end = 21.0
    free = solve(system, (0, end), [0.0, 2.0], params=(2.0, 1e9), max_step=1.0)
    solution = solve(system, (0, end), [0.0, 2.0], params=(2.0, -79.5), max_step=1.0)
    assert len(solution.events) == 1
    assert solution.n_steps <= free.n_steps + 2


def test_a_bounce_takes_one_step():
    solution = solve(
        ball(directions=(1,)), (0, 201), [1.0, 0.0], params=(2.0, 0.0, 1.0)
    )
    assert len(solution.events) == 100
    assert solution.n_steps <= 120


@field
def turns(t, y, mode, params, dy):
    dy[0] = y[1]
    dy[1] = -y[0]


@guards
def without_the_time(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] - 0.3 * np.cos(2.0 * t)
    hdot[0] = dy[0]


@on_event
def push(t, y, mode, params, guard, direction):
    y[1] += 0.2 * (direction > 0)
    return 0


@guards
def with_the_time(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] - 0.3 * np.cos(2.0 * t)
    hdot[0] = dy[0] + 0.6 * np.sin(2.0 * t)


def test_rates_that_leave_out_the_time_lose_no_event():
    """After a flip the shortest windows were uninformative, and the search never left them."""
    wrong = System(turns, without_the_time, push, n_states=2, guard_names=("line",))
    right = System(turns, with_the_time, push, n_states=2, guard_names=("line",))
    for start in np.random.default_rng(1).uniform(-1.0, 1.0, (5, 2)):
        solution = solve(wrong, (0.0, 20.0), start)
        truth = solve(right, (0.0, 20.0), start)
        assert solution.success
        assert len(truth.events) > 0
        assert solution.events.time == pytest.approx(truth.events.time, abs=1e-6)


@field
def two_sines_field(t, y, mode, params, dy):
    dy[0] = -y[1]
    dy[1] = y[0]


@guards
def two_sines(t, y, dy, mode, params, h, hdot):
    h[0] = (
        np.sin(params[0] * t)
        + params[1] * np.sin(params[2] * t + params[3])
        + params[4]
    )
    hdot[0] = params[0] * np.cos(params[0] * t)
    hdot[0] += params[1] * params[2] * np.cos(params[2] * t + params[3])


def test_the_middle_of_a_long_step_does_not_hide_dips_of_a_faster_sine():
    """Dips 0.8 deep were lost at rtol 1e-9, where ends and middle met a cubic by accident."""
    system = System(two_sines_field, two_sines, n_states=2, guard_names=("sines",))
    params = [
        77.87729160135082,
        0.2659239306026223,
        288.1659120598802,
        3.0302903245190596,
    ]
    start = [-0.03985940913167259, -0.9992052979761836]
    solution = solve(
        system,
        (0, 10),
        start,
        params=[*params, -0.22169638018639393],
        rtol=1e-9,
        atol=1e-12,
    )
    assert len(solution.events) == 248
