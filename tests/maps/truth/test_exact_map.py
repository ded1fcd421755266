"""The exact map in the axes of the estimates, and errors against it."""

import json

import numpy as np
import pytest
from made_up_landings import ARMS, END, MIDDLE, POINTS, coefficients, landings, noisy

from hopdata.maps.corrected.map_estimates import estimate_maps
from hopdata.maps.rigid import body_shape, rigid_states, section_coordinates, split_states
from hopdata.maps.truth.exact_map import (
    estimate_errors,
    exact_map,
    marker_states,
    score_estimates,
)

TIME_S = 0.02
EXACT = {
    "body_points_m": POINTS.tolist(),
    "x": MIDDLE.tolist(),
    "y": [END.tolist()] * 2,
    "maps": [(coefficients().T + d).tolist() for d in (0.1, -0.1)],
}


def test_marker_states_are_undone_by_the_rigid_body_fit():
    rng = np.random.default_rng(2)
    x, y = (np.hstack([np.zeros((20, 3)), 0.3 * rng.normal(size=(20, 8))]) for _ in range(2))
    y[:, :3] = rng.normal(size=(20, 3))
    fits = (rigid_states(marker_states(z, ARMS), ARMS) for z in (x, y))
    inputs, outputs = section_coordinates(*fits)
    np.testing.assert_allclose(inputs, x[:, 3:], atol=1e-12)
    np.testing.assert_allclose(outputs, y, atol=1e-12)


def test_in_the_axes_of_the_body_it_is_the_mean_of_the_schedules():
    before, _, _ = landings(50)
    found = exact_map(EXACT, before, shape=ARMS, time_unit_s=TIME_S)
    np.testing.assert_allclose(found.coefficients, coefficients(), rtol=1e-6, atol=1e-7)
    assert found.error(coefficients()) < 1e-6
    assert found.error(2 * coefficients()) == pytest.approx(1.0, rel=1e-6)
    assert found.inputs.shape == (50, 8)


def test_estimates_in_axes_of_their_own_agree_with_it():
    """Small deviations from the middle, so that the estimate is the derivative there."""
    rng = np.random.default_rng(0)
    dx = 1e-4 * rng.normal(size=(60, 8))
    before = marker_states(np.hstack([np.zeros((60, 3)), MIDDLE + dx]), ARMS)
    after = marker_states(END + dx @ coefficients(), ARMS)
    shape = body_shape(split_states(before)[0])
    assert np.abs(shape - ARMS).max() > 1e-3  # turned by the mean attitude
    found = exact_map(EXACT, before, shape=shape, time_unit_s=TIME_S)
    estimates = estimate_maps(before, after, rng.normal(size=(60, 3)), time_unit_s=TIME_S)
    assert found.error(estimates.maps["ols"].coefficients) < 1e-3
    assert np.abs(found.coefficients - coefficients()).max() > 1e-2


def turned(states, angle):
    """Marker states in a frame of the plane that is turned and moved."""
    c, s = np.cos(angle), np.sin(angle)
    parts = states.reshape(len(states), 6, 3) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    parts[:, :3, :2] += [0.3, -0.7]
    return parts.reshape(len(states), -1)


def test_errors_do_not_depend_on_the_frame_of_the_plane():
    true, after, instants = landings(300)
    before = noisy(true, 2e-4, 1e-2)
    errors = []
    for angle in (0.0, 0.4):
        pair = (turned(states, angle) for states in (before, after))
        found = estimate_maps(*pair, instants, time_unit_s=TIME_S)
        exact = exact_map(EXACT, true, shape=found.shape, time_unit_s=TIME_S)
        errors.append([exact.error(one.coefficients) for one in found.maps.values()])
    np.testing.assert_allclose(*errors, rtol=0.02)


def test_errors_and_gain_are_said():
    before, after, instants = landings(700, bend=1.0)
    seen = noisy(before, 1e-4, 1e-2)
    estimates = estimate_maps(seen, after, instants, time_unit_s=TIME_S)
    found = exact_map(EXACT, before, shape=estimates.shape, time_unit_s=TIME_S)
    table = estimate_errors(found, json.loads(json.dumps(estimates.to_dict())))
    error = table.set_index("estimator")["error"]
    assert error["corrected_curved"] < 0.5 * error["printed"]
    entries = score_estimates(table)
    assert entries["map_estimate_error_ols"]["value"] == error["ols"]
    gain = error["printed"] / error["corrected_curved"]
    assert entries["map_estimate_gain"]["value"] == pytest.approx(gain)
    assert "map_estimate_gain" not in score_estimates(table[table["estimator"] == "ols"])


def test_the_table_has_displacements():
    before, _, _ = landings(50)
    found = exact_map(EXACT, before, shape=ARMS, time_unit_s=TIME_S)
    row = found.table().iloc[11 * 2]
    assert (row["input"], row["output"]) == ("forward_m_s", "step_x_m")
    sd = found.inputs[:, 2].std(ddof=1)
    assert row["standardised"] == pytest.approx(1e3 * sd * found.coefficients[2, 0])
