"""Classical solvers that the method wraps: each finds the same events of the octants."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hopdata.hybrid.printed import (
    FixedSteps,
    Ivp,
    PrintedOptions,
    dopri5_step,
    integrate,
    region_of,
    rk4_step,
)
from hopdata.scenes.octant import INITIAL_STATE, T_SPAN, octant, octant_end

TIGHT = {"rtol": 1e-9, "atol": 1e-11, "max_step": 0.005}
SOLVERS = {
    "solve_ivp RK45": Ivp(TIGHT),
    "solve_ivp DOP853": Ivp({**TIGHT, "method": "DOP853"}),
    "solve_ivp LSODA": Ivp({**TIGHT, "method": "LSODA"}),
    "Runge and Kutta's steps": FixedSteps(rk4_step, 0.005),
    "DOPRI5's steps": FixedSteps(dopri5_step, 0.005),
}


@pytest.mark.parametrize("name", SOLVERS)
def test_any_solver_finds_the_events_and_the_end(name):
    found = integrate(region_of(octant()), T_SPAN, INITIAL_STATE, solver=SOLVERS[name])
    assert [found.events.guard_names[k] for k in found.events.guard] == ["y", "z", "x"]
    assert np.abs(found.y_end - octant_end()).max() < 3e-7
    assert found.t_end == T_SPAN[1]
    assert (np.diff(found.t) > 0).all()


def test_the_instants_are_those_of_the_printed_method_and_not_of_solve_ivp():
    """On long steps they differ, as a Hermite spline does from solve_ivp's interpolant."""
    region = region_of(octant())
    coarse = Ivp({"rtol": 0.9, "atol": 1e9, "max_step": 0.2, "first_step": 0.2})
    ours = integrate(region, T_SPAN, INITIAL_STATE, solver=coarse).events.time[0]
    fine = integrate(region, T_SPAN, INITIAL_STATE, solver=Ivp(TIGHT)).events.time[0]
    mode = -np.ones(3, dtype=np.int64)
    slope = region.slope_in(mode)

    def event(t, y):
        return y[1]

    event.terminal = True
    options = {"rtol": 0.9, "atol": 1e9, "max_step": 0.2, "first_step": 0.2}
    theirs = solve_ivp(slope, T_SPAN, INITIAL_STATE, events=event, **options).t[-1]
    assert 0 < abs(ours - fine) < 1e-3
    assert abs(ours - theirs) > 1e-9


def test_a_leg_may_begin_at_each_event():
    """With the tail of Algorithm 5 a long step after an event is coarse."""
    region, coarse = region_of(octant()), Ivp({"rtol": 1e-10, "atol": 1e-12})
    heun, restart = (
        integrate(
            region,
            T_SPAN,
            INITIAL_STATE,
            solver=coarse,
            options=PrintedOptions(tail=tail),
        )
        for tail in ("heun", "restart")
    )
    errors = [np.abs(one.y_end - octant_end()).max() for one in (heun, restart)]
    assert errors[1] < 0.2 * errors[0]
    assert restart.events.guard.tolist() == heun.events.guard.tolist() == [1, 2, 0]


def test_a_solver_that_does_not_ask_where_to_stop_is_refused():
    """Its events, but those of its last step, would be lost without a word."""
    asking = FixedSteps(rk4_step, 0.01)

    def deaf(slope, t, y, t_end, stop):
        never = NeverStop()
        return asking(slope, t, y, t_end, never)

    class NeverStop:
        events = ()

        def __call__(self, *_):
            return False

    region = region_of(octant())
    with pytest.raises(ArithmeticError, match=r"went on after t = 0\.2"):
        integrate(region, T_SPAN, INITIAL_STATE, solver=deaf)
    assert integrate(region, T_SPAN, INITIAL_STATE, solver=asking).events.time.size == 3
