"""Matching of instants: one to one, as many as possible, nearest; against brute force."""

from itertools import permutations

import numpy as np
import pandas as pd
import pytest
from synthetic_landings import POST_HEIGHT_M, PRE_HEIGHT_M, simulate

from hopdata.errors import AnalysisError
from hopdata.landings.overlay import (
    COLUMNS,
    compare_contacts,
    likely_offset,
    match_instants,
    median_interval,
    robust_sd,
    summarise_overlay,
)
from hopdata.landings.touchdowns import touchdown_table
from hopdata.recordings.external import Column, ExternalContacts


def brute_force(first, second, window_s):
    """Return the largest number of pairs and, for it, the least sum of differences."""
    best = (0, 0.0)
    padded = [*range(len(second)), *[None] * len(first)]
    for chosen in set(permutations(padded, len(first))):
        apart = [
            abs(first[i] - second[j]) for i, j in enumerate(chosen) if j is not None
        ]
        if all(d <= window_s for d in apart):
            best = min(best, (-len(apart), sum(apart)))
    return -best[0], best[1]


@pytest.mark.parametrize("seed", range(20))
def test_as_many_pairs_as_there_can_be_and_the_nearest(seed):
    rng = np.random.default_rng(seed)
    first, second = rng.uniform(0, 0.3, 4), rng.uniform(0, 0.3, 3)
    i, j = match_instants(first, second, window_s=0.05)
    assert len(set(i)) == len(set(j)) == len(i)
    apart = np.abs(first[i] - second[j])
    assert (apart <= 0.05).all()
    number, total = brute_force(first, second, 0.05)
    assert len(i) == number
    assert apart.sum() == pytest.approx(total, abs=1e-12)
    assert (np.diff(first[i]) > 0).all()


def test_long_lists_with_losses():
    rng = np.random.default_rng(1)
    true = np.cumsum(rng.uniform(0.3, 0.6, 3000))
    kept_a, kept_b = rng.random(3000) < 0.95, rng.random(3000) < 0.9
    a, b = true[kept_a], true[kept_b] + rng.normal(0, 0.002, kept_b.sum())
    i, j = match_instants(a, b, window_s=0.05)
    assert len(i) == (kept_a & kept_b).sum()
    np.testing.assert_array_equal(np.flatnonzero(kept_a)[i], np.flatnonzero(kept_b)[j])


@pytest.mark.parametrize(
    ("first", "second"), [([], []), ([1.0], []), ([], [1.0]), ([1.0], [2.0])]
)
def test_nothing_to_match(first, second):
    i, j = match_instants(np.array(first), np.array(second), window_s=0.1)
    assert len(i) == len(j) == 0


def test_the_offset_of_two_clocks_is_found():
    rng = np.random.default_rng(2)
    true = np.cumsum(rng.uniform(0.4, 0.8, 60))
    found = likely_offset(true[5:], true[:50] - 0.731, window_s=0.02)
    assert found == pytest.approx(0.731, abs=1e-9)
    assert likely_offset(true, rng.uniform(0, 30, 60), window_s=0.001) is None
    assert likely_offset(true, np.empty(0), window_s=0.02) is None


# Contacts found compared with known ones: matched, missed, invented, of another foot.

FEET = ("foot1", "foot2", "foot3")
SECTIONS = {"pre_height_m": PRE_HEIGHT_M, "post_height_m": POST_HEIGHT_M}


@pytest.fixture(scope="module")
def scene():
    return simulate(40, seed=3)


@pytest.fixture(scope="module")
def touchdowns(scene):
    return touchdown_table(scene.recording, **SECTIONS)


def known(instants, feet=("foot1",), *, span_s=None, other_feet_above_m=None):
    instants = np.sort(np.asarray(instants, float))
    span = span_s or (float(instants[0]), float(instants[-1]))
    return ExternalContacts(
        Column("switch", feet), instants, "contacts", span, other_feet_above_m
    )


def compare(scene, touchdowns, contacts, window_s=0.05):
    return compare_contacts(scene.recording, touchdowns, contacts, window_s=window_s)


@pytest.mark.parametrize("foot", range(3))
def test_each_foot_against_the_truth(scene, touchdowns, foot):
    table = compare(
        scene, touchdowns, known(scene.contact_times[:, foot], FEET[foot : foot + 1])
    )
    assert list(table.columns) == list(COLUMNS)
    assert (table["status"] == "matched").all()
    assert (table["first_foot"] == FEET[foot]).all()
    np.testing.assert_array_equal(table["touchdown"], np.arange(40) + 1)
    np.testing.assert_array_equal(
        table["found_s"], touchdowns[f"contact_{FEET[foot]}_s"]
    )
    np.testing.assert_allclose(
        table["difference_s"], table["found_s"] - scene.contact_times[:, foot]
    )
    assert table["difference_s"].abs().max() < 0.0015
    np.testing.assert_array_equal(table["se_s"], touchdowns[f"se_{FEET[foot]}_s"])


def test_feet_of_one_column_are_compared_by_their_first_contact(scene, touchdowns):
    table = compare(scene, touchdowns, known(scene.contact_times.min(axis=1), FEET))
    assert (table["status"] == "matched").all()
    assert table["difference_s"].abs().max() < 0.0015
    first = np.argmin(scene.contact_times, axis=1)
    right = table["first_foot"].to_numpy() == np.array(FEET)[first]
    assert right.mean() > 0.9
    assert set(table["feet"]) == {"foot1 foot2 foot3"}


def test_a_known_offset_is_the_difference(scene, touchdowns):
    table = compare(scene, touchdowns, known(scene.contact_times[:, 0] + 0.01))
    assert table["difference_s"].median() == pytest.approx(-0.01, abs=0.0005)


def test_a_contact_that_hopdata_lost_is_missed_with_the_reason(scene, touchdowns):
    lost = touchdowns.copy()
    lost.loc[7, ["contact_foot1_s", "se_foot1_s"]] = np.nan
    lost.loc[7, ["excluded", "reason"]] = [True, "poor fit of foot 1"]
    lost = lost.drop(index=12).reset_index(drop=True)
    table = compare(scene, lost, known(scene.contact_times[:, 0]))
    missed = table[table["status"] == "missed"]
    assert missed["touchdown"].tolist() == [8, pd.NA]
    assert missed["reason"].tolist() == [
        "poor fit of foot 1",
        "no descent through the pre section",
    ]
    np.testing.assert_array_equal(missed["external_s"], scene.contact_times[[7, 12], 0])
    assert (table["status"] == "matched").sum() == 38


def test_a_foot_that_lands_after_the_post_section_belongs_to_that_touchdown(
    scene, touchdowns
):
    late = touchdowns.copy()
    late.loc[7, ["contact_foot1_s", "se_foot1_s"]] = np.nan
    late.loc[7, ["excluded", "reason"]] = [True, "foot 1 not down by the post section"]
    instants = scene.contact_times[:, 0].copy()
    instants[7] = late.loc[7, "t_post_s"] + 0.06
    (row,) = (
        compare(scene, late, known(instants))
        .query("status == 'missed'")
        .to_dict("records")
    )
    assert (row["touchdown"], row["reason"]) == (
        8,
        "foot 1 not down by the post section",
    )


def test_a_contact_that_nobody_else_knows_is_invented(scene, touchdowns):
    instants = np.delete(scene.contact_times[:, 0], 20)
    table = compare(scene, touchdowns, known(instants))
    invented = table[table["status"] == "invented"]
    assert invented["touchdown"].tolist() == [21]
    assert invented["external_s"].isna().all()
    assert (table["status"] == "matched").sum() == 39


def test_what_lies_beyond_the_external_data_is_not_compared(scene, touchdowns):
    table = compare(scene, touchdowns, known(scene.contact_times[10:30, 0]))
    out = table[table["status"] == "not compared"]
    assert len(out) == 20
    assert set(out["reason"]) == {"outside the external data"}


def test_what_lies_beyond_the_recording_is_not_compared(scene, touchdowns):
    end = scene.recording.time[-1]
    table = compare(scene, touchdowns, known([*scene.contact_times[:, 0], end + 0.4]))
    assert table.iloc[-1]["status"] == "not compared"
    assert table.iloc[-1]["reason"] == "outside the recording"


def test_contacts_of_excluded_touchdowns_are_matched_but_never_invented(
    scene, touchdowns
):
    out = touchdowns.copy()
    out.loc[[5, 6], "excluded"] = True
    out.loc[[5, 6], "reason"] = "order ambiguous"
    table = compare(scene, out, known(np.delete(scene.contact_times[:, 0], 6)))
    five, six = (table[table["touchdown"] == i].iloc[0] for i in (6, 7))
    assert (five["status"], five["excluded"], five["reason"]) == (
        "matched",
        True,
        "order ambiguous",
    )
    assert (six["status"], six["reason"]) == ("not compared", "order ambiguous")


def test_contacts_of_feet_that_are_not_followed(scene, touchdowns):
    apexes = 0.5 * (scene.contact_times[:-1, 0] + scene.contact_times[1:, 0])
    heights = [np.interp(apexes, scene.recording.time, scene.recording.feet[:, i, 2])
               for i in range(3)]  # fmt: skip
    aloft = apexes[np.min(heights, axis=0) > 0.03]
    assert len(aloft) > 10
    both = [*scene.contact_times.min(axis=1), *aloft]
    table = compare(scene, touchdowns, known(both, FEET, other_feet_above_m=0.03))
    assert (table["status"] == "other foot").sum() == len(aloft)
    assert (table["status"] == "matched").sum() == 40
    assert len(table) == 40 + len(aloft)


def test_times_that_do_not_overlap_are_told(scene, touchdowns):
    with pytest.raises(
        AnalysisError, match=r"within the recording \(0.000 to .* found 1000.*unit"
    ):
        compare(scene, touchdowns, known(scene.contact_times[:, 0] + 1000))


def test_where_nothing_was_found_all_known_contacts_are_missed(scene, touchdowns):
    table = compare(
        scene, touchdowns.iloc[:0], known(np.sort(scene.contact_times[:, 0]))
    )
    assert set(table["status"]) == {"missed"}
    assert len(table) == 40


def test_an_offset_between_the_clocks_is_told(scene, touchdowns):
    shifted = known(np.sort(scene.contact_times[:, 0]) + 0.1503)
    with pytest.raises(
        AnalysisError, match=r"found none among 40 and 40.*larger by -0.150"
    ):
        compare(scene, touchdowns, shifted, window_s=0.02)


# Counts, bias, interval and scatter of an overlay.


def overlay(difference, *, recording="a", column="Fz", se=0.001, external_se=np.nan):
    n = len(difference)
    return pd.DataFrame(
        {
            "recording": recording,
            "source": "forces",
            "column": column,
            "feet": "heel toe",
            "status": "matched",
            "external_s": np.arange(n, dtype=float),
            "external_se_s": external_se,
            "found_s": np.arange(n) + difference,
            "se_s": se,
            "difference_s": difference,
            "first_foot": ["heel", "toe"] * (n // 2) + ["toe"] * (n % 2),
            "touchdown": pd.array(range(1, n + 1), dtype="Int64"),
            "excluded": False,
            "reason": "",
        }
    )


def test_the_error_of_the_other_device_counts():
    """A plate that is as bad as the cameras explains scatter of root two."""
    draw = np.random.default_rng(5).normal(0.0, 0.001 * np.sqrt(2), 2000)
    (alone,) = summarise_overlay(overlay(draw)).to_dict("records")
    (both,) = summarise_overlay(overlay(draw, external_se=0.001)).to_dict("records")
    assert alone["scatter_over_se"] == pytest.approx(np.sqrt(2), rel=0.06)
    assert both["scatter_over_se"] == pytest.approx(1.0, rel=0.06)
    assert np.isnan(alone["external_se_s"])
    assert both["external_se_s"] == 0.001


def test_counts_by_status():
    table = overlay(np.zeros(9))
    table["status"] = (
        ["matched"] * 3
        + ["missed"] * 2
        + ["invented", "other foot"]
        + ["not compared"] * 2
    )
    table.loc[1, "excluded"] = True
    (row,) = summarise_overlay(table).to_dict("records")
    counts = {
        key: row[f"n_{key}"] for key in ("external", "matched", "excluded", "missed")
    }
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


@pytest.mark.parametrize("seed", range(5))
def test_clocks_that_run_apart_are_told_from_those_that_do_not(seed):
    rng = np.random.default_rng(seed)
    sound = rng.normal(0.003, 0.001, 120)
    sound[rng.integers(0, 30, 4)] += (
        0.03  # a few that are wrong, early in the recording
    )
    assert summarise_overlay(overlay(sound))["drift_s"][0] == 0.0
    apart = sound - 50e-6 * np.arange(120)  # 50 ppm over 119 s
    assert summarise_overlay(overlay(apart))["drift_s"][0] == pytest.approx(
        -0.006, abs=5e-4
    )
    assert np.isnan(summarise_overlay(overlay(apart[:9]))["drift_s"][0])


def test_the_interval_covers_the_median_as_often_as_it_says():
    rng = np.random.default_rng(5)
    draws = rng.exponential(1.0, (2000, 38))
    inside = [low <= np.log(2) <= high for low, high in map(median_interval, draws)]
    assert (
        0.94 <= np.mean(inside) <= 0.985
    )  # order statistics are discrete: 0.95 at least


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
    both = pd.concat(
        [overlay(np.full(8, 0.001)), overlay(np.full(6, 0.002), recording="b")]
    )
    table = summarise_overlay(pd.concat([both, overlay(np.zeros(6), column="Fy")]))
    assert table[["recording", "column", "n_matched"]].to_numpy().tolist() == [
        ["a", "Fz", 8],
        ["b", "Fz", 6],
        ["a", "Fy", 6],
        ["all", "Fz", 14],
    ]
