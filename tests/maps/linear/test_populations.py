import numpy as np
import pytest

from hopdata.maps.linear.populations import (
    Population,
    common_split,
    large_enough,
    needed_training,
    select_populations,
    split_sizes,
)


def test_near_and_far_are_below_and_above_the_median_of_all():
    schedule = np.array(["1>2", "2>1", "1>2", "", "1>2"])
    spread = np.array([1.0, 2.0, 3.0, 4.0, np.nan])
    populations, notes = select_populations(schedule, spread, 2)
    rows = {item.name: item.rows.tolist() for item in populations}
    assert rows == {
        "schedule 1>2": [0, 2, 4],
        "near": [0, 1],
        "all": [0, 1, 2, 3, 4],
        "far": [2, 3],
    }
    assert notes == [
        {"what": "specialised models of schedule 2>1", "reason": "1 touchdowns, at least 2 wanted"}
    ]


def test_no_class_is_said_once_more_for_all():
    _, notes = select_populations(np.array(["", ""]), np.array([np.nan, np.nan]), 40)
    assert notes == [{"what": "specialised models", "reason": "no mode schedule has 40 touchdowns"}]


@pytest.mark.parametrize(
    ("population", "expected"),
    [(2860, (120, 41)), (161, (120, 41)), (160, (119, 41)), (40, (30, 10)), (2, (1, 1))],
)
def test_splits_scale_down_in_proportion(population, expected):
    assert split_sizes(population, 120, 41) == expected


def test_needed_training_counts_independent_inputs():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(50, 4)) @ rng.normal(size=(4, 9))
    assert needed_training(x) == 4 + 1 + 2
    assert needed_training(rng.normal(size=(50, 9))) == 9 + 1 + 2
    assert needed_training(np.empty((0, 9))) == 3


def test_the_smallest_kept_population_decides_the_split():
    schedule = np.array(["1>2"] * 100 + ["2>1"] * 300)
    populations, _ = select_populations(schedule, np.arange(400.0), 40)
    kept, notes = large_enough(populations, 120, 41, 12)
    assert kept == populations
    assert notes == []
    sizes, scaled = common_split(kept, 120, 41)
    assert sizes == split_sizes(100, 120, 41)
    assert scaled[0] == {
        "what": "All models were trained on 75 and tested on 25 touchdowns instead of 120 and 41",
        "reason": "the rarest order with a model of its own, 1>2, has only 100",
    }
    assert common_split(kept[1:], 120, 41) == ((120, 41), [])
    assert common_split([], 120, 41) == ((120, 41), [])


@pytest.mark.parametrize(("kind", "words"), [("near", "30 near touchdowns"), ("all", "30 touch")])
def test_a_split_without_classes_says_how_few_touchdowns_there_are(kind, words):
    (note,) = common_split([Population(kind, "", np.arange(30))], 120, 41)[1]
    assert f"there are only {words}" in note["reason"]


def test_what_is_too_small_does_not_shrink_the_others():
    schedule = np.array(["1>2"] * 10 + ["2>1"] * 29)
    populations, _ = select_populations(schedule, np.arange(39.0), 5)
    kept, notes = large_enough(populations, 120, 41, 20)
    assert [item.name for item in kept] == ["schedule 2>1", "all"]
    assert [note["what"] for note in notes] == ["schedule 1>2", "near", "far"]
    assert common_split(kept, 120, 41)[0] == split_sizes(29, 120, 41)


def test_many_thin_classes_are_counted_together():
    schedule = np.repeat([f"{k}" for k in range(9)], np.arange(20, 29))
    populations, notes = select_populations(schedule, np.arange(len(schedule)) * 1.0, 15)
    assert notes == []
    kept, notes = large_enough(populations, 120, 41, 26)
    assert [item.name for item in kept] == ["near", "all", "far"]
    assert notes == [
        {
            "what": "affine models of 9 schedules",
            "reason": "15 to 21 touchdowns each to fit, an affine map of these inputs needs 26",
        }
    ]
