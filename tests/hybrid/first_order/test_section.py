"""Impact states of a falling ball, whose derivative is known."""

from __future__ import annotations

import numpy as np
import pytest

from hopdata.hybrid.first_order import NotTransversalError, project_onto_section

G = 9.81


def impact(height, speed, floor_speed):
    """State where a ball meets a floor that rises from 0 at t = 0, and the time."""
    down = speed - floor_speed
    t = (down + np.sqrt(down**2 + 2 * G * height)) / G
    return np.array([floor_speed * t, speed - G * t]), t


@pytest.mark.parametrize("floor_speed", [0.0, 0.3])
def test_derivative_of_the_impact_state(floor_speed):
    start, step = np.array([1.2, 0.4]), 1e-6
    state, t = impact(*start, floor_speed)
    flow, rate = np.array([[1, t], [0, 1]]), np.array([state[1], -G])
    found = project_onto_section(flow, rate, [-1.0, 0.0], time_rate=floor_speed)
    columns = [
        (impact(*(start + step * e), floor_speed)[0] - impact(*(start - step * e), floor_speed)[0])
        / (2 * step)
        for e in np.eye(2)
    ]
    np.testing.assert_allclose(found, np.array(columns).T, atol=1e-8)


def test_a_section_at_rest_maps_into_itself():
    rng = np.random.default_rng(2)
    flow, rate, slope = rng.normal(size=(4, 4)), rng.normal(size=4), rng.normal(size=4)
    np.testing.assert_allclose(slope @ project_onto_section(flow, rate, slope), 0, atol=1e-13)
    np.testing.assert_allclose(project_onto_section(np.eye(4), rate, slope) @ rate, 0, atol=1e-13)


def test_grazing_is_refused():
    with pytest.raises(NotTransversalError):
        project_onto_section(np.eye(2), [0.0, 1.0], [1.0, 0.0])
