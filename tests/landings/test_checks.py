"""The checks pass on good data, and each fails on data with its own fault."""

import re

import numpy as np
import pandas as pd
import pytest

from hopdata.landings.checks import (
    GOOD,
    LOOK,
    NOT_ASKED,
    POOR,
    UNKNOWN,
    blurred,
    check_study,
)
from hopdata.landings.contacts.altered import FILTER_DELAYS
from hopdata.landings.exclusion import POST_NEVER_REACHED
from hopdata.messages import Message

TOO_LATE = Message(POST_NEVER_REACHED).text()
WHAT = {
    "seen": "frames seen, worst marker",
    "faults": "swaps, spikes, jumps, frozen, time",
    "noise": "noise of a coordinate over expected",
    "used": "touchdowns used",
    "error": "error of a contact over the spread",
    "order": "orders less sure than 0.9",
    "sections": "sections move, over their distance",
    "drift": "drift, in spreads",
}


@pytest.fixture
def tables():
    markers = pd.DataFrame(
        {
            "recording": "r",
            "marker": ["b1", "f1", "boom"],
            "role": ["body", "foot", "boom"],
            "frames": 1000,
            "missing": [0, 2, 900],
            "longest_s": [0.0, 0.02, 9.0],
            "noise_m": [6e-4, 6.1e-4, 6e-4],
        }
    )
    faults = pd.DataFrame({"kind": []}, dtype=object)
    touchdowns = pd.DataFrame(
        {
            "recording": "r",
            "t_pre_s": np.arange(10.0),
            "contact_f1_s": np.arange(10.0) + 0.02,
            "contact_f2_s": np.arange(10.0) + 0.03,
            "se_f1_s": [3e-4] * 10,
            "se_f2_s": [3e-4] * 10,
            "spread_s": [0.01] * 10,
            "method": ["kink"] * 10,
            "schedule": ["1>2"] * 10,
            "probability": [1.0] * 10,
            "order_class": ["1>2"] * 10,
            "excluded": [False] * 9 + [True],
            "reason": [""] * 9 + [TOO_LATE],
        }
    )
    stability = pd.DataFrame(
        {
            "variant": ["all data", "half"],
            "pre_height_m": [0.5, 0.502],
            "post_height_m": [0.3, 0.299],
            "note": ["", ""],
        }
    )
    drift = pd.DataFrame(
        {
            "quantity": "contact spread",
            "part": ["a", "b"],
            "median_of_part": [1.0, 1.1],
            "typical": 1.05,
            "se": 0.1,
            "deviation": [-0.05, 0.05],
        }
    )
    return {
        "markers": markers,
        "faults": faults,
        "touchdowns": touchdowns,
        "stability": stability,
        "drift": drift,
    }


def judged(tables, noise_m=6e-4, **options):
    return {
        c.what: c for c in check_study(**tables, expected_noise_m=noise_m, **options)
    }


def test_flights_that_are_continued_to_the_section_are_counted(tables):
    assert "continued" not in judged(tables)[WHAT["used"]].remark
    tables["touchdowns"].loc[[1, 2, 9], "contact_f2_s"] = [
        0.996,
        1.992,
        8.9,
    ]  # row 9 is excluded
    told = "in 2 the flight is continued to the pre section, by 8 ms at most"
    assert told in judged(tables)[WHAT["used"]].remark


def test_what_is_known_of_contacts_is_told_beside_their_errors(tables):
    values = {"foot": "f2", "landings": 7, "often": "7 landings", "ms": 2.5}
    bounces = Message("landings.foot_bounces", values)
    plain = judged(tables)
    told = judged(tables, contact_remarks=[bounces])
    errors = WHAT["error"]
    assert told[errors].remark == f"{plain[errors].remark}; {bounces}"
    assert "f2 bounces off the floor at once (7 landings)" in str(bounces)
    for what, check in plain.items():
        assert told[what].status == check.status
        if what != errors:
            assert told[what].remark == check.remark


def test_the_same_of_several_feet_is_told_once(tables):
    values = {"landings": 7, "often": "7 landings", "ms": 2.5}
    both = [
        Message("landings.foot_bounces", {**values, "foot": foot})
        for foot in ("f1", "f2")
    ]
    remark = judged(tables, contact_remarks=both)[WHAT["error"]].remark
    assert remark.count("bounce off the floor at once") == 1
    assert "f1 (7 landings" in remark
    assert "f2 (7 landings" in remark


def test_good_data_are_good(tables):
    found = judged(tables)
    assert list(found) == list(WHAT.values())
    assert {c.status for c in found.values()} == {GOOD}
    assert found[WHAT["seen"]].value == pytest.approx(99.8)  # the boom does not count
    assert found[WHAT["sections"]].value == pytest.approx(1.0)
    assert re.match(r"(pre|post), by \d", found[WHAT["sections"]].remark)
    assert f"{TOO_LATE} (1)" in found[WHAT["used"]].remark


@pytest.mark.parametrize(
    ("name", "table", "column", "value", "status"),
    [
        ("seen", "markers", "missing", 30, LOOK),
        ("seen", "markers", "missing", 200, POOR),
        ("noise", "markers", "noise_m", 1.2e-3, LOOK),
        ("noise", "markers", "noise_m", 2.4e-3, POOR),
        ("noise", "markers", "noise_m", np.nan, UNKNOWN),
        ("used", "touchdowns", "excluded", True, POOR),
        ("error", "touchdowns", "se_f1_s", 0.002, LOOK),
        ("order", "touchdowns", "probability", 0.8, POOR),
        ("sections", "stability", "post_height_m", [0.3, 0.32], LOOK),
        ("sections", "stability", "pre_height_m", [0.5, 0.6], POOR),
        ("drift", "drift", "deviation", [0.9, 0.1], GOOD),  # within its errors
    ],
)
def test_each_fault_is_seen_by_its_own_check(
    tables, name, table, column, value, status
):
    tables[table][column] = value
    found = judged(tables)
    assert found[WHAT[name]].status == status


def test_the_worst_foot_is_not_hidden_by_the_others(tables):
    tables["touchdowns"] = tables["touchdowns"].assign(se_f3_s=2.0)
    found = judged(tables)[WHAT["error"]]
    assert found.status == POOR
    assert found.remark.endswith("worst foot f3")


@pytest.mark.parametrize(
    ("method", "told"),
    [
        ("kink", ""),
        ("velocity_minimum", "only the rounding to a frame counts in these errors"),
        (
            "velocity_minimum_parabola",
            "only the noise of the heights counts in these errors",
        ),
    ],
)
def test_errors_say_what_their_method_leaves_out_and_kinks_are_for_the_kink_fit(
    tables, method, told
):
    """At 50 Hz the rounding to a frame alone is an error of 5.8 ms."""
    tables["touchdowns"] = tables["touchdowns"].assign(
        method=method, se_f1_s=5.8e-3, se_f2_s=5.8e-3, probability=0.7
    )
    found = judged(tables)
    assert found[WHAT["error"]].remark.endswith(told or "worst foot f1")
    assert ("without a kink" in found[WHAT["order"]].remark) == (method == "kink")


def test_the_commonest_reason_names_the_foot_as_the_recording_does(tables):
    landed = [*[""] * 7, *["poor fit of foot 2"] * 3]
    tables["touchdowns"] = tables["touchdowns"].assign(
        reason=landed, excluded=[bool(r) for r in landed]
    )
    assert judged(tables)[WHAT["used"]].remark.endswith(
        "most often: poor fit of f2 (3)"
    )


@pytest.mark.parametrize(
    ("error_s", "told"),
    [
        (
            3e-4,
            "; in 10 of 10, f2 and f3 land as close together as their errors of 0.3 ms",
        ),
        (
            2e-2,
            "; in 10 of 10, f2 and f3 are least sure: f3 slows without a kink (error 20 ms)",
        ),
    ],
)
def test_the_feet_of_a_doubtful_order_are_those_that_land_together(
    tables, error_s, told
):
    tables["touchdowns"] = tables["touchdowns"].assign(
        contact_f3_s=tables["touchdowns"]["contact_f2_s"] + 1e-4,
        se_f1_s=4e-4,  # less certain than the two, and certainly first
        se_f3_s=error_s,
        probability=0.6,
        excluded=False,
    )
    assert judged(tables)[WHAT["order"]].remark == f"of the touchdowns used{told}"


def test_drift_beyond_its_errors_is_named(tables):
    tables["drift"] = tables["drift"].assign(
        median_of_part=[1.0, 2.0], deviation=[-0.05, 0.9]
    )
    found = judged(tables)[WHAT["drift"]]
    assert (found.status, found.value) == (LOOK, 0.9)
    assert found.remark == "contact spread in b"


def test_faults_are_counted_by_kind(tables):
    rows = [
        ("swap", "a", 1.0),
        ("swap", "b", 1.0),
        ("swap", "a", 7.0),
        ("swap", "b", 7.0),
    ]
    rows += [("spike", "b", 1.0)]  # a swap has one row per marker
    faults = pd.DataFrame(rows, columns=["kind", "marker", "start_s"])
    tables["faults"] = faults.assign(recording="r")
    found = judged(tables)[WHAT["faults"]]
    assert (found.status, found.value) == (LOOK, 3.0)
    assert found.remark == (
        "2 swaps, 1 spike: 3 at a contact (within 50 ms), 0 between contacts; first "
        "a and b at 1.00 s, a and b at 7.00 s, b at 1.00 s"
    )
    later = judged(tables, starts_s={"r": 0.5})[WHAT["faults"]]
    assert "0 at a contact (within 50 ms), 3 between" in later.remark


@pytest.mark.parametrize(("marker", "told"), [("b1", True), ("f1", False)])
def test_descents_that_nobody_could_see_are_not_passed_over(tables, marker, told):
    away = tables["markers"]["marker"] == marker
    tables["markers"] = tables["markers"].assign(
        missing=np.where(away, 500, 0), longest_s=np.where(away, 5.0, 0.5)
    )
    remark = judged(tables)[WHAT["used"]].remark
    assert remark.startswith("9 of 10")
    assert ("b1 (missing in 50 % of r)" in remark) == told
    tables["touchdowns"] = tables["touchdowns"].head(0)
    assert ("b1 (missing in 50 % of r)" in judged(tables)[WHAT["used"]].remark) == told


def test_without_an_expected_noise_the_found_one_is_shown(tables):
    found = judged(tables, noise_m=None)[WHAT["noise"]]
    assert (
        found.status == NOT_ASKED
    )  # not unknown: the light of the recordings can be lit
    assert "0.6 mm found" in found.remark
    assert "report.expected_noise_m" in found.remark


def test_a_study_without_touchdowns_has_no_good_landings(tables):
    tables["touchdowns"] = tables["touchdowns"].head(0)
    tables["drift"] = tables["drift"].head(0)
    found = judged(tables)
    for name in ("used", "error", "order", "drift"):
        assert found[WHAT[name]].status == UNKNOWN


@pytest.mark.parametrize(
    ("other_feet", "value", "status"), [(False, 40.0, POOR), (True, 80.0, GOOD)]
)
def test_landings_of_feet_that_are_not_followed_do_not_count(
    tables, other_feet, value, status
):
    landed = ["", "", "", "", TOO_LATE]
    tables["touchdowns"]["reason"] = landed + ["no foot of the study landed"] * 5
    tables["touchdowns"]["excluded"] = tables["touchdowns"]["reason"] != ""
    found = judged(tables, other_feet=other_feet)[WHAT["used"]]
    assert (found.value, found.status) == (value, status)
    assert ("5 more descents, of other feet" in found.remark) == other_feet


@pytest.mark.parametrize("by_hand", [3, 10])
def test_landings_left_out_by_hand_do_not_count(tables, by_hand):
    reasons = ["by hand: tripped"] * by_hand + [TOO_LATE, *[""] * 9]
    tables["touchdowns"]["reason"] = reasons[:10]
    tables["touchdowns"]["excluded"] = tables["touchdowns"]["reason"] != ""
    found = judged(tables)[WHAT["used"]]
    expected = None if by_hand == 10 else pytest.approx(600 / 7)
    assert found.value == expected
    assert f"; not counted: {by_hand} left out by hand" in found.remark


def test_no_landing_of_any_followed_foot_is_poor(tables):
    tables["touchdowns"] = tables["touchdowns"].assign(
        excluded=True, reason="no foot of the study landed"
    )
    found = judged(tables, other_feet=True)[WHAT["used"]]
    assert (found.value, found.status) == (0.0, POOR)


def test_a_filter_blurs_where_half_its_period_is_longer_than_a_landing(tables):
    touchdowns = tables["touchdowns"].assign(
        recording="r", common_f1_s=1e-4, common_f2_s=2e-4
    )
    touchdowns["t_post_s"] = touchdowns["t_pre_s"] + 0.05
    assert blurred(touchdowns) == ""
    late_s = FILTER_DELAYS / np.array([11.0, 9.0])  # a half period of 45 and of 56 ms
    assert blurred(touchdowns.assign(common_f2_s=late_s[0])) == ""
    other = touchdowns.assign(recording="filtered", common_f2_s=late_s[1])
    assert "'filtered' is smoothed as by a low-pass of some 9 Hz" in blurred(other)
    assert blurred(pd.concat([touchdowns, other])) == blurred(other)
    assert blurred(other.assign(excluded=True)) == ""
