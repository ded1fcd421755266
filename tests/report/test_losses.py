"""Landings that were lost for how they came down."""

import numpy as np
import pandas as pd
import pytest
from fake_study import full_study, no_answer, verdict
from test_page import Page

from hopdata.report.losses import WORTH_SAYING, lost_for_how_they_came_down
from hopdata.report.page import build_report

LATE = "heel not down by the post section"
ORDERS = ("1>2>3", "2>1>3", "3>2>1")


def study(n_lost, reason=LATE, n=300, order="2>1>3"):
    """Return the touchdowns of a study that lost its last landings for one reason."""
    lost = np.arange(n) >= n - n_lost
    feet = {f"contact_{foot}_s": 0.1 for foot in ("toe", "heel", "thumb")}
    return pd.DataFrame(
        {
            "recording": "hops",
            "touchdown": np.arange(n) + 1,
            "schedule": np.where(lost, order, np.resize(ORDERS, n)),
            "order_class": np.where(lost, order, np.resize(ORDERS, n)),
            "probability": 1.0,
            "spread_s": np.where(lost, 0.025, 0.012),
            "excluded": lost,
            "reason": np.where(lost, reason, ""),
            "t_pre_s": 0.5 * np.arange(n),
            "t_post_s": 0.5 * np.arange(n) + 0.2,
        }
    ).assign(**feet)


def said(touchdowns, **changes):
    lost = lost_for_how_they_came_down(touchdowns, verdict(**changes))
    return "" if lost is None else str(lost).replace("\u00a0", " ")


def test_late_feet_are_told_with_their_order_and_how_far_apart_they_touch():
    words = said(study(60), contacts_r2=0.994)
    assert words.startswith(
        "Landings left out for how they came down: 60 of 300, above"
    )
    assert "all in the order heel → toe → thumb (60 of its 140)." in words
    assert "contacts spread by 25 ms, those of the used ones by 12 ms" in words
    assert "99.4 % of how far apart the feet touch is foretold" in words
    page = Page(build_report(full_study(touchdowns=study(60))))
    shown = page.text.replace("\u00a0", " ")
    assert shown.count("Landings left out for how they came down: 60 of 300") == 1


def test_the_reasons_may_name_feet_or_number_them():
    assert said(study(60, "foot 2 not down by the post section"))
    assert said(study(60, "toe down before the pre section"))
    assert said(study(60, "post section never reached"))


@pytest.mark.parametrize(
    "reason",
    [
        "frames missing at the contact of heel",
        "too few frames of the body markers",
        "no foot of the study landed",
        "by hand: heel not down by the post section",
    ],
)
def test_what_was_not_measured_well_says_nothing_about_the_landing(reason):
    assert said(study(60, reason)) == ""


def test_few_lost_landings_are_not_worth_a_note():
    few = round(WORTH_SAYING * 300)
    assert said(study(few))
    assert said(study(few - 1)) == ""
    assert said(study(0)) == ""


def test_without_a_size_there_is_nothing_to_bias():
    assert lost_for_how_they_came_down(study(60), no_answer()) is None
    assert lost_for_how_they_came_down(None, verdict()) is None


def test_what_is_not_known_of_the_lost_is_left_out():
    unknown = study(60)
    unknown.loc[unknown["excluded"], ["schedule", "spread_s"]] = ["", np.nan]
    words = said(unknown, contacts_r2=None)
    assert words.startswith(
        "Landings left out for how they came down: 60 of 300. Sizes"
    )
    for absent in ("order", "spread by", "foretold"):
        assert absent not in words
