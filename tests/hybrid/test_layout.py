"""The first step in an affine mode: as long as its fastest motion allows."""

from __future__ import annotations

import re
from pathlib import Path

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

from hopdata.hybrid import System, affine, field, solve
from hopdata.hybrid import layout as codes
from hopdata.hybrid.layout import FIELD_NOT_FINITE, FINISHED, STEP_UNDERFLOW


@field
def linear(t, y, mode, params, dy):
    dy[0] = params[0] * y[0] + params[1] * y[1]
    dy[1] = params[2] * y[0] + params[3] * y[1]


@affine
def form(mode, params, a, b):
    a[0, 0], a[0, 1] = params[0], params[1]
    a[1, 0], a[1, 1] = params[2], params[3]
    b[:] = 0.0


SYSTEM = System(linear, affine=form, n_states=2)


def run(matrix, y0, end, start=0.0):
    return solve(
        SYSTEM, (start, end), y0, params=np.ravel(matrix), rtol=1e-12, atol=1e-15
    )


@pytest.mark.parametrize("omega", [1e-3, 1.0, 30.0, 1e6])
@pytest.mark.parametrize("turn", [1.0, 4.4, 50.0])
def test_a_swing_begins_with_a_step_that_is_not_rejected(omega, turn):
    found = run([[0.0, 1.0], [-(omega**2), 0.0]], [1.0, 0.0], turn / omega)
    assert found.status == FINISHED
    assert found.n_rejected == 0
    assert found.n_steps <= 1 + turn / 2.5
    assert found.y_end[0] == pytest.approx(np.cos(turn), abs=1e-13 * (1 + turn))


@pytest.mark.parametrize("end", [1e-6, 1.0, 1e6])
def test_a_mode_without_motion_is_one_step(end):
    found = run([[0.0, 1.0], [0.0, 0.0]], [1.0, 2.0], end)
    assert found.n_steps == 1
    assert found.y_end == pytest.approx([1.0 + 2.0 * end, 2.0])


def test_a_fast_motion_that_rests_costs_a_step_or_two():
    found = run([[0.0, 0.0], [0.0, -1e8]], [3.0, 0.0], 1.0)
    assert found.status == FINISHED
    assert found.n_steps <= 3
    assert found.y_end.tolist() == [3.0, 0.0]


@pytest.mark.parametrize("rate", [1e20, 1e60, 1e160, 1e200])
def test_a_motion_faster_than_time_can_tell_is_reported(rate):
    found = run([[0.0, rate], [-rate, 0.0]], [1.0, 0.0], 2.0, start=1.0)
    assert found.status == (STEP_UNDERFLOW if rate < 1e40 else FIELD_NOT_FINITE)
    assert found.n_steps < 100


# Every failure ends in a clear status, and soon.


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
    assert "sliding=('origin',)" in solution.message  # how to declare it


def test_crossing_is_not_sliding():
    assert solve(sliding(), (0, 3), [-1.0], params=(-3.0, 2.0)).status == 0


@pytest.mark.parametrize(
    ("restitution", "pile"), [(0.1, 11 / 9), (0.5, 3.0), (0.9, 19.0)]
)
def test_zeno_sequence(restitution, pile):
    solution = solve(
        ball(directions=(1,)), (0, 99), [1.0, 0.0], params=(2.0, 0.0, restitution)
    )
    assert solution.status == codes.ZENO
    assert "'floor'" in solution.message
    assert solution.t_end == pytest.approx(pile, abs=1e-6)
    assert solution.n_steps < 10_000


def test_max_steps_and_max_events():
    solution = solve(growth(), (0, 2), [1.0, 0.0], params=(0.7, 4.0), max_steps=3)
    assert solution.status == codes.TOO_MANY_STEPS
    assert solution.n_steps == 3
    solution = solve(
        ladder(3), (0, 2), [0.0, 0.0], params=(1, 1.1, 1.2, 0, 0, 0), max_events=2
    )
    assert solution.status == codes.TOO_MANY_EVENTS
    assert len(solution.events) == 2


def test_an_exception_in_a_callback_is_raised():
    system = System(raising_field, n_states=2)
    with pytest.raises(ValueError, match="beyond the edge"):
        solve(system, (0, 2), [0.0, 0.0], params=(1.0,))
    assert solve(system, (0, 2), [0.0, 0.0], params=(5.0,)).success


def test_partial_results_are_returned():
    solution = solve(
        sliding(), (0, 3), [-1.0], params=(3.0, 2.0), t_eval=[0.1, 0.2, 0.8]
    )
    assert solution.t.tolist() == [0.1, 0.2]
    assert np.abs(solution.y[0] - [-0.8, -0.6]).max() < 1e-14


def test_no_name_of_a_row_or_slot_is_given_twice():
    """A second meaning would replace the first, and another row would be written."""
    text = Path(codes.__file__).read_text()
    lists = re.findall(r"^([A-Z0-9_, ]+) = numbers", text, re.MULTILINE)
    names = [
        name.strip() for one in lists for name in one.split(",") if name.strip() != "_"
    ]
    assert len(names) > 100
    assert len(set(names)) == len(names)
