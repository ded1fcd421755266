"""Algorithm 7 on the hopper in one dimension, against its closed form."""

from __future__ import annotations

import numpy as np
import pytest

from hopdata.hybrid.printed import Dopri5, Stepping, integrate_alternating, region_of
from hopdata.hybrid.printed.alternation import heading
from hopdata.scenes.vertical_hopper import VerticalHopper

HOPPER = VerticalHopper()
START, END = (2.0, 0.0), 2.0


def regions():
    """Touchdown, where the height above contact falls, and take-off, where it rises."""
    return tuple(region_of(HOPPER.system(), HOPPER.params, orientation=(k,)) for k in (-1, 1))


def hop(max_step, t_span=(0.0, END), start=START):
    solver = Stepping(Dopri5, {"rtol": 1e-9, "atol": 1e-12, "max_step": max_step})
    return integrate_alternating(*regions(), t_span, start, solver=solver)


@pytest.fixture(scope="module")
def truth():
    """Instants of touchdown and take-off, and the state at the end."""
    g, k = HOPPER.gravity_m_s2, HOPPER.stiffness_n_m / HOPPER.mass_kg
    fall, speed, omega = np.sqrt(2 / g), np.sqrt(2 * g), np.sqrt(k)
    stance = 2 * np.arctan2(speed / omega, -g / k) / omega
    hop = stance + 2 * fall
    times = np.array([fall, fall + stance, fall + hop])
    late = END - fall - hop - stance
    return times, np.array([1 + speed * late - g * late**2 / 2, speed - g * late])


def test_two_hops(truth):
    times, end = truth
    solution = hop(0.002)
    assert solution.events.direction.tolist() == [-1, 1, -1, 1]
    assert solution.events.time[:3] == pytest.approx(times, abs=1e-6)
    assert solution.y_end == pytest.approx(end, abs=1e-5)
    assert solution.t_end == END
    assert (np.diff(solution.t) > 0).all()
    assert solution.events.mode.ravel().tolist() == [-1, 1, -1, 1]


def test_fourth_order(truth):
    steps = 0.004 / 2.0 ** np.arange(4)
    errors = [np.abs(hop(step).y_end - truth[1]).max() for step in steps]
    assert np.log2(errors[0] / errors[-1]) / 3 > 3.0  # scatters with where events fall in steps
    assert errors[-1] < 1e-6


def test_it_ends_where_it_starts():
    """As printed, `while t0 <= tf`, it would not."""
    solution = hop(0.01, t_span=(0.5, 0.5))
    assert solution.t.tolist() == [0.5]
    assert solution.y_end.tolist() == list(START)
    assert len(solution.events) == 0


def test_from_rest_it_takes_more_than_a_step_at_a_time():
    """The sign of a velocity that is zero is that of the acceleration."""
    down, _ = regions()
    assert heading(down, 0.0, np.array([2.0, 0.0]), 1) == -1
    assert heading(down, 0.0, np.array([0.9, 0.0]), 1) == 1
    flight = hop(0.05, t_span=(0.0, 0.4))
    assert len(flight.t) < 20
    assert flight.y_end == pytest.approx([2 - 9.81 * 0.08, -9.81 * 0.4], abs=1e-12)


def test_in_equilibrium_it_ends():
    balance = 1.0 - 9.81 / 1000
    solution = hop(0.05, t_span=(0.0, 0.2), start=(balance, 0.0))
    assert solution.t_end == 0.2
    assert solution.y_end == pytest.approx([balance, 0.0], abs=1e-12)


def test_the_tail_without_error_control_ruins_a_long_step(truth):
    """With the maximum step of section 4.4.3, one second, the end is wrong by more than 5 m."""
    assert np.abs(hop(1.0).y_end - truth[1]).max() > 5.0


def test_a_step_over_apex_and_touchdown_loses_the_touchdown():
    """Seen on the mesh alone, the velocity has changed sign when the leg is long on the floor."""
    start, span = (1.01, 0.3), (0.0, 0.12)
    solver = Stepping(Dopri5, {"rtol": 0.9, "atol": 1e9, "max_step": 0.12, "first_step": 0.12})
    lost = integrate_alternating(*regions(), span, start, solver=solver)
    seen = hop(0.001, t_span=span, start=start)
    assert seen.events.direction.tolist() == [-1]
    assert len(lost.events) == 0
