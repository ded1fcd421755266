"""The whole method on table 4.3, around several classical solvers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import DOP853, LSODA, RK45, Radau
from scipy.linalg import expm
from scipy.optimize import brentq

from hopdata.hybrid.printed import (
    Mesh,
    PrintedOptions,
    Stepping,
    integrate,
    region_of,
)
from hopdata.hybrid.printed.roots import FINDERS
from hopdata.scenes.octant import INITIAL_STATE, T_SPAN, octant

START, END = (-0.4, -0.15, 0.3), 0.5


def flow(rows, time, state):
    whole = np.zeros((4, 4))
    whole[:3, :3], whole[:3, 3] = rows, (1.0, 1.0, -1.0)
    return (expm(whole * time) @ np.append(state, 1.0))[:3]


@pytest.fixture(scope="module")
def octant_truth():
    """Return the instants at which y, z and x are crossed, and the state at 0.5."""
    modes = (
        ([[0, -1, 0], [1, 0, 0], [0, 0, -1]], 1),
        ([[0, 1, 0], [-1, 0, 0], [0, 0, -1]], 2),
        ([[0, 1, 0], [-1, 0, 0], [0, 0, 3]], 0),
    )
    state, times = np.array(START), [0.0]
    for rows, axis in modes:
        span = brentq(lambda t: flow(rows, t, state)[axis], 1e-9, 0.3, xtol=1e-16)  # noqa: B023
        state = flow(rows, span, state)
        times.append(times[-1] + span)
    last = [[10, 0, 0], [0, 1, 0], [0, 0, 3]]
    return np.array(times[1:]), flow(last, END - times[-1], state)


PHASES = (np.arange(8) + 0.5) / 8


def fixed(kind, step, phase=1.0):
    """Return a solver whose steps have one length, except for the first step of each run."""
    return Stepping(
        kind, {"rtol": 0.9, "atol": 1e9, "max_step": step, "first_step": phase * step}
    )


def octant_end(solver, options=None):
    return integrate(
        region_of(octant()), T_SPAN, INITIAL_STATE, solver=solver, options=options
    ).y_end


def rms_error(step, truth, options=None):
    """Return the rms error over several positions of the events within their steps."""
    errors = [
        octant_end(fixed(RK45, step, phase), options) - truth[1] for phase in PHASES
    ]
    return np.sqrt(np.mean(np.square(errors)))


def classical_runge_kutta(slope, t, y, t_end, stop):
    """The simplest possible classical solver: a function with a loop."""
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
    one, other = (
        octant_end(fixed(RK45, 0.1), PrintedOptions(name)) for name in FINDERS
    )
    assert one == pytest.approx(other, abs=1e-14)


def test_error_of_fourth_order(octant_truth):
    """Localisation and tail are of third order and occur a fixed number of times: dt^4."""
    steps = 0.02 / 2.0 ** np.arange(4)
    errors = [rms_error(step, octant_truth) for step in steps]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] > 3.9


def test_slopes_not_refreshed_cost_a_factor_of_six(octant_truth):
    """This holds if all events share one step; events far from one another are not affected."""
    printed = PrintedOptions(refresh_slopes=False)
    together, apart = 0.5, 0.01
    ends = [octant_end(fixed(RK45, together), options) for options in (printed, None)]
    stale, fresh = (np.sqrt(np.mean((end - octant_truth[1]) ** 2)) for end in ends)
    assert stale > 6 * fresh
    assert rms_error(apart, octant_truth, printed) == rms_error(apart, octant_truth)


def test_locks_are_signs():
    region = region_of(octant())
    assert region.first_locks(0.0, np.array([-0.4, 0.15, 0.3])).tolist() == [-1, 1, -1]


def test_the_orientation_turns_events_and_mode():
    region, y = region_of(octant(), orientation=(1, -1, 1)), np.array([0.1, 0.2, 0.3])
    h, rates = region.events(0.0, y, np.array([1.0, 2.0, 3.0]), np.array([1, -1, -1]))
    assert h.tolist() == [0.1, -0.2, -0.3]
    assert rates.tolist() == [1.0, -2.0, -3.0]
    assert region.mode(np.array([1, -1, -1])).tolist() == [1, 1, -1]
