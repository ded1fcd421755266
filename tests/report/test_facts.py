import pandas as pd
import pytest
from fake_study import full_study, prediction, touchdowns, truth

from hopdata.landings.exclusions import NO_FOOT_LANDED
from hopdata.landings.quality.checks import check_study
from hopdata.report.facts import study_facts
from hopdata.report.inputs import ReportInputs
from hopdata.report.page import build_report


def test_counts_are_those_of_the_table():
    table = touchdowns(recordings=("a", "b"))
    facts = study_facts(ReportInputs("s", touchdowns=table))
    assert facts["n_descents"] == facts["n_landings"] == 431
    assert facts["n_excluded"] == table["excluded"].sum()
    assert facts["n_used"] + facts["n_excluded"] == 431
    assert facts["n_schedules"] == 6
    assert facts["n_recordings"] == 2


def test_descents_in_which_no_foot_lands_are_no_landings():
    table = touchdowns(20).assign(excluded=[True] * 9 + [False] * 11)
    table["reason"] = [NO_FOOT_LANDED] * 6 + ["poor fit of foot 1"] * 3 + [""] * 11
    facts = study_facts(ReportInputs("s", touchdowns=table))
    names = ("n_descents", "n_landings", "n_not_landed", "n_used", "n_excluded")
    assert [facts[name] for name in names] == [20, 14, 6, 11, 3]
    page = build_report(ReportInputs("s", touchdowns=table))
    said = "of 14 landings, 3 excluded; in 6 more of 20 descents no foot of the study landed"
    assert said in page
    checks = check_study(
        pd.DataFrame({"role": [], "longest_s": [], "noise_m": []}), pd.DataFrame({"kind": []}),
        table, pd.DataFrame({"pre_height_m": [1.0], "post_height_m": [0.9], "note": [""]}),
        pd.DataFrame({name: [] for name in ("median", "typical", "se")}), other_feet=True,
    )  # fmt: skip
    used = next(check for check in checks if check.what == "touchdowns used")
    assert used.remark.startswith("11 of 14 landings; ")
    assert used.remark.endswith("; not counted: 6 more descents, of other feet")


@pytest.mark.parametrize("yes", ["True", "true", 1])
def test_booleans_that_csv_made_text_are_understood(yes):
    table = touchdowns(20).assign(excluded=[yes] * 5 + ["False"] * 15)
    assert study_facts(ReportInputs("s", touchdowns=table))["n_excluded"] == 5


def test_texts_with_units():
    facts = study_facts(full_study())
    assert facts["units"] == "29.1\u00a0mm and 27\u00a0ms"
    assert facts["travel"] == "211\u00a0mm"
    assert facts["split"] == "52/18"
    assert facts["labels_right"] == {
        "kink": ("97.9\u00a0%", "95.1\u00a0%"),
        "velocity minimum": ("94.9\u00a0%", None),
    }
    assert facts["not_fitted"] == ""


def test_models_that_are_missing_are_listed():
    table = prediction()
    table.loc[table["model"] == "near", "median"] = None
    facts = study_facts(ReportInputs("s", prediction=table[table["model"] != "specialised"]))
    assert facts["not_fitted"] == "affine (specialised) and affine (near)"
    assert facts["medians"]["near"] is None


def test_nothing_known_gives_the_same_keys():
    bare = study_facts(ReportInputs("s"))
    assert bare.keys() == study_facts(full_study()).keys()
    assert bare["travel"] is bare["units"] is bare["n_used"] is bare["spread"] is None
    empty = study_facts(ReportInputs("s", touchdowns=touchdowns(5).iloc[:0]))
    assert (empty["n_descents"], empty["spread"]) == (0, None)


def test_a_share_that_could_not_be_computed_is_left_out():
    entries = truth()
    entries["labels_right_kink"]["value"] = None
    assert "kink" not in study_facts(ReportInputs("s", truth=entries))["labels_right"]


def test_tables_without_rows_or_optional_columns():
    lean = prediction()[["model", "median"]]
    facts = study_facts(ReportInputs("s", prediction=lean, distances=pd.DataFrame(
        {"kind": [], "median": []})))  # fmt: skip
    assert facts["split"] is None
    assert set(facts["distances"].values()) == {None}
