"""Classical solvers that the method wraps: each finds the same events and the same end."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import throw

from hopdata.hybrid.printed import (
    FixedSteps,
    Ivp,
    PrintedOptions,
    integrate,
    region_of,
    rk4_step,
)


def test_an_event_that_is_undone_within_the_next_step_is_found_by_solve_ivp():
    """A ball just over a ceiling: solve_ivp sees it enter, a far mesh point does not."""
    region = region_of(throw(), (10.0, 1.0))
    solver = Ivp({"rtol": 1e-9, "atol": 1e-9, "first_step": 0.44, "max_step": 0.44})
    found = integrate(region, (0.0, 1.0), [0.0, 4.5], solver=solver)
    assert len(found.events) == 1
    rising = (4.5 - np.sqrt(4.5**2 - 20.0)) / 10.0
    assert found.events.time[0] == pytest.approx(rising, abs=1e-12)


@pytest.mark.parametrize("solver", [Ivp(), FixedSteps(rk4_step, 0.1)])
def test_without_events_it_reaches_the_end_exactly(solver):
    found = integrate(
        region_of(throw(), (10.0, 9.0)), (0.0, 0.73), [0.0, 4.5], solver=solver
    )
    assert found.t_end == 0.73
    assert found.y_end == pytest.approx([4.5 * 0.73 - 5 * 0.73**2, 4.5 - 7.3], abs=1e-9)


def test_steps_of_one_length_do_not_end_in_a_step_of_rounding():
    found = integrate(
        region_of(throw(), (10.0, 9.0)), (0.0, 0.7), [0.0, 4.5],
        solver=FixedSteps(rk4_step, 0.1),
    )  # fmt: skip
    assert len(found.t) == 8


def test_solve_ivp_that_fails_is_an_error():
    region = region_of(throw(), (np.nan, 9.0))
    with pytest.raises(ArithmeticError, match="failed at t = 0"):
        integrate(region, (0.0, 1.0), [0.0, 4.5], solver=Ivp())


@pytest.mark.parametrize("name", ["refresh_slopes", "keep_locks", "cross_at_surface"])
def test_a_choice_that_is_made_or_not_is_true_or_false(name):
    with pytest.raises(ValueError, match=f"{name}: expected True or False, found no"):
        PrintedOptions(**{name: "no"})
    assert getattr(PrintedOptions(**{name: False}), name) is False
