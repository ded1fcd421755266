"""Steps end soon after the next event, and are not shorter than they must be."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import ball, ladder, throw

from hopdata.hybrid import solve
from hopdata.hybrid.driver.prediction import flip_time


def test_flip_time_of_parabolas():
    rng = np.random.default_rng(2)
    for _ in range(300):
        value, rate, bend = rng.uniform(0, 2), *rng.normal(size=2)
        roots = np.roots([0.5 * bend, rate, value])
        falling = [x.real for x in roots if x.imag == 0 and x.real > 0 and rate + bend * x.real < 0]
        assert flip_time(value, rate, bend) == pytest.approx(min(falling, default=0.0), rel=1e-9)


@pytest.mark.parametrize(("rate", "bend", "expected"), [(-2.0, 0.0, 0.5), (2.0, 0.0, 0.0)])
def test_flip_time_without_bend(rate, bend, expected):
    assert flip_time(1.0, rate, bend) == expected


@pytest.mark.parametrize(("rate", "bend", "expected"), [(2.0, -1.0, 4.0), (2.0, 1.0, 0.0)])
def test_flip_time_on_the_surface(rate, bend, expected):
    assert flip_time(0.0, rate, bend) == expected


def test_a_step_reaches_a_known_event_with_little_to_spare():
    """Were the step not clipped, it would be taken again: six evaluations more for each event."""
    rungs = np.linspace(0.05, 0.95, 10)
    solution = solve(
        ladder(10), (0, 1), [0.0, 0.0], params=(*rungs, *np.zeros(10)),
        first_step=0.1, method="dopri5",
    )  # fmt: skip
    assert len(solution.events) == 10
    assert solution.nfev <= 10 * 8 + 12


def test_the_step_is_as_long_as_before_once_the_event_is_past():
    """Steps of 1, then one that is clipped to reach the event at 9.97; the next are no shorter."""
    system, end = throw(), 21.0
    free = solve(system, (0, end), [0.0, 2.0], params=(2.0, 1e9), max_step=1.0)
    solution = solve(system, (0, end), [0.0, 2.0], params=(2.0, -79.5), max_step=1.0)
    assert len(solution.events) == 1
    assert solution.n_steps <= free.n_steps + 2


def test_a_bounce_takes_one_step():
    solution = solve(ball(directions=(1,)), (0, 201), [1.0, 0.0], params=(2.0, 0.0, 1.0))
    assert len(solution.events) == 100
    assert solution.n_steps <= 120
