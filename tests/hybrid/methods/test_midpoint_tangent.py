"""The tangent of very short steps: its order, what it says of its error, and what it saves."""

from __future__ import annotations

import numpy as np
import pytest
from jacobian_checks import carried, gap
from tangent_flow import error_of, flow

from hopdata.hybrid import System, field, guards, solve
from hopdata.hybrid.methods.midpoint_tangent import midpoint_tangent
from hopdata.hybrid.methods.tangent import LOOSER

RTOL = 1e-6
RUNGS = 100
START, SPAN = (-0.6, 0.9), (0.0, 1.5)


@field
def pendulum_field(t, y, mode, params, dy):
    passed = 0.0
    for k in range(len(mode)):
        if mode[k] > 0:
            passed += 1.0
    dy[0] = y[1]
    dy[1] = -np.sin(y[0]) - params[0] * passed


@guards
def rung_guards(t, y, dy, mode, params, h, hdot):
    for k in range(len(h)):
        h[k] = y[0] - 0.01 * (k - 50)
        hdot[k] = dy[0]


def pendulum() -> System:
    """A pendulum that passes a rung every 0.01 rad, each of which slows it down a little more."""
    names = tuple(f"rung{k}" for k in range(RUNGS))
    return System(pendulum_field, rung_guards, n_states=2, guard_names=names)


def test_it_is_of_second_order():
    errors = [error_of(midpoint_tangent, dt) for dt in (0.02, 0.01, 0.005)]
    assert errors[0] < 1e-4
    assert np.log2(errors[0] / errors[1]) == pytest.approx(3.0, abs=0.1)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(3.0, abs=0.1)


@pytest.mark.parametrize("dt", [0.02, 0.005])
def test_what_it_says_of_its_error_is_of_the_errors_size(dt):
    """The derivative changes faster here than the motion tells: the account is too low by that."""
    said = flow(midpoint_tangent, dt, RTOL)[1] * LOOSER * RTOL
    assert said < error_of(midpoint_tangent, dt) < 4.0 * said


def test_it_judges_its_error_by_the_tolerance():
    loose, tight = (flow(midpoint_tangent, 0.01, rtol)[1] for rtol in (1e-6, 1e-8))
    assert tight == pytest.approx(100.0 * loose)


def test_where_events_are_dense_most_steps_take_the_derivative_once():
    """By differences it takes 4 n evaluations; the tangent of short steps would take twice that."""
    options = {"params": (1e-3,), "rtol": RTOL, "atol": RTOL}
    state = solve(pendulum(), SPAN, START, **options)
    both = solve(pendulum(), SPAN, START, jacobian=True, **options)
    assert len(both.events) == len(state.events) == RUNGS
    for_jacobian = both.nfev - state.nfev
    assert for_jacobian < 1.5 * (4 * 2) * both.n_steps


def test_the_jacobian_through_dense_events_is_right():
    both = solve(pendulum(), SPAN, START, jacobian=True, params=(1e-3,), rtol=RTOL, atol=RTOL)
    exact = carried(pendulum(), SPAN, START, params=(1e-3,), method="dop853")
    assert gap(both.jacobian, exact.jacobian) < LOOSER * RTOL
