from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest
from fake_study import distances, floors, prediction, sections, touchdowns, truth

from hopdata.report import tables
from hopdata.report.formatting import Table, mapping_table
from hopdata.report.inputs import ReportFigure, ReportInputs, picture_of, rendered
from hopdata.report.page import build_report
from hopdata.report.tables import (
    agreement_table,
    own_devices_table,
    quality_table,
    thresholds_table,
    unmatched_table,
)

SVG = b'<svg width="300.5pt" height="20pt"></svg>'


def picture(svg, caption=""):
    return picture_of(ReportFigure("seen", svg, "image/svg+xml", caption), {})


def page(**changes):
    parts = {
        "title": "mon<day>.tsv",
        "answer": "Nothing wrong.",
        "highlights": [("Rate", "100 Hz", "0 frames dropped")],
        "notes": [],
        "version": "0.1.0",
        "markers": [],
        "span": (),
        "pictures": [picture(SVG, "# Where each marker was seen\n\nOne bar a marker.")],
        "tables": [Table("Markers", ("marker", "gaps"), (("hip & toe", "3"),))],
    }
    return rendered("inspection.html.j2", **{**parts, **changes})


class Tags(HTMLParser):
    def __init__(self):
        super().__init__()
        self.opened, self.found = [], []

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))
        if tag not in ("meta", "img"):
            self.opened.append(tag)

    def handle_endtag(self, tag):
        assert self.opened.pop() == tag


def test_the_page_is_whole_and_loads_nothing():
    tags = Tags()
    tags.feed(page())
    assert tags.opened == []
    sources = [attrs["src"] for tag, attrs in tags.found if tag == "img"]
    assert sources == [picture(SVG).source]
    assert sources[0].startswith("data:image/svg+xml;base64,")
    links = [attrs["href"] for _, attrs in tags.found if "href" in attrs]
    assert links == ["#content"]


def test_text_from_the_file_is_escaped():
    text = page(notes=["<script>"])
    assert "<script>" not in text
    assert "mon&lt;day&gt;.tsv" in text
    assert "hip &amp; toe" in text


def test_the_picture_s_width_is_that_of_the_svg():
    assert picture(SVG).width_pt == 300.5
    assert picture(b"<svg></svg>").width_pt == 496.0


# Tables and section of contacts from other sources.

SUMMARY = pd.DataFrame(
    {
        "recording": ["run"], "source": ["forces"], "column": ["Fz"], "feet": ["heel toe"],
        "first_feet": ["toe 39"], "n_external": [39], "n_matched": [38], "n_excluded": [1],
        "n_missed": [1], "n_invented": [0], "n_other_foot": [40], "n_not_compared": [2],
        "bias_s": [-0.00331], "bias_low_s": [-0.004], "bias_high_s": [-0.002], "drift_s": [0.0],
        "robust_sd_s": [0.00099], "sd_s": [0.0016], "largest_s": [0.0068],
        "scatter_over_se": [1.25], "external_se_s": [0.00051],
    }
)  # fmt: skip
CONTACTS = pd.DataFrame(
    {
        "recording": "run",
        "column": "Fz",
        "status": ["matched", "missed", "missed", "invented"],
        "external_s": [1.0, 2.0, 3.0, np.nan],
        "found_s": [1.0, np.nan, np.nan, 4.0],
        "touchdown": [0, np.nan, 2, 3],
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


def test_notes_on_plates_are_listed():
    notes = pd.DataFrame(
        {
            "recording": ["run"],
            "code": ["landings.plate_shared"],
            "note": ["plate 1: two"],
        }
    )
    table = own_devices_table({"contact_overlay_notes": notes})
    assert table.rows == (("run", "plate 1: two"),)
    assert own_devices_table({"contact_overlay_notes": notes[:0]}) is None
    assert own_devices_table({}) is None


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
    assert str(table.note) == "10 more in tables/contact_overlay.csv."


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


def column(table, name):
    return [row[table.head.index(name)] for row in table.rows]


def assert_rectangular(table):
    assert table.rows
    assert {len(row) for row in table.rows} == {len(table.head)}


def test_every_table_is_rectangular_and_all_text():
    made = [
        tables.recordings_table([{"name": "a"}]),
        tables.floor_table(floors()),
        tables.sections_table(sections()),
        tables.schedules_table(touchdowns()),
        tables.exclusions_table(touchdowns()),
        tables.prediction_table(prediction()),
        tables.distances_table(distances()),
        tables.truth_table(truth()),
        tables.times_table({"level": 1.0}),
        mapping_table("t", ("a", "b"), {"x": 1, "y": {"z": 2}}),
    ]
    for table in made:
        assert_rectangular(table)
        assert all(isinstance(cell, str) for row in table.rows for cell in row)


@pytest.mark.parametrize("n_feet", [2, 3, 4])
def test_schedules_are_counted_commonest_first(n_feet):
    data = touchdowns(n_feet=n_feet)
    table = tables.schedules_table(data)
    counts = [int(cell) for cell in column(table, "touchdowns")]
    used = data[~data["excluded"]]
    assert counts == sorted(used["schedule"].value_counts().tolist(), reverse=True)[:24]
    assert len(table.rows) == min(used["schedule"].nunique(), 24)


def test_rare_schedules_beyond_the_list_are_mentioned():
    data = touchdowns(3000, n_feet=5)
    table = tables.schedules_table(data)
    assert len(table.rows) == 24
    counts = data.loc[~data["excluded"], "schedule"].value_counts().to_numpy()
    left = f"{counts[24:].sum()} touchdowns, at most {counts[24]} each."
    assert str(table.note) == f"Not listed: {len(counts) - 24} rarer orders, {left}"
    assert len(counts) > 100


def test_exclusions_by_reason_and_recording():
    data = touchdowns(recordings=("a", "b"))
    table = tables.exclusions_table(data)
    assert table.head == ("reason", "a", "b", "descents")
    assert table.rows[-1][0] == "all reasons"
    for row in table.rows:
        assert int(row[1]) + int(row[2]) == int(row[3])
    assert int(table.rows[-1][3]) == data["excluded"].sum()


def test_reasons_name_the_feet():
    data = touchdowns().assign(contact_toe_s=0.0, contact_heel_s=0.0)
    rows = tables.exclusions_table(data).rows[:-1]
    assert {row[0] for row in rows} == {
        "heel down before the pre section",
        "toe not down at the post section",
    }
    listed = tables.excluded_table(data).rows
    assert all(row[1].startswith(("toe ", "heel ")) for row in listed)


def test_descents_in_which_no_foot_of_the_study_landed_are_only_counted():
    data = touchdowns().assign(touchdown=range(len(touchdowns())))
    out = data[data["excluded"]].index
    data.loc[out[::2], "reason"] = tables.NO_FOOT_LANDED
    table = tables.excluded_table(data)
    assert [row[2] for row in table.rows] == [str(k) for k in out[1::2]]
    assert f"{len(out[::2])} descents, in which no foot of the study" in str(table.note)
    rows = tables.exclusions_table(data).rows
    assert (tables.NO_FOOT_LANDED, str(len(out[::2]))) in rows
    data.loc[out, "reason"] = tables.NO_FOOT_LANDED
    assert tables.excluded_table(data) is None


def test_one_recording_needs_no_columns_of_its_own_and_a_lost_reason_is_said():
    data = touchdowns().assign(reason=np.nan)
    table = tables.exclusions_table(data)
    assert table.head == ("reason", "descents")
    assert table.rows[0][0] == "no reason given"
    assert tables.exclusions_table(data[~data["excluded"]]) is None


def test_sections_begin_with_what_matters_and_keep_the_rest():
    table = tables.sections_table(sections())
    rows = {row[0]: row[1:] for row in table.rows}
    assert rows["travel from pre to post"] == ("210.80", "mm")
    assert rows["ground mode of the minimum foot height"] == ("−0.2", "mm")
    assert rows["its scatter"] == ("0.54", "mm")
    assert rows["kind of frames pooled"] == ("all", "")
    assert rows["how the sections are chosen"] == ("landings", "")
    assert rows["speed of the fall at the post section"] == ("1.43", "m/s")
    each = "time per mm of height, post section"
    assert rows[each] == ("0.70", "ms")
    assert rows["its 95 % quantile, post section"] == ("0.81", "ms")
    assert "its 95 % quantile, pre section" not in rows
    assert rows["place chosen between them, 0 to 1"] == ("0.15", "")
    assert rows["pre section by the other rule"] == ("509", "mm")
    assert [table.kind(i) for i in range(3)] == ["text", "number", "unit"]


def test_a_height_from_the_configuration_is_marked():
    decided = {"pre_height_m": "config", "post_height_m": "data"}
    names = column(
        tables.sections_table(sections() | {"chosen_by": decided}), "quantity"
    )
    assert "pre section (from the configuration)" in names
    assert "post section" in names
    assert not any("chosen_by" in name for name in names)


def test_prediction_keeps_the_printed_order_and_names_what_is_missing():
    data = prediction().iloc[::-1]
    table = tables.prediction_table(data[data["model"] != "far"])
    assert column(table, "model") == [
        "affine (specialised)",
        "affine (near)",
        "affine (all)",
        "affine (far)",
        "mean (specialised)",
        "mean (all)",
    ]
    assert column(table, "median") == ["1.95", "2.03", "3.13", "—", "15.40", "29.50"]
    assert "10⁻³ units²" in str(table.note)
    assert "not fitted" in str(table.note)
    assert "not fitted" not in str(tables.prediction_table(prediction()).note)


def test_an_unknown_model_or_kind_is_shown_too():
    extra = pd.concat([prediction(), prediction().tail(1).assign(model="ridge")])
    assert column(tables.prediction_table(extra), "model")[-1] == "ridge"
    kinds = pd.concat([distances(), distances().tail(1).assign(kind="shuffled")])
    assert column(tables.distances_table(kinds), "subspaces")[-1] == "shuffled"


def test_a_kind_without_pairs_has_zero():
    table = tables.distances_table(distances().iloc[2:])
    assert column(table, "pairs") == ["0", "0", "1000", "1000"]


def test_truth_reads_as_sentences():
    rows = {row[0]: row[1:] for row in tables.truth_table(truth()).rows}
    assert rows["Whether near < all < far"] == ("yes", "")
    assert rows["Rms of fitted minus true floor height"] == ("—", "mm")
    assert rows["Pre section found minus that of the truth"] == ("−0.42", "mm")


def test_truth_is_measured_as_elsewhere_on_the_page():
    rows = {row[0]: row[1:] for row in tables.truth_table(truth()).rows}
    assert rows["Share of right mode schedules, kink method"] == ("97.9", "%")
    assert rows["Touchdowns without a true landing nearby"] == ("0", "touchdowns")
    height = {
        "section_pre_true": {"value": 0.50318, "unit": "m", "what": "pre section"}
    }
    assert tables.truth_table(height).rows == (("Pre section", "503.2", "mm"),)


def test_the_worst_coordinate_is_explained():
    assert "97.5\u00a0% of the bootstraps" in str(
        tables.prediction_table(prediction()).note
    )


def test_a_check_that_must_find_nothing_wants_zero():
    check = {"what": "faults", "value": 0.0, "unit": "", "status": "good", "remark": ""}
    assert quality_table([check | {"good": 0.0, "poor": 10.0}]).rows[0][-2:] == (
        "0",
        "> 10",
    )
    assert quality_table([check | {"good": 0.5, "poor": 1.0}]).rows[0][-2:] == (
        "≤ 0.5",
        "> 1",
    )


def test_times_stand_longest_first():
    table = tables.times_table({"a": 0.5, "b": 12.25})
    assert table.rows == (("b", "12.25"), ("a", "0.50"))


def test_what_is_missing_has_no_table():
    empty = pd.DataFrame()
    assert tables.recordings_table([]) is None
    assert tables.floor_table({}) is None
    assert tables.sections_table(None) is None
    assert tables.schedules_table(empty) is None
    assert tables.exclusions_table(None) is None
    assert tables.prediction_table(empty) is None
    assert tables.distances_table(None) is None
    assert tables.truth_table({}) is None


def filled():
    columns = ["marker", "gaps", "longest_s", "missing", "filled", "left"]
    rows = [
        ("b1", 2, 0.05, 8, 8, 0),
        ("b2", 3, 0.5, 70, 20, 50),
        ("b3", 0, 0.0, 0, 0, 0),
    ]
    return pd.DataFrame(rows, columns=columns).assign(
        recording="hopper", role="body", frames=1000
    )


def test_filled_gaps_with_the_marker_most_often_unseen_first():
    table = tables.filled_table(filled())
    assert [row[1] for row in table.rows] == ["b2", "b1"]
    assert table.rows[0][3:] == ("3", "0.50", "70", "7.00", "20", "50")
    assert "78" in str(table.note)
    assert "28" in str(table.note)
    resting = touchdowns().assign(filled_share=0.0)
    resting.loc[~resting["excluded"], "filled_share"] = 0.1
    used = int((~resting["excluded"]).sum())
    assert f"{used} of {used} used touchdowns" in str(
        tables.filled_table(filled(), resting).note
    )
    assert tables.filled_table(filled(), touchdowns()).note == table.note
    assert tables.filled_table(None) is None
    assert tables.filled_table(filled().iloc[2:]) is None


def test_ambiguous_touchdowns_are_counted_by_schedule():
    data = touchdowns()
    assert {row[2] for row in tables.schedules_table(data).rows} == {"0"}
    data["order_class"] = data["schedule"].where(data.index % 7 != 0, "ambiguous")
    table = tables.schedules_table(data)
    used = data[~data["excluded"]]
    assert (
        sum(int(row[2]) for row in table.rows)
        == (used["order_class"] == "ambiguous").sum()
    )
