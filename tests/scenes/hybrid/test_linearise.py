"""Slopes of guards, active guards, checked arguments."""

from __future__ import annotations

import numpy as np
import pytest
from hybrid_systems import throw

from hopdata.hybrid.first_order.linearise import (
    active_guards,
    cross,
    differentiate,
    instant,
    linearise,
    state_scale,
)
from hopdata.scenes.body import flight_mode
from hopdata.scenes.hopper import hopper_system
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.scenes.octant import octant

HOPPER = HopperParameters()
ONES = np.ones(12)


def hopper_at(y, mode=None):
    mode = flight_mode(hopper_system(), -1.0) if mode is None else mode
    return instant(hopper_system(), y, params=HOPPER.vector(), mode=mode, t=0.0)


def test_slopes_are_exact_where_rates_use_dy():
    start = instant(octant(), [0.1, 0.2, 0.3], params=(), mode=[-1, -1, -1], t=0.0)
    here = linearise(octant(), start, np.ones(3))
    np.testing.assert_array_equal(here.gradients, np.diag([1, 1, -1]))
    np.testing.assert_array_equal(here.time_rates, 0)
    np.testing.assert_array_equal(here.guard_rates, here.rate * [1, 1, -1])


def test_slopes_are_exact_where_a_far_surface_spoils_differences():
    start = instant(throw(), [1.0, -3.0], params=(9.81, 1e10), mode=[-1], t=0.0)
    here = linearise(throw(), start, np.ones(2))
    np.testing.assert_array_equal(here.gradients, [[1, 0]])
    np.testing.assert_array_equal(here.guard_rates, [-3])


def test_slopes_of_the_feet_are_those_of_their_heights():
    rng = np.random.default_rng(3)
    y = 0.3 * rng.normal(size=12)
    here = linearise(hopper_system(), hopper_at(y), ONES)
    pitch, roll = y[4:6]
    feet = HOPPER.rest_feet()
    expected = np.zeros((3, 12))
    expected[:, 2] = -1
    row_by_pitch = [
        -np.cos(pitch),
        -np.sin(pitch) * np.sin(roll),
        -np.sin(pitch) * np.cos(roll),
    ]
    expected[:, 4] = -feet @ row_by_pitch
    expected[:, 5] = -feet @ [
        0,
        np.cos(pitch) * np.cos(roll),
        -np.cos(pitch) * np.sin(roll),
    ]
    np.testing.assert_allclose(here.gradients[:3], expected, atol=1e-12)
    np.testing.assert_array_equal(here.gradients[:3, 6:], 0)
    np.testing.assert_array_equal(here.gradients[3], np.eye(12)[8])


def test_derivatives_by_differences():
    start = instant(octant(), [0.1, 0.2, 0.3], params=(), mode=[-1, -1, -1], t=0.5)
    state, time = differentiate(
        lambda p: np.array([np.sin(p.y[0]) * p.y[1] ** 3, np.exp(p.t)]),
        start,
        np.ones(3),
    )
    expected = [[np.cos(0.1) * 0.008, np.sin(0.1) * 0.12, 0], [0, 0, 0]]
    np.testing.assert_allclose(state, expected, atol=1e-12)
    np.testing.assert_allclose(time, [0, np.exp(0.5)], atol=1e-11)


def test_guards_on_whose_surface_the_state_lies():
    for y, expected in (
        ([0, 0, 0], (0, 1, 2)),
        ([0, 0.1, 1e-12], (0, 2)),
        ([1, 1, 1], ()),
    ):
        start = instant(octant(), y, params=(), mode=[-1, -1, -1], t=0.0)
        here = linearise(octant(), start, np.ones(3))
        assert active_guards(octant(), here, None, np.ones(3)) == expected
    assert active_guards(octant(), here, ("z", 0), np.ones(3)) == (2, 0)
    for wrong in (("w",), (3,), (0, "x"), (-1,)):
        with pytest.raises(ValueError):
            active_guards(octant(), here, wrong, np.ones(3))


def test_crossing_flips_the_lock_and_runs_the_handler_on_copies():
    start = hopper_at(np.zeros(12))
    after = start
    for leg in range(3):
        after = cross(hopper_system(), after, leg)
    np.testing.assert_array_equal(after.mode, [1, 1, 1, -1, -1, 1, 1, 1, 1])
    np.testing.assert_array_equal(start.mode, flight_mode(hopper_system(), -1.0))


@pytest.mark.parametrize("mode", [[-1, -1], [-1, 0, 1], [-1, -1, 2]])
def test_all_locks_must_be_set(mode):
    with pytest.raises(ValueError, match="mode"):
        instant(octant(), [0, 0, 0], params=(), mode=mode, t=0.0)


def test_state_and_scale_are_checked():
    with pytest.raises(ValueError, match="state"):
        instant(octant(), [0, 0], params=(), mode=[-1, -1, -1], t=0.0)
    with pytest.raises(ValueError, match="scale"):
        state_scale(octant(), [1, 0, 1])


def test_a_guard_of_another_name_is_refused():
    start = instant(octant(), [0.0, 0.0, 0.0], params=(), mode=[-1, -1, -1], t=0.0)
    here = linearise(octant(), start, np.ones(3))
    with pytest.raises(ValueError, match=r"names among .*'x'.*found .*'back'"):
        active_guards(octant(), here, ["back"], np.ones(3))
    assert active_guards(octant(), here, ["x"], np.ones(3)) == (0,)
