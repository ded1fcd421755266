"""Each order against all others: the one that differs is named, and no other."""

import os

import numpy as np
import pytest
from kinked_landings import kinks_of_feet, landings

from hopdata.maps.verdict import judge
from hopdata.maps.verdict.orders import OF_ORDER, OTHERS

ODD = "1>2>3"
N_STUDIES = 60 if "ALL" in os.environ else 3


def one_differs(seed, size, **changes):
    """Return a study in which the order `ODD` answers otherwise to the state.

    The outcome jumps at the borders of this order, on average by nothing.
    """
    data = landings(500, seed=seed, feet=3, **changes)
    order = np.argsort(data.instants, axis=1)
    is_odd = (order == [0, 1, 2]).all(axis=1)
    along = np.random.default_rng(5).standard_normal(8) / np.sqrt(8)
    change = 0.01 * size * (data.x / data.x.std(axis=0)) @ along * is_odd
    after = data.after.copy()
    after[:, 0:9:3] += change[:, None]
    after[:, 9::3] += 20.0 * change[:, None]
    return data.before, after, data.instants


def named(answer):
    return [
        one["first"]
        for one in answer.orders
        if one["of"] == OF_ORDER and one["low"] > 0.0
    ]


def verdict(data, seed):
    return judge(*data, seed=seed, flips=99)


def test_the_order_that_differs_is_named_and_no_other():
    right = 0
    for seed in range(N_STUDIES):
        answer = verdict(one_differs(seed, 2.0), seed)
        if named(answer) == [ODD]:
            right += 1
            assert "only the order 1 → 2 → 3" in answer.main_contrast
            assert "maps.own_map" in [note.code for note in answer.notes]
    assert right >= 0.9 * N_STUDIES


@pytest.mark.parametrize("change", [{}, {"curvature": 1.0}, {"cubic": 0.1}])
def test_of_one_smooth_map_no_order_is_named(change):
    for seed in range(N_STUDIES):
        answer = verdict(one_differs(100 + seed, 0.0, **change), seed)
        assert named(answer) == []
        assert answer.conclusion != "different"


def test_its_landings_are_no_mistakes():
    answer = verdict(one_differs(1, 2.0), 1)
    n_odd = next(one["n_first"] for one in answer.orders if one["first"] == ODD)
    assert n_odd > 50
    assert len(answer.gross_errors["outcome_far_off"]) < 0.05 * 500


def test_what_exchanges_two_feet_is_not_said_of_one_order():
    for changes in ({"pair": 1.5}, {"last": 2.0}, {"jump": 1.5}):
        assert (
            "only the order"
            not in verdict(kinks_of_feet(1, **changes), 1).main_contrast
        )


def test_each_order_has_a_size_with_its_numbers_of_landings():
    answer = verdict(one_differs(1, 0.0), 1)
    rows = [one for one in answer.orders if one["of"] == OF_ORDER]
    assert len(rows) == 6
    for one in rows:
        assert one["second"] == OTHERS
        assert one["n_first"] + one["n_second"] == answer.n_window
        assert one["low"] <= one["estimate"] <= one["high"]


@pytest.mark.parametrize("n_feet", [2, 4])
def test_two_feet_are_a_pair_and_of_four_pairs_of_feet_are_compared(n_feet):
    data = landings(450, seed=1, feet=n_feet)
    answer = verdict((data.before, data.after, data.instants), 1)
    assert {one["of"] for one in answer.orders} <= {"map", "jump"}
