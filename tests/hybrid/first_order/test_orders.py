"""Orders of crossing: which occur, and what they do."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hybrid_systems import ladder, sliding

from hopdata.hybrid import System, field, guards
from hopdata.hybrid.first_order import NotTransversalError, bouligand_derivative
from hopdata.scenes.octant import octant


@field
def bar_field(t, y, mode, params, dy):
    dy[0], dy[1] = y[2], y[3]
    dy[2], dy[3] = -9.81, 0.0
    for k in range(len(params)):
        if mode[k] > 0:
            dy[2] += 20.0
            dy[3] += 60.0 * params[k]


@guards
def bar_guards(t, y, dy, mode, params, h, hdot):
    for k in range(len(params)):
        h[k] = -y[0] - params[k] * np.sin(y[1])
        hdot[k] = -dy[0] - params[k] * np.cos(y[1]) * dy[1]


def pieces_of_bar(places):
    """A bar (height, angle, velocities) that falls on contacts at these places, all at once."""
    names = tuple(f"contact{k}" for k in range(len(places)))
    system = System(bar_field, bar_guards, n_states=4, guard_names=names)
    state, mode = [0.0, 0.0, -1.0, 0.0], [-1] * len(places)
    return bouligand_derivative(system, state, params=places, mode=mode)


def test_octant_has_six_orders_and_two_products():
    orders = bouligand_derivative(octant(), [0, 0, 0], mode=[-1, -1, -1]).pieces()
    assert {order.guards for order in orders} == set(permutations(range(3)))
    distinct = {order.matrix.tobytes() for order in orders}
    assert len(distinct) == 2
    for order in orders:
        first_x = order.guards.index(0) < order.guards.index(1)
        expected = np.eye(3)
        if first_x:
            expected[1, :2] = 0.5
        np.testing.assert_allclose(order.matrix, expected, atol=1e-15)


@pytest.mark.parametrize("places", [(-1.0, 0.5), (-1.0, 0.2, 1.0), (-1.0, -0.3, 0.2, 0.7)])
def test_a_bar_meets_its_contacts_from_one_end_to_the_other(places):
    """Contacts on a line: height and angle leave the two monotone orders and no other."""
    d = pieces_of_bar(places)
    n = len(places)
    orders = d.pieces()
    ascending = tuple(range(n))
    assert {order.guards for order in orders} == {ascending, ascending[::-1]}
    for order in orders:
        assert d.order(order.direction) == order.guards
        assert np.linalg.norm(order.direction) == pytest.approx(1.0)
        np.testing.assert_allclose(order.matrix, orders[0].matrix, atol=1e-13)


def test_guards_with_one_surface_are_crossed_together():
    d = bouligand_derivative(ladder(2), [1.0, 0.0], params=(1, 1, 0.5, 2.0), mode=[-1, -1])
    orders = d.pieces()
    assert len(orders) == 2
    np.testing.assert_allclose(orders[0].matrix, orders[1].matrix, atol=1e-15)
    np.testing.assert_allclose(orders[0].matrix[0, 0], 3.5)


def test_a_guard_that_is_not_approached_is_refused():
    left = bouligand_derivative(sliding(), [0.0], params=(1.0, 2.0), mode=[-1])
    np.testing.assert_allclose(left([1.0]), [-0.5])
    leaving = bouligand_derivative(sliding(), [0.0], params=(1.0, -2.0), mode=[-1])
    with pytest.raises(NotTransversalError, match="guard origin: expected to be approached"):
        leaving([1.0])


def test_many_guards_are_found_by_random_deviations():
    bar = pieces_of_bar(tuple(np.linspace(-1, 1, 9)))
    assert {order.guards for order in bar.pieces()} == {tuple(range(9)), tuple(range(8, -1, -1))}
    for order in bar.pieces():
        assert bar.order(order.direction) == order.guards
