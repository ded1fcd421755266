import numpy as np
import pandas as pd
import pytest

from hopdata.steering.experiments.outcomes import (
    median_interval,
    outcome_table,
    rate_interval,
    ratio_interval,
)


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


def rng(seed=0):
    return np.random.default_rng(np.random.SeedSequence(seed))


@pytest.mark.parametrize(
    ("successes", "runs", "low", "high"),
    [(27, 30, 0.7347, 0.9789), (30, 30, 0.8843, 1.0), (0, 10, 0.0, 0.3085)],
)
def test_rates_have_the_intervals_of_clopper_and_pearson(successes, runs, low, high):
    np.testing.assert_allclose(rate_interval(successes, runs), [low, high], atol=5e-5)


def test_the_interval_of_a_rate_covers_at_least_as_often_as_it_says():
    from scipy.stats import binom

    for rate in (0.05, 0.3, 0.5, 0.8, 0.97):
        covers = [low <= rate <= high for low, high in (rate_interval(k, 30) for k in range(31))]
        assert binom.pmf(np.arange(31), 30, rate)[covers].sum() >= 0.95


def test_the_interval_of_a_median_by_order_statistics():
    values = np.arange(1, 31)[::-1]
    assert median_interval(values) == (10.0, 21.0)  # ranks 10 and 21 of 30: 95.7 %
    assert all(np.isnan(median_interval([1.0, 2.0, 3.0])))
    assert all(np.isnan(median_interval([])))


def test_the_interval_of_a_median_covers_at_least_as_often_as_it_says():
    drawn = rng(4).exponential(size=(800, 15))
    inside = [low <= np.log(2) <= high for low, high in map(median_interval, drawn)]
    assert np.mean(inside) > 0.93


def test_a_ratio_of_pairs():
    others = rng(1).uniform(20, 40, 25)
    ratio, low, high = ratio_interval(1.2 * others, others, rng=rng(2))
    np.testing.assert_allclose([ratio, low, high], 1.2)
    ratio, low, high = ratio_interval(rng(3).uniform(24, 48, 25), others, rng=rng(2))
    assert low < ratio < high
    assert all(np.isnan(ratio_interval([], [], rng=rng())))


@pytest.mark.parametrize("pairs", [1, 2, 5])
def test_a_ratio_of_few_pairs_has_no_interval(pairs):
    ratio, low, high = ratio_interval(np.full(pairs, 40.0), np.full(pairs, 20.0), rng=rng())
    assert ratio == 2.0
    assert np.isnan([low, high]).all()
