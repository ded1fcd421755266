"""Damaged files of an earlier run are made again by Snakemake, and told."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from hopdata import digests
from hopdata.commands.healing import MARKS, METADATA, heal
from hopdata.commands.workflow import run_workflow

RULES = """
rule all:
    input: "results/b"
rule a:
    output: "results/a"
    shell: "printf whole > results/a; echo a >> done"
rule b:
    input: "results/a"
    output: "results/b"
    shell: "cat results/a results/a > results/b; echo b >> done"
"""


@pytest.fixture
def made(tmp_path, monkeypatch):
    """Make both files and their digests; return a function that runs Snakemake again."""
    monkeypatch.chdir(tmp_path)
    Path("config.yaml").write_text("study: trial\n")
    Path("Snakefile").write_text(RULES)

    def run():
        options = (Path("config.yaml"), "trial", "--cores", "1")
        assert run_workflow(*options, snakefile=Path("Snakefile")) == 0

    run()
    digests.keep([Path("results/a"), Path("results/b")])
    Path("done").unlink()
    return run


def test_nothing_is_done_where_nothing_is_damaged(made):
    assert heal("results") == ""
    assert not any(MARKS.glob("*"))


def test_a_damaged_file_is_made_again_also_if_nothing_asks_for_it(made):
    """Snakemake alone would not look at a file of which all that follows is there."""
    Path("results/a").write_text("whale")
    told = heal("results")
    assert told == (
        "results/a is not as written (damaged, or changed by hand); it is made again"
    )
    assert heal("results") == told  # an interrupted repair is repeated
    made()
    assert Path("results/a").read_text() == "whole"
    assert Path("results/b").read_text() == "wholewhole"
    assert heal("results") == ""
    assert not any(MARKS.glob("*"))


def test_a_damaged_file_of_no_rule_has_the_output_of_its_job_made_again(made):
    """Snakemake knows no job for it, so a mark of its own would not be seen."""
    Path("results/further").write_text("whole")
    digests.keep_further("results/b", ["results/further"])
    assert heal("results") == ""
    Path("results/further").write_text("whale")
    told = heal("results")
    assert told.startswith("results/further is not as written")
    made()
    assert Path("done").read_text() == "b\n"


def test_several_are_told_in_one_line(made):
    for name in ("a", "b"):
        Path("results", name).write_text("")
    told = heal("results")
    assert "results/a and 1 more are not as written" in told
    assert "\n" not in told


def test_a_damaged_record_of_snakemake_is_removed_and_its_file_made_again(made):
    record = next(iter(sorted(METADATA.glob("*"))))
    assert isinstance(json.loads(record.read_text()), dict)
    for content in (b"\xff\xfe{", b"{", b"", b"[1]"):
        record.write_bytes(content)
        told = heal("results")
        assert "is known from a damaged record of Snakemake; it is made again" in told
        assert not record.exists()
    made()
    assert Path("done").read_text()
    assert heal("results") == ""


def test_long_names_are_marked_where_snakemake_looks(made, tmp_path):
    """Its own code finds the mark of a name that it cuts."""
    name = "results/" + "/".join(["folder" * 10] * 5) + "/file"
    Path(name).parent.mkdir(parents=True)
    Path(name).write_text("x")
    digests.keep([name])
    Path(name).write_text("y")
    heal("results")
    program = (
        "from snakemake.persistence.file import FilePersistence\n"
        f"print(FilePersistence()._filter_incomplete_keys([{name!r}, 'other']))"
    )
    ask = [sys.executable, "-c", program]
    found = subprocess.run(ask, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == repr({name})
