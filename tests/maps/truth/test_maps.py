"""The exact map in the axes of the estimates, and errors relative to it."""

import json

import numpy as np
import pytest
from made_up_landings import ARMS, END, MIDDLE, POINTS, coefficients, landings, noisy

from hopdata.maps.coordinates import rigid_states, section_coordinates, split_states
from hopdata.maps.corrected.estimates import estimate_maps
from hopdata.maps.truth.maps import (
    estimate_errors,
    exact_map,
    exact_table,
    input_root,
    judged,
    largest_difference,
    marker_motions,
    marker_states,
    relative_difference,
    score_estimates,
    score_verdict,
    true_effect,
    verdict_errors,
)
from hopdata.rigid import body_shape

TIME_S = 0.02
EXACT = {
    "body_points_m": POINTS.tolist(),
    "x": MIDDLE.tolist(),
    "y": [END.tolist()] * 2,
    "maps": [(coefficients().T + d).tolist() for d in (0.1, -0.1)],
}


def test_marker_states_are_undone_by_the_rigid_body_fit():
    rng = np.random.default_rng(2)
    x, y = (
        np.hstack([np.zeros((20, 3)), 0.3 * rng.normal(size=(20, 8))]) for _ in range(2)
    )
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
    """Deviations from the middle are small, so that the estimate is the derivative there."""
    rng = np.random.default_rng(0)
    dx = 1e-4 * rng.normal(size=(60, 8))
    before = marker_states(np.hstack([np.zeros((60, 3)), MIDDLE + dx]), ARMS)
    after = marker_states(END + dx @ coefficients(), ARMS)
    shape = body_shape(split_states(before)[0])
    assert np.abs(shape - ARMS).max() > 1e-3  # rotated by the mean attitude
    found = exact_map(EXACT, before, shape=shape, time_unit_s=TIME_S)
    estimates = estimate_maps(
        before, after, rng.normal(size=(60, 3)), time_unit_s=TIME_S
    )
    assert found.error(estimates.maps["ols"].coefficients) < 1e-3
    assert np.abs(found.coefficients - coefficients()).max() > 1e-2


def turned(states, angle):
    """Return marker states in a rotated and translated frame of the plane."""
    c, s = np.cos(angle), np.sin(angle)
    parts = states.reshape(len(states), 6, 3) @ np.array(
        [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    )
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
    assert "map_estimate_gain" not in score_estimates(
        table[table["estimator"] == "ols"]
    )


def test_the_table_has_displacements():
    before, _, _ = landings(50)
    found = exact_map(EXACT, before, shape=ARMS, time_unit_s=TIME_S)
    row = found.table().iloc[11 * 2]
    assert (row["input"], row["output"]) == ("forward_m_s", "step_x_m")
    sd = found.inputs[:, 2].std(ddof=1)
    assert row["standardised"] == pytest.approx(1e3 * sd * found.coefficients[2, 0])


RNG = np.random.default_rng(2)
X = RNG.normal(size=(500, 4)) @ RNG.normal(size=(4, 4))
A, B = RNG.normal(size=(2, 3, 4))
UNITS = np.array([1.0, 20.0, 0.1])


def test_the_root_is_one_of_the_covariance():
    root = input_root(X)
    np.testing.assert_allclose(root @ root.T, np.cov(X.T), atol=1e-12)


def test_a_difference_is_that_of_the_predictions():
    centred = X - X.mean(axis=0)
    apart, size = (np.linalg.norm(centred @ m.T / UNITS) for m in (A - B, B))
    found = relative_difference(A, B, root=input_root(X), units=UNITS)
    assert found == pytest.approx(apart / size, rel=1e-12)
    assert relative_difference(B, B, root=input_root(X), units=UNITS) == 0
    assert relative_difference(
        2 * B, B, root=input_root(X), units=UNITS
    ) == pytest.approx(1)


def test_it_does_not_change_with_the_coordinates_of_the_inputs():
    turn = RNG.normal(size=(4, 4))
    there, back = X @ turn.T, np.linalg.inv(turn)
    found = relative_difference(A @ back, B @ back, root=input_root(there), units=UNITS)
    assert found == pytest.approx(
        relative_difference(A, B, root=input_root(X), units=UNITS)
    )


def test_the_largest_of_all_pairs_is_relative_to_the_mean_map():
    maps, root = np.array([B, B + 0.01 * A, B - 0.02 * A]), input_root(X)
    mean = maps.mean(axis=0)
    expected = relative_difference(mean + 0.03 * A, mean, root=root, units=UNITS)
    assert largest_difference(maps, root=root, units=UNITS) == pytest.approx(expected)
    assert largest_difference(maps[:1], root=root, units=UNITS) == 0


# The true effect of made-up exact maps, and the score of a verdict against it.

ANSWER = {
    "conclusion": "different",
    "effect": {
        **{
            "estimate": 0.3,
            "low": 0.2,
            "high": 0.4,
            "upper_bound": 0.38,
            "detectable": 0.1,
        },
        "p_value": 0.001,
    },
}
ORDERS = ("1>2>3", "1>3>2", "2>1>3")
INSTANTS = np.tile([[0.0, 0.01, 0.02], [0.0, 0.02, 0.01], [0.01, 0.0, 0.02]], (14, 1))[
    :40
]


def exact(*changes):
    return {
        "body_points_m": POINTS.tolist(),
        "schedules": ORDERS[: len(changes)],
        "x": MIDDLE.tolist(),
        "y": [END.tolist()] * len(changes),
        "maps": [(coefficients().T * (1 + change)).tolist() for change in changes],
    }


def test_equal_maps_have_no_effect():
    assert true_effect(exact(0.0, 0.0, 0.0), landings(40)[0], INSTANTS) < 1e-12


def test_effect_is_the_rms_over_the_pairs_of_schedules():
    found = true_effect(exact(-0.1, 0.1, 0.0), landings(40)[0], INSTANTS)
    assert found == pytest.approx(np.sqrt(np.mean([0.2**2, 0.1**2, 0.1**2])), rel=1e-9)


def test_positions_and_velocities_count_alike_whatever_their_units():
    maps = exact(0.0, 0.0)
    changed = np.array(maps["maps"])
    changed[0, 5:] *= 1.1
    changed[1, 5:] *= 0.9
    found = true_effect(maps | {"maps": changed.tolist()}, landings(40)[0], INSTANTS)
    assert found == pytest.approx(0.2 / np.sqrt(2), rel=1e-9)


def test_truth_is_weighed_with_the_landings_that_are_judged():
    """Drops far off, in a direction in which the maps agree, would hide their difference."""
    differ, agree = np.diag([1.0] + [0.0] * 7), np.diag([0.0] + [1.0] * 7)
    maps = exact(0.0, 0.0, 0.0)
    base = coefficients().T
    changed = [base @ (agree + f * differ) for f in (0.5, 1.5, 1.0)]
    maps = maps | {"maps": [one.tolist() for one in changed]}
    rng = np.random.default_rng(6)
    deviations = 1e-3 * rng.normal(size=(40, 8))
    deviations[:3, 1:] *= 30  # from the operator's hand
    coordinates = np.hstack([np.zeros((40, 3)), MIDDLE + deviations])
    states = marker_states(coordinates, ARMS)
    verdict = {"gross_errors": {"state_far_off": [1, 2], "outcome_far_off": [3]}}

    kept = judged(states, INSTANTS, verdict)
    np.testing.assert_array_equal(kept, np.arange(3, 40))
    alone = true_effect(maps, states[3:], INSTANTS[3:])
    assert true_effect(maps, states[kept], INSTANTS[kept]) == alone
    assert true_effect(maps, states, INSTANTS) < 0.5 * alone
    np.testing.assert_array_equal(
        judged(states, INSTANTS, {"gross_errors": {}}), np.arange(40)
    )
    unknown = INSTANTS.copy()
    unknown[5, 1] = np.nan
    assert 5 not in judged(states, unknown, verdict)


def test_legs_that_scatter_are_inputs_as_well():
    by_legs = np.random.default_rng(5).standard_normal((11, 3))
    changes = (-0.1, 0.1, 0.0)

    def with_legs(*factors):
        maps = [(by_legs * factor).tolist() for factor in factors]
        legs = {"maps": maps, "covariance_m2": (0.008**2 * np.eye(3)).tolist()}
        return true_effect(exact(*changes) | {"legs": legs}, landings(40)[0], INSTANTS)

    without = true_effect(exact(*changes), landings(40)[0], INSTANTS)
    assert with_legs(0.0, 0.0, 0.0) == pytest.approx(without, rel=1e-9)
    assert with_legs(0.9, 1.1, 1.0) == pytest.approx(without, rel=1e-9)
    assert with_legs(1.0, 1.0, 1.0) < 0.999 * without
    assert with_legs(0.5, 1.5, 1.0) > 1.001 * without


def test_turns_move_the_markers_as_said():
    """The rms motion of the markers about each axis is that of a small rotation of the body."""
    motions = marker_motions(POINTS)
    arms = POINTS - POINTS.mean(axis=0)
    for column, axis in ((2, [0, 0, 1]), (3, [0, 1, 0]), (4, [1, 0, 0])):
        way = np.sqrt(np.mean(np.sum(np.cross(axis, arms) ** 2, axis=1)))
        assert np.linalg.norm(motions[:, column]) == pytest.approx(way)
        assert np.linalg.norm(motions[:, 12 - column]) == pytest.approx(way)


@pytest.mark.parametrize(("true", "covered"), [(0.35, True), (0.1, False)])
def test_score_says_whether_the_interval_holds_the_truth(true, covered):
    entries = score_verdict(verdict_errors(true, ANSWER))
    assert entries["verdict_true_effect"]["value"] == true
    assert entries["verdict_interval_covers"]["value"] is covered


def test_without_exact_maps_nothing_is_compared():
    assert score_verdict(verdict_errors(None, ANSWER)) == {}
    estimates = {"maps": {"printed": {"what": "", "coefficients": []}}, "n_landings": 9}
    assert estimate_errors(None, estimates).empty
    assert exact_table(None).empty


def test_no_answer_is_not_scored():
    none = {"conclusion": "cannot tell", "effect": None}
    assert score_verdict(verdict_errors(0.1, none)) == {}


@pytest.mark.parametrize(("true", "holds"), [(0.8, True), (0.01, False)])
def test_an_interval_without_an_upper_end_holds_all_that_is_not_below_it(true, holds):
    open_end = ANSWER["effect"] | {"low": 0.05, "high": None, "upper_bound": None}
    entries = score_verdict(verdict_errors(true, ANSWER | {"effect": open_end}))
    assert entries["verdict_interval_covers"]["value"] is holds
