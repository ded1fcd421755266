"""`hopdata doctor` knows all that the installation asks for, and what does not fit."""

import tomllib
from pathlib import Path

from packaging.requirements import Requirement

from hopdata.__main__ import main
from hopdata.commands import doctor

PROJECT = tomllib.loads(
    (Path(__file__).parents[2] / "pyproject.toml").read_text("utf-8")
)["project"]
#: Extras of those who develop hopdata.
OF_DEVELOPERS = {"test", "bench", "cluster", "mutants", "fuzz", "lint"}


def test_each_need_and_each_extra_has_its_use():
    needed = {Requirement(one).name for one in PROJECT["dependencies"]}
    assert set(doctor.USES["needed"]) == needed
    extras = set(PROJECT["optional-dependencies"]) - OF_DEVELOPERS
    assert set(doctor.USES["extras"]) == extras


def test_what_is_missing_or_too_old_is_a_problem(monkeypatch, capsys):
    versions = {"numpy": "1.26.4", "rich": doctor.MISSING}
    real = doctor.version_of
    monkeypatch.setattr(
        doctor, "version_of", lambda name: versions.get(name) or real(name)
    )
    assert main(["doctor"]) == 1
    out = capsys.readouterr().out
    assert "numpy: expected >=2.0, found 1.26.4; install hopdata anew" in out
    assert "rich: expected >=13.7, found none; install hopdata anew" in out
    assert "scipy: expected" not in out


def test_an_extra_that_is_not_there_is_no_problem(monkeypatch, capsys):
    real = doctor.version_of
    monkeypatch.setattr(
        doctor,
        "version_of",
        lambda name: doctor.MISSING if name == "openpyxl" else real(name),
    )
    assert main(["doctor"]) == 0
    assert "openpyxl not installed" in capsys.readouterr().out
