"""The derivative without saltation: right where events change nothing, wrong elsewhere."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hybrid_systems import ladder, ladder_solution

from hopdata.hybrid import solve
from hopdata.hybrid.first_order import derivative_without_saltation, saltation_matrix

RUNGS = (1.0, 1.5, 2.0)
TIGHT = {"rtol": 1e-12, "atol": 1e-13}


def both(gains, end=3.0):
    """Return the derivatives with respect to state and parameters, without and with."""
    params = (*RUNGS, *gains)
    ignored = derivative_without_saltation(
        ladder(3), (0.0, end), [0.0, 0.0], params=params, jacobian="params", **TIGHT
    )
    whole = solve(
        ladder(3), (0.0, end), [0.0, 0.0], params=params, jacobian="params", **TIGHT
    )
    return ignored, whole


def test_without_a_change_of_the_field_it_is_the_derivative():
    (solution, of_state, of_params), whole = both((0.0, 0.0, 0.0))
    assert len(solution.events) == 3
    np.testing.assert_allclose(of_state, whole.jacobian, atol=1e-7)
    np.testing.assert_allclose(of_params, whole.sensitivity, atol=1e-7)


def test_what_it_lacks_are_the_saltation_matrices():
    """On the ladder all pieces have slope 1 in the place, and crossings scale it."""
    gains = (0.5, -0.25, 1.0)
    (solution, of_state, of_params), whole = both(gains)
    assert of_state[0, 0] == pytest.approx(1.0, abs=1e-9)
    assert whole.jacobian[0, 0] == pytest.approx(2.25, abs=1e-9)
    speeds = np.cumsum([1.0, *gains])
    product = 1.0
    for before, after in pairwise(speeds):
        product *= saltation_matrix([before], [after], [1.0])[0, 0]
    assert whole.jacobian[0, 0] == pytest.approx(product)
    # A rung farther out lets the point move at its earlier speed for longer.
    assert of_params[0, 0] == pytest.approx(0.0, abs=1e-9)
    step = 1e-6
    moved = (RUNGS[0] + step, *RUNGS[1:])
    ends = [ladder_solution(rungs, gains, 3.0)[1] for rungs in (moved, RUNGS)]
    assert whole.sensitivity[0, 0] == pytest.approx(
        (ends[0] - ends[1]) / step, rel=1e-4
    )
    # A gain acts on the piece behind its rung, in both.
    last = 3.0 - solution.events.time[2]
    assert of_params[0, 5] == pytest.approx(last, abs=1e-7)


def test_an_integration_without_events_is_one_piece():
    solution, of_state, of_params = derivative_without_saltation(
        ladder(1), (0.0, 0.5), [0.0, 0.0], params=(1.0, 1.0)
    )
    assert len(solution.events) == 0
    np.testing.assert_allclose(of_state, [[1.0, 0.0], [0.5, 1.0]], atol=1e-7)
    assert of_params is None
