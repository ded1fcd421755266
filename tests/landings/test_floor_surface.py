import numpy as np
import pytest

from hopdata.landings.floor_rests import rest_points
from hopdata.landings.floor_surface import (
    design,
    directions,
    polynomial_terms,
    rim_of,
    robust_regression,
    within_rim,
)
from hopdata.recording import Recording


def test_columns_of_the_design_are_products_of_powers():
    places = np.random.default_rng(0).uniform(-1, 1, (50, 2))
    terms = polynomial_terms(4)
    expected = np.column_stack(
        [places[:, 0] ** i * places[:, 1] ** j for i, j in terms]
    )
    np.testing.assert_allclose(design(places, terms), expected, rtol=1e-14)
    assert design(np.empty((0, 2)), terms).shape == (0, 15)


def test_places_beyond_the_rim_go_straight_to_it():
    rng = np.random.default_rng(1)
    places, rim = rng.uniform(-3, 3, (2000, 2)), rng.uniform(0.8, 1.2, 24)
    moved = within_rim(places, rim)
    beyond = (places @ directions(24).T / rim).max(axis=1)
    inside = beyond <= 1.0
    assert 0.05 < inside.mean() < 0.95
    np.testing.assert_array_equal(moved[inside], places[inside])
    np.testing.assert_allclose(
        (moved @ directions(24).T / rim).max(axis=1)[~inside], 1.0
    )
    np.testing.assert_allclose(
        moved * np.maximum(beyond, 1.0)[:, None], places, rtol=1e-14
    )


def test_a_rim_of_one_spot_moves_every_place_to_it():
    places = np.array([[0.0, 0.0], [3.0, -4.0], [np.nan, 0.0]])
    rim = rim_of(np.zeros((5, 2)), 24)
    with np.errstate(all="raise"):
        moved = within_rim(places, rim)
    np.testing.assert_array_equal(moved[:2], np.zeros((2, 2)))
    assert np.isnan(moved[2, 0])


def test_unknown_places_stay_unknown_and_the_given_ones_are_kept():
    places = np.array([[np.nan, 0.0], [5.0, 0.0], [0.0, 0.0]])
    kept = places.copy()
    moved = within_rim(places, np.ones(24))
    assert np.isnan(moved[0]).any()
    np.testing.assert_allclose(moved[1:], [[1.0, 0.0], [0.0, 0.0]])
    np.testing.assert_array_equal(places, kept)
    assert within_rim(np.empty((0, 2)), np.ones(24)).shape == (0, 2)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e3])
def test_the_robust_regression_does_not_depend_on_the_unit(unit):
    rng = np.random.default_rng(3)
    columns = np.column_stack([np.ones(300), rng.uniform(-1, 1, (300, 3))])
    truth = rng.standard_normal(4)
    heights = columns @ truth + 0.001 * rng.standard_normal(300)
    heights[::10] += 0.5
    found = robust_regression(columns, unit * heights)
    np.testing.assert_allclose(found / unit, robust_regression(columns, heights))
    assert np.abs(found / unit - truth).max() < 0.002
    exact = robust_regression(columns, unit * (columns @ truth))
    np.testing.assert_allclose(exact / unit, truth)


def test_a_foot_that_comes_to_rest_slowly_counts_in_a_short_recording_alone():
    """Twelve frames at rest are too few; in one or two jumps, feet sinking at 0.08 m/s count."""
    speed = np.repeat([-1.0, -0.08, 0.0, 1.0], [100, 25, 12, 100])
    height = np.concatenate([[1.0], 1.0 + 0.01 * np.cumsum(speed)])

    def rest(z):
        positions = np.zeros((len(z), 1, 3))
        positions[:, 0, 2] = z
        return rest_points(
            Recording(
                "r", 0.01 * np.arange(len(z)), positions, ("f",), ("foot",), 100.0
            )
        )

    short = rest(height)
    assert 30 <= len(short.foot) <= 40
    assert np.isfinite(short.start_m).all()
    long = rest(np.concatenate([height, height[-1] + 0.01 * np.arange(1000)]))
    assert len(long.foot) == 0
    assert np.isnan(long.start_m).all()
