"""The tangent of short steps: its order, what it saves, and that its error is controlled."""

from __future__ import annotations

import numpy as np
import pytest
from jacobian_checks import carried, gap
from tangent_flow import CONSTANT, error_of, flow

from hopdata.hybrid import solve
from hopdata.hybrid.methods.short_tangent import short_tangent
from hopdata.scenes.plate import Plate


def test_it_is_of_fourth_order():
    errors = [error_of(short_tangent, dt) for dt in (0.2, 0.1, 0.05)]
    assert errors[0] < 1e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(5.0, abs=0.5)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(5.0, abs=0.5)


def test_it_judges_its_error_by_the_fastest_motion():
    _, loose, fastest = flow(short_tangent, 0.1, rtol=1e-6)
    _, tight, _ = flow(short_tangent, 0.1, rtol=1e-8)
    assert tight == pytest.approx(100.0 * loose)
    assert fastest >= np.abs(np.diag(CONSTANT)).max() ** 2 / 2


@pytest.mark.parametrize("form", [{}, {"sums": True}])
def test_dense_events_need_few_more_evaluations_of_the_field(form):
    """A step that is taken again for its Jacobian would double them."""
    plate, start = Plate(20), [0.0, 2.2, 0.07, 0.0, 0.0, 0.0]
    options = {"params": plate.params, "rtol": 1e-6, "atol": 1e-6}
    state = solve(plate.system(**form), (0, 1), start, **options)
    both = solve(plate.system(**form), (0, 1), start, jacobian=True, **options)
    assert len(both.events) == len(state.events) > 20
    assert both.nfev < 1.5 * state.nfev
    exact = carried(plate.system(**form), (0, 1), start, params=plate.params)
    assert gap(both.jacobian, exact.jacobian) < 1e-5
