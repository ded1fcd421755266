"""Which orders differ: pairs with intervals that hold together, and their words."""

import os
from itertools import combinations, permutations

import numpy as np
import pytest
from kinked_landings import kinks_of_feet as study

from hopdata.maps.verdict import judge
from hopdata.maps.verdict.orders import (
    OF_JUMPS,
    OF_ORDER,
    OneTest,
    PairEffect,
    joint_level,
    mainly,
    orders_table,
)
from hopdata.messages import Message

N_STUDIES = 20 if "ALL" in os.environ else 10


def verdict(seed, flips=199, *, feet=3, **changes):
    """Return the verdict on landings whose outcome has kinks or jumps of these feet."""
    data = study(seed, feet=feet, **changes)
    return judge(*data, seed=seed, flips=flips)


def feet(order):
    return order.split(">")


def exchanges(effect, a="1", b="2"):
    """Return whether the two orders of a pair have two feet in either order."""
    one, other = feet(effect["first"]), feet(effect["second"])
    return (one.index(a) < one.index(b)) != (other.index(a) < other.index(b))


def found(answer, of="map"):
    return [one for one in answer.orders if one["of"] == of and one["low"] > 0.0]


def test_squares_of_pairs_have_the_square_of_the_study_as_their_mean():
    answer = verdict(1, pair=1.0, jump=1.0)
    for of, size in (("map", answer.effect), ("jump", answer.jump)):
        pairs = [one for one in answer.orders if one["of"] == of]
        assert len(pairs) == {"map": 15, "jump": 3}[of]
        # Estimates are not below zero, squares less noise may be.
        squares = [one["estimate"] ** 2 for one in pairs]
        assert np.mean(squares) == pytest.approx(size.squared, rel=0.02)
        assert np.mean(squares) >= size.squared


@pytest.mark.parametrize("feet", [2, 3, 4] if "ALL" in os.environ else [3])
def test_of_one_smooth_map_no_pair_differs(feet):
    for seed in range(N_STUDIES):
        answer = verdict(seed, feet=feet)
        assert answer.conclusion != "different"
        assert all(one["low"] == 0.0 for one in answer.orders)
        assert all(one["p_value"] >= 0.05 for one in answer.orders)
        assert answer.main_contrast == ""


@pytest.mark.parametrize("seed", range(6 if "ALL" in os.environ else 3))
def test_a_kink_of_two_feet_is_found_between_the_orders_that_exchange_them(seed):
    answer = verdict(seed, pair=1.5)
    pairs = found(answer)
    assert len(pairs) == 9
    assert all(exchanges(one) for one in pairs)
    assert answer.main_contrast == (
        "mainly: orders with foot 1 before foot 2 "
        "against those with foot 2 before foot 1"
    )
    rest = [one for one in answer.orders if one["of"] == "map" and one not in pairs]
    assert max(one["estimate"] for one in rest) < min(one["low"] for one in pairs)


@pytest.mark.parametrize("seed", range(3 if "ALL" in os.environ else 2))
@pytest.mark.parametrize(("which", "says"), [("last", "end"), ("first", "begin")])
def test_a_kink_of_the_last_or_first_foot_is_found_and_named(seed, which, says):
    answer = verdict(seed, **{which: 2.0})
    place = {"last": -1, "first": 0}[which]
    for one in found(answer):
        assert feet(one["first"])[place] != feet(one["second"])[place]
    assert answer.main_contrast == f"mainly: orders that {says} with different feet"


@pytest.mark.parametrize("seed", range(3))
def test_a_jump_is_found_between_the_feet_that_cause_it(seed):
    answer = verdict(seed, jump=1.5)
    (one,) = found(answer, "jump")
    assert (one["first"], one["second"]) == ("1>2", "2>1")
    assert one["low"] < one["estimate"] < one["high"]
    assert (
        "the outcome jumps most where foot 1 and foot 2 exchange"
        in answer.main_contrast
    )


def test_no_pair_is_different_unless_the_study_is_and_pairs_cost_certainty():
    for seed in range(8):
        answer = verdict(seed, pair=0.35)
        pairs = found(answer)
        if pairs:
            assert answer.conclusion == "different"
        pairs = [one for one in answer.orders if one["of"] != OF_ORDER]
        least = min(one["p_value"] for one in pairs)
        assert least >= min(answer.effect.p_value, answer.jump.p_value)
        for one in answer.orders:
            assert (one["p_value"] < 0.05) == (one["low"] > 0.0)
            assert one["low"] <= one["estimate"] <= one["high"]


def test_intervals_of_all_pairs_hold_the_exact_sizes_together():
    exact = {(a, b): size for a, b, size in sizes_without_noise()}
    held = 0
    for seed in range(N_STUDIES):
        answer = verdict(seed, pair=1.0)
        held += all(
            one["low"] <= exact[one["first"], one["second"]] <= one["high"]
            for one in answer.orders
            if one["of"] == "map"
        )
    assert held >= 0.9 * N_STUDIES


def sizes_without_noise():
    """Return the sizes of pairs from many landings, whose noise hardly matters."""
    data = [study(seed, pair=1.0) for seed in range(100, 110)]
    answer = judge(
        *(np.vstack(part) for part in zip(*data, strict=True)), seed=1, flips=99
    )
    pairs = [one for one in answer.orders if one["of"] == "map"]
    return [(one["first"], one["second"], one["estimate"]) for one in pairs]


class Drawn:
    """Draws of a statistic that are given."""

    def __init__(self, drawn, statistic):
        self.drawn, self.statistic = drawn, statistic

    def statistics(self, _true):
        return self.drawn


def of_two(rng, shares):
    drawn = rng.standard_normal((400, 2))
    drawn[:, 1] += drawn[:, 0]  # the two are alike
    tests = [OneTest(Drawn(drawn[1:, k], drawn[0, k]), 0.1, shares[k]) for k in (0, 1)]
    p_values = [np.mean(drawn[:, k] >= drawn[0, k]) for k in (0, 1)]
    return joint_level(tests, 0.05), p_values


@pytest.mark.parametrize("shares", [(0.5, 0.5), (1.0 - OF_JUMPS, OF_JUMPS)])
def test_two_tests_together_err_as_often_as_said(shares):
    rng = np.random.default_rng(1)
    errs = []
    for _ in range(1500):
        joint, p_values = of_two(rng, shares)
        errs.append(
            any(p < level for p, level in zip(p_values, joint.of_each, strict=True))
        )
        assert errs[-1] == (joint.p_value < 0.05)
    assert 0.035 < np.mean(errs) < 0.065
    ratio = joint.of_each[1] / joint.of_each[0]
    assert ratio == pytest.approx(shares[1] / shares[0])


def test_one_test_has_the_whole_level():
    rng = np.random.default_rng(2)
    drawn = rng.standard_normal(400)
    joint = joint_level([OneTest(Drawn(drawn[1:], drawn[0]), 0.1, 1.0)], 0.05)
    assert joint.of_each == [pytest.approx(0.05, abs=1 / 400)]


def test_levels_of_kinks_and_jumps_are_stated():
    levels = verdict(1, flips=999).levels
    assert 0.037 < levels["effect"] < 0.045
    assert 0.009 < levels["jump"] < 0.012


def test_feet_that_exchange_their_order_together_are_named_together():
    rng = np.random.default_rng(3)
    one, other = rng.standard_normal((2, 300))
    instants = np.column_stack([one, -one, 1.0 + other, 1.0 + other + 0.8 * one])
    together = (
        "foot 1 and foot 2 or foot 3 and foot 4 (these exchange their order together, "
        "so that few landings or none tell them apart)"
    )
    jumps = [effect("1>2, 4>3", 0.3, of="jump"), effect("1>3", 0.0, of="jump")]
    said = str(mainly(jumps, instants))
    assert said == f"the outcome jumps most where {together} exchange their order"
    maps = [effect("1>2", 0.3), effect("1>3", 0.0)]
    said = str(mainly(maps, instants))
    assert said == f"most of all: which comes first of {together}"
    alone = instants[:, [0, 1, 2]]
    jumps[0] = effect("1>2", 0.3, of="jump")
    assert "where foot 1 and foot 2 exchange" in str(mainly(jumps, alone))
    named = str(mainly(jumps, alone, names=("toe", "heel", "thumb")))
    assert "where toe and heel exchange" in named


def effect(first, low, of="map"):
    second = ">".join(reversed(feet(first)))
    return PairEffect(of, first, second, low + 0.1, low, low + 0.2, 0.01, 40, 40, 0.1)


SIX = [">".join(order) for order in permutations("123")]


def of_orders(ends):
    """Return all pairs of six orders, with these ends of the first intervals."""
    pairs = []
    for k, (a, b) in enumerate(combinations(SIX, 2)):
        low, high = ends[k] if k < len(ends) else (0.0, 0.1)
        middle = (low + high) / 2
        pairs.append(PairEffect("map", a, b, middle, low, high, 0.01, 40, 40, 0.1))
    return pairs


def in_words(effects, **changes):
    return str(mainly(effects, np.zeros((1, 3)), **changes))


def test_a_pair_differs_most_only_if_its_interval_is_above_all_others():
    above = of_orders([(0.3, 0.8), (0.0, 0.29)])
    assert in_words(above) == "most of all: the orders 1 → 2 → 3 and 1 → 3 → 2"
    overlap = of_orders([(0.3, 0.8), (0.0, 0.31)])
    assert in_words(overlap) == (
        "surest to differ are the orders 1 → 2 → 3 and 1 → 3 → 2, "
        "though other orders may differ as much or more"
    )
    assert "orders a → b → c and a → c → b" in in_words(above, names=("a", "b", "c"))
    assert "orders a → b → c and a → c → b," in in_words(overlap, names=("a", "b", "c"))
    alone = in_words(overlap, alone="3>1>2", names=("a", "b", "c"))
    assert "only the order c → a → b:" in alone


def test_pairs_whose_low_ends_read_the_same_are_named_together():
    same = of_orders([(0.304, 0.8), (0.296, 0.8)])
    assert in_words(same).startswith(
        "surest to differ are the orders 1 → 2 → 3 and 1 → 3 → 2, "
        "and likewise 1 → 2 → 3 and 2 → 1 → 3, though"
    )
    other = of_orders([(0.304, 0.8), (0.294, 0.8)])
    assert "likewise" not in in_words(other)
    told = mainly(same, np.zeros((1, 3)))
    assert str(Message.from_dict(told.to_dict())) == str(told)


def test_a_jump_is_largest_only_if_its_interval_is_above_all_others():
    highest = effect("1>3", 0.0, of="jump").high
    above = [effect("1>2", highest + 0.01, of="jump"), effect("1>3", 0.0, of="jump")]
    assert in_words(above).startswith("the outcome jumps most where foot 1 and foot 2")
    overlap = [effect("1>2", highest, of="jump"), effect("1>3", 0.0, of="jump")]
    assert in_words(overlap) == (
        "the outcome is surest to jump where foot 1 and foot 2 exchange their order, "
        "though it may jump as much or more where others do"
    )
    same = [effect("1>2", 0.102, of="jump"), effect("1>3", 0.098, of="jump")]
    assert "foot 1 and foot 2, and likewise foot 1 and foot 3 ex" in in_words(
        [effect("1>2", 0.302, of="jump"), effect("1>3", 0.298, of="jump")]
    )
    assert "likewise" not in in_words(same)


def test_feet_matter_most_only_if_their_interval_is_above_all_others():
    rng = np.random.default_rng(4)
    instants = rng.standard_normal((300, 4))
    highest = effect("1>3", 0.0).high
    above = [effect("1>2", highest + 0.01), effect("1>3", 0.0)]
    said = str(mainly(above, instants))
    assert said == "most of all: which comes first of foot 1 and foot 2"
    overlap = [effect("1>2", highest), effect("1>3", 0.0)]
    assert str(mainly(overlap, instants)) == (
        "surest to matter is which comes first of foot 1 and foot 2, "
        "though that of other feet may matter as much or more"
    )
    same = [effect("1>2", 0.302), effect("1>3", 0.298)]
    assert "foot 1 and foot 2, and likewise foot 1 and foot 3, though" in str(
        mainly(same, instants)
    )
    instants[:, 2] = instants[:, 1]  # the two exchange their order with foot 1 together
    together = str(mainly(same, instants))
    assert together.count("foot 1 and foot 3") == 1
    assert "likewise" not in together


def test_the_table_has_a_row_for_each_pair():
    answer = verdict(1)
    table = orders_table(answer.orders)
    assert len(table) == len(answer.orders) == 24
    assert list(table)[:3] == ["of", "first", "second"]
    assert list(orders_table([])) == list(table)


def test_pairs_do_not_depend_on_the_names_of_the_feet():
    before, after, instants = study(1, last=1.5)
    turned = instants[:, [2, 0, 1]]
    one = judge(before, after, instants, seed=1, flips=199)
    other = judge(before, after, turned, seed=1, flips=199)
    names = {"1": "2", "2": "3", "3": "1"}  # of a foot of `one` in `other`
    sizes = {}
    for pair in other.orders:
        sizes[pair["of"], frozenset((pair["first"], pair["second"]))] = pair["low"]
    pairs = [pair for pair in one.orders if pair["of"] != OF_ORDER]
    for pair in pairs:
        ends = [
            ">".join(names[foot] for foot in feet(pair[side]))
            for side in ("first", "second")
        ]
        same = sizes[pair["of"], frozenset(ends)]
        assert pair["low"] == pytest.approx(same, abs=1e-8)


RMS = ("rms over all pairs; 95 % interval", "rms over all exchanges; 95 % interval")


def test_a_size_over_several_pairs_is_said_to_be_an_rms():
    told = verdict(1, pair=2.0, jump=1.5).sentence
    assert all(words in told for words in RMS)
    of_one_pair = verdict(1, feet=2, pair=2.0, jump=1.5).sentence
    assert "are different: by" in of_one_pair
    assert "the outcome jumps by" in of_one_pair
    assert "rms" not in of_one_pair
