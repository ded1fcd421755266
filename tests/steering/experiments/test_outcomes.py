import numpy as np
import pandas as pd

from hopdata.steering.experiments.outcomes import outcome_table


def runs(experiment="origin", seed=1, touched=0, **hops):
    """Return runs of controllers by the hops that they took; -1 for one that never arrived."""
    rows = [
        {
            "seed": seed, "experiment": experiment, "controller": controller, "run": k,
            "success": taken > 0, "hops": taken, "last_error": 0.1 if taken > 0 else 0.7,
            "reason": "arrived" if taken > 0 else "not in time", "blind": k % 2,
            "touched": touched,
        }
        for controller, all_taken in hops.items()
        for k, taken in enumerate(all_taken)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def row(table, controller):
    return table[table["controller"] == controller].iloc[0]


def test_the_worst_seed_stands_beside_the_median():
    seeds = [
        runs(seed=k, planner=[30] * good + [-1] * (30 - good), ceiling=[25] * 30)
        for k, good in enumerate((30, 28, 27), start=1)
    ]
    table = outcome_table(pd.concat(seeds))
    found = row(table, "planner")
    assert (found["seeds"], found["runs"], found["late"], found["blind"]) == (
        3,
        90,
        5,
        45,
    )
    assert (found["worst_rate"], found["worst_seed"]) == (27 / 30, 3)
    assert found["median_rate"] == 28 / 30
    np.testing.assert_allclose(
        found[["hops", "ratio", "worst_ratio"]].astype(float), [30, 1.2, 1.2]
    )
    assert found["met"] == "too few seeds"
    assert found["last_error"] == 0.1
    assert row(table, "ceiling")["met"] == ""


def test_one_bad_seed_is_enough_not_to_meet_what_is_asked():
    ten = [runs(seed=k, planner=[30] * 30, ceiling=[25] * 30) for k in range(1, 11)]
    good = pd.concat(ten)
    few = runs(seed=11, planner=[30] * 26 + [-1] * 4, ceiling=[25] * 30)
    slow = runs(seed=11, planner=[34] * 30, ceiling=[25] * 30)
    assert row(outcome_table(good), "planner")["met"] == "yes"
    nine = outcome_table(pd.concat(ten[1:]))
    assert row(nine, "planner")["met"] == "too few seeds"
    for bad in (few, slow):
        assert row(outcome_table(pd.concat([good, bad])), "planner")["met"] == "no"


def test_runs_are_compared_from_the_same_starts_only():
    found = row(
        outcome_table(runs(planner=[-1, 20, 40], ceiling=[10, 10, -1])), "planner"
    )
    assert found["ratio"] == 2.0
    assert found["hops"] == 30.0


def test_without_a_success_there_are_no_hops_and_the_experiments_stay_apart():
    table = outcome_table(
        pd.concat(
            [runs(printed=[-1, -1]), runs("turn_board", touched=2, printed=[20, 22])]
        )
    )
    assert len(table) == 2
    assert np.isnan(table["hops"].iloc[0])
    assert table["median_rate"].tolist() == [0.0, 1.0]
    assert table["touched"].tolist() == [0, 2]
