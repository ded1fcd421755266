"""The rates that pages and methods paragraphs state are those of the campaign's table."""

import re
from pathlib import Path

import pandas as pd
import pytest
from statsmodels.stats.proportion import proportion_confint

from hopdata.report.verdict import measured

DOCS = Path(__file__).parents[2] / "docs"
PAGE = DOCS.joinpath("verdict_campaign.md").read_text("utf-8")
RATES = re.compile(r"([\d,]*\d) of ([\d,]*\d)")
MECHANISM = re.compile(r"^\| `(\w+)` \|[^|]*\| ([^|]+) \|$", flags=re.M)


def number(text):
    return int(text.replace(",", ""))


def rates_in(text):
    return {tuple(number(one) for one in rate) for rate in RATES.findall(text)}


def cells(mechanisms):
    """Return the cells of these mechanisms, with counts in place of shares.

    `different`, and of the studies with a number: `known`, `intervals` that hold,
    `endless` ones without an upper end, `bounded` ones with a bound, and `bounds` that
    hold.
    """
    table = pd.read_csv(DOCS / "verdict_campaign.csv")
    table = table[table["mechanism"].isin(mechanisms)]
    judged = table["studies"] - table["failed"]
    known = judged - table["without_number"]
    endless = (known * table["saturates"].fillna(0.0)).round()
    bounded = known - endless
    counts = {
        "different": judged * table["called_different"],
        "known": known,
        "endless": endless,
        "intervals": known * table["interval_holds"].fillna(0.0),
        "bounded": bounded,
        "bounds": bounded * table["bound_holds"].fillna(0.0),
    }
    return {name: int(column.round().sum()) for name, column in counts.items()}


def mechanisms(difference):
    """Return the mechanisms whose difference the page describes so."""
    return [name for name, kind in MECHANISM.findall(PAGE) if kind == difference]


def lasting():
    """Return those without a difference that fades or grows."""
    return [name for kind in ("none", "kink", "jump") for name in mechanisms(kind)]


def test_false_alarms_are_of_studies_with_a_number():
    smooth = cells(["c1"])
    assert (smooth["different"], smooth["known"]) in rates_in(str(measured()))


def test_bounds_and_intervals_are_those_of_differences_that_last():
    found = cells(lasting())
    told = rates_in(str(measured()))
    assert (found["bounds"], found["bounded"]) in told
    assert (found["intervals"], found["known"]) in told
    assert found["bounded"] + found["endless"] == found["known"]
    assert f"{found['endless']} had no upper end" in str(measured())
    assert "fades or grows with the time between contacts" in str(measured())


def test_the_page_tells_apart_what_fades_and_what_grows():
    assert mechanisms("kink that grows") == ["side", "twist"]
    assert mechanisms("kink that saturates") == ["friction", "stick", "sated", "decay"]
    assert "c1" in lasting()
    growing = cells(["side", "twist"])
    assert (growing["bounds"], growing["bounded"]) in rates_in(PAGE)
    for name in ("side", "twist"):
        found = cells([name])
        assert f"{found['intervals']} of {found['known']} `{name}`" in PAGE


def test_all_rates_stand_on_the_page_of_the_campaign():
    told = rates_in(str(measured()))
    assert len(told) == 3
    assert told <= rates_in(PAGE)
    for page in ("reporting.md", "verdict.md"):
        (stated,) = re.findall(
            r".*2 of 1,150.*", DOCS.joinpath(page).read_text("utf-8")
        )
        assert rates_in(stated) <= told


def test_the_range_of_a_share_is_that_of_wilson():
    stated = re.search(r"(\d+) of (\d+) means (\d+) to 100 %", PAGE)
    hits, studies, low = stated.groups()
    found, _ = proportion_confint(int(hits), int(studies), method="wilson")
    assert int(low) == round(100 * found)
    one_sided = 0.05 ** (1 / 22)
    assert int(low) != round(100 * one_sided)
    table = pd.read_csv(DOCS / "verdict_campaign_detectable.csv").dropna()
    for row in table.itertuples():
        count = round(row.found_share * row.studies)
        low, high = proportion_confint(count, row.studies, method="wilson")
        assert (row.found_low, row.found_high) == pytest.approx((low, high), abs=6e-4)
