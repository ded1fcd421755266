"""The rates that pages and methods paragraphs state are those of the campaign's page."""

import re
from pathlib import Path

import pandas as pd

from hopdata.report.verdict import measured

DOCS = Path(__file__).parents[2] / "docs"
RATES = re.compile(r"([\d,]*\d) of ([\d,]*\d)")


def rates_in(text):
    return {
        tuple(int(one.replace(",", "")) for one in rate) for rate in RATES.findall(text)
    }


def test_false_alarms_are_those_of_the_table():
    table = pd.read_csv(DOCS / "verdict_campaign.csv")
    smooth = table[table["mechanism"] == "c1"]
    studies = int(smooth["studies"].sum())
    different = round((smooth["studies"] * smooth["called_different"]).sum())
    assert (different, studies) in rates_in(str(measured()))


def test_all_rates_stand_on_the_page_of_the_campaign():
    found = DOCS.joinpath("verdict_campaign.md").read_text("utf-8")
    told = rates_in(str(measured()))
    assert len(told) == 3
    assert told <= rates_in(found)
    for page in ("reporting.md", "verdict.md"):
        (stated,) = re.findall(
            r".*2 of 1,172.*", DOCS.joinpath(page).read_text("utf-8")
        )
        assert rates_in(stated) <= told
