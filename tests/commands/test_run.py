"""`hopdata run`, and the commands that manage its results."""

import base64
import json
import os
import re
import shutil
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
from checkouts import part_of_sample
from fake_study import verdict

from hopdata import __version__
from hopdata.__main__ import main
from hopdata.bundled import SNAKEFILE
from hopdata.commands.bringing import bring_recording
from hopdata.commands.run import _Run, _tell_early, read_inputs
from hopdata.commands.workflow import run_workflow

ROOT = Path(__file__).parents[2]
CONFIG = "study: trial\nrecordings: []\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("config.yaml").write_text(CONFIG)
    for study in ("trial", "other"):
        Path("results", study).mkdir(parents=True)
    return tmp_path


def workflow(folder, rules):
    path = folder / "Snakefile"
    path.write_text(rules)
    return path


def test_progress_is_plain_lines_where_no_one_looks(folder, capfd):
    rules = 'rule all:\n    input: "a"\nrule a:\n    output: "a"\n    shell: "echo loud >&2; touch a"\n'
    options = (Path("config.yaml"), "trial", "--cores", "1")
    assert run_workflow(*options, snakefile=workflow(folder, rules)) == 0
    lines = capfd.readouterr().err.splitlines()
    begin = r"trial: a [\d.]+ s; 1 of 2 jobs done, "
    assert lines[0].startswith("trial: 0 of 2 jobs done, a first run compiles code")
    assert re.fullmatch(begin + r"after [\d.]+ s", lines[1])
    assert re.fullmatch(r"trial: 2 of 2 jobs done, after [\d.]+ s", lines[2])
    assert len(lines) == 3
    log = Path("results/trial/logs/run.log").read_text()
    assert "loud" in log
    assert "\x1e" not in log


def test_that_no_verdict_is_reached_is_said_before_the_page(folder, capsys):
    answer = Path("results/trial/verdict.json")
    note = {"reason": "found 36 landings"}
    asked = _Run(Path("config.yaml"), "trial", SNAKEFILE, answer)
    told = partial(_tell_early, asked)
    told("verdict")  # it has not been written yet
    answer.write_text(json.dumps({"effect": None, "jump": None, "notes": [note]}))
    told("home_frame")
    assert capsys.readouterr().err == ""
    told("verdict")
    said = capsys.readouterr().err
    assert "no verdict is reached: found 36 landings" in said
    assert "contacts" in said
    answer.write_text(json.dumps({"effect": {}, "jump": None, "notes": []}))
    told("verdict")
    assert capsys.readouterr().err == ""


def test_the_answer_has_the_words_of_the_page(folder, monkeypatch, capsys):
    values = {"compared": "6 contact orders", "where": " over these landings"}
    values |= {
        "bound": "13 %",
        "confidence": "95 %",
        "margin": "20 %",
        "spreads": "0.7",
    }
    sentence = {"code": "maps.no_difference_at_contact", "values": values}
    found = verdict(messages={"sentence": sentence}, sentence="As written.")
    found |= {"holds_from": 0.00814, "contact_spread": 0.0112}
    Path("results/sample").mkdir()
    Path("results/sample/verdict.json").write_text(json.dumps(found))
    Path("results/sample/report.html").touch()
    monkeypatch.setattr("hopdata.commands.run.run_workflow", lambda *_, **__: 0)
    assert main(["run"]) == 0
    said = capsys.readouterr().out
    assert "No difference between the maps of 6 contact orders larger" in said
    assert "spent once contacts are some 8.1 ms apart" in said
    assert "\u00a0" not in said


def test_a_dry_run_says_a_line_a_stage(folder, capfd):
    rules = (
        'rule all:\n    input: "a1", "a2"\n'
        'rule a:\n    output: "a{n}"\n    shell: "touch {output}"\n'
    )
    options = (Path("config.yaml"), "trial", "--cores", "1")
    snakefile = workflow(folder, rules)
    assert run_workflow(*options, "--dry-run", snakefile=snakefile) == 0
    said = capfd.readouterr()
    assert [line.split() for line in said.out.splitlines()] == [
        ["trial:", "would", "run"],
        ["a", "2", "jobs"],
    ]
    assert said.err == ""
    assert not Path("a1").exists()
    assert run_workflow(*options, snakefile=snakefile) == 0
    capfd.readouterr()
    assert run_workflow(*options, "--dry-run", snakefile=snakefile) == 0
    assert capfd.readouterr().out == "trial: nothing to do\n"


def test_a_failure_names_its_line_and_the_log(folder, capfd):
    rules = 'rule a:\n    output: "a"\n    shell: "echo hopdata: error: no feet >&2; exit 1"\n'
    options = (Path("config.yaml"), "trial", "--cores", "1")
    assert run_workflow(*options, snakefile=workflow(folder, rules)) == 1
    lines = capfd.readouterr().err.splitlines()
    assert "hopdata: error: no feet" in lines
    assert lines[-1] == "hopdata: results/trial/logs/run.log: all that Snakemake said"
    assert not Path("a").exists()


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signals")
@pytest.mark.parametrize(
    ("victim", "told"),
    [
        ("$$", "hopdata: error: a: it was killed (SIGKILL)"),
        ("$PPID", "hopdata: error: Snakemake: it was killed (SIGKILL)"),
    ],
)
def test_a_job_or_a_snakemake_that_was_killed_is_told_in_one_line(
    folder, capfd, victim, told
):
    rules = f'rule a:\n    output: "a"\n    shell: "kill -9 {victim}; sleep 1"\n'
    options = (Path("config.yaml"), "trial", "--cores", "1")
    assert run_workflow(*options, snakefile=workflow(folder, rules)) != 0
    lines = capfd.readouterr().err.splitlines()
    if "jobs done" in lines[0]:  # the progress, before anything failed
        del lines[0]
    assert [line for line in lines if line.startswith(told)] == lines[:1]
    assert len(lines) <= 2


def test_what_a_killed_job_left_is_made_again(folder, capfd):
    """Snakemake's mark shows it; the profile that asks for this is not beside the rules."""
    mark = Path(".snakemake/incomplete", base64.b64encode(b"a").decode())
    mark.parent.mkdir(parents=True)
    for path in (mark, Path("a")):
        path.touch()
    rules = 'rule a:\n    output: "a"\n    shell: "echo whole > a"\n'
    options = (Path("config.yaml"), "trial", "--cores", "1")
    assert run_workflow(*options, snakefile=workflow(folder, rules)) == 0
    assert Path("a").read_text() == "whole\n"


def test_results_of_another_version_are_refused_by_name(folder, capsys):
    record = {"config": {}, "inputs": {}, "versions": {"hopdata": "0.0.7"}}
    Path("results/trial/provenance.json").write_text(json.dumps(record))
    assert main(["run", "--from", "results/trial/provenance.json"]) == 1
    assert (
        f"expected results of hopdata {__version__}, found those of 0.0.7"
        in capsys.readouterr().err
    )


@pytest.mark.parametrize("content", ["[]", "{}", "no JSON", '{"config": {}}'])
def test_another_file_is_no_provenance(folder, capsys, content):
    Path("p.json").write_text(content)
    assert main(["run", "--from", "p.json"]) == 1
    assert "p.json: expected the provenance.json of a study" in capsys.readouterr().err


RECORD = {
    "config": {"study": "trial", "recordings": []},
    "inputs": {},
    "versions": {"hopdata": __version__},
    "code_sha256": "0",
}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"config": [1]}, "p.json: config: expected keys with values, found [1]"),
        ({"config": None}, "p.json: config: expected keys with values, found None"),
        ({"config": {"study": 5}}, "p.json: config: study: expected text"),
        ({"config": {"study": "../x"}}, "p.json: config: study: expected"),
        ({"config": {"study": "/tmp/x"}}, "p.json: config: study: expected"),
        ({"inputs": 3}, "p.json: inputs: expected keys with values, found 3"),
        ({"versions": None}, "p.json: versions: expected keys with values, found None"),
        (
            {"versions": {}},
            "p.json: versions: expected the version of hopdata that made it",
        ),
        ({"code_sha256": 1}, "p.json: code_sha256: expected text, found 1"),
    ],
)
def test_values_of_a_provenance_are_checked_before_anything_is_written(
    folder, capsys, monkeypatch, change, said
):
    ran = []
    monkeypatch.setattr(
        "hopdata.commands.run.run_workflow", lambda *_, **__: ran.append(1) or 1
    )
    before = sorted(folder.rglob("*"))
    Path("p.json").write_text(json.dumps(RECORD | change))
    assert main(["run", "--from", "p.json"]) == 1
    assert said in capsys.readouterr().err
    assert sorted(folder.rglob("*")) == sorted([*before, folder / "p.json"])
    assert not ran


def test_a_sound_provenance_is_repeated_within_the_results(folder, monkeypatch):
    ran = []
    monkeypatch.setattr(
        "hopdata.commands.run.run_workflow", lambda *a, **__: ran.append(a) or 1
    )
    config = {"study": "trial", "recordings": [{"name": "a", "file": "a.tsv"}]}
    config |= {"markers": {"body": ["a", "b", "c"], "feet": ["d", "e"]}}
    Path("p.json").write_text(json.dumps(RECORD | {"config": config}))
    assert main(["run", "--from", "p.json"]) == 1
    assert ran[0][0] == Path("results/trial_again/config.yaml")
    assert ran[0][0].exists()


@pytest.mark.parametrize("digest", ["12", "34"])
def test_a_simulated_study_is_repeated_by_what_its_recordings_hold(
    folder, monkeypatch, capsys, digest
):
    """They lie in the folder of their study, which has another name the second time."""
    config = {"study": "trial", "recordings": [{"name": "a", "simulation": {}}]}
    body, feet = ["body1", "body2", "body3"], ["foot1", "foot2", "foot3"]
    config |= {"markers": {"body": body, "feet": feet}}
    old, new = Path("results/trial"), Path("results/trial_again")
    old.mkdir(parents=True, exist_ok=True)
    record = RECORD | {"config": config}
    record |= {"inputs": {"results/trial/simulated/a.h5": "12"}}
    (old / "provenance.json").write_text(json.dumps(record))
    (old / "verdict.json").write_text("{}")

    def run(*_, **__):
        inputs = {"results/trial_again/simulated/a.h5": digest}
        (new / "provenance.json").write_text(json.dumps({"inputs": inputs}))
        (new / "verdict.json").write_text("{}")
        return 0

    monkeypatch.setattr("hopdata.commands.run.run_workflow", run)
    code = main(["run", "--from", "results/trial/provenance.json"])
    told = capsys.readouterr()
    if digest == "12":
        assert code == 0
        assert "1 of 1 files are the same bytes" in told.out
    else:
        assert code == 1
        assert "found other content" in told.err


def test_a_provenance_nested_without_end_is_refused_in_one_line(folder, capsys):
    Path("p.json").write_text("[" * 100_000)
    assert main(["run", "--from", "p.json"]) == 1
    assert capsys.readouterr().err == (
        "hopdata: error: p.json: expected at most 50 levels, one within another, "
        "found more\n"
    )


@pytest.mark.parametrize("linked", ["results/trial_again", "the file in it"])
def test_links_do_not_lead_a_repeated_study_out_of_the_folder(
    folder, tmp_path_factory, monkeypatch, capsys, linked
):
    ran = []
    monkeypatch.setattr(
        "hopdata.commands.run.run_workflow", lambda *a, **__: ran.append(a) or 1
    )
    outside = tmp_path_factory.mktemp("outside")
    Path("results").mkdir(exist_ok=True)
    if linked == "the file in it":
        Path("results/trial_again").mkdir()
        Path("results/trial_again/config.yaml").symlink_to(outside / "config.yaml")
    else:
        Path(linked).symlink_to(outside)
    config = {"study": "trial", "recordings": [{"name": "a", "file": "a.tsv"}]}
    config |= {"markers": {"body": ["a", "b", "c"], "feet": ["d", "e"]}}
    Path("p.json").write_text(json.dumps(RECORD | {"config": config}))
    assert main(["run", "--from", "p.json"]) == 1
    assert "expected a file of this folder, found a link to" in capsys.readouterr().err
    assert [*outside.iterdir()] == []
    assert not ran


def test_results_on_another_disk_are_the_users_choice(
    folder, tmp_path_factory, monkeypatch
):
    monkeypatch.setattr("hopdata.commands.run.run_workflow", lambda *_, **__: 1)
    disk = tmp_path_factory.mktemp("disk")
    Path("results").rename("before")
    Path("results").symlink_to(disk)
    config = {"study": "trial", "recordings": [{"name": "a", "file": "a.tsv"}]}
    config |= {"markers": {"body": ["a", "b", "c"], "feet": ["d", "e"]}}
    Path("p.json").write_text(json.dumps(RECORD | {"config": config}))
    assert main(["run", "--from", "p.json"]) == 1
    assert (disk / "trial_again" / "config.yaml").is_file()


# Modules of Python that a study's folder could shadow: all of the standard library.
# This file says that one of them was run.
TRAP = "open({!r}, 'a').write(__name__ + ' ')\nraise SystemExit(3)\n"


def set_traps(folder):
    """Put a file for each module of the standard library into a folder; return what they write."""
    mark = folder / "RAN"
    for name in sys.stdlib_module_names:
        (folder / f"{name}.py").write_text(TRAP.format(str(mark)))
    return mark


def test_no_file_beside_the_configuration_is_run(folder):
    mark = set_traps(folder)
    command = [sys.executable, "-m", "snakemake", "--version"]
    subprocess.run(command, cwd=folder, capture_output=True, check=False)
    assert mark.exists(), "the traps do not work"
    mark.unlink()
    program = Path(sys.executable).with_name("hopdata")
    command = [program, "run", "--dry-run"]
    ended = subprocess.run(command, cwd=folder, capture_output=True, check=False)
    assert not mark.exists(), mark.read_text()
    assert ended.returncode == 0, ended.stderr


def test_the_module_run_by_its_name_leaves_the_folder_too(folder):
    """Except for what Python itself imports before any line of hopdata."""
    mark = set_traps(folder)
    names = [sys.executable, "-P", "-c", "import runpy, sys; print(*sys.modules)"]
    loaded = subprocess.run(
        names, capture_output=True, text=True, check=True
    ).stdout.split()
    for name in {one.partition(".")[0] for one in loaded} & sys.stdlib_module_names:
        (folder / f"{name}.py").unlink()
    command = [sys.executable, "-m", "hopdata", "clean", "--all", "--dry-run"]
    ended = subprocess.run(command, cwd=folder, capture_output=True, check=False)
    assert not mark.exists(), mark.read_text()
    assert ended.returncode == 0, ended.stderr


def test_clean_removes_one_study_and_says_so(folder, capsys):
    assert main(["clean", "config.yaml", "--dry-run"]) == 0
    assert Path("results/trial").exists()
    assert main(["clean", "config.yaml"]) == 0
    assert "results/trial: removed" in capsys.readouterr().out
    assert [one.name for one in Path("results").iterdir()] == ["other"]


def test_clean_leaves_the_page_of_a_clone(folder):
    page = Path("results/README.md")
    page.write_text("what will be here")
    assert main(["clean", "--all"]) == 0
    assert [*Path("results").iterdir()] == [page]
    page.unlink()
    assert main(["clean", "--all"]) == 0
    assert not Path("results").exists()


def test_a_run_stops_after_a_stage(folder, monkeypatch, capsys):
    ran = []
    monkeypatch.setattr(
        "hopdata.commands.run.run_workflow", lambda *a, **__: ran.append(a) or 0
    )
    for name in ("level/one.json", "level/one.h5", "verdict.json", "report.html"):
        file = Path("results/trial", name)
        file.parent.mkdir(exist_ok=True)
        file.write_text("{}")
    markers = "markers: {body: [body1, body2, body3], feet: [foot1, foot2]}\n"
    study = f"study: trial\nrecordings: [{{name: one}}]\n{markers}"
    Path("config.yaml").write_text(study)
    assert main(["run", "config.yaml", "--until", "floor_compensation"]) == 0
    assert ran[0][-2:] == ("--until", "floor_compensation")
    assert capsys.readouterr().out.split() == [
        "results/trial/level/one.h5",
        "results/trial/level/one.json",
    ]
    assert main(["run", "config.yaml", "--until", "poincare_section"]) == 1
    error = capsys.readouterr().err
    assert "--until: expected one of simulate, import_recording, " in error
    assert "found 'poincare_section'; did you mean 'poincare_sections'" in error
    table = "subject\tfile\nanna\ta.h5\nben\tb.h5\n"
    Path("group.tsv").write_text(table)
    Path("group.yaml").write_text(f"study: trial\nsamples: group.tsv\n{markers}")
    assert main(["run", "group.yaml", "--until", "verdict"]) == 1
    assert "--until: expected the configuration of a study" in capsys.readouterr().err
    assert len(ran) == 1


def test_a_product_s_target_is_run_by_its_name(folder, monkeypatch, capsys):
    ran = []
    monkeypatch.setattr(
        "hopdata.commands.run.run_workflow", lambda *a, **__: ran.append(a) or 0
    )
    assert main(["run", "dissertation", "--cores", "3", "--force"]) == 0
    config, name, *options = ran[0]
    assert config == ROOT / "config/config.yaml"
    assert name == "dissertation"
    assert options == ["--cores", "3", "dissertation", "--forceall"]
    assert Path("data/sample/hopper.h5").is_file()
    capsys.readouterr()
    assert main(["run", "dissertation", "--until", "verdict"]) == 1
    error = capsys.readouterr().err
    assert "--until: expected the configuration of a study" in error
    assert "found a target, dissertation" in error
    assert main(["run", "dissertations"]) == 1
    assert "dissertations: expected a readable configuration" in capsys.readouterr().err
    # A configuration of this name comes first.
    Path("dissertation").write_text(CONFIG)
    assert main(["run", "dissertation"]) == 1
    assert len(ran) == 1


def test_clean_spares_the_results_of_other_recordings(folder, capsys):
    record = Path("results/trial/provenance.json")
    record.write_text(
        json.dumps({"config": {"recordings": [{"name": "one", "file": "one.tsv"}]}})
    )
    for file, code in (("two.tsv", 1), ("one.tsv", 0)):
        Path("config.yaml").write_text(
            f"study: trial\nrecordings: [{{name: a, file: {file}}}]\n"
        )
        assert main(["clean", "config.yaml"]) == code
        assert record.exists() == bool(code)
    assert "expected the recordings of results/trial (one.tsv), found two.tsv" in (
        capsys.readouterr().err
    )


@pytest.mark.parametrize("study", ["..", "", "../trial", ".", "/tmp"])
def test_clean_stays_within_the_results(folder, study):
    Path("config.yaml").write_text(f"study: '{study}'\n")
    assert main(["clean", "config.yaml"]) == 1
    assert len(list(Path("results").iterdir())) == 2


def test_clean_waits_for_a_run_and_for_a_name(folder, capsys):
    assert main(["clean"]) == 1
    assert "expected a CONFIG, or --all" in capsys.readouterr().err
    Path(".snakemake/locks").mkdir(parents=True)
    Path(".snakemake/locks/0.output.lock").touch()
    assert main(["clean", "--all"]) == 1
    assert Path("results/trial").exists()


def test_doctor_says_what_there_is(folder, capsys):
    assert main(["doctor"]) == 0
    out = capsys.readouterr().out
    for word in (
        "python",
        "numba",
        "cores",
        "memory",
        "compiled",
        "nothing is missing",
    ):
        assert word in out


def test_doctor_names_a_lock(folder, capsys):
    Path(".snakemake/locks").mkdir(parents=True)
    Path(".snakemake/locks/0.output.lock").touch()
    assert main(["doctor"]) == 1
    assert "a run is at work here" in capsys.readouterr().out


def test_of_two_runs_in_one_folder_the_second_says_so(folder, capfd):
    """The first holds the folder until the second has ended."""
    rules = 'rule a:\n    output: "a"\n    shell: "while [ ! -e go ]; do sleep 0.1; done; touch a"\n'
    snakefile = workflow(folder, rules)
    command = [
        sys.executable,
        "-m",
        "snakemake",
        "--cores",
        "1",
        "--snakefile",
        str(snakefile),
    ]
    first = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    locks = folder / ".snakemake/locks"
    try:
        deadline = time.monotonic() + 60
        while (
            not (locks.exists() and any(locks.iterdir()))
            and time.monotonic() < deadline
        ):
            time.sleep(0.1)
        options = (Path("config.yaml"), "trial", "--cores", "1")
        assert run_workflow(*options, snakefile=snakefile) == 1
        assert "locked" in capfd.readouterr().err
    finally:
        (folder / "go").touch()
        assert first.wait(timeout=60) == 0
    assert Path("a").exists()


def test_a_bundled_configuration_is_brought_with_the_files_that_it_names(
    folder, monkeypatch
):
    monkeypatch.setattr("hopdata.commands.run.run_workflow", lambda *_, **__: 1)
    for name, more in (
        ("group", "config/group.tsv"),
        ("sample_control", "data/sample/control.h5"),
    ):
        assert main(["run", f"config/{name}.yaml"]) == 1
        for file in (f"config/{name}.yaml", more):
            assert Path(file).read_bytes() == (ROOT / file).read_bytes()
        Path(more).write_text("mine")
        main(["run", f"config/{name}.yaml"])
        assert Path(more).read_text() == "mine"


def test_a_recording_of_the_sample_is_brought_to_where_pages_name_it(folder):
    file = Path("data/sample/RBDS001runT25markers.tsv")
    bring_recording(file)
    assert file.read_bytes() == (ROOT / file).read_bytes()
    file.write_text("mine")
    bring_recording(file)
    assert file.read_text() == "mine"
    for other in ("data/sample/none.tsv", "sample/hopper.h5", "data/../README.md"):
        bring_recording(Path(other))
        assert not Path(other).exists()


NO_LOCKS = """
#include <errno.h>
int flock(int file, int how) { (void)file; (void)how; errno = ENOLCK; return -1; }
"""


@pytest.mark.workflow
def test_a_study_runs_without_home_and_locks_in_an_odd_folder_in_the_c_locale(tmp_path):
    """Locks are refused as on a network home, if there is a compiler to simulate this."""
    kept = {
        name: text
        for name, text in os.environ.items()
        if name in ("PATH", "VIRTUAL_ENV")
    }
    if sys.platform == "linux" and (compiler := shutil.which("cc")):
        shim = tmp_path / "no_locks.so"
        command = [compiler, "-shared", "-fPIC", "-x", "c", "-", "-o", str(shim)]
        subprocess.run(command, input=NO_LOCKS, text=True, check=True)
        kept["LD_PRELOAD"] = str(shim)
    folder = tmp_path / "Grüße und Maße"
    folder.mkdir()
    (folder / "Läufer 1.h5").symlink_to(part_of_sample(tmp_path / "hopper.h5", 120))
    markers = "markers: {body: [body1, body2, body3], feet: [foot1, foot2, foot3]}\n"
    recordings = "recordings: [{name: one, file: Läufer 1.h5}]\n"
    (folder / "k.yaml").write_text(
        f"study: odd\n{recordings}{markers}", encoding="utf-8"
    )
    target = "results/odd/sections.json"
    mark = set_traps(folder)  # nor does any job run a file of the study's folder
    result = subprocess.run(
        [sys.executable, "-P", "-m", "hopdata", "run", "k.yaml", "--cores", "1", "--", target],
        env={**kept, "HOME": "/dev/null/home", "LC_ALL": "C", "PYTHONPATH": str(ROOT / "src")},
        cwd=folder, capture_output=True, text=True, check=False, timeout=600,
    )  # fmt: skip
    assert not mark.exists(), mark.read_text()
    assert result.returncode == 0, result.stderr
    assert json.loads((folder / target).read_text())["pre_height_m"] > 0


def test_a_simulated_recording_is_the_same_in_the_folder_of_another_study():
    first = read_inputs({"results/trial/simulated/a.h5": "1", "b.c3d": "2"}, "trial")
    again = {"results/trial_again/simulated/a.h5": "1", "b.c3d": "2"}
    assert read_inputs(again, "trial_again") == first
    assert read_inputs({**again, "b.c3d": "3"}, "trial_again") != first
