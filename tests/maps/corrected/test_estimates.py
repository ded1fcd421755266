"""All estimates of a study, from marker states."""

import json

import numpy as np
import pytest
from made_up_landings import END, MIDDLE, POINTS, coefficients, landings, noisy

from hopdata.maps.coordinates import rigid_states, section_coordinates, split_states
from hopdata.maps.corrected.estimates import ESTIMATORS, estimate_maps, printed_map
from hopdata.maps.truth.maps import estimate_errors, exact_map, score_estimates
from hopdata.rigid import body_shape

TIME_S = 0.02


def relative(found, estimates):
    size = (
        np.sqrt(np.diag(estimates.input_covariance))[:, None] * estimates.output_weights
    )
    return np.linalg.norm((found - coefficients()) * size) / np.linalg.norm(
        coefficients() * size
    )


def test_a_linear_map_without_noise_is_found_by_all():
    before, after, instants = landings(800)
    found = estimate_maps(before, after, instants, time_unit_s=TIME_S)
    assert list(found.maps) == list(ESTIMATORS)
    # The coordinates refer to the mean attitude, some hundredths of a radian from the
    # body's.
    for name, one in found.maps.items():
        assert one.coefficients.shape == (8, 11)
        assert relative(one.coefficients, found) < 0.06, name
    assert found.noise.position < 1e-20
    assert found.notes == []


def test_the_printed_map_is_least_squares_in_other_coordinates():
    before, after, instants = landings(400)
    before, after = noisy(before, 2e-4, 1e-2), noisy(after, 2e-4, 1e-2, seed=10)
    shape = body_shape(split_states(before)[0])
    printed = printed_map(before, after, shape)
    found = estimate_maps(before, after, instants, time_unit_s=TIME_S)
    plain = found.maps["ols"].coefficients
    size = np.sqrt(np.diag(found.input_covariance))[:, None] * found.output_weights
    miss = np.linalg.norm((printed.coefficients - plain) * size) / np.linalg.norm(
        plain * size
    )
    assert miss < 0.01


@pytest.mark.parametrize("count", [40, 200])
def test_standard_errors_of_affine_maps_are_those_of_repeated_data(count):
    """The printed map's predictions scatter less than the landings it was fitted to."""
    fits = []
    for seed in range(40):
        before, after, instants = landings(count, seed=seed)
        before = noisy(before, 2e-4, 1e-2, seed=(seed, 1))
        after = noisy(after, 1e-3, 5e-2, seed=(seed, 2))
        fits.append(estimate_maps(before, after, instants, time_unit_s=TIME_S).maps)
    for name in ("printed", "ols", "corrected"):
        found = np.std([fit[name].coefficients for fit in fits], axis=0)
        said = np.sqrt(
            np.mean([fit[name].standard_errors ** 2 for fit in fits], axis=0)
        )
        assert 0.8 < np.median(found / said) < 1.2, name
        assert (found / said).max() < 1.6, name


def test_landings_with_an_unknown_state_take_no_part():
    before, after, instants = landings(60)
    lost = before.copy()
    lost[3, 4] = np.nan
    found = estimate_maps(lost, after, instants, time_unit_s=TIME_S)
    others = (np.delete(one, 3, axis=0) for one in (before, after, instants))
    rest = estimate_maps(*others, time_unit_s=TIME_S)
    assert found.n_landings == 59
    for name, one in rest.maps.items():
        np.testing.assert_array_equal(found.maps[name].coefficients, one.coefficients)


def test_noise_biases_least_squares_and_not_the_correction():
    before, after, instants = landings(4000)
    true = (
        estimate_maps(before, after, instants, time_unit_s=TIME_S)
        .maps["ols"]
        .coefficients
    )
    seen = noisy(before, 2e-4, 3e-2)
    found = estimate_maps(seen, after, instants, time_unit_s=TIME_S)
    shape = found.shape
    size = np.sqrt(np.diag(found.input_covariance))[:, None] * found.output_weights
    miss = {
        name: np.linalg.norm((one.coefficients - true) * size)
        / np.linalg.norm(true * size)
        for name, one in found.maps.items()
    }
    assert np.sqrt(found.noise.velocity) == pytest.approx(3e-2, rel=0.05)
    assert miss["ols"] > 0.1
    assert miss["corrected"] < 0.25 * miss["ols"]
    x, _ = section_coordinates(rigid_states(before, shape), rigid_states(after, shape))
    y, _ = section_coordinates(rigid_states(seen, shape), rigid_states(after, shape))
    drawn = np.sqrt(np.mean((y - x) ** 2, axis=0))
    np.testing.assert_allclose(
        np.sqrt(np.diag(found.errors.inputs)), drawn, rtol=0.05, atol=1e-4
    )


def test_tables_and_json_hold_the_same():
    before, after, instants = landings(120)
    found = estimate_maps(before, after, instants, time_unit_s=TIME_S)
    table = found.table()
    assert len(table) == len(ESTIMATORS) * 88
    row = table[(table["estimator"] == "ols") & (table["output"] == "turn_rad")].iloc[3]
    assert (row["input"], row["value"]) == (
        "sideways_m_s",
        found.maps["ols"].coefficients[3, 2],
    )
    said = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert said["maps"]["curved"]["degree"] == 1
    assert said["maps"]["ols"]["coefficients"][3][2] == row["value"]


def test_landings_without_instants_take_no_part():
    before, after, instants = landings(90)
    lacking = instants.copy()
    lacking[::3, 1] = np.nan
    some = np.isfinite(lacking).all(axis=1)
    one = estimate_maps(before, after, lacking, time_unit_s=TIME_S)
    other = estimate_maps(before[some], after[some], instants[some], time_unit_s=TIME_S)
    assert one.n_landings == 60
    for name in ESTIMATORS:
        np.testing.assert_array_equal(
            one.maps[name].coefficients, other.maps[name].coefficients
        )


def test_too_few_landings_are_said():
    before, after, instants = landings(9)
    found = estimate_maps(before, after, instants, time_unit_s=TIME_S)
    assert found.maps == {}
    assert len(found.notes) == len(ESTIMATORS)
    assert "9 landings" in found.notes[0]["reason"]
    assert found.table().empty
    assert list(found.table())[:3] == ["estimator", "input", "output"]


@pytest.mark.parametrize(
    ("count", "flat", "reason"), [(1, 1.0, "1 landings"), (60, 0.0, "line")]
)
def test_what_shows_no_rigid_body_is_said(count, flat, reason):
    before, after, instants = landings(count)
    along = np.tile([1.0, flat, flat], 6)
    found = estimate_maps(before * along, after * along, instants, time_unit_s=TIME_S)
    assert found.maps == {}
    assert found.n_landings == count
    assert reason in found.notes[0]["reason"]
    said = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    exact = {
        "body_points_m": POINTS.tolist(),
        "x": MIDDLE,
        "y": [END],
        "maps": [coefficients().T],
    }
    shape = np.array(said["shape_m"]).reshape(-1, 3)
    known = exact_map(exact, landings(30)[0], shape=shape, time_unit_s=TIME_S)
    assert score_estimates(estimate_errors(known, said)) == {}


def test_noise_beyond_the_spread_is_noted():
    before, after, instants = landings(60)
    seen = noisy(before, 2e-4, 0.3)
    found = estimate_maps(seen, after, instants, time_unit_s=TIME_S)
    assert found.maps["corrected"].removed < 1.0
    assert "of the noise covariance" in found.notes[0]["reason"]
    assert np.isfinite(found.maps["corrected_curved"].coefficients).all()
