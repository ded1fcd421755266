from dataclasses import replace

import pytest
import yaml

from hopdata.config import load_config
from hopdata.config.draft import Draft, draft_config, scalar, study_name

DRAFT = Draft(
    study="mine",
    recording="monday",
    file="data/monday.tsv",
    markers={"body": ["b1", "b2", "b3"], "feet": ["f1", "f2"], "boom": []},
    reasons={"markers.body": "rigid.", "input.vertical_axis": "the markers fall along it."},
    settings={"input": {"vertical_axis": "y", "rate_hz": 250.0}},
    remarks=["look at frame 3"],
    all_markers=["b1", "b2", "b3", "f1", "f2", "left over"],
)


def test_a_draft_is_a_configuration():
    config = load_config(yaml.safe_load(draft_config(DRAFT, path="x.yaml")), check_files=False)
    assert config["study"] == "mine"
    assert config["recordings"][0]["file"] == "data/monday.tsv"
    assert config["markers"] == {"body": ["b1", "b2", "b3"], "feet": ["f1", "f2"], "boom": []}
    assert config["input"]["vertical_axis"] == "y"
    assert config["input"]["rate_hz"] == 250.0
    assert config["home"]["marker"] == "b1"


def test_comments_say_how_to_run_what_was_guessed_and_what_is_left():
    text = draft_config(DRAFT, path="config/x.yaml")
    for part in (
        "# Run:   snakemake --cores 2 --configfile config/x.yaml",
        "# TO DO: look at frame 3",
        "  # Rigid.\n  body:",
        "  # The markers fall along it.\n  vertical_axis: y",
        "  # Not used: left over",
    ):
        assert part in text


@pytest.mark.parametrize(
    "value",
    ["plain", "R.Heel_1", "on", "NO", "y", "1", "1e3", "a: b", "x #y", "", "null", "-", "ä", "~",
     "0x10", "2021-01-01", "a'b", 'a"b', "[a]", "data/x y.tsv", 3, 2.5, True, None],
)  # fmt: skip
def test_every_value_is_read_back_as_it_was(value):
    assert yaml.safe_load(f"key: {scalar(value)}")["key"] == value


@pytest.mark.parametrize(
    ("text", "name"),
    [("monday", "monday"), ("day 1 (run)", "day-1-run"), ("..", "study"), ("_x_", "x"),
     ("Läufer müde", "Laufer-mude"), ("跑", "study")],
)  # fmt: skip
def test_study_names_fit_the_schema(text, name):
    assert study_name(text) == name


@pytest.mark.parametrize("name", ["2021-11-05", "0012", "no", "1e5", "null"])
def test_names_that_yaml_takes_for_something_else_stay_names(name):
    draft = replace(DRAFT, study=name, recording=name)
    config = load_config(yaml.safe_load(draft_config(draft, path="x.yaml")), check_files=False)
    assert config["study"] == config["recordings"][0]["name"] == name


def test_the_commands_of_a_draft_can_be_pasted():
    text = draft_config(DRAFT, path="my studies/x.yaml")
    assert "hopdata check 'my studies/x.yaml'" in text
    assert "--configfile 'my studies/x.yaml'" in text
