"""An impossible integration ends in a status that says so, or in the user's own exception."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import ball, sliding
from stress_failing import (
    IN_FIELD,
    IN_GUARD,
    IN_HANDLER,
    IS_INFINITE,
    IS_NAN,
    NOWHERE,
    RAISES,
    faulty,
    seesaw,
    spiral,
)

from hopdata.hybrid import solve

STATUS = {IN_FIELD: -2, IN_GUARD: -3}
LIMIT = {"max_steps": 200_000, "max_events": 200_000}
GATE = 1.0


def run(place, kind, beyond, lock=0, end=3.0, start=0.0):
    params = (place, kind, beyond, lock, GATE)
    return solve(faulty(), (0.0, end), [start, 0.0], params=params, **LIMIT)


@pytest.mark.parametrize("kind", [IS_NAN, IS_INFINITE])
@pytest.mark.parametrize("place", [IN_FIELD, IN_GUARD])
@pytest.mark.parametrize("beyond", [0.5, 1.0 / 3.0, 1.5, 2.0])
def test_not_finite_in_the_middle(place, kind, beyond):
    solution = run(place, kind, beyond)
    assert solution.status == STATUS[place]
    assert not solution.success
    assert solution.t_end == pytest.approx(beyond, abs=1e-12)
    assert len(solution.events) == (beyond > GATE)
    assert np.isfinite(solution.y).all()
    assert "NaN" in solution.message


@pytest.mark.parametrize("kind", [IS_NAN, IS_INFINITE])
@pytest.mark.parametrize("place", [IN_FIELD, IN_GUARD])
def test_not_finite_at_the_start(place, kind):
    solution = run(place, kind, -1.0)
    assert solution.status == STATUS[place]
    assert solution.t_end == 0.0
    assert solution.y_end.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("kind", [IS_NAN, IS_INFINITE])
@pytest.mark.parametrize("place", [IN_FIELD, IN_GUARD])
def test_not_finite_after_the_end(place, kind):
    assert run(place, kind, 3.0 + 1e-12).status == 0


@pytest.mark.parametrize("kind", [IS_NAN, IS_INFINITE])
@pytest.mark.parametrize("place", [IN_FIELD, IN_GUARD])
@pytest.mark.parametrize("margin", [1e-12, 1e-6, 0.1])
def test_not_finite_only_beyond_an_event(place, kind, margin):
    """The mode before the event ends in time: the other mode takes over on its surface."""
    solution = run(place, kind, GATE + margin, lock=-1)
    assert solution.status == 0
    assert solution.events.time == pytest.approx([1.0], abs=1e-14)
    assert solution.y_end == pytest.approx([3.0, 0.25 + 2 * 0.5], abs=1e-13)


@pytest.mark.parametrize("place", [IN_FIELD, IN_GUARD])
def test_not_finite_from_the_event_on(place):
    """Without any room behind the surface the crossing may go unseen; then the status says so."""
    solution = run(place, IS_NAN, GATE, lock=-1)
    assert solution.status in (0, STATUS[place])
    if solution.status == 0:
        assert solution.y_end == pytest.approx([3.0, 1.25], abs=1e-13)
    else:
        assert solution.t_end == pytest.approx(GATE, abs=1e-12)
        assert solution.y_end == pytest.approx([GATE, 0.25], abs=1e-12)


@pytest.mark.parametrize("place", [IN_FIELD, IN_GUARD])
@pytest.mark.parametrize("beyond", [-1.0, 0.5, 1.5])
def test_exceptions_reach_the_caller(place, beyond):
    with pytest.raises(ValueError, match="here"):
        run(place, RAISES, beyond)
    again = run(NOWHERE, 0, 0.0)
    assert again.status == 0
    assert again.y_end == pytest.approx([3.0, 1.25], abs=1e-13)


def test_exception_of_the_handler_reaches_the_caller():
    with pytest.raises(ValueError, match="no handler here"):
        run(IN_HANDLER, RAISES, 0.0)
    assert run(NOWHERE, 0, 0.0).status == 0


@pytest.mark.parametrize("kind", [IS_NAN, IS_INFINITE])
def test_a_handler_that_leaves_no_number(kind):
    """The field of `faulty` does not use y[1], so it stays finite when the state does not."""
    solution = run(IN_HANDLER, kind, 0.0)
    assert solution.status < 0
    assert solution.t_end == pytest.approx(GATE, abs=1e-12)


@pytest.mark.parametrize("restitution", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("directions", [(1,), (0,)])
def test_a_bouncing_ball_comes_to_rest(restitution, directions):
    rest = 1.0 + 2.0 * restitution / (1.0 - restitution)
    solution = solve(
        ball(directions=directions), (0, rest + 1), [1.0, 0.0], params=(2.0, 0.0, restitution),
        **LIMIT,
    )  # fmt: skip
    assert solution.status == -7
    assert solution.t_end == pytest.approx(rest, abs=1e-9)
    assert solution.y_end == pytest.approx([0.0, 0.0], abs=1e-9)
    exact = 1.0 + 2.0 * np.cumsum(restitution ** np.arange(1, 9))
    times = solution.events.of("floor", direction=1).time
    assert times[:9] == pytest.approx([1.0, *exact], abs=1e-9)


def test_a_spiral_winds_into_its_centre():
    system, params = spiral()
    solution = solve(system, (0, 3), [1.0, 0.0], params=params, **LIMIT)
    assert solution.status == -7
    assert solution.t_end == pytest.approx(1 / 0.6, abs=1e-9)
    assert solution.y_end == pytest.approx([0.0, 0.0], abs=1e-9)
    quarters = np.cumsum((0.7 / 1.3) ** np.arange(10)) / 1.3
    assert solution.events.time[:10] == pytest.approx(quarters, abs=1e-13)
    assert solution.events.guard[:4].tolist() == [0, 1, 0, 1]


@pytest.mark.parametrize("start", [1.0, -1.0, 1e-12, 0.0])
def test_sliding_is_told(start):
    solution = solve(sliding(), (0, 3), [start], params=(1.0, 2.0), **LIMIT)
    assert solution.status == -6
    reached = start if start >= 0 else -start / 2
    assert solution.t_end == pytest.approx(reached, abs=1e-14)
    assert solution.y_end == pytest.approx([0.0], abs=1e-14)
    assert "slide" in solution.message


def test_guards_that_push_each_other_without_end():
    solution = solve(seesaw(), (0, 3), [0.0], **LIMIT)
    assert solution.status in (-6, -7)
    assert solution.t_end == pytest.approx(1.0, abs=1e-14)
