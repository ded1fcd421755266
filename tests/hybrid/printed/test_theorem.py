"""Theorem 4.2.1: measured errors lie below the proven bounds, and both shrink as dt^4."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hopdata.hybrid.printed.theorem import MESHES, localise, turning_point

STEPS = 0.6 / 1.5 ** np.arange(12)
PARTS = (0.05, 0.4, 0.5, 0.9)

each_mesh = pytest.mark.parametrize("mesh", MESHES)


@each_mesh
@pytest.mark.parametrize("part", PARTS)
def test_the_bounds_hold(mesh, part):
    for dt in STEPS:
        found = localise(turning_point(), dt, part=part, mesh=mesh)
        assert 0.0 < found.time_error <= found.time_bound
        assert 0.0 < found.state_error <= found.state_bound


@each_mesh
def test_the_errors_are_of_fourth_order(mesh):
    found = [localise(turning_point(), dt, mesh=mesh) for dt in STEPS]
    for errors in (
        [one.time_error for one in found],
        [one.state_error for one in found],
    ):
        assert np.polyfit(np.log(STEPS), np.log(errors), 1)[0] == pytest.approx(
            4.0, abs=0.07
        )


def test_the_bounds_are_not_idle():
    """At the worst place, the errors are within a factor of thirty of the bound."""
    found = [localise(turning_point(), 0.05, part=part) for part in PARTS]
    assert max(one.time_error / one.time_bound for one in found) > 1 / 30
    assert max(one.state_error / one.state_bound for one in found) > 1 / 30


def test_the_constants_on_a_short_step_are_those_at_the_event():
    event = turning_point()
    found = localise(event, 1e-3).constants
    y, dy, fourth = (event.derivative(k, np.array(event.time)) for k in (0, 1, 4))
    slope = event.hessian @ y + event.gradient
    assert found.liveness == pytest.approx(slope @ dy, rel=1e-2)
    assert found.lipschitz == pytest.approx(np.abs(slope).sum(), rel=1e-2)
    assert found.speed == pytest.approx(np.abs(dy).max(), rel=1e-2)
    assert found.spline == pytest.approx(np.abs(fourth).max() / 384, rel=1e-2)


def test_a_plane_makes_no_error_of_its_own():
    """For a linear event function, h(p) is a cubic: L = 0, and both splines have one root."""
    event = turning_point()
    y = event.derivative(0, np.array(event.time))
    plane = replace(event, hessian=np.zeros((3, 3)), offset=-float(event.gradient @ y))
    found = localise(plane, 0.2)
    assert found.constants.fourth == pytest.approx(0.0, abs=1e-9)
    assert 0.0 < found.time_error <= found.time_bound


def test_known_event_is_consistent():
    event, t = turning_point(), np.array(0.3)
    assert event.height(event.derivative(0, np.array(event.time))) == pytest.approx(
        0, abs=1e-16
    )
    assert event.slope(0.3, event.derivative(0, t)) == pytest.approx(
        event.derivative(1, t)
    )
    near = (event.derivative(3, t + 1e-5) - event.derivative(3, t - 1e-5)) / 2e-5
    assert event.derivative(4, t) == pytest.approx(near, abs=1e-9)


def test_what_the_theorem_does_not_cover_is_refused():
    with pytest.raises(ValueError, match="mesh"):
        localise(turning_point(), 0.1, mesh="midpoint")
    with pytest.raises(ValueError, match="live on the whole step"):
        localise(turning_point(), 3.0)
