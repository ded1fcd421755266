"""The random-effects model of squared sizes, on made-up verdicts whose truth is known."""

import gc
import re

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binom, chi2, sem, t, ttest_1samp
from statsmodels.stats.meta_analysis import combine_effects

from hopdata.errors import AnalysisError
from hopdata.maps.verdict.group import (
    combine,
    compare_conditions,
    conditions_said,
    differ,
    joint_level,
    judge_group,
    jumps_that_hold,
)
from hopdata.maps.verdict.model import LEFT

NOISE, ALONG = 0.15, 0.1
DIRECTIONS = 20


def studies(sizes, seed, condition="", left=0.0, conclusion="cannot tell"):
    """Return verdicts on subjects of these sizes: |b|^2 minus its noise, and a common kink."""
    rng = np.random.default_rng(seed)
    noise = NOISE / np.sqrt(DIRECTIONS)
    kinks = noise * rng.standard_normal((len(sizes), DIRECTIONS))
    kinks[:, 0] += sizes
    kinks[:, 1] += left
    return pd.DataFrame(
        {
            "subject": [f"s{n}" for n in range(len(sizes))],
            "condition": condition,
            "conclusion": conclusion,
            "squared": (kinks**2).sum(axis=1) - NOISE**2,
            "squared_error": NOISE**2 * np.sqrt(2.0 / DIRECTIONS),
            "along_error": noise,
            "allowed": LEFT,
            "left": LEFT,
        }
    )


def share(conclusion, size, left=0.0, count=60, subjects=8):
    found = [judge_group(studies(np.full(subjects, size), seed, left=left))
             for seed in range(count)]  # fmt: skip
    return np.mean([one.conclusion == conclusion for one in found])


def test_no_difference_is_seldom_called_one():
    assert share("different", 0.0) <= 0.08


def test_what_all_share_does_not_become_a_difference():
    """A remainder of smooth terms is equal in each subject, so no number of subjects removes it."""
    assert share("different", 0.0, left=0.09, subjects=30) <= 0.08


def test_a_difference_is_found_and_covered():
    found = [judge_group(studies(np.full(8, 0.25), seed)) for seed in range(60)]
    assert np.mean([one.conclusion == "different" for one in found]) > 0.9
    assert np.mean([one.low <= 0.25 <= one.high for one in found]) > 0.9


@pytest.mark.parametrize("along", [-0.05, 0.1])
def test_what_smooth_terms_leave_along_a_difference_is_covered_in_large_groups(along):
    found = [judge_group(studies(np.full(30, 0.3 + along), seed)) for seed in range(40)]
    assert np.mean([one.low <= 0.3 <= one.high for one in found]) > 0.9
    assert all(one.conclusion == "different" for one in found)


@pytest.mark.parametrize(("found", "is_different"), [(1, False), (2, True), (6, True)])
def test_more_differences_than_false_alarms_explain_are_one_of_the_group(
    found, is_different
):
    """Their sizes scatter too much for the mean; one alarm in six is chance, two are not."""
    table = studies(np.array([0.0, 0.0, 0.1, 0.2, 0.3, 1.2]), 1)
    table.loc[6 - found :, "conclusion"] = "different"
    verdict = judge_group(table)
    assert verdict.low == 0.0
    assert (verdict.conclusion == "different") == is_different
    said = (
        "Different on their own: 1 of 6 studies, which decides nothing: false alarms "
        "give as many in up to 26 % of groups without a difference."
    )
    if is_different:
        chance = {2: "3.3 %", 6: "0.1 %"}[found]
        said = (
            f"{found} of 6 studies are on their own, and false alarms give as many in "
            f"at most {chance} of groups without a difference."
        )
        assert "Over all of them, derivatives differ by " in verdict.sentence
    assert said in verdict.sentence


def test_what_false_alarms_explain_is_said_beside_a_mean_that_decides():
    table = studies(np.full(8, 0.6), 1)
    none = judge_group(table)
    assert none.low > 0.0
    assert none.sentence.endswith("Different on their own: 0 of 8 studies.")
    table.loc[:3, "conclusion"] = "different"
    some = judge_group(table)
    at_most = "false alarms give as many in at most 0.1 % of groups"
    assert f"Different on their own: 4 of 8 studies; {at_most}" in some.sentence


@pytest.mark.parametrize("number", [6, 12, 48])
def test_jumps_of_a_group_seldom_hold_by_chance(number, monkeypatch):
    """P-values of 1,999 signs; without Holm one of 12 studies jumps in every ninth group."""
    # statsmodels looks for garbage in each call, a second long in a process of many tests.
    monkeypatch.setattr(gc, "collect", lambda: 0)
    rng = np.random.default_rng(number)
    drawn = rng.integers(1, 2001, (1000, number)) / 2000
    alone = np.mean((drawn < 0.01).any(axis=1))
    held = np.mean([jumps_that_hold(one) > 0 for one in drawn])
    assert alone == pytest.approx(1 - 0.99**number, abs=0.04)
    assert held < 0.07
    assert held < alone


def test_a_jump_holds_in_a_group_if_it_is_surer_than_one_of_many():
    none = np.full(11, np.nan)
    assert jumps_that_hold([0.0005, *none]) == 1
    assert jumps_that_hold([0.009, *none]) == 0
    assert jumps_that_hold([0.009, *none[:4]]) == 1
    # Each that holds leaves one fewer to correct for.
    assert jumps_that_hold([0.0005, 0.0045, *none[:10]]) == 2
    assert jumps_that_hold([0.0045, *none]) == 0
    assert jumps_that_hold([]) == 0


@pytest.mark.parametrize("confidence", [0.9, 0.95, 0.99])
def test_two_rules_share_the_level_of_a_group(confidence):
    for number in range(3, 60):
        fewest, of_mean = joint_level(number, confidence)
        by_number = binom.sf(fewest - 1, number, 1.0 - confidence)
        assert by_number + of_mean <= 1.0 - confidence + 1e-12
        assert of_mean >= 0.1 * (1.0 - confidence)
        assert fewest >= 2, "a single study never decides a group"
        # One study fewer would leave the mean too little.
        fewer = binom.sf(fewest - 2, number, 1.0 - confidence)
        assert fewer >= 0.9 * (1.0 - confidence)


def test_the_lower_end_has_the_level_that_the_number_of_studies_leaves():
    """Of seven, two alarms have 4.4 % of the 5 %; of four, they leave one whole tail."""
    for number, tail in ((4, 0.025), (7, 0.05 - binom.sf(1, 7, 0.05))):
        assert joint_level(number, 0.95) == (2, pytest.approx(tail))
        table = studies(np.full(number, 0.5), 1).assign(left=0.0, allowed=0.0)
        found = judge_group(table)
        model = found.combined
        low = np.sqrt(model.mean - t.isf(tail, number - 1) * model.error)
        assert found.low == pytest.approx(low)


def test_false_alarms_of_studies_are_seldom_one_of_the_group():
    rng = np.random.default_rng(4)
    found = []
    for seed in range(200):
        table = studies(np.zeros(6), seed)
        table["conclusion"] = np.where(rng.random(6) < 0.05, "different", "cannot tell")
        found.append(judge_group(table).conclusion == "different")
    assert np.mean(found) <= 0.06


def test_what_smooth_terms_leave_in_some_subjects_much_is_no_difference():
    """The rms of the remainder is larger than its mean."""
    left = np.tile([0.1, 1.0], 20)
    table = studies(left, 1).assign(allowed=left, left=left)
    assert judge_group(table).low == 0.0
    assert judge_group(table.assign(left=left.mean())).low > 0.0


def test_subjects_of_equal_errors_are_compared_by_students_test():
    """Their scatter then is the error, and what exceeds their errors is between them."""
    squared = np.array([0.02, 0.05, 0.11, 0.08, 0.31])
    error = 0.04
    found = combine(squared, error**2)
    q = np.sum((squared - squared.mean()) ** 2) / error**2
    assert found.mean == pytest.approx(squared.mean())
    assert found.error == pytest.approx(sem(squared))
    assert found.p_value == pytest.approx(ttest_1samp(squared, 0.0).pvalue)
    assert found.between == pytest.approx(np.sqrt(squared.var(ddof=1) - error**2))
    assert found.q == pytest.approx(q)
    assert found.q_p_value == pytest.approx(chi2.sf(q, 4))
    assert found.i2 == pytest.approx(1.0 - 4.0 / q)


def test_subjects_that_scatter_less_than_their_errors_have_these_errors():
    found = combine(np.array([0.10, 0.11, 0.09, 0.10]), 0.04**2)
    assert found.error == pytest.approx(0.04 / 2.0)
    assert found.p_value == pytest.approx(2.0 * t.sf(5.0, 3))
    assert found.between == 0.0
    assert found.i2 == 0.0


def test_q_above_its_degrees_of_freedom_means_variance_between_subjects():
    """In many groups: an iteration may stop just beyond the root and then give none."""
    rng = np.random.default_rng(1)
    for squared in 0.01 * rng.standard_normal((300, 8)):
        found = combine(squared, 8.8e-5)
        assert (found.q > 7.0) == (found.between > 0.0) == (found.i2 > 0.0)
        left = found.variance + found.between**2
        q_left = np.sum((squared - found.mean) ** 2) / left
        assert q_left == pytest.approx(min(found.q, 7.0))


def test_a_group_agrees_with_another_program():
    squared = np.array([0.02, 0.05, 0.11, 0.08, 0.31])
    other = combine_effects(squared, np.full(5, 0.04**2), method_re="iterated")
    found = combine(squared, 0.04**2)
    assert found.mean == pytest.approx(other.mean_effect_re)
    assert found.error == pytest.approx(other.sd_eff_w_re_hksj)
    assert found.q == pytest.approx(other.q)
    assert found.between**2 == pytest.approx(other.tau2)


def test_heterogeneity_is_told_from_noise():
    mixed = judge_group(studies(np.tile([0.0, 0.5], 6), 1)).combined
    alike = judge_group(studies(np.full(12, 0.2), 1)).combined
    assert mixed.i2 > 0.8
    assert mixed.q_p_value < 1e-6
    assert alike.i2 < 0.5


def test_large_differences_do_not_weigh_less_for_their_larger_errors():
    """Errors grow with the size that chance gave, so weighting by them would bias the mean low."""
    table = studies(np.linspace(0.0, 0.4, 9), 3)
    table["squared_error"] = 0.01 + table["squared"].abs()
    assert judge_group(table).combined.mean == pytest.approx(table["squared"].mean())


def test_conditions_are_compared_within_subjects():
    base = np.linspace(0.1, 0.5, 10)  # subjects differ far more than conditions
    rows = [
        studies(base, 1, "a"),
        studies(np.sqrt(base**2 + 0.15), 2, "b"),
        studies(base, 3, "c"),
    ]
    table = compare_conditions(pd.concat(rows)).set_index(
        ["condition_a", "condition_b"]
    )
    assert table.loc[("a", "b"), "difference"] == pytest.approx(-0.15, abs=0.05)
    assert table.loc[("a", "b"), "p_holm"] < 0.01
    assert table.loc[("a", "c"), "p_holm"] > 0.05


def test_the_interval_of_a_difference_is_students_and_what_smooth_terms_leave():
    squared = {
        "a": np.array([0.05, 0.30, 0.10, 0.22, 0.41]),
        "b": np.array([0.09, 0.25, 0.31, 0.40, 0.52]),
    }
    rows = [
        studies(np.zeros(5), 1, name).assign(
            squared=values, squared_error=0.01, along_error=0.01, left=0.05
        )
        for name, values in squared.items()
    ]
    (row,) = compare_conditions(pd.concat(rows)).to_dict("records")
    apart = squared["a"] - squared["b"]
    size_a, size_b = (np.sqrt(values.mean()) for values in squared.values())
    reach = t.isf(0.025, 4) * sem(apart) + 0.05 * (size_a + size_b)
    assert (row["condition_a"], row["condition_b"], row["n"]) == ("a", "b", 5)
    assert (row["size_a"], row["size_b"]) == pytest.approx((size_a, size_b))
    assert row["difference"] == pytest.approx(apart.mean())
    assert row["low"] == pytest.approx(apart.mean() - reach)
    assert row["high"] == pytest.approx(apart.mean() + reach)
    assert row["p_value"] == pytest.approx(ttest_1samp(apart, 0.0).pvalue)
    assert row["p_holm"] == row["p_value"]


def test_conditions_that_differ_by_what_smooth_terms_leave_are_not_told_apart():
    """The p-value accounts for the same remainder in both."""
    rows = [studies(np.full(30, 0.3), 1, "a"), studies(np.full(30, 0.34), 2, "b")]
    found = compare_conditions(pd.concat(rows)).iloc[0]
    assert found["p_value"] < 0.05
    assert found["low"] < 0 < found["high"]
    assert not differ(found)
    alike = conditions_said(compare_conditions(pd.concat(rows)))
    assert alike.startswith("Within subjects, no difference was shown between a (")
    rows[1] = studies(np.full(30, 0.5), 2, "b")
    apart = compare_conditions(pd.concat(rows))
    assert apart.iloc[0]["high"] < 0
    assert differ(apart.iloc[0])
    assert re.fullmatch(
        r"Within subjects, conditions differ: a \(\d+ %\) and b \(\d+ %\), squares by "
        r"-0\.\d+ \(95 % interval -0\.\d+ to -0\.\d+; p \S+, 30 subjects\)\.",
        conditions_said(apart),
    )
    rows.append(studies(np.full(30, 0.5), 3, "c"))
    of_three = conditions_said(compare_conditions(pd.concat(rows)))
    assert of_three.count(" after Holm, 30 subjects") == 3


def test_each_condition_leaves_its_own_remainder_in_a_difference():
    rows = [studies(np.full(9, 0.3), 1, "a"), studies(np.full(9, 0.3), 2, "b")]
    (before,) = compare_conditions(pd.concat(rows)).to_dict("records")
    rows[1]["left"] = LEFT + 0.2
    (row,) = compare_conditions(pd.concat(rows)).to_dict("records")
    assert before["low"] - row["low"] == pytest.approx(0.2 * row["size_b"])


def test_conditions_that_few_subjects_share_are_not_compared():
    rows = [studies(np.full(2, 0.1), 1, "a"), studies(np.full(9, 0.1), 2, "b")]
    assert compare_conditions(pd.concat(rows)).empty


def test_too_few_subjects_are_refused():
    with pytest.raises(
        AnalysisError, match="expected 3 subjects with an answer or more, found 2"
    ):
        combine(np.zeros(2), 1.0)


@pytest.mark.parametrize(
    "column", ["squared", "squared_error", "along_error", "allowed", "left"]
)
@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_a_size_that_is_not_known_is_named_with_its_row(column, wrong):
    table = studies(np.full(8, 0.2), 1)
    assert np.isfinite(judge_group(table).upper_bound)
    table[column] = table[column].astype(float)
    table.loc[2, column] = wrong
    words = f"members, column {column}, row 3: expected a finite number, found {wrong}"
    with pytest.raises(AnalysisError, match=f"^{words}$"):
        judge_group(table)
