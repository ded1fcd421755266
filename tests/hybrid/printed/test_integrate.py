"""The whole method on table 4.3, around several classical solvers."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from hybrid_systems import ball, ladder, throw
from scipy.integrate import RK45

from hopdata.hybrid.printed import (
    AS_PRINTED,
    CHOICES,
    FixedSteps,
    Mesh,
    PrintedOptions,
    Stepping,
    integrate,
    region_of,
    rk4_step,
)


def fixed(kind, step, phase=1.0):
    """Return a solver whose steps have one length, except for the first step of each run."""
    return Stepping(
        kind, {"rtol": 0.9, "atol": 1e9, "max_step": step, "first_step": phase * step}
    )


def test_an_event_on_the_mesh_happens_once():
    region = region_of(ladder(1), (0.5, 1.0))
    solution = integrate(region, (0.0, 1.0), [0.0, 0.0], solver=fixed(RK45, 0.125))
    assert solution.events.time == pytest.approx([0.5], abs=1e-15)
    assert solution.y_end[0] == pytest.approx(1.5, abs=1e-14)


def test_a_guard_at_zero_is_in_no_mode_if_locks_are_signs():
    """As printed, b = sgn(0) = 0: the guard is not crossed, and never will be."""
    region = region_of(ladder(1), (0.5, 1.0))
    kept, signs = (
        integrate(
            region, (0.0, 1.0), [0.5, 0.0], solver=fixed(RK45, 0.125),
            options=PrintedOptions(keep_locks=keep),
        )
        for keep in (True, False)
    )  # fmt: skip
    assert kept.mode.tolist() == [1]
    assert kept.y_end[0] == pytest.approx(2.5, abs=1e-14)
    assert signs.y_end[0] == pytest.approx(1.5, abs=1e-14)  # at speed 1 instead of 2


def test_an_event_on_the_mesh_is_forgotten_if_locks_are_signs():
    region = region_of(ladder(1), (0.5, 1.0))
    solution = integrate(
        region, (0.0, 1.0), [0.0, 0.0], solver=FixedSteps(rk4_step, 0.125),
        options=PrintedOptions(keep_locks=False),
    )  # fmt: skip
    assert len(solution.events) == 1
    assert solution.y_end[0] == pytest.approx(1.0, abs=1e-14)  # and not 1.5


def test_a_touch_and_go_within_a_step_is_lost():
    """Every test of signs on the mesh has this limit; a region with live guards avoids it."""
    region = region_of(throw(), (10.0, 1.0))
    seen, lost = (
        integrate(region, (0.0, 1.0), [0.0, 4.5], solver=fixed(RK45, step))
        for step in (0.01, 1.0)
    )
    assert len(seen.events) == 1
    assert len(lost.events) == 0


def test_ends_where_it_is_told():
    region = region_of(throw(), (10.0, 9.0))
    solution = integrate(
        region,
        (0.0, 1.0),
        [0.0, 4.5],
        solver=fixed(RK45, 0.02),
        ended=lambda _, y: y[1] < 0,
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
    with (
        pytest.raises(ArithmeticError, match="failed at t = 0"),
        np.errstate(invalid="ignore"),
    ):
        integrate(region_of(throw(), (np.nan, 9.0)), (0.0, 1.0), [0.0, 4.5])


# Regions: locks at a start, orientation, unsupported systems.


@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_a_guard_at_zero_has_the_mode_it_moves_into(zero):
    rising = region_of(throw(), (10.0, 1.0))
    assert rising.first_locks(0.0, np.array([1.0 + zero, 2.0])).tolist() == [1]
    assert rising.first_locks(0.0, np.array([1.0 + zero, -2.0])).tolist() == [-1]
    falling = region_of(throw(), (10.0, 1.0), orientation=(-1,))
    assert falling.first_locks(0.0, np.array([1.0 + zero, -2.0])).tolist() == [1]


def test_a_guard_at_rest_at_zero_is_not_crossed():
    assert region_of(throw(), (10.0, 1.0)).first_locks(
        0.0, np.array([1.0, 0.0])
    ).tolist() == [-1]


def test_what_cannot_be_done_is_said():
    with pytest.raises(ValueError, match="on_event"):
        region_of(ball())
    for wrong in ((1,), (1, 0), (1, 1, 1)):
        with pytest.raises(ValueError, match="orientation"):
            region_of(ladder(2), orientation=wrong)
    for name in CHOICES:
        with pytest.raises(
            ValueError, match=f"{name}: expected one of .*, found other"
        ):
            PrintedOptions(**{name: "other"})


def test_as_printed_every_choice_differs_from_the_default():
    default = PrintedOptions()
    same = {
        one.name
        for one in fields(PrintedOptions)
        if getattr(default, one.name) == getattr(AS_PRINTED, one.name)
    }
    assert same == {"tail"}
