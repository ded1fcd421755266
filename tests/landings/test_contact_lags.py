"""Lags of feet: their intervals cover a lag that is known, with what feet share."""

import numpy as np
import pandas as pd
import pytest

from hopdata.landings.contact_lags import LAG_COLUMNS, lag_table, lags_of_touchdowns

FEET = ("left", "right")
# Scatter of the lag over landings, and the common error of each foot, s.
SCATTER_S = 0.008
COMMON_S = 0.0015


def table_of(instants, *, common_s=COMMON_S, recording="a"):
    """Return contacts of the feet in each landing, `instants` by foot, NaN if untimed."""
    parts = []
    for foot, contact_s in instants.items():
        own = pd.DataFrame({"contact_s": np.asarray(contact_s, float)})
        own["landing"] = np.arange(1, len(own) + 1)
        parts.append(own.assign(foot=foot))
    table = pd.concat(parts, ignore_index=True)
    found = table["contact_s"].notna()
    return table.assign(recording=recording, common_s=common_s, found=found)


def intervals(lag_s, *, landings=30, common_s=COMMON_S, stated_s=COMMON_S, seed=61):
    """Return the bounds (200, 2) of 200 lags, s; the right foot lands `lag_s` later.

    Each time both feet have a common error of their own.
    """
    rng = np.random.default_rng(seed)
    first = np.arange(landings) + 1.0
    table = table_of({"left": first, "right": first}, common_s=stated_s)
    bounds = []
    for _ in range(200):
        of_left, of_right = rng.normal(0, common_s, 2)
        left = first + of_left
        right = first + lag_s + rng.normal(0, SCATTER_S, landings) + of_right
        table["contact_s"] = np.concatenate([left, right])
        bounds.append(lag_table(table, FEET).loc[0, ["low_s", "high_s"]])
    return np.array(bounds, float)


def covered(lag_s, **options):
    """Return the share of draws whose interval contains the lag, left less right."""
    low, high = intervals(lag_s, **options).T
    return np.mean((low <= -lag_s) & (-lag_s <= high))


# Of 200 intervals that hold in 95 %, at least 180 do but in one of 860 series.
@pytest.mark.parametrize(("lag_s", "landings"), [(0.012, 30), (0.0, 30), (0.012, 4)])
def test_intervals_cover_a_known_lag_and_none(lag_s, landings):
    assert 0.90 <= covered(lag_s, landings=landings) <= 0.99


def test_without_the_common_error_intervals_of_many_landings_are_too_narrow():
    assert covered(0.012, landings=400, stated_s=0.0) < 0.5
    exact = covered(0.012, landings=400, common_s=0.0, stated_s=0.0)
    assert 0.90 <= exact <= 0.99, "nothing is shared, so that nothing is missing"


def test_a_lag_is_told_from_none():
    found = intervals(0.012)
    assert np.mean(found[:, 1] < 0) > 0.95, "the left foot touches first"
    none = intervals(0.0)
    assert np.mean((none[:, 1] < 0) | (none[:, 0] > 0)) < 0.10


def test_the_sign_of_a_lag_follows_the_order_of_the_names():
    table = table_of({"left": [1.0, 2.0], "right": [1.02, 2.02]})
    assert lag_table(table, FEET).loc[0, "mean_s"] == pytest.approx(-0.02)
    assert lag_table(table, FEET[::-1]).loc[0, "mean_s"] == pytest.approx(0.02)


def test_the_numbers_of_a_lag_are_those_of_its_landings():
    left = [1.000, 2.000, 3.000, 4.0, np.nan]
    right = [1.010, 1.990, 3.030, np.nan, 5.0]
    table = table_of({"left": left, "right": right}, common_s=0.003)
    table.loc[table["foot"] == "right", "common_s"] = 0.004
    (lag,) = lag_table(table, FEET).to_dict("records")
    assert tuple(lag) == LAG_COLUMNS
    assert (lag["foot"], lag["other"], lag["landings"]) == ("left", "right", 3)
    assert lag["mean_s"] == pytest.approx(-0.01)
    assert lag["sd_s"] == pytest.approx(0.02)
    assert lag["se_s"] == pytest.approx(0.02 / np.sqrt(3))
    assert lag["common_s"] == pytest.approx(0.005)
    assert lag["median_abs_s"] == pytest.approx(0.01)
    assert (lag["low_s"] + lag["high_s"]) / 2 == pytest.approx(-0.01)


@pytest.mark.parametrize(("common_s", "factor"), [(np.nan, 4.302653), (0.0, 4.302653)])
def test_the_scatter_alone_has_the_factor_of_student(common_s, factor):
    # Student's 97.5 % point of two degrees of freedom is 4.302653.
    instants = {"left": [1.0, 2.0, 3.0], "right": [1.01, 1.99, 3.03]}
    lag = lag_table(table_of(instants, common_s=common_s), FEET).iloc[0]
    half_s = (lag["high_s"] - lag["low_s"]) / 2
    assert half_s == pytest.approx(factor * lag["se_s"])
    assert np.isnan(lag["common_s"]) == np.isnan(common_s)


def test_a_lag_without_scatter_has_the_factor_of_the_normal_distribution():
    instants = {"left": [1.0, 2.0, 3.0], "right": [1.25, 2.25, 3.25]}
    lag = lag_table(table_of(instants, common_s=0.003), FEET).iloc[0]
    half_s = (lag["high_s"] - lag["low_s"]) / 2
    assert half_s == pytest.approx(1.959964 * np.hypot(0.003, 0.003))


def test_of_one_landing_there_is_a_lag_and_no_interval():
    lag = lag_table(table_of({"left": [1.0], "right": [1.02]}), FEET).iloc[0]
    assert lag["mean_s"] == pytest.approx(-0.02)
    assert lag[["se_s", "low_s", "high_s", "sd_s"]].isna().all()
    assert lag["common_s"] > 0


def test_feet_that_never_land_together_have_no_lag():
    table = table_of({"left": [1.0, np.nan], "right": [np.nan, 2.0]})
    assert lag_table(table, FEET).empty
    assert lag_table(table.head(0), FEET).empty
    assert [*lag_table(table.head(0), FEET)] == [*LAG_COLUMNS]


def test_contacts_that_cannot_be_trusted_do_not_count():
    table = table_of({"left": [1.0, 2.0], "right": [1.02, 2.9]})
    table.loc[table["contact_s"] == 2.9, "found"] = False
    lag = lag_table(table, FEET).iloc[0]
    assert lag["landings"] == 1
    assert lag["mean_s"] == pytest.approx(-0.02)


def test_landings_of_several_recordings_count_together_with_their_mean_common_error():
    instants = {"left": [1.0, 2.0], "right": [1.02, 2.04]}
    one = table_of(instants, common_s=0.001)
    other = table_of(instants, common_s=0.003, recording="b")
    lag = lag_table(pd.concat([one, other], ignore_index=True), FEET).iloc[0]
    assert lag["landings"] == 4
    assert lag["mean_s"] == pytest.approx(-0.03)
    assert lag["common_s"] == pytest.approx(np.hypot(0.002, 0.002))


def test_of_a_study_the_touchdowns_used_count():
    touchdowns = pd.DataFrame(
        {
            "recording": ["a", "a", "a", "b"],
            "touchdown": [1, 2, 3, 1],
            "contact_left_s": [1.0, 2.0, 3.0, 1.0],
            "contact_right_s": [1.01, np.nan, 3.5, 1.03],
            "common_left_s": [0.003, 0.003, 0.003, 0.006],
            "common_right_s": [0.004, 0.004, 0.004, 0.008],
            "excluded": [False, False, True, False],
        }
    )
    (lag,) = lags_of_touchdowns(touchdowns).to_dict("records")
    assert (lag["foot"], lag["other"], lag["landings"]) == ("left", "right", 2)
    assert lag["mean_s"] == pytest.approx(-0.02)
    assert lag["common_s"] == pytest.approx(np.hypot(0.0045, 0.006))
    touchdowns["excluded"] = True
    assert lags_of_touchdowns(touchdowns).empty
