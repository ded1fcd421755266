"""Tables and section of the contacts known from elsewhere."""

import numpy as np
import pandas as pd

from hopdata.report.inputs import ReportInputs
from hopdata.report.overlay_tables import agreement_table, thresholds_table, unmatched_table
from hopdata.report.page import build_report

SUMMARY = pd.DataFrame(
    {
        "recording": ["run"], "source": ["forces"], "column": ["Fz"], "feet": ["heel toe"],
        "first_feet": ["toe 39"], "n_external": [39], "n_matched": [38], "n_excluded": [1],
        "n_missed": [1], "n_invented": [0], "n_other_foot": [40], "n_not_compared": [2],
        "bias_s": [-0.00331], "bias_low_s": [-0.004], "bias_high_s": [-0.002],
        "robust_sd_s": [0.00099], "sd_s": [0.0016], "largest_s": [0.0068],
        "scatter_over_se": [1.25],
    }
)  # fmt: skip
CONTACTS = pd.DataFrame(
    {
        "recording": "run",
        "column": "Fz",
        "status": ["matched", "missed", "missed", "invented"],
        "external_s": [1.0, 2.0, 3.0, np.nan],
        "found_s": [1.0, np.nan, np.nan, 4.0],
        "index": [0, np.nan, 2, 3],
        "reason": ["", "no descent through the pre section", "poor fit of foot 1", ""],
    }
)
THRESHOLDS = pd.DataFrame(
    {
        "recording": "run", "column": "Fz", "threshold": [0.05, 0.1], "unit": "body_weight",
        "n_matched": [39, 38], "n_missed": [0, 1], "n_invented": 0, "bias_s": [0.003, np.nan],
        "robust_sd_s": [0.001, np.nan],
    }
)  # fmt: skip
OVERLAY = {
    "contact_overlay_summary": SUMMARY,
    "contact_overlay": CONTACTS,
    "contact_overlay_thresholds": THRESHOLDS,
}


def test_agreement_in_milliseconds():
    table = agreement_table(OVERLAY)
    row = dict(zip(table.head, table.rows[0], strict=True))
    assert row["bias (ms)"] == "−3.31"
    assert row["95 % interval (ms)"] == "−4.00 to −2.00"
    assert row["robust sd (ms)"] == "0.99"
    assert (row["known"], row["matched"], row["missed"], row["of other feet"]) == (
        "39",
        "38",
        "1",
        "40",
    )


def test_every_missed_and_invented_contact_is_listed_with_its_reason():
    table = unmatched_table(OVERLAY)
    assert [row[2:] for row in table.rows] == [
        ("missed", "—", "no descent through the pre section", "2.000"),
        ("missed", "2", "poor fit of foot 1", "3.000"),
        ("invented", "3", "—", "4.000"),
    ]


def test_a_long_list_is_cut_and_said():
    many = pd.concat([CONTACTS.iloc[[1]]] * 70, ignore_index=True)
    table = unmatched_table({"contact_overlay": many})
    assert len(table.rows) == 60
    assert table.note == "10 more stand in contact_overlay.csv."


def test_thresholds_and_a_missing_value():
    rows = thresholds_table(OVERLAY).rows
    assert rows[0][2:] == ("0.05", "body weights", "0", "0", "3.00", "1.00")
    assert rows[1][-1] == "—"
    assert thresholds_table({}) is None


def test_the_section_stands_only_where_something_is_known():
    page = build_report(ReportInputs("plate", overlay=OVERLAY))
    assert 'id="overlay"' in page
    assert 'href="#overlay"' in page
    assert "poor fit of foot 1" in page
    assert "overlay" not in build_report(ReportInputs("plate")).split("<body>")[1]


def test_nothing_missed_is_said():
    page = build_report(
        ReportInputs("plate", overlay={**OVERLAY, "contact_overlay": CONTACTS.iloc[:1]})
    )
    assert "No landing was missed or invented." in page
