"""A group of subjects: their table, a study of each, and one page for all."""

import contextlib
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
import yaml
from checkouts import part_of_sample

from hopdata.__main__ import main
from hopdata.errors import ConfigError
from hopdata.figures.verdict import group_figure
from hopdata.group import put_together
from hopdata.samples import read_group
from hopdata.report.verdict import build_group_page

ROOT = Path(__file__).parents[1]
CONFIG = {
    "study": "jumps",
    "samples": "samples.tsv",
    "markers": {
        "body": ["body1", "body2", "body3"],
        "feet": ["foot1", "foot2", "foot3"],
    },
}


@pytest.fixture
def group(tmp_path, monkeypatch):
    """Return a function that writes a table of samples beside a configuration, and reads both."""
    monkeypatch.chdir(tmp_path)

    def read(table, **keys):
        Path("samples.tsv").write_text(table)
        Path("group.yaml").write_text(yaml.safe_dump(CONFIG | keys))
        return read_group("group.yaml")

    return read


def test_rows_of_a_subject_and_condition_are_one_study(group):
    read = group(
        "subject\tsession\tcondition\tfile\tmass\n"
        "anna\t1\tbare\ta.h5\t60\nanna\t2\tbare\tb.h5\t60\nanna\t1\tshod\tc.h5\t60\nben\t1\tbare\td.h5\t\n"
    )
    members = read["members"]
    assert list(members) == ["anna_bare", "anna_shod", "ben_bare"]
    assert members["anna_bare"]["config"]["recordings"] == [
        {"name": "1", "file": "a.h5"}, {"name": "2", "file": "b.h5"}
    ]  # fmt: skip
    assert members["anna_shod"]["further"] == {"mass": "60"}
    seeds = {member["config"]["seed"] for member in members.values()}
    assert len(seeds) == 3


def test_what_the_files_of_a_study_do_not_share_is_shown_of_each(group):
    table = "subject\tfile\tshoe\tmass\nanna\ta.h5\tred\t60\nanna\tb.h5\tblue\t60\n"
    further = group(table)["members"]["anna"]["further"]
    assert list(further.items()) == [("shoe", "red, blue"), ("mass", "60")]


def test_only_a_line_that_begins_with_a_hash_is_a_remark(group):
    table = "# runs\nsubject\tfile\tmass\t\nP#1\ta#2.h5\t60\t\n#P2\tb.h5\t\nP3\tc.h5\n"
    members = group(table)["members"].values()
    assert [member["subject"] for member in members] == ["P#1", "P3"]
    files = [member["config"]["recordings"][0]["file"] for member in members]
    assert files == ["a#2.h5", "c.h5"]
    assert [member["further"]["mass"] for member in members] == ["60", ""]


def test_a_subject_more_leaves_the_others_alone(group):
    few = group("subject\tfile\nanna\ta.h5\nben\tb.h5\n")["members"]
    more = group("subject\tfile\nzoe\tz.h5\nanna\ta.h5\nben\tb.h5\n")["members"]
    assert {name: more[name] for name in few} == few


def test_names_are_shown_as_written_and_made_safe_for_folders(group):
    table = "subject\tfile\tcondition\nJürgen B.\ta.h5\tslow run\nJürgen B.\tb.h5\tslow run\n"
    members = group(table + "2.1\tc.h5\tbare\n")["members"]
    assert list(members) == ["Jurgen-B-_slow-run", "2-1_bare"]
    first = members["Jurgen-B-_slow-run"]
    assert (first["subject"], first["condition"]) == ("Jürgen B.", "slow run")
    assert len(first["config"]["recordings"]) == 2


@pytest.mark.parametrize(
    ("table", "told"),
    [
        (
            "subject\tpath\nanna\ta.h5\n",
            "columns subject, file, separated by tabs, found 1 rows of subject, path",
        ),
        ("subject\tfile\n", "found 0 rows"),
        ("# runs\n\nsubject\tfile\n\ta.h5\n", "line 4: subject: expected a name"),
        (
            "subject\tfile\nanna\n",
            "line 2: expected the 2 columns subject, file, separated by tabs",
        ),
        ("subject\tfile\nanna\ta.h5\tb.h5\n", "separated by tabs, found 3"),
        (
            "subject\tfile\nanna\ta.h5\nben\t./a.h5\n",
            "line 3: file: expected each file once",
        ),
        (
            "subject\tfile\nanna\ta.h5\nben\t\n",
            "line 3: file: expected a value in each row",
        ),
        (
            "subject\tcondition\tfile\nanna\t\ta.h5\nben\tshod\tb.h5\n",
            "line 2: condition: expected a value in each row",
        ),
        ("subject\tsubject\tfile\nanna\tben\ta.h5\n", "no column twice, and"),
        ("subject\tfile\nanna\ta.h5\nAnna\tb.h5\nben\tc.h5\n", "found 'anna', 'Anna'"),
        ("subject\tfile\nmüde\ta.h5\nben\tc.h5\nmude\tb.h5\n", "found 'müde', 'mude'"),
    ],
)
def test_a_wrong_table_is_refused(group, table, told):
    with pytest.raises(ConfigError, match=re.escape(told)):
        group(table)


def test_a_mistake_common_to_all_is_told_once_with_its_line(group):
    with pytest.raises(ConfigError, match=r"group\.yaml, line \d+: sections\.pre: "):
        group("subject\tfile\nanna\ta.h5\nben\tb.h5\n", sections={"pre": 1})


def row(subject, squared, reason="", conclusion="cannot tell"):
    sizes = {
        "conclusion": conclusion,
        "squared": squared,
        "squared_error": 0.02,
        "allowed": 0.1,
        "left": 0.1,
        "along_error": 0.1,
    }
    return {
        "subject": subject,
        "condition": "",
        "further": {},
        "reason": reason,
        **sizes,
    }


GROUP = {"study": "jumps", "seed": 1, "verdict": {"margin": 0.2, "confidence": 0.95}}


def test_those_without_an_answer_are_listed_and_not_counted():
    rows = [
        *(row(f"s{n}", 0.1 + 0.001 * n) for n in range(5)),
        row("s9", 9.0, "no feet"),
    ]
    found = put_together(rows, GROUP)
    assert found["effect"]["combined"]["n"] == 5
    assert found["conclusion"] == "different"
    assert len(found["members"]) == 6
    assert "Without an answer: 1 of 6 studies." in found["sentence"]
    assert "Without" not in put_together(rows[:5], GROUP)["sentence"]


def test_the_page_says_how_many_landings_a_subject_lacks():
    sizes = {
        "estimate": 0.1,
        "low": 0.0,
        "high": 0.4,
        "conclusion": "cannot tell",
        "landings": 300,
    }
    sizes["name"] = "a"
    rows = [
        row("a", 0.1 + k) | sizes | {"landings_needed": needed}
        for k, needed in enumerate((1234, None, 9))
    ]
    page = build_group_page(put_together(rows, GROUP), [])
    assert page.count('<td class="number">300 (1') == page.count(" needed)</td>") == 1
    assert page.count('<td class="number">300</td>') == 2


def test_the_same_landings_as_two_subjects_are_told():
    """For copies of a file under two names, the size is identical to the bit for any seed."""
    rows = [row(*one) for one in (("a", 0.1), ("b", 0.2), ("c", 0.1), ("d", 0.3))]
    found = put_together(rows, GROUP)
    assert found["effect"] is None
    assert "expected different landings, found the same in: a, c." in found["sentence"]


def test_the_page_shows_the_jump_of_a_study_that_it_decided():
    sizes = {"estimate": 0.02, "low": 0.0, "high": 0.38, "conclusion": "different"}
    jumps = {"decided_by": "jump", "jump_estimate": 0.12, "landings": 500}
    jumps |= {"jump_low": 0.054, "jump_high": 0.17}
    rows = [row(n, 0.01 * k) | sizes | jumps | {"name": n} for k, n in enumerate("abc")]
    group = put_together(rows, GROUP)
    assert group["conclusion"] == "different"
    assert (
        "more than false alarms explain. The outcome jumps in 3 of" in group["sentence"]
    )
    page = build_group_page(group, [])
    assert (
        page.count(">a jump of 12\u00a0%<")
        == page.count(">5.4\u00a0% to 17\u00a0%<")
        == 3
    )
    assert "38\u00a0%" not in page
    (axes,) = group_figure(group).axes
    assert [text.get_text() for text in axes.texts] == [
        "the outcome jumps, by 12\u00a0% (5.4\u00a0% to 17\u00a0%) of what it varies"
    ] * 3


@pytest.mark.parametrize("rows", [[], [row("a", 0.1), row("b", 0.1)]])
def test_too_few_answers_are_no_answer(rows):
    rows = [*rows, row("c", 0.1, "no file")]
    found = put_together(rows, GROUP)
    assert found["effect"] is None
    assert "cannot tell" in found["conclusion"]


@pytest.mark.workflow
def test_a_group_runs_to_its_page(tmp_path):
    """One subject's file is missing and another's is not a recording: the others have answers."""
    sample = part_of_sample(tmp_path / "hopper.h5", 150)
    (tmp_path / "broken.h5").write_bytes(b"no recording")
    table = f"subject\tfile\tkind\nanna\t{sample}\thopper\nben\tgone.h5\t\ncara\tbroken.h5\t\n"
    (tmp_path / "samples.tsv").write_text(table)
    few = {"prediction": {"bootstraps": 40}, "subspaces": {"bootstraps": 40}}
    config = CONFIG | {"figures": {"formats": ["svg"]}, "study": "trio", **few}
    (tmp_path / "group.yaml").write_text(yaml.safe_dump(config))
    result = subprocess.run(
        [sys.executable, "-m", "hopdata", "run", "group.yaml", "--cores", "1"],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
        capture_output=True, text=True, check=False, timeout=600,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert result.stdout.splitlines()[-1] == "results/trio/group.html"
    assert "4 of 4 jobs done" in result.stderr
    found = json.loads((tmp_path / "results/trio/group.json").read_text())
    reasons = {row["subject"]: row["reason"] for row in found["members"]}
    assert reasons["anna"] == ""
    assert "gone.h5" in reasons["ben"]
    assert "broken.h5" in reasons["cara"]
    page = (tmp_path / "results/trio/group.html").read_text()
    for name, reason in reasons.items():
        assert f'href="members/{name}/report.html"' in page
        assert (tmp_path / f"results/trio/members/{name}/report.html").exists()
        assert reason.split(";")[0].split("'")[0] in page


def started(folder, *options):
    """Return a run of the group in a session of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "hopdata", "run", "group.yaml", "--cores", "2", *options],
        cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT / "src")}, start_new_session=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def bytes_of_all(folder):
    """Return all files of a run, including hidden ones; logs record when and how long it ran."""
    files = [path for path in (folder / "results").rglob("*") if path.is_file()]
    names = {
        path: str(path.relative_to(folder))
        for path in files
        if path.parent.name != "logs"
    }
    return {name: path.read_bytes() for path, name in names.items()}


@pytest.mark.workflow
def test_a_locked_folder_is_told_with_the_command_that_unlocks_it(group, capfd):
    group("subject\tfile\nanna\t\n")
    lock = Path(".snakemake/locks/0.output.lock")
    lock.parent.mkdir(parents=True)
    lock.write_text("results/jumps/group.html\n")
    assert main(["run", "group.yaml"]) == 1
    said = [line for line in capfd.readouterr().err.splitlines() if "--unlock" in line]
    assert len(said) == 1
    unlock = shlex.split(said[0].split("unlock the folder: ")[1])
    assert subprocess.run(unlock, check=False, timeout=120).returncode == 0
    assert not lock.exists()


@pytest.mark.workflow
@pytest.mark.skipif(
    "KILLS" not in os.environ, reason="takes minutes: KILLS=2, or KILLS=30"
)
def test_a_group_killed_at_any_time_ends_in_the_same_bytes(tmp_path):
    """KILLS=30 kills a group of eight 30 times: the whole run, or one of its processes."""
    kills, seed = (
        int(os.environ.get(*one)) for one in (("KILLS", "2"), ("KILLS_SEED", "29"))
    )
    names = [f"s{number}" for number in range(8 if kills > 2 else 2)]
    folders = tmp_path / "whole", tmp_path / "killed"
    for folder in folders:
        folder.mkdir()
        (folder / "samples.tsv").write_text(
            "subject\tfile\n" + "".join(f"{n}\t\n" for n in names)
        )
        config = CONFIG | {"simulation": {"hops": 100}}
        (folder / "group.yaml").write_text(yaml.safe_dump(config))
    whole, killed = folders
    begun = time.monotonic()
    assert started(whole).wait(600) == 0
    takes_s, wanted = time.monotonic() - begun, bytes_of_all(whole)
    assert len([name for name in wanted if name.endswith("member.json")]) == len(names)
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    done = rounds = 0
    while done < kills or not (killed / "results/jumps/group.html").exists():
        run = started(killed)
        try:
            wait_s = rng.uniform(0.0, takes_s / 2) if done < kills else 600
            assert run.wait(wait_s) == 0
        except subprocess.TimeoutExpired:
            jobs = psutil.Process(run.pid).children(recursive=True)
            if jobs and rng.random() < 0.5:
                with contextlib.suppress(psutil.NoSuchProcess):
                    jobs[rng.integers(len(jobs))].kill()
            else:
                os.killpg(run.pid, signal.SIGKILL)
            done += 1
            run.wait(600)
            if any((killed / ".snakemake/locks").glob("*")):
                assert started(killed, "--", "--unlock").wait(600) == 0
            continue
        rounds += 1
        found = bytes_of_all(killed)
        assert sorted(found) == sorted(wanted)
        assert [name for name in wanted if found[name] != wanted[name]] == []
        if done < kills:
            shutil.rmtree(killed / "results")
    print(f"{done} kills of a run of {takes_s:.0f} s, compared {rounds} times")


@pytest.mark.parametrize("n_characters", [131_072, 131_073])
def test_a_cell_that_is_too_long_is_refused_with_its_line(group, n_characters):
    table = f"subject\tfile\nanna\ta.h5\nben\t{'x' * n_characters}\n"
    if n_characters > 131_072:
        with pytest.raises(
            ConfigError, match=r"samples.tsv, line 3: expected cells of at most"
        ):
            group(table)
    else:
        assert list(group(table)["members"]) == ["anna", "ben"]
