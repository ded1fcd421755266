"""``hopdata plan`` on the verdict of a pilot."""

import json
from pathlib import Path

import pytest
from overlaps import text_faults

from hopdata.__main__ import main
from hopdata.figures.verdict import plan_figure

ROOT = Path(__file__).parents[2]

PILOT = {
    "n_landings": 1000,
    "n_feet": 3,
    "power": 0.8,
    "margin": 0.2,
    "effect": {"detectable": 0.2, "allowed": 0.1},
}


def written(tmp_path, content):
    file = tmp_path / "verdict.json"
    file.write_text(content if isinstance(content, str) else json.dumps(content))
    return str(file)


def table_of(said):
    """Return the lines of the table, which stands between empty lines, below its head."""
    return said.split("\n\n")[1].splitlines()[1:]


def test_the_number_falls_with_the_square_of_what_smooth_terms_do_not_leave(
    tmp_path, capsys
):
    assert main(["plan", written(tmp_path, PILOT), "--difference", "0.18"]) == 0
    said = capsys.readouterr().out
    assert "1,000 judged landings of 3 feet find 20 % in 80 % of studies" in said
    rows = dict(map(str.strip, line.split("%")) for line in table_of(said))
    # The terms of 3 feet take 60 landings: 60 + 940 / 0.5^2.
    assert rows["15"] == "3,800"
    assert rows["20"] == "1,000"
    assert rows["18"] == "1,500"  # 1,529 to two digits
    assert rows["50"] == "150", "second-order terms take as many"


FEWEST = "of which there is a size. This number stands for every difference"


@pytest.mark.parametrize(
    ("feet", "number"),
    [(2, "140"), (3, "150"), (4, "170")],  # 139, 150 and 168 to two digits
)
def test_the_least_number_of_landings_is_told_beneath_the_table(
    tmp_path, capsys, feet, number
):
    """All differences of a third of the map and more ask for it."""
    quiet = PILOT | {"n_feet": feet, "effect": {"detectable": 0.15, "allowed": 0.1}}
    assert main(["plan", written(tmp_path, quiet)]) == 0
    said = capsys.readouterr().out
    numbers = [row.split("%")[1].strip() for row in table_of(said)]
    assert numbers.count(number) > 1
    told = f"{number} landings are the fewest of {feet} feet {FEWEST}"
    assert said.split("\n\n")[2].startswith(told)


def test_a_least_number_that_no_difference_asks_for_is_not_told(tmp_path, capsys):
    noisy = PILOT | {"effect": {"detectable": 0.9, "allowed": 0.1}}
    assert main(["plan", written(tmp_path, noisy)]) == 0
    assert FEWEST not in capsys.readouterr().out


def test_what_smooth_terms_may_leave_is_in_no_plan(tmp_path, capsys):
    apart = PILOT | {"effect": {"detectable": 0.4, "allowed": 0.22}}
    assert main(["plan", written(tmp_path, apart)]) == 0
    said = capsys.readouterr().out
    assert said.splitlines()[-1].startswith("the margin, 20 %, is within the 22 %")
    assert [row.split("%")[0].strip() for row in table_of(said)] == [
        "25",
        "27",
        "32",
        "37",
        "42",
        "52",
        "62",
    ]
    assert main(["plan", written(tmp_path, apart), "--difference", "0.2"]) == 1
    assert "above 0.22, as much as smooth terms may leave" in capsys.readouterr().err


def test_the_margin_is_in_the_plan(tmp_path, capsys):
    odd = PILOT | {"margin": 0.17}
    assert main(["plan", written(tmp_path, odd)]) == 0
    assert "17 %     2,000" in capsys.readouterr().out  # 60 + 940 (0.1 / 0.07)^2


def test_a_pilot_that_saturates_promises_no_number(tmp_path, capsys):
    spent = {"saturates": True, "effect": {"detectable": 0.2, "allowed": 0.1}}
    found = spent | {"conclusion": "different"}
    assert main(["plan", written(tmp_path, PILOT | found)]) == 1
    told = capsys.readouterr()
    assert "So no number of landings can be promised" in told.err
    assert "landings" not in told.out


def test_what_may_be_hidden_may_saturate(tmp_path, capsys):
    spent = {"saturates": True, "effect": {"detectable": 0.2, "allowed": 0.1}}
    hidden = spent | {"conclusion": "cannot tell"}
    assert main(["plan", written(tmp_path, PILOT | hidden)]) == 0
    assert "differences over the landings" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({}, []),
        ({"n_feet": 2}, ["Two feet give little power"]),
        ({"conclusion": "different"}, ["The pilot differs, by 40 %."]),
        # Beside a jump kinks that are not there seem to saturate.
        (
            {"conclusion": "different", "saturates": True, "jump": {"low": 0.1}},
            ["The pilot's outcome jumps"],
        ),
    ],
)
def test_a_plan_says_what_it_rests_on(tmp_path, capsys, more, said):
    effect = PILOT["effect"] | {"estimate": 0.4}
    pilot = PILOT | {"effect": effect} | more
    assert main(["plan", written(tmp_path, pilot)]) == 0
    out = capsys.readouterr().out
    assert out.count("note: ") == len(said)
    assert all(f"note: {words}" in out for words in said)


def test_a_small_pilot_is_planned_by_the_landings_that_a_large_study_uses(
    tmp_path, capsys
):
    """Of few landings the farther ones are used too, and more is allowed for them."""
    effect = {"detectable": 0.4, "allowed": 0.157}
    nearest = {"detectable_nearest": 0.5, "allowed_nearest": 0.1}
    small = PILOT | {"n_landings": 300, "effect": effect | nearest}
    assert main(["plan", written(tmp_path, small), "--difference", "0.12"]) == 0
    said = capsys.readouterr().out
    rows = dict(map(str.strip, line.split("%")) for line in table_of(said))
    # 60 + 240 (0.4 / 0.02)^2, and 60 + 240 (0.4 / 0.1)^2
    assert rows["12"] == "96,000"
    assert rows["20"] == "3,900"
    assert rows["50"] == "180"  # 60 + 240 (0.243 / 0.343)^2, in the wider window

    older = PILOT | {"n_landings": 300, "effect": effect}
    assert main(["plan", written(tmp_path, older), "--difference", "0.12"]) == 1
    assert "above 0.16, as much as smooth terms may leave" in capsys.readouterr().err


def test_the_curve_is_drawn_through_the_pilot(tmp_path):
    figure = tmp_path / "plan.png"
    assert main(["plan", written(tmp_path, PILOT), "--figure", str(figure)]) == 0
    assert figure.stat().st_size > 2000
    drawn = plan_figure({0.1: 4000, 0.2: 1000}, (1000, 0.2), 0.8)
    line, point = drawn.axes[0].lines
    assert list(line.get_xdata()) == pytest.approx([10, 20])
    assert list(line.get_ydata()) == [4000, 1000]
    assert (point.get_xdata()[0], point.get_ydata()[0]) == (pytest.approx(20), 1000)
    assert text_faults(drawn) == []


def test_a_configuration_is_run_where_no_workflow_is(tmp_path, monkeypatch, capfd):
    (tmp_path / "results").write_text(
        ""
    )  # the workflow itself refuses a file of this name
    monkeypatch.chdir(tmp_path)
    assert main(["plan", str(ROOT / "config/quadruped.yaml")]) == 1
    said = capfd.readouterr().err
    assert "results: expected a folder for the results, found a file" in said
    assert "the study does not run to its verdict; see above" in said


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "expected the verdict.json of a study"),
        ("[]", "expected the verdict.json of a study"),
        (
            PILOT | {"effect": {"detectable": 0.2}},
            "found an older one; run the pilot again",
        ),
        (
            PILOT | {"effect": None, "sentence": "too few."},
            "the pilot has no answer: too few.",
        ),
    ],
)
def test_a_file_that_tells_nothing_is_told(content, words, tmp_path, capsys):
    assert main(["plan", written(tmp_path, content)]) == 1
    assert words in capsys.readouterr().err


def test_a_file_that_is_not_there_is_told(tmp_path, capsys):
    assert main(["plan", str(tmp_path / "none.json")]) == 1
    assert "none.json" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        (
            "n_landings",
            "many",
            "verdict.json: n_landings: expected a number, 0 or more",
        ),
        ("n_landings", 10**300, "verdict.json: n_landings: expected a number"),
        (
            "n_feet",
            None,
            "verdict.json: n_feet: expected a number, 0 or more, found None",
        ),
        ("power", -1, "verdict.json: power: expected a number, 0 or more, found -1"),
        ("effect", [1], "expected a verdict of this version"),
        (
            "effect",
            {"detectable": True, "allowed": 0.1},
            "verdict.json: effect.detectable: expected a number, 0 or more, found True",
        ),
    ],
)
def test_values_of_another_kind_are_told_in_one_line(
    tmp_path, capsys, key, value, said
):
    assert main(["plan", written(tmp_path, PILOT | {key: value})]) == 1
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1


def test_the_answer_of_a_group_is_told_how_a_group_is_planned(tmp_path, capsys):
    file = tmp_path / "group.json"
    file.write_text(json.dumps({"conclusion": "different", "members": []}))
    assert main(["plan", str(file)]) == 1
    told = capsys.readouterr().err
    assert "from the verdict.json of one member" in told
    assert "four times as many halve it" in told
