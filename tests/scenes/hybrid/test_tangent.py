"""The flow's Jacobian along smooth arcs of the octants and the plate."""

from __future__ import annotations

import pytest
from jacobian_checks import carried, differences, gap

from hopdata.hybrid import solve
from hopdata.hybrid.methods.table import TABLEAUS
from hopdata.scenes.octant import INITIAL_STATE, T_SPAN, octant
from hopdata.scenes.plate import Plate


@pytest.mark.parametrize("method", ["auto", "taylor", *TABLEAUS])
def test_methods_agree_where_modes_are_affine(method):
    found = carried(octant(), T_SPAN, INITIAL_STATE, method=method)
    assert (
        gap(found.jacobian, carried(octant(), T_SPAN, INITIAL_STATE).jacobian) < 1e-11
    )
    reference = differences(octant(), T_SPAN, INITIAL_STATE, step=1e-4)
    assert gap(found.jacobian, reference) < 1e-10


@pytest.mark.parametrize("form", [{}, {"sums": True}])
def test_dense_events_need_few_more_evaluations_of_the_field(form):
    """If steps were repeated for their Jacobian, evaluations would double."""
    plate = Plate(20)
    start = [0.0, 2.2, 0.07, 0.0, 0.0, 0.0]
    options = {"params": plate.params, "rtol": 1e-6, "atol": 1e-6, "method": "dopri5"}
    state = solve(plate.system(**form), (0, 1), start, **options)
    both = solve(plate.system(**form), (0, 1), start, jacobian=True, **options)
    assert len(both.events) == len(state.events) > 20
    assert both.nfev < 1.5 * state.nfev
    exact = carried(
        plate.system(**form), (0, 1), start, params=plate.params, method="dopri5"
    )
    assert gap(both.jacobian, exact.jacobian) < 1e-5
