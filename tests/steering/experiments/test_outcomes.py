import numpy as np
import pandas as pd

from hopdata.steering.experiments.outcomes import outcome_table


def runs(experiment="origin", start="any", **hops):
    """Runs of controllers by the hops that they took; -1 for one that never arrived."""
    rows = [
        {
            "experiment": experiment, "start": start, "controller": controller, "run": k,
            "success": taken > 0, "hops": taken,
            "reason": "arrived" if taken > 0 else "not in time", "stances": 40, "blind": k % 2,
        }
        for controller, all_taken in hops.items()
        for k, taken in enumerate(all_taken)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def row(table, controller):
    return table[table["controller"] == controller].iloc[0]


def test_rates_hops_and_what_was_asked():
    planner, ceiling = [30] * 28 + [-1] * 2, [25] * 30
    table = outcome_table(runs(planner=planner, ceiling=ceiling), seed=1)
    found = row(table, "planner")
    assert (found["runs"], found["succeeded"], found["late"]) == (30, 28, 2)
    assert found["hops"] == 30
    assert found["paired_starts"] == 28
    np.testing.assert_allclose(found[["hops_ratio", "ratio_low", "ratio_high"]].astype(float), 1.2)
    assert found["met"] == "yes"
    assert (found["stances"], found["blind"]) == (1200, 15)
    assert row(table, "ceiling")["met"] == ""


def test_too_few_or_too_slow_is_not_met():
    few = runs(planner=[30] * 26 + [-1] * 4, ceiling=[25] * 30)
    slow = runs(planner=[34] * 30, ceiling=[25] * 30)
    assert row(outcome_table(few, seed=1), "planner")["met"] == "no"
    assert row(outcome_table(slow, seed=1), "planner")["met"] == "no"


def test_runs_are_compared_from_the_same_starts_only():
    table = outcome_table(runs(planner=[-1, 20, 40], ceiling=[10, 10, -1]), seed=1)
    found = row(table, "planner")
    assert found["paired_starts"] == 1
    assert found["hops_ratio"] == 2.0
    assert found["hops"] == 30.0


def test_without_a_success_there_are_no_hops_and_the_experiments_stay_apart():
    table = outcome_table(
        pd.concat([runs(printed=[-1, -1]), runs("turn", printed=[20, 22])]), seed=1
    )
    assert len(table) == 2
    assert np.isnan(table["hops"].iloc[0])
    assert table["rate"].tolist() == [0.0, 1.0]
