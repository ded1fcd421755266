"""The first step in an affine mode: as long as its fastest motion allows."""

from __future__ import annotations

import numpy as np
import pytest

from hopdata.hybrid import System, affine, field, solve
from hopdata.hybrid.status import FIELD_NOT_FINITE, FINISHED, STEP_UNDERFLOW


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
    return solve(SYSTEM, (start, end), y0, params=np.ravel(matrix), rtol=1e-12, atol=1e-15)


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
