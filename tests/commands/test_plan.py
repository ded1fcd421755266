"""``hopdata plan`` on the verdict of a pilot."""

import json

import pytest

from hopdata.__main__ import main

PILOT = {"n_landings": 1000, "n_feet": 3, "power": 0.8, "effect": {"detectable": 0.2}}


def written(tmp_path, content):
    file = tmp_path / "verdict.json"
    file.write_text(content if isinstance(content, str) else json.dumps(content))
    return str(file)


def test_the_number_falls_with_the_square_of_the_difference(tmp_path, capsys):
    assert main(["plan", written(tmp_path, PILOT), "--difference", "0.08"]) == 0
    said = capsys.readouterr().out
    assert "1,000 landings of 3 feet find 20 % in 80 % of studies" in said
    rows = dict(map(str.strip, line.split("%")) for line in said.splitlines()[3:])
    assert rows["10"] == "4,000"
    assert rows["20"] == "1,000"
    assert rows["8"] == "6,200"  # two digits of 6,250
    assert rows["50"] == "180", "second-order terms take as many"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "expected the verdict.json of a study"),
        ("[]", "expected the verdict.json of a study"),
        (PILOT | {"effect": None, "sentence": "too few."}, "the pilot has no answer: too few."),
    ],
)
def test_a_file_that_tells_nothing_is_told(content, words, tmp_path, capsys):
    assert main(["plan", written(tmp_path, content)]) == 1
    assert words in capsys.readouterr().err


def test_a_file_that_is_not_there_is_told(tmp_path, capsys):
    assert main(["plan", str(tmp_path / "none.json")]) == 1
    assert "none.json" in capsys.readouterr().err
