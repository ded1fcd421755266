"""Every way to fail ends in a clear status, and soon."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import (
    ball,
    failing_guard,
    fall_field,
    growth,
    ladder,
    raising_field,
    sliding,
)

from hopdata.hybrid import System, solve
from hopdata.hybrid import status as codes


def test_nan_in_the_field():
    solution = solve(growth(), (0, 2), [1.0, 0.0], params=(0.7, 1.0))
    assert solution.status == codes.FIELD_NOT_FINITE
    assert not solution.success
    assert solution.t_end == pytest.approx(1.0, abs=1e-3)
    assert "field is NaN" in solution.message


def test_nan_in_the_field_at_the_start():
    solution = solve(growth(), (2, 3), [1.0, 0.0], params=(0.7, 1.0))
    assert solution.status == codes.FIELD_NOT_FINITE
    assert solution.t_end == 2.0


def test_nan_in_a_guard_names_it():
    system = System(fall_field, failing_guard, n_states=2, guard_names=("far", "bad"))
    solution = solve(system, (0, 2), [0.0, 0.0], params=(1.0, 0.75))
    assert solution.status == codes.GUARD_NOT_FINITE
    assert solution.t_end == pytest.approx(0.75, abs=0.25)
    assert "'bad'" in solution.message


def test_blow_up():
    solution = solve(growth(), (0, 1), [1.0, 0.0], params=(1e6, 4.0), rtol=1e-6)
    assert solution.status < 0
    assert solution.t_end < 1.0


def test_sliding_is_reported_with_guard_time_and_rates():
    solution = solve(sliding(), (0, 3), [-1.0], params=(3.0, 2.0))
    assert solution.status == codes.SLIDING
    assert solution.t_end == pytest.approx(0.5, abs=1e-14)
    for word in ("'origin'", f"t = {solution.t_end:.17g}", "+2 below", "-3 above"):
        assert word in solution.message


def test_crossing_is_not_sliding():
    assert solve(sliding(), (0, 3), [-1.0], params=(-3.0, 2.0)).status == 0


@pytest.mark.parametrize(("restitution", "pile"), [(0.1, 11 / 9), (0.5, 3.0), (0.9, 19.0)])
def test_zeno_sequence(restitution, pile):
    solution = solve(ball(directions=(1,)), (0, 99), [1.0, 0.0], params=(2.0, 0.0, restitution))
    assert solution.status == codes.ZENO
    assert "'floor'" in solution.message
    assert solution.t_end == pytest.approx(pile, abs=1e-6)
    assert solution.n_steps < 10_000


def test_max_steps_and_max_events():
    solution = solve(growth(), (0, 2), [1.0, 0.0], params=(0.7, 4.0), max_steps=3)
    assert solution.status == codes.TOO_MANY_STEPS
    assert solution.n_steps == 3
    solution = solve(ladder(3), (0, 2), [0.0, 0.0], params=(1, 1.1, 1.2, 0, 0, 0), max_events=2)
    assert solution.status == codes.TOO_MANY_EVENTS
    assert len(solution.events) == 2


def test_an_exception_in_a_callback_is_raised():
    system = System(raising_field, n_states=2)
    with pytest.raises(ValueError, match="beyond the edge"):
        solve(system, (0, 2), [0.0, 0.0], params=(1.0,))
    assert solve(system, (0, 2), [0.0, 0.0], params=(5.0,)).success


def test_partial_results_are_returned():
    solution = solve(sliding(), (0, 3), [-1.0], params=(3.0, 2.0), t_eval=[0.1, 0.2, 0.8])
    assert solution.t.tolist() == [0.1, 0.2]
    assert np.abs(solution.y[0] - [-0.8, -0.6]).max() < 1e-14
