"""Saltation matrices against flows that are known."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import ball

from hopdata.hybrid import System, field, guards, on_event
from hopdata.hybrid.first_order import NotTransversalError, saltation_matrix, saltation_product
from hopdata.scenes.octant import octant


def test_bounce_is_the_textbook_one():
    """State (height, velocity), restitution e: [[-e, 0], [-g (1 + e) / v, -e]]."""
    g, e, v = 9.81, 0.8, -2.0
    found = saltation_product(ball(), [0.0, v], [0], params=(g, 0.0, e), mode=[-1])
    np.testing.assert_allclose(found, [[-e, 0], [-g * (1 + e) / v, -e]], rtol=1e-10, atol=1e-10)


@field
def drift_field(t, y, mode, params, dy):
    dy[0] = 1.0 if mode[0] < 0 else 3.0
    dy[1] = t if mode[0] < 0 else -t


@guards
def moving_guard(t, y, dy, mode, params, h, hdot):
    h[0] = y[0] - params[0] * t
    hdot[0] = dy[0] - params[0]


@on_event
def push_in_time(t, y, mode, params, guard, direction):
    y[1] += params[1] * t * y[0]
    return 0


def drift(**options):
    return System(drift_field, moving_guard, n_states=2, guard_names=("wall",), **options)


def test_moving_guard():
    """Deviation a of y0: met later by a / (1 - w); y0 gains 2 per unit of time from then on."""
    w, t = 0.25, 2.0
    found = saltation_product(drift(), [w * t, 0.0], [0], params=(w, 0), mode=[-1], t=t)
    expected = [[1 + 2 / (1 - w), 0], [-2 * t / (1 - w), 1]]
    np.testing.assert_allclose(found, expected, rtol=1e-14)


def exact_drift(y, w, c, t, end):
    """Flow from y at t, before the wall y0 = w t, to the time `end`, beyond it."""
    meets = (y[0] - t) / (w - 1)  # y0 + (s - t) = w s
    y0, y1 = w * meets, y[1] + (meets**2 - t**2) / 2
    y1 += c * meets * y0
    return np.array([y0 + 3 * (end - meets), y1 - (end**2 - meets**2) / 2])


def test_reset_that_depends_on_state_and_time():
    w, c, t = 0.25, 0.7, 2.0
    found = saltation_product(
        drift(on_event=push_in_time), [w * t, 0.0], [0], params=(w, c), mode=[-1], t=t
    )
    # The exact flow holds on both sides of t; both fields have unit state transition.
    here, step = np.array([w * t, 0.0]), 1e-5
    columns = [
        np.subtract(*(exact_drift(here + s * step * e, w, c, t, t) for s in (1, -1))) / (2 * step)
        for e in np.eye(2)
    ]
    np.testing.assert_allclose(found, np.array(columns).T, atol=1e-9)


def test_product_multiplies_in_the_order_of_crossing():
    first = saltation_product(octant(), [0, 0, 0], [0], mode=[-1, -1, -1])
    then = saltation_product(octant(), [0, 0, 0], [1], mode=[1, -1, -1])
    both = saltation_product(octant(), [0, 0, 0], [0, 1], mode=[-1, -1, -1])
    np.testing.assert_array_equal(both, then @ first)
    assert np.abs(both - first @ then).max() > 0.1


def test_it_takes_the_field_before_to_the_field_after():
    rng = np.random.default_rng(1)
    before, after, slope = rng.normal(size=(3, 4))
    np.testing.assert_allclose(saltation_matrix(before, after, slope) @ before, after, rtol=1e-12)


def test_a_guard_at_rest_is_refused():
    with pytest.raises(NotTransversalError):
        saltation_matrix([1.0, 0.0], [2.0, 0.0], [0.0, 1.0])
