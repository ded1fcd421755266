import pandas as pd
import pytest
from fake_study import full_study, prediction, touchdowns, truth

from hopdata.report.facts import study_facts
from hopdata.report.inputs import ReportInputs


def test_counts_are_those_of_the_table():
    table = touchdowns(recordings=("a", "b"))
    facts = study_facts(ReportInputs("s", touchdowns=table))
    assert facts["n_touchdowns"] == 431
    assert facts["n_excluded"] == table["excluded"].sum()
    assert facts["n_used"] + facts["n_excluded"] == 431
    assert facts["n_schedules"] == 6
    assert facts["n_recordings"] == 2


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
    assert (empty["n_touchdowns"], empty["spread"]) == (0, None)


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
