"""Counts, bias, interval and scatter of an overlay."""

import numpy as np
import pandas as pd
import pytest

from hopdata.landings.overlay_summary import median_interval, robust_sd, summarise_overlay


def overlay(difference, *, recording="a", column="Fz", se=0.001):
    n = len(difference)
    return pd.DataFrame(
        {
            "recording": recording,
            "source": "forces",
            "column": column,
            "feet": "heel toe",
            "status": "matched",
            "external_s": np.arange(n, dtype=float),
            "found_s": np.arange(n) + difference,
            "se_s": se,
            "difference_s": difference,
            "first_foot": ["heel", "toe"] * (n // 2) + ["toe"] * (n % 2),
            "index": pd.array(range(n), dtype="Int64"),
            "excluded": False,
            "reason": "",
        }
    )


def test_counts_by_status():
    table = overlay(np.zeros(9))
    table["status"] = (
        ["matched"] * 3 + ["missed"] * 2 + ["invented", "other foot"] + ["not compared"] * 2
    )
    table.loc[1, "excluded"] = True
    (row,) = summarise_overlay(table).to_dict("records")
    counts = {key: row[f"n_{key}"] for key in ("external", "matched", "excluded", "missed")}
    assert counts == {"external": 5, "matched": 3, "excluded": 1, "missed": 2}
    assert (row["n_invented"], row["n_other_foot"], row["n_not_compared"]) == (1, 1, 2)
    assert row["first_feet"] == "heel 2, toe 1"


def test_bias_and_scatter_of_a_normal_with_outliers():
    draw = np.random.default_rng(4).normal(0.003, 0.001, 2000)
    draw[:20] += 0.03
    row = summarise_overlay(overlay(draw)).iloc[0]
    assert row["bias_s"] == pytest.approx(0.003, abs=1e-4)
    assert row["robust_sd_s"] == pytest.approx(0.001, rel=0.05)
    assert row["sd_s"] > 0.002
    assert row["largest_s"] > 0.028
    assert row["scatter_over_se"] == pytest.approx(1.0, rel=0.05)
    assert row["bias_low_s"] < 0.003 < row["bias_high_s"]


def test_the_interval_covers_the_median_as_often_as_it_says():
    rng = np.random.default_rng(5)
    draws = rng.exponential(1.0, (2000, 38))
    inside = [low <= np.log(2) <= high for low, high in map(median_interval, draws)]
    assert 0.94 <= np.mean(inside) <= 0.985  # order statistics are discrete: 0.95 at least


def test_the_interval_is_that_of_the_textbook():
    assert median_interval(np.arange(1.0, 11.0)) == (2.0, 9.0)  # n = 10: 97.9 %


@pytest.mark.parametrize("n", [0, 1, 5])
def test_too_few_values_have_no_interval(n):
    assert np.isnan(median_interval(np.arange(float(n)))).all()


def test_robust_sd_of_few_values():
    assert np.isnan(robust_sd(np.array([1.0])))
    assert robust_sd(np.array([1.0, 2.0, 3.0])) == pytest.approx(1.4826, rel=1e-4)


def test_nothing_matched_has_no_bias():
    table = overlay(np.zeros(2)).assign(status="missed", difference_s=np.nan)
    row = summarise_overlay(table).iloc[0]
    assert np.isnan(row["bias_s"])
    assert row["n_missed"] == 2


def test_a_column_of_several_recordings_has_a_row_for_all():
    both = pd.concat([overlay(np.full(8, 0.001)), overlay(np.full(6, 0.002), recording="b")])
    table = summarise_overlay(pd.concat([both, overlay(np.zeros(6), column="Fy")]))
    assert table[["recording", "column", "n_matched"]].to_numpy().tolist() == [
        ["a", "Fz", 8],
        ["b", "Fz", 6],
        ["a", "Fy", 6],
        ["all", "Fz", 14],
    ]
