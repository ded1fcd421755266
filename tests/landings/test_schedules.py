"""Order of contacts, its probability, and its spread."""

from itertools import permutations
from math import factorial

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from hopdata.landings.schedules import (
    count_mode_schedules,
    first_probability,
    mode_schedules,
    order_probability,
    runner_up,
    schedule_classes,
    schedule_names,
    spread,
)


def test_names_follow_the_order_and_skip_what_is_unknown():
    instants = np.array([[0.3, 0.1, 0.2], [0.1, 0.1, 0.0], [0.1, np.nan, 0.2]])
    assert schedule_names(instants) == ["2>3>1", "3>1>2", ""]


def test_spread_is_the_population_sd():
    np.testing.assert_allclose(
        spread(np.array([[0.0, 0.003, 0.006]])), [np.sqrt(6) * 1e-3]
    )


def test_two_feet_against_the_closed_form():
    rng = np.random.default_rng(0)
    mean, sd = rng.normal(size=(200, 2)), 10 ** rng.uniform(-3, 1, (200, 2))
    exact = norm.cdf(np.abs(mean[:, 1] - mean[:, 0]) / np.hypot(sd[:, 0], sd[:, 1]))
    np.testing.assert_allclose(order_probability(mean, sd), exact, atol=1e-11)


def test_the_first_of_several_against_draws_and_what_cannot_be_first():
    rng = np.random.default_rng(3)
    mean = rng.normal(size=(40, 4))
    sd = 10 ** rng.uniform(-2, 1, (40, 4))
    mean[::2, 1] = np.inf  # it does not touch
    seen = np.where(np.isfinite(mean), mean, 0.0)
    drawn = seen + sd * rng.standard_normal((100_000, 40, 4))
    drawn[:, np.isinf(mean)] = np.inf
    is_first = drawn.argmin(axis=2) == mean.argmin(axis=1)
    found = first_probability(mean, sd)
    np.testing.assert_allclose(found, is_first.mean(axis=0), atol=0.007)
    # The order of the feet changes no digit, and of two the first is their order.
    for order in permutations(range(4)):
        turned = first_probability(mean[:, order], sd[:, order])
        np.testing.assert_array_equal(turned, found)
    two = first_probability(mean[:, 2:], sd[:, 2:])
    np.testing.assert_allclose(two, order_probability(mean[:, 2:], sd[:, 2:]))
    alone = first_probability(np.array([[1.0, np.inf]]), np.ones((1, 2)))
    np.testing.assert_allclose(alone, 1.0)
    unknown = first_probability(np.array([[1.0, 2.0]]), np.array([[0.1, np.nan]]))
    assert np.isnan(unknown).all()


def test_a_clock_that_counts_seconds_since_1970_rounds_no_probability():
    se = np.full((50, 2), 2e-5)
    now = 1.7e9 + np.random.default_rng(2).normal(0, 3e-5, (50, 2))
    exact = norm.cdf(np.abs(now[:, 1] - now[:, 0]) / np.hypot(se[:, 0], se[:, 1]))
    np.testing.assert_allclose(order_probability(now, se), exact, atol=1e-11)


@pytest.mark.parametrize("n", [2, 3, 4, 5, 6])
def test_equal_feet_have_every_order_equally(n):
    value = order_probability(np.zeros((1, n)), np.full((1, n), 0.001))
    np.testing.assert_allclose(value, 1 / factorial(n), rtol=1e-10)


def test_three_feet_against_scipy():
    rng = np.random.default_rng(1)
    mean, sd = rng.normal(size=(20, 3)), rng.uniform(0.1, 2, (20, 3))
    expected = []
    for m, s in zip(mean, sd, strict=True):
        gaps = np.diff(np.eye(3)[np.argsort(m)], axis=0)
        cov = gaps @ np.diag(s**2) @ gaps.T
        expected.append(multivariate_normal.cdf(gaps @ m, cov=cov))
    np.testing.assert_allclose(order_probability(mean, sd), expected, atol=1e-8)


def test_four_feet_against_sampling():
    mean, sd = np.array([[0.0, 0.4, 0.7, 1.5]]), np.array([[0.5, 0.2, 0.6, 0.3]])
    draws = np.random.default_rng(2).normal(mean, sd, (400_000, 4))
    share = (np.diff(draws, axis=1) > 0).all(axis=1).mean()
    assert order_probability(mean, sd)[0] == pytest.approx(share, abs=0.004)


def test_far_apart_is_certain_and_missing_is_missing():
    mean = np.array([[0.0, 1.0, 2.0], [0.0, np.nan, 1.0]])
    value = order_probability(mean, np.full((2, 3), 1e-4))
    assert value[0] == pytest.approx(1.0, abs=1e-12)
    assert np.isnan(value[1])


def test_the_unknown_have_no_probability_even_if_all_are():
    instants = np.array([[0.1, np.nan], [np.nan, np.nan]])
    assert np.isnan(order_probability(instants, np.full((2, 2), 0.001))).all()
    assert order_probability(instants[:0], instants[:0]).shape == (0,)


def test_chunks_do_not_matter():
    rng = np.random.default_rng(3)
    mean, sd = rng.normal(size=(1203, 3)), np.full((1203, 3), 0.5)
    each = [
        order_probability(mean[i : i + 1], sd[i : i + 1])[0]
        for i in (0, 499, 500, 1202)
    ]
    np.testing.assert_allclose(order_probability(mean, sd)[[0, 499, 500, 1202]], each)


def test_the_probabilities_of_all_orders_add_up_to_one():
    rng = np.random.default_rng(2)
    mean, sd = rng.normal(0, 0.003, (50, 4)), rng.uniform(2e-4, 9e-4, (50, 4))
    each = np.stack(
        [order_probability(mean, sd, np.array(o)) for o in permutations(range(4))]
    )
    np.testing.assert_allclose(each.sum(axis=0), 1.0, atol=1e-9)
    own, ranked = order_probability(mean, sd), np.sort(each, axis=0)
    sure = ranked[-1] > 0.5  # then it is the order of every two estimates
    assert sure.sum() > 20
    np.testing.assert_array_equal(own[sure], ranked[-1][sure])
    order, second = runner_up(mean, sd)
    np.testing.assert_allclose(order_probability(mean, sd, order), second)
    assert np.abs(ranked[-2] - second)[sure].max() < 0.02


def test_two_feet_have_two_orders():
    mean, sd = np.array([[0.0, 1e-3]]), np.full((1, 2), 1e-3)
    order, second = runner_up(mean, sd)
    assert order.tolist() == [[1, 0]]
    assert second + order_probability(mean, sd) == pytest.approx(1.0)


def test_classes_are_schedules_or_ambiguous():
    names, probability = ["1>2", "2>1", "", "1>2"], np.array([0.95, 0.6, np.nan, 0.9])
    found = schedule_classes(names, probability, ambiguous_below=0.9)
    assert found == ["1>2", "ambiguous", "", "1>2"]
    assert schedule_classes(names, probability, ambiguous_below=0.0) == names


# Mode schedules of hops: orders of landing and of lift-off.


@pytest.mark.parametrize(
    ("n_feet", "n_hops", "count"),
    [(3, 1, 36), (3, 2, 1_296), (3, 3, 46_656), (1, 5, 1), (2, 3, 64), (4, 1, 576)],
)
def test_mode_schedules_are_counted_by_going_through_them(n_feet, n_hops, count):
    assert count_mode_schedules(n_feet, n_hops) == count
    assert count == factorial(n_feet) ** (2 * n_hops)


def test_every_mode_schedule_comes_once():
    found = list(mode_schedules(3, 2))
    assert len(set(found)) == len(found)
    for orders in found:
        assert len(orders) == 4  # landing, lift-off, landing, lift-off
        assert all(sorted(order) == [0, 1, 2] for order in orders)
