"""Lags of the feet over the subjects of a group: each subject is one number."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import ttest_1samp, ttest_rel

from hopdata.landings.group_lags import lag_differences, lags_over_subjects


def lags_of(subject, condition, mean_s, foot="left", other="right", common_s=0.001):
    return {
        "subject": subject,
        "condition": condition,
        "foot": foot,
        "other": other,
        "mean_s": mean_s,
        "common_s": common_s,
        "median_abs_s": abs(mean_s),
    }


def of_conditions():
    """Return lags of four subjects in shoes, of whom three are barefoot, too."""
    shoes = dict(zip("abcd", (0.004, 0.009, 0.001, 0.007), strict=True))
    bare = dict(zip("abc", (0.002, 0.006, 0.001), strict=True))
    rows = [lags_of(subject, "shoes", mean_s) for subject, mean_s in shoes.items()]
    rows += [
        lags_of(subject, "bare", mean_s, common_s=0.003)
        for subject, mean_s in bare.items()
    ]
    return pd.DataFrame(rows)


def test_the_mean_over_subjects_has_the_interval_of_students_t():
    found = lags_over_subjects(of_conditions()).set_index("condition")
    interval = ttest_1samp([0.004, 0.009, 0.001, 0.007], 0.0).confidence_interval()
    assert found["subjects"].tolist() == [4, 3]
    assert found.loc["shoes", "mean_s"] == pytest.approx(0.00525)
    assert found.loc["shoes", "low_s"] == pytest.approx(interval.low)
    assert found.loc["shoes", "high_s"] == pytest.approx(interval.high)
    assert found.loc["bare", "common_s"] == pytest.approx(0.003)


def test_conditions_are_compared_within_the_subjects_of_both():
    (found,) = lag_differences(of_conditions()).to_dict("records")
    paired = ttest_rel([0.004, 0.009, 0.001], [0.002, 0.006, 0.001])
    interval = paired.confidence_interval()
    assert (found["condition_a"], found["condition_b"]) == ("shoes", "bare")
    assert found["subjects"] == 3
    assert found["low_s"] == pytest.approx(interval.low)
    assert found["high_s"] == pytest.approx(interval.high)
    assert found["common_s"] == pytest.approx(np.hypot(0.001, 0.003))


def test_one_subject_has_a_mean_and_no_interval_and_is_not_compared():
    rows = of_conditions()
    one = rows[rows["subject"] == "a"]
    found = lags_over_subjects(one)
    assert found["mean_s"].tolist() == [0.004, 0.002]
    assert found["low_s"].isna().all()
    assert lag_differences(one).empty


def test_a_common_error_that_no_subject_knows_stays_unknown():
    rows = of_conditions().assign(common_s=np.nan)
    assert lags_over_subjects(rows)["common_s"].isna().all()
