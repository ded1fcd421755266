import numpy as np
import pytest

from hopdata.errors import AnalysisError
from hopdata.maps.units import choose_units, prediction_errors


def pairs(rng, n=200, markers=3):
    p = 6 * markers
    x = rng.normal(size=(n, p)) * 0.02
    y = x @ rng.normal(size=(p, p)) / 4
    y[:, : p // 2] += 1e-3 * rng.normal(size=(n, p // 2))
    y[:, p // 2 :] += 4e-2 * rng.normal(size=(n, p // 2))
    return x, y


@pytest.mark.parametrize("markers", [3, 5])
def test_position_and_velocity_errors_weigh_the_same(markers):
    x, y = pairs(np.random.default_rng(0), markers=markers)
    half = 3 * markers
    units = choose_units(x, y)
    scale = np.repeat([units.length_unit_m, units.velocity_unit_m_s], half)
    errors, _ = prediction_errors(x / scale, y / scale)
    position, velocity = np.mean(errors[:, :half] ** 2), np.mean(errors[:, half:] ** 2)
    assert abs(position / velocity - 1) < 1e-9
    unscaled, _ = prediction_errors(x, y)
    assert np.mean(unscaled[:, half:] ** 2) > 100 * np.mean(unscaled[:, :half] ** 2)


def test_planted_errors_give_the_time_unit():
    units = choose_units(*pairs(np.random.default_rng(1), n=5000))
    assert units.time_unit_s == pytest.approx(1 / 40, rel=0.02)
    assert units.rms_position_error_m == pytest.approx(1e-3, rel=0.02)
    assert units.rms_velocity_error_m_s == pytest.approx(4e-2, rel=0.02)
    assert units.predictor == "affine"


def test_length_unit_is_the_rms_distance_from_the_mean_outcome():
    x, y = pairs(np.random.default_rng(2))
    y[:, :9] = 5.0
    y[::2, 0], y[1::2, 0] = 5.0 + 0.03, 5.0 - 0.03
    assert choose_units(x, y).length_unit_m == pytest.approx(0.03, rel=1e-12)


def test_given_units_are_kept_and_named():
    units = choose_units(
        *pairs(np.random.default_rng(3)), length_m=0.02913, time_s=0.027
    )
    assert (units.length_unit_m, units.time_unit_s) == (0.02913, 0.027)
    assert units.velocity_unit_m_s == pytest.approx(1.0789, abs=1e-4)
    assert units.length_rule == units.time_rule == "given"
    assert units.to_dict()["velocity_unit_m_s"] == units.velocity_unit_m_s


def test_few_landings_fall_back_to_the_mean_and_say_so():
    x, y = pairs(np.random.default_rng(4), n=12)
    units = choose_units(x, y)
    assert units.predictor == "mean"
    assert "mean" in units.time_rule
    others = np.delete(y, 5, axis=0).mean(0)
    np.testing.assert_allclose(prediction_errors(x, y)[0][5], y[5] - others, rtol=1e-12)


def test_an_exact_map_leaves_its_rounding_alone():
    x, _ = pairs(np.random.default_rng(6))
    y = 3 * x
    units = choose_units(x, y)
    assert units.predictor == "mean"
    expected = y[:, :9].std() / y[:, 9:].std()
    assert units.time_unit_s == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_fewer_than_three_landings_are_refused(count):
    x, y = pairs(np.random.default_rng(6))
    with pytest.raises(AnalysisError, match=f"at least 3 landings, found {count}"):
        choose_units(x[:count], y[:count])


def test_equal_landings_are_refused():
    with pytest.raises(AnalysisError, match="differ from each other"):
        choose_units(np.ones((30, 18)), np.ones((30, 18)))
