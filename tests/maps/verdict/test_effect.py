"""Size, interval, bound and detectable size for kinks with a known error."""

from dataclasses import fields, replace
from itertools import permutations

import numpy as np
import pytest

from hopdata.errors import AnalysisError
from hopdata.maps.verdict.effect import (
    SHOWN_SCATTER,
    EffectSize,
    contrasts,
    detectable_in,
    effect_size,
    landings_needed,
    relative_size,
)
from hopdata.maps.verdict.model import HIDDEN, LEFT, OF_FOURTH, KinkFit, upper_ends
from hopdata.maps.verdict.signs import crossing

KINKS, OUTPUTS, LANDINGS = 2, 4, 150
WEIGHTS = 0.02 * np.linspace(0.5, 2.0, KINKS * OUTPUTS)  # unequal errors of the kinks


def fit(size, seed, allowed=LEFT, like_errors=False):
    """Return kinks of this size with an error that the landings' contributions make up.

    Their direction is random: any, or as those of errors are.
    """
    rng = np.random.default_rng(seed)
    scores = WEIGHTS * rng.standard_normal((LANDINGS, len(WEIGHTS))) / np.sqrt(LANDINGS)
    direction = rng.standard_normal(len(WEIGHTS))
    if like_errors:
        direction *= WEIGHTS
    found = size * direction / np.linalg.norm(direction) + scores.sum(axis=0)
    return KinkFit(
        coefficients=found.reshape(KINKS, OUTPUTS),
        linear=np.zeros((8, OUTPUTS)),
        scores=scores,
        null_scores=scores,
        seen=np.eye(KINKS),
        rows=np.arange(LANDINGS),
        allowed=allowed,
        left=allowed,
    )


def size_of(kinks, seed=0):
    generator = np.random.default_rng(seed)
    return effect_size(
        kinks,
        np.eye(len(WEIGHTS)),
        generator=generator,
        confidence=0.95,
        power=0.8,
        flips=199,
    )


def sizes(size, count=150, allowed=LEFT):
    return [size_of(fit(size, seed, allowed), seed) for seed in range(count)]


def share(holds):
    return np.mean(list(holds))


@pytest.mark.parametrize("allowed", [LEFT, 0.3])
def test_false_alarms_are_as_rare_as_said(allowed):
    """This holds for any shift of the kinks by smooth terms, up to what is allowed for them."""
    assert share(effect.low > 0 for effect in sizes(0.0, allowed=allowed)) <= 0.01
    found = sizes(allowed, count=300, allowed=allowed)
    assert 0.0 < share(effect.low > 0 for effect in found) <= 0.1
    assert share(effect.p_value <= 0.2 for effect in found) >= 0.1


def test_only_sizes_below_the_estimate_share_the_errors_of_no_kinks():
    kinks = fit(0.4, 0)
    own, wide = size_of(kinks), size_of(replace(kinks, null_scores=2 * kinks.scores))
    assert (wide.high, wide.upper_bound) == (own.high, own.upper_bound)
    assert wide.low < own.low


@pytest.mark.parametrize("size", [0.1, 0.2, 0.4])
@pytest.mark.parametrize("shift", [-HIDDEN, 0.0, 1.0])
def test_interval_and_bound_hold_the_size(size, shift):
    found = sizes(size + shift * LEFT, count=80)
    assert share(effect.low <= size <= effect.high for effect in found) >= 0.9
    assert share(size <= effect.upper_bound for effect in found) >= 0.9


def test_both_ends_hold_what_one_landing_has_beside_the_mean_of_all():
    """For large differences this is a share of them; for small ones, what smooth terms hide."""
    share_changed = 2 * (0.4 / OF_FOURTH) ** (2 / 3)
    expected = [HIDDEN * 0.4, 10 * (1 + share_changed)]
    assert upper_ends([0.0, 10.0], 0.4) == pytest.approx(expected, rel=1e-3)
    assert share(effect.upper_bound >= 1.0 for effect in sizes(0.85, count=40)) >= 0.9
    assert share(effect.low <= 1.0 for effect in sizes(1.25, count=40)) >= 0.9


def test_the_detectable_size_is_found_as_often_as_said():
    size = float(np.median([effect.detectable for effect in sizes(0.0, count=20)]))
    shown = size * np.exp(SHOWN_SCATTER * np.random.default_rng(7).standard_normal(300))
    found = [
        size_of(fit(one, seed, like_errors=True), seed).low > 0
        for seed, one in enumerate(shown)
    ]
    assert 0.73 < np.mean(found) < 0.87


def test_the_estimate_is_right_on_average():
    squares = [effect.estimate**2 for effect in sizes(0.2)]
    assert np.sqrt(np.mean(squares)) == pytest.approx(0.2, rel=0.03)


def test_the_interval_is_in_order_and_clear_of_zero_with_the_test():
    for effect in [*sizes(0.0, count=40), *sizes(0.17, count=40)]:
        assert effect.low <= effect.high
        assert effect.upper_bound <= effect.high
        assert (effect.low > 0) == (effect.p_value < 0.05)


def test_half_the_difference_takes_four_times_the_landings_beyond_the_terms():
    # 51 terms of three feet take 60 landings, of which 85 % are fitted.
    assert landings_needed(1060, 0.4, 0.3, 0.35, 3) == pytest.approx(4060, abs=1)
    assert landings_needed(1060, 0.4, 0.3, 0.5, 3) == pytest.approx(310, abs=1)
    assert (
        landings_needed(1000, 0.2, LEFT, 0.9, 3) == 150
    )  # those for second-order terms


def size_with(**values):
    """Return a size with these values, and others that do not matter."""
    names = [one.name for one in fields(EffectSize)]
    return EffectSize(**{**dict.fromkeys(names, 0.0), **values})


@pytest.mark.parametrize("feet", [2, 3, 5])
def test_what_other_landings_detect_is_the_number_needed_turned_round(feet):
    """A part of a study asks for as many landings as the whole of it."""
    size = size_with(
        detectable=0.4, allowed=0.16, detectable_nearest=0.5, allowed_nearest=0.1
    )
    asked = size.landings_needed(300, 0.2, feet)
    at_needed = size.in_landings(300, asked, feet)
    assert at_needed.detectable == pytest.approx(0.2, abs=1e-4)
    assert at_needed.allowed == 0.1  # of the nearest, which show it first
    for others in (300, 500, 2000):
        of_others = size.in_landings(300, others, feet)
        again = of_others.landings_needed(others, 0.2, feet)
        assert again == pytest.approx(asked, abs=2)
    # The root of the share of all landings, as it was, asks for others.
    of_root = 0.1 + 0.4 * np.sqrt(300 / 2000)
    assert landings_needed(2000, of_root, 0.1, 0.2, feet) > 1.15 * asked


def test_too_few_landings_for_the_smooth_terms_detect_nothing():
    assert detectable_in(60, 300, 0.4, 0.1, 3) == np.inf
    same = size_with(
        detectable=0.4, allowed=0.2, detectable_nearest=0.3, allowed_nearest=0.1
    )
    # The window of a study itself was chosen by more than the size.
    assert same.in_landings(300, 300, 3) == same


def test_of_two_windows_the_one_that_needs_less_is_planned_for():
    nearest = {"detectable_nearest": 0.5, "allowed_nearest": 0.1}
    both = [landings_needed(360, 0.4, 0.15, d, 3, **nearest) for d in (0.12, 0.2, 0.35)]
    # 300 (0.4 / 0.02)^2 and 300 (0.4 / 0.1)^2 by the nearest, 300 (0.25 / 0.2)^2.
    assert both == pytest.approx([120_060, 4_860, 529], abs=1)
    alone = [landings_needed(360, 0.4, 0.15, d, 3) for d in (0.2, 0.35)]
    assert alone == pytest.approx([7_560, 529], abs=1)
    with pytest.raises(AnalysisError, match=r"numbers above 0\.15, .* found 0\.12"):
        landings_needed(360, 0.4, 0.15, 0.12, 3)
    with pytest.raises(AnalysisError, match=r"numbers above 0\.1, .* found 0\.1$"):
        landings_needed(360, 0.4, 0.15, 0.1, 3, **nearest)


def test_of_three_feet_each_pair_of_orders_is_compared():
    orders = np.array(list(permutations(range(3))))
    differences, mean = contrasts(orders, np.ones(6))
    assert differences.shape == (15, 6)
    assert np.allclose(differences.sum(axis=1), 0)
    assert np.allclose(mean, 1 / 6)


def test_of_more_feet_each_two_are_compared_as_they_occur():
    orders = np.array([[0, 1, 2, 3], [1, 0, 2, 3], [3, 2, 1, 0]])
    differences, mean = contrasts(orders, np.array([60, 30, 25]))
    assert np.allclose(mean, np.array([60, 30, 25]) / 115)
    first = differences[0]  # foot 0 before foot 1, or after it
    assert np.allclose(first, [1.0, -30 / 55, -25 / 55])
    assert np.allclose(differences[1], [60 / 90, 30 / 90, -1.0])  # 0 before 2
    rare = contrasts(orders, np.array([60, 30, 19]))[0]
    assert len(rare) == 1, (
        "only feet 0 and 1 exchange their order in 20 landings or more"
    )


def test_known_maps_have_the_size_that_the_formula_says():
    rng = np.random.default_rng(2)
    mean, change = rng.standard_normal((2, 11, 8))
    maps = np.array([mean + change / 2, mean - change / 2])
    weights = contrasts(np.array([[0, 1], [1, 0]]), np.ones(2))
    parts = [
        np.sum(change[k] ** 2) / np.sum(mean[k] ** 2) for k in (slice(5), slice(5, 11))
    ]
    assert relative_size(maps, weights) == pytest.approx(np.sqrt(np.mean(parts)))
    units = np.repeat([1e3, 1e-2], [5, 6])[:, None]
    assert relative_size(units * maps, weights) == pytest.approx(
        np.sqrt(np.mean(parts))
    )


def test_without_any_order_nothing_is_compared():
    differences, mean = contrasts(np.empty((0, 3), int), np.empty(0, int))
    assert differences.shape == (0, 0)
    assert mean.shape == (0,)


def test_a_bound_falls_to_the_margin_where_the_estimate_leaves_room():
    """As many landings as are named bring it there, if the estimate stays."""
    size = of_two_feet(estimate=0.12, upper_bound=0.22)
    needed = size.landings_for_bound(576, 0.2, 2)
    assert 1_200 < needed < 3_000
    # 45 terms, one kink and one step take 1/0.85 landings each.
    free = (needed - 47 / 0.85) / (576 - 47 / 0.85)
    seen = crossing(lambda e: 0.22 - upper_ends([e], 0.105)[0])
    shrunk = 0.12 + (seen - 0.12) / np.sqrt(free)
    (bound,) = upper_ends([shrunk], 0.105)
    assert bound == pytest.approx(0.2, abs=1e-4)

    # The study's own bound takes as many landings as it has, and a lower one more.
    assert size.landings_for_bound(576, 0.22, 2) == pytest.approx(576, abs=1)
    assert size.landings_for_bound(576, 0.19, 2) > needed
    # No bound is below what smooth terms may hide of the estimate alone.
    assert size.landings_for_bound(576, 0.17, 2) is None
    unbounded = replace(size, high=np.inf, upper_bound=np.inf)
    assert unbounded.landings_for_bound(576, 0.2, 2) is None


def of_two_feet(**values):
    """Return a size of landings of two feet."""
    known = {
        "estimate": 0.12,
        "low": 0.0,
        "high": 0.23,
        "upper_bound": 0.22,
        "detectable": 0.18,
        "p_value": 0.2,
        "squared": 0.0146,
        "squared_error": 0.0011,
        "along_error": 0.022,
        "allowed": 0.105,
        "left": 0.105,
        "detectable_nearest": 0.18,
        "allowed_nearest": 0.105,
    }
    return EffectSize(**known | values)
