"""What own maps gain for landings that were not fitted, and what they do not."""

import numpy as np
import pytest

from hopdata.errors import AnalysisError
from hopdata.maps.one_or_own import CONFIDENCE, _median, one_or_own
from hopdata.rigid import OUTPUT_NAMES

SHAPE = np.array([[0.13, 0.03, 0.0], [-0.07, 0.11, 0.02], [-0.06, -0.14, -0.01]])


def study(n=900, differs=0.0, noise=0.001, seed=1):
    """Return marker states whose climb after the landing differs between two orders.

    It is by `differs` m/s for each standard deviation of the climb before.
    """
    rng = np.random.default_rng(seed)
    velocity = 0.1 * rng.standard_normal((n, 3)) - [0.0, 0.0, 2.0]
    place = 0.01 * rng.standard_normal((n, 3)) + [0.0, 0.0, 0.5]
    is_second = rng.random(n) < 0.5
    after = 0.5 * velocity
    after[:, 2] += differs * is_second * (velocity[:, 2] + 2.0) / 0.1

    def states(at, moving):
        positions = at[:, None] + SHAPE + noise * rng.standard_normal((n, 3, 3))
        speeds = moving[:, None] + 10 * noise * rng.standard_normal((n, 3, 3))
        return np.hstack([positions.reshape(n, -1), speeds.reshape(n, -1)])

    landed = place + 0.1 * velocity * [1.0, 1.0, 0.0] - [0.0, 0.0, 0.2]
    schedule = np.where(is_second, "2>1", "1>2")
    return states(place, velocity), states(landed, after), schedule


def of(table, outcome):
    return table.set_index("outcome").loc[outcome]


def test_own_maps_gain_where_the_orders_differ_and_nowhere_else():
    climb = of(one_or_own(*study(differs=0.05)), "climb")
    # Either order's map is 25 mm/s for each standard deviation from one map of both.
    assert climb["apart"] == pytest.approx(25 * 0.6745, rel=0.15)
    assert climb["gain_low"] > 5.0
    forward = of(one_or_own(*study(differs=0.05)), "forward")
    assert forward["gain"] < 0.1 * forward["missed_by_one"]


def test_of_one_smooth_map_nothing_is_gained():
    table = one_or_own(*study())
    assert (table["gain"] < 0.05 * table["missed_by_one"]).all()


def test_the_example_is_a_landing_that_happened():
    x, y, schedule = study(differs=0.05)
    table = one_or_own(x, y, schedule)
    assert len(table) == len(OUTPUT_NAMES)
    row = int(table["touchdown"].iloc[0]) - 1
    assert (table["order"] == schedule[row]).all()
    climb = of(table, "climb")
    exact = y[row, [11, 14, 17]].mean() - y[:, [11, 14, 17]].mean()
    assert climb["happened"] == pytest.approx(1e3 * exact, abs=3.0)
    assert abs(climb["own_map"] - climb["happened"]) < 30.0


def test_half_of_the_examples_outcomes_are_further_apart_than_is_typical():
    table = one_or_own(*study(differs=0.05))
    far = (table["own_map"] - table["one_map"]).abs() / table["apart"]
    assert np.median(far) == pytest.approx(1.0, abs=0.02)


def test_units_are_of_whom_watches():
    table = one_or_own(*study()).set_index("outcome")
    units = table["unit"].to_dict()
    assert units["step x"] == "mm"
    assert units["pitch"] == "°"
    assert units["climb"] == "mm/s"
    assert units["spin z"] == "°/s"


def test_with_too_few_landings_or_one_order_there_is_nothing():
    x, y, schedule = study(n=100)
    assert one_or_own(x, y, schedule).empty
    x, y, schedule = study()
    assert one_or_own(x, y, np.full(len(x), "1>2")).empty
    assert next(iter(one_or_own(x[:0], y[:0], schedule[:0]))) == "outcome"


def test_the_interval_of_a_median_holds_it_as_often_as_said():
    rng = np.random.default_rng(2)
    held = 0
    for _ in range(400):
        _, low, high = _median(rng.standard_normal(101))
        held += low <= 0.0 <= high
    assert held / 400 == pytest.approx(CONFIDENCE, abs=0.03)


def test_the_example_is_named_by_its_recording_and_its_number_there():
    x, y, schedule = study(differs=0.05)
    unnamed = one_or_own(x, y, schedule)
    row = unnamed["touchdown"].iloc[0] - 1  # from 1
    assert unnamed["order"].eq(schedule[row]).all()
    recording = np.where(np.arange(len(x)) < len(x) // 2, "monday", "friday")
    numbers = 7 + np.arange(len(x))
    named = one_or_own(x, y, schedule, recording=recording, touchdown=numbers)
    assert named["recording"].eq(recording[row]).all()
    assert named["touchdown"].eq(7 + row).all()


def test_arrays_of_other_lengths_are_refused():
    x, y, schedule = study(n=100)
    for wrong in ((x, y[:5], schedule), (x, y, schedule[:5]), (x[:, 0], y, schedule)):
        with pytest.raises(AnalysisError, match="x, y, schedule: expected one row per"):
            one_or_own(*wrong)
    with pytest.raises(
        AnalysisError, match="touchdown: expected a value for each of 100"
    ):
        one_or_own(x, y, schedule, touchdown=[1, 2])
    assert one_or_own(x, y, schedule, touchdown=np.arange(100)).empty
