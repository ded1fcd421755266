"""Answers for scripts: one JSON object, also after an error, with the documented fields."""

import argparse
import json
import re
from pathlib import Path

import numpy as np
import pytest
from made_up_files import export
from made_up_hopper import hopping, with_spike
from test_check import STUDY

from hopdata.__main__ import COMMANDS, main
from hopdata.commands import answers
from hopdata.messages import Message

PAGE = Path(__file__).parents[2] / "docs" / "json.md"
#: Fields whose content is described elsewhere, or is named by what it holds.
OPAQUE = (
    "contacts[]",
    "orders[]",
    "lags[]",
    "message",
    "seen_share",
    "machine",
    "effect",
)
OPAQUE += ("quality", "planned", "reason", "error", "packages[]")


def documented(command):
    """Return the fields of a command, as paths."""
    sections = dict(re.findall(r"^## (.*)\n([^#]*)", PAGE.read_text(), re.MULTILINE))
    found = set()
    for section in ("Every command", command):
        for cells in re.findall(r"^\| (`[^|]*`) \|", sections[section], re.MULTILINE):
            found |= set(re.findall(r"`([^`]*)`", cells))
    return found


def paths(content, path=""):
    """Yield the path of each value."""
    if path and path.split(".")[-1] in OPAQUE and path != "error":
        yield path
    elif isinstance(content, dict):
        for key, value in content.items():
            name = "NAME" if path == "extras" else key
            yield from paths(value, f"{path}.{name}".lstrip("."))
    elif isinstance(content, list):
        for one in content:
            yield from paths(one, f"{path}[]")
        if not content:
            yield f"{path}[]"
    else:
        yield path


def answer(capsys, *arguments, code=0):
    assert main([*map(str, arguments), "--json"]) == code
    content = json.loads(capsys.readouterr().out)
    command = arguments[0]
    assert content["command"] == command
    assert content["ok"] == (code == 0)
    lists = {f"{name}[]" for name, one in content.items() if one == []}
    known = documented(command)
    for path in set(paths(content)) - lists:
        assert path in known, f"docs/json.md: {command}: {path} is not there"
    return content


@pytest.fixture
def faulty(tmp_path):
    return export(tmp_path, with_spike(hopping(3)[1], "hip2", 400, 0.06))


def test_inspect(faulty, capsys):
    found = answer(capsys, "inspect", faulty, code=1)
    (file,) = found["files"]
    (suspect,) = file["suspects"]
    assert suspect["kind"] == "spike"
    assert suspect["markers"] == ["hip2"]
    assert suspect["first_frame"] == 401
    # Each field of the page is there, but for those of other ways to call it.
    others = {"error.code", "error.lines[]", "files[].line", "files[].error"}
    others |= {"files[].clusters[].markers[]", "files[].clusters[].noise_m"}
    assert documented("inspect") - others <= set(paths(found))


def test_several_files_of_which_one_is_none(faulty, capsys):
    found = answer(capsys, "inspect", faulty, faulty.with_name("none.tsv"), code=1)
    sound, refused = found["files"]
    assert sound["line"].startswith(f"{faulty}: 100 Hz")
    assert "none.tsv" in refused["error"]["lines"][0]


def test_contacts(faulty, capsys):
    found = answer(capsys, "contacts", faulty)
    assert len(found["orders"]) == found["orders"][-1]["landing"]
    assert {"foot", "contact_s", "se_s"} <= {*found["contacts"][0]}


def test_plan(tmp_path, capsys):
    verdict = {"n_landings": 500, "n_feet": 2, "power": 0.8, "sentence": ""}
    verdict |= {"margin": 0.2, "effect": {"detectable": 0.4, "allowed": 0.1}}
    file = tmp_path / "verdict.json"
    file.write_text(json.dumps(verdict))
    found = answer(capsys, "plan", file, "--difference", "0.3")
    needed = {one["difference"]: one["landings"] for one in found["plan"]}
    assert needed[0.2] > needed[0.3] > 500
    verdict["effect"] = None
    file.write_text(json.dumps(verdict))
    found = answer(capsys, "plan", file, code=1)
    assert "the pilot has no answer" in found["error"]["lines"][0]


def test_doctor(capsys):
    found = answer(capsys, "doctor")
    assert {"numpy", "snakemake"} <= {one["name"] for one in found["needed"]}
    assert found["extras"]["excel"]["packages"][0]["name"] == "openpyxl"
    assert found["problems"] == []


def test_check(tmp_path, capsys):
    config = tmp_path / "study.yaml"
    config.write_text(STUDY.format(file=export(tmp_path), unit="auto"))
    found = answer(capsys, "check", config)
    (recording,) = found["recordings"]
    assert (recording["name"], recording["frames"]) == ("one", 2000)
    assert found["forecast"]["detectable"] is None
    assert "150 touchdowns" in found["forecast"]["reason"]["text"]
    assert "unsure" in found["but"]
    assert found["notes"] == []


def test_check_and_run_of_a_file_that_is_none(tmp_path, capsys):
    for command in ("check", "run"):
        found = answer(capsys, command, tmp_path / "none.yaml", code=1)
        assert "none.yaml" in found["error"]["lines"][0]


def test_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("hopdata.commands.run.run_workflow", lambda *_, **__: 0)
    results = Path("results/sample")
    results.mkdir(parents=True)
    verdict = {"sentence": "They differ.", "conclusion": "different", "p": 0.01}
    (results / "verdict.json").write_text(json.dumps(verdict))
    (results / "report.html").touch()
    found = answer(capsys, "run")
    assert found["verdict"] == {"sentence": "They differ.", "conclusion": "different"}
    assert found["page"] == "results/sample/report.html"


def test_every_command_with_an_answer_is_on_the_page():
    told = {name for name, entry in COMMANDS.items() if entry.get("json")}
    sections = set(re.findall(r"^## (.*)", PAGE.read_text(), re.MULTILINE))
    assert sections == told | {"Every command"}


def test_values_of_all_kinds_become_plain():
    content = {"a": np.float64(np.nan), "b": np.arange(2), "c": Path("x/y"), 3: (True,)}
    content["m"] = Message("inspecting.nothing_suspect")
    plain = answers.as_plain(content)
    assert plain["m"]["code"] == "inspecting.nothing_suspect"
    assert {key: plain[key] for key in ("a", "b", "c", "3")} == {
        "a": None,
        "b": [0, 1],
        "c": "x/y",
        "3": [True],
    }


def test_what_a_command_gives_is_gone_after_it(capsys):
    def command(_):
        answers.give(one=1)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        answers.in_json(argparse.Namespace(), "a", command)
    assert not answers.is_asked()
    answers.give(two=2)
    assert capsys.readouterr().out == ""
