"""The whole method on table 4.3, around several classical solvers."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import ladder, throw
from octant_scene import INITIAL_STATE, T_SPAN, octant
from scipy.integrate import DOP853, LSODA, RK45, Radau

from hopdata.hybrid.printed import (
    Mesh,
    PrintedOptions,
    Stepping,
    integrate,
    integrate_alternating,
    region_of,
)
from hopdata.hybrid.printed.contacts import FINDERS
from hopdata.hybrid.printed.supervisor import heading
from hopdata.scenes.small import VerticalHopper

PHASES = (np.arange(8) + 0.5) / 8


def fixed(kind, step, phase=1.0):
    """A solver that takes steps of one length, the first of each run excepted."""
    return Stepping(kind, {"rtol": 0.9, "atol": 1e9, "max_step": step, "first_step": phase * step})


def octant_end(solver, options=None):
    return integrate(
        region_of(octant()), T_SPAN, INITIAL_STATE, solver=solver, options=options
    ).y_end


def rms_error(step, truth, options=None):
    """Over several positions of the events within their steps."""
    errors = [octant_end(fixed(RK45, step, phase), options) - truth[1] for phase in PHASES]
    return np.sqrt(np.mean(np.square(errors)))


def classical_runge_kutta(slope, t, y, t_end, stop):
    """The least that serves as a classical solver: a function with a loop."""
    times, states, dt = [t], [y], 0.002
    while times[-1] < t_end:
        t, y = times[-1], states[-1]
        dt = min(dt, t_end - t)
        a = slope(t, y)
        b = slope(t + dt / 2, y + dt / 2 * a)
        c = slope(t + dt / 2, y + dt / 2 * b)
        d = slope(t + dt, y + dt * c)
        times.append(t_end if dt == t_end - t else t + dt)
        states.append(y + dt / 6 * (a + 2 * b + 2 * c + d))
        if stop(times[-1], states[-1]):
            break
    return Mesh(np.array(times), np.array(states))


@pytest.mark.parametrize("finder", FINDERS)
def test_events_and_end(octant_truth, finder):
    solution = integrate(
        region_of(octant()), T_SPAN, INITIAL_STATE,
        solver=fixed(RK45, 0.002), options=PrintedOptions(finder),
    )  # fmt: skip
    times, end = octant_truth
    log = solution.events
    assert [log.guard_names[k] for k in log.guard] == ["y", "z", "x"]
    assert log.direction.tolist() == [1, 1, 1]
    assert log.mode.tolist() == [[-1, 1, -1], [-1, 1, 1], [1, 1, 1]]
    assert log.time == pytest.approx(times, abs=1e-12)
    assert np.abs(np.diagonal(log.before[:, [1, 2, 0]])).max() < 1e-12
    assert solution.y_end == pytest.approx(end, abs=2e-8)
    assert solution.t_end == 0.5
    assert (np.diff(solution.t) > 0).all()
    assert set(log.time) <= set(solution.t)
    assert solution.mode.tolist() == [1, 1, 1]


@pytest.mark.parametrize("kind", [RK45, DOP853, Radau, LSODA])
def test_around_the_steppers_of_scipy(octant_truth, kind):
    solver = Stepping(kind, {"rtol": 1e-9, "atol": 1e-11, "max_step": 0.002})
    assert octant_end(solver) == pytest.approx(octant_truth[1], abs=1e-7)


def test_around_a_function(octant_truth):
    assert octant_end(classical_runge_kutta) == pytest.approx(octant_truth[1], abs=1e-7)


def test_both_root_finders_agree():
    one, other = (octant_end(fixed(RK45, 0.1), PrintedOptions(name)) for name in FINDERS)
    assert one == pytest.approx(other, abs=1e-14)


def test_error_of_fourth_order(octant_truth):
    """Third-order localisation and tail, a fixed number of times: dt^4."""
    steps = 0.02 / 2.0 ** np.arange(4)
    errors = [rms_error(step, octant_truth) for step in steps]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] > 3.9


def test_slopes_not_refreshed_cost_a_factor_of_six(octant_truth):
    """Where all events share one step; apart from one another they do not notice."""
    printed = PrintedOptions(refresh_slopes=False)
    together, apart = 0.5, 0.01
    ends = [octant_end(fixed(RK45, together), options) for options in (printed, None)]
    stale, fresh = (np.sqrt(np.mean((end - octant_truth[1]) ** 2)) for end in ends)
    assert stale > 6 * fresh
    assert rms_error(apart, octant_truth, printed) == rms_error(apart, octant_truth)


def test_an_event_on_the_mesh_happens_once():
    region = region_of(ladder(1), (0.5, 1.0))
    solution = integrate(region, (0.0, 1.0), [0.0, 0.0], solver=fixed(RK45, 0.125))
    assert solution.events.time == pytest.approx([0.5], abs=1e-15)
    assert solution.y_end[0] == pytest.approx(1.5, abs=1e-14)


def test_a_touch_and_go_within_a_step_is_lost():
    """A limit of all tests by sign on the mesh; a region with live guards has none."""
    region = region_of(throw(), (10.0, 1.0))
    seen, lost = (
        integrate(region, (0.0, 1.0), [0.0, 4.5], solver=fixed(RK45, step)) for step in (0.01, 1.0)
    )
    assert len(seen.events) == 1
    assert len(lost.events) == 0


def test_ends_where_it_is_told():
    region = region_of(throw(), (10.0, 9.0))
    solution = integrate(
        region, (0.0, 1.0), [0.0, 4.5], solver=fixed(RK45, 0.02), ended=lambda _, y: y[1] < 0
    )
    assert solution.t_end == pytest.approx(0.46)
    assert len(integrate(region, (0.3, 0.3), [0.0, 4.5]).t) == 1


def test_a_solver_that_fails_or_stands_still_is_an_error():
    region = region_of(throw(), (10.0, 9.0))
    with pytest.raises(ArithmeticError, match="did not advance"):
        integrate(
            region, (0.0, 1.0), [0.0, 4.5],
            solver=lambda _, t, y, *rest: Mesh(np.array([t]), y[None]),  # noqa: ARG005
        )  # fmt: skip
    with pytest.raises(ArithmeticError, match="failed at t = 0"), np.errstate(invalid="ignore"):
        integrate(region_of(throw(), (np.nan, 9.0)), (0.0, 1.0), [0.0, 4.5])


# Algorithm 7 on the hopper in one dimension, against its closed form.

HOPPER = VerticalHopper()
START, END = (2.0, 0.0), 2.0


def regions():
    """Touchdown, where the height above contact falls, and take-off, where it rises."""
    return tuple(region_of(HOPPER.system(), HOPPER.params, orientation=(k,)) for k in (-1, 1))


def hop(max_step, t_span=(0.0, END), start=START):
    solver = Stepping(RK45, {"rtol": 1e-9, "atol": 1e-12, "max_step": max_step})
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
    solver = Stepping(RK45, {"rtol": 0.9, "atol": 1e9, "max_step": 0.12, "first_step": 0.12})
    lost = integrate_alternating(*regions(), span, start, solver=solver)
    seen = hop(0.001, t_span=span, start=start)
    assert seen.events.direction.tolist() == [-1]
    assert len(lost.events) == 0
