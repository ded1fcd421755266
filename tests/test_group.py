"""A group of subjects: their table, a study of each, and one page for all."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import psutil
import pytest
import yaml
from checkouts import part_of_sample
from overlaps import text_faults

import hopdata as hd
from hopdata.__main__ import main
from hopdata.figures.sizes import sizes_figure
from hopdata.figures.verdict import group_figure
from hopdata.group import contacts_of, landings_left_out, one_by_one, put_together
from hopdata.report.group_page import build_group_page

ROOT = Path(__file__).parents[1]
CONFIG = {
    "study": "jumps",
    "samples": "samples.tsv",
    "markers": {
        "body": ["body1", "body2", "body3"],
        "feet": ["foot1", "foot2", "foot3"],
    },
}


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
        "upper_bound": 0.36,
        "conclusion": "cannot tell",
        "landings": 300,
    }
    sizes["name"] = "a"
    rows = [
        row("a", 0.1 + k) | sizes | {"landings_needed": needed}
        for k, needed in enumerate((1234, None, 9))
    ]
    page = build_group_page(put_together(rows, GROUP), []).replace("\u00a0", " ")
    assert page.count(">300 (1") == page.count(" show 20 %)</td>") == 1
    assert page.count(">300</td>") == 2
    assert page.count("at most 36") == 3
    assert "0 % to 40" not in page


def test_the_same_landings_as_two_subjects_are_told():
    """For copies of a file under two names, the size is identical to the bit for any seed."""
    rows = [row(*one) for one in (("a", 0.1), ("b", 0.2), ("c", 0.1), ("d", 0.3))]
    found = put_together(rows, GROUP)
    assert found["effect"] is None
    assert "expected different landings, found the same in: a, c." in found["sentence"]


def test_the_page_shows_the_jump_of_a_study_that_it_decided():
    sizes = {"estimate": 0.02, "low": 0.0, "high": 0.38, "conclusion": "different"}
    jumps = {"decided_by": "jump", "jump_estimate": 0.12, "landings": 500}
    jumps |= {"jump_low": 0.054, "jump_high": 0.17, "jump_p_value": 0.009}
    rows = [row(n, 0.01 * k) | sizes | jumps | {"name": n} for k, n in enumerate("abc")]
    group = put_together(rows, GROUP)
    assert group["conclusion"] == "different"
    assert "3 of 3 studies are on their own" in group["sentence"]
    corrected = "corrected for the number of studies (Holm, 95 %), in {}."
    assert (
        "The outcome jumps in 3 of them, which the size does not show; "
        in (group["sentence"])
    )
    assert corrected.format(3) in group["sentence"]
    others = [row(f"o{k}", 0.3 + k) for k in range(5)]
    larger = put_together([*rows, *others], GROUP)["sentence"]
    assert "The outcome jumps in 3 of them" in larger
    assert corrected.format(0) in larger
    page = build_group_page(group, [])
    assert (
        page.count(">a jump of 12\u00a0%<")
        == page.count(">5.4\u00a0% to 17\u00a0%<")
        == 3
    )
    assert "38\u00a0%" not in page
    (axes,) = group_figure(group).axes
    assert [text.get_text() for text in axes.texts] == [
        "the outcome jumps, by 12\u00a0% (5.4\u00a0% to 17\u00a0%) of the map"
    ] * 3


def test_the_size_at_the_contact_stands_beside_that_over_the_landings():
    """The size of all is over the landings, so the squares of all rows are, too."""
    rows = made_up(5)[1:]
    at_contact = {"saturates": True, "estimate": 0.6, "high": 0.9, "upper_bound": 0.8}
    sizes = ("estimate", "low", "high", "upper_bound")
    before = {f"over_landings_{size}": rows[1][size] for size in sizes}
    plain = group_figure(put_together(rows, GROUP))
    rows[1] |= before | at_contact
    group = put_together(rows, GROUP)
    figure = group_figure(group)
    squares, triangles = (_marks(figure, mark) for mark in "s^")
    assert _marks(plain, "s") == squares
    assert _marks(plain, "^") == []
    assert triangles == [60.0]
    assert plain.legends == []
    assert len(figure.legends[0].get_texts()) == 2
    assert text_faults(figure) == []
    page = build_group_page(group, [])
    over = f"{100 * before['over_landings_estimate']:.2g}"
    assert page.count(f"60\u00a0% (over the landings {over}\u00a0%)") == 1
    assert "shrink as the contacts" in page
    assert "shrink as the contacts" not in build_group_page(
        put_together(made_up(5), GROUP), []
    )


def in_conditions(number):
    """Return rows of subjects that differ in one of two conditions."""
    rows = []
    for k, one in enumerate(made_up(2 * number)[1:]):
        coupled = k % 2 == 0
        squared = 0.5 + 0.01 * k if coupled else 0.0001 * k
        more = {"subject": f"s{k // 2}", "condition": "coupled" if coupled else "c1"}
        more |= {"squared": squared, "estimate": squared**0.5, "reason": ""}
        more |= {"high": squared**0.5 + 0.1, "conclusion": "cannot tell"}
        rows.append({**one, **more})
    return rows


def test_each_condition_has_its_own_answer_and_none_is_of_all():
    """The rms of both, some 50 %, is true of neither."""
    group = put_together(in_conditions(8), GROUP)
    coupled, c1 = group["by_condition"]
    assert group["effect"] is None
    assert (coupled["conclusion"], c1["conclusion"]) == ("different", "no difference")
    assert coupled["effect"]["estimate"] > 0.6 > 0.1 > c1["effect"]["estimate"]
    assert group["conclusion"] == "different"
    for one in group["by_condition"]:
        assert (
            f"{one['condition']}: Over {one['subjects']} subjects" in group["sentence"]
        )
        assert one["sentence"] in group["sentence"]
    assert "conditions differ: coupled (" in group["sentence"]
    figure = group_figure(group)
    assert sorted(_marks(figure, "D")) == pytest.approx(
        [100 * one["effect"]["estimate"] for one in (c1, coupled)]
    )
    names = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert names[-2:] == ["all, coupled", "all, c1"]
    assert text_faults(figure) == []
    page = build_group_page(group, [])
    assert "Over the subjects of each condition" in page
    assert "They are not pooled" in page


def test_a_condition_of_few_subjects_has_no_size():
    rows = [row for row in in_conditions(8) if row["subject"] < "s3"]
    rows = [row for row in rows if (row["subject"], row["condition"]) != ("s1", "c1")]
    coupled, c1 = put_together(rows, GROUP)["by_condition"]
    assert (coupled["subjects"], c1["subjects"]) == (3, 2)
    assert coupled["effect"] is not None
    assert c1["effect"] is None
    assert c1["conclusion"] == "cannot tell"
    assert "expected" not in c1["sentence"]
    assert "answer of their own: 2 (" in c1["sentence"]


def test_two_subjects_are_told_their_own_answers_and_three_are_judged():
    rows = [row(name, 0.01 * k) for k, name in enumerate("abc", 1)]
    of_two = put_together(rows[:2], GROUP)
    assert of_two["conclusion"] == "cannot tell"
    assert of_two["effect"] is None
    assert "expected" not in of_two["sentence"]
    answers = "; ".join(f"{one['subject']}: {one['conclusion']}" for one in rows[:2])
    assert f"their own: 2 ({answers}). No answer over subjects" in of_two["sentence"]
    of_three = put_together(rows, GROUP)
    assert of_three["effect"] is not None
    assert "No answer over subjects" not in of_three["sentence"]


def _marks(figure, mark):
    """Return the places of all marks of this kind, per cent."""
    lines = [line for line in figure.axes[0].get_lines() if line.get_marker() == mark]
    return [float(x) for line in lines for x in line.get_xdata()]


def made_up(number):
    """Return rows of studies with sizes up to 40 %, every tenth without an answer."""
    rng = np.random.default_rng(number)
    rows = []
    for k in range(number):
        size = float(rng.uniform(0.0, 0.4))
        conclusion = "different" if size > 0.3 else "no difference"
        sizes = {"estimate": size, "low": 0.0, "high": size + 0.1, "landings": 400}
        more = {"name": f"s{k}", "upper_bound": size, "quality": [["floor", "poor"]]}
        reason = "no feet" if k % 10 == 0 else ""
        rows.append(row(f"s{k}", size**2, reason, conclusion) | sizes | more)
    return rows


def test_a_large_group_is_summed_up():
    rows = made_up(300)
    assert not one_by_one(rows)
    assert one_by_one(rows[:100])
    group = put_together(rows, GROUP)
    page = build_group_page(group, [], one_by_one=False)
    different = sum(not one["reason"] and one["estimate"] > 0.3 for one in rows)
    assert f"<summary>different: {different}</summary>" in page
    assert f"<summary>no difference: {270 - different}</summary>" in page
    assert '<th scope="row">no feet</th><td class="number">30</td>' in page
    assert '<th scope="row">floor</th><td class="number">300</td>' in page
    # Each study is there once, folded; none is in a small group's one table.
    assert all(page.count(f'href="members/s{k}/report.html"') == 1 for k in range(300))
    assert "<summary>different" not in build_group_page(group, [])
    histogram, whole = sizes_figure(group).axes
    assert sum(bar.get_height() for bar in histogram.patches) == 270
    assert whole.get_xlim() == histogram.get_xlim()


def test_conditions_of_a_large_group_have_a_histogram_each_unless_they_are_many():
    rows = made_up(300)
    for conditions in ("ab", "abcdefg"):
        for k, one in enumerate(rows):
            one["condition"] = conditions[k % len(conditions)]
            one["subject"] = f"s{k // len(conditions)}"
        *histograms, _ = sizes_figure(put_together(rows, GROUP)).axes
        assert len(histograms) == {2: 2, 7: 1}[len(conditions)]
        bars = [bar.get_height() for axes in histograms for bar in axes.patches]
        assert sum(bars) == 270


def test_one_reason_of_all_is_told_once():
    """The sentence at the top gives the first reason, so equal ones add nothing."""
    same = [made_up(4)[k] | {"reason": "expected 150, found 149"} for k in range(3)]
    page = build_group_page(put_together(same, GROUP), [])
    assert page.count("expected 150, found 149") == 1
    assert page.count(">no answer<") == 3
    same[1]["reason"] = "no feet"
    page = build_group_page(put_together(same, GROUP), [])
    assert page.count("expected 150, found 149") == 3
    assert page.count(">no answer: no feet<") == 1


def landed(n_feet=2, unsure=1):
    """Return a table of four landings; of the last a contact is not known."""
    names = ["left", "right", "third"][:n_feet]
    table = pd.DataFrame({"schedule": ["1>2", "1>2", "2>1", "1>2"]})
    for k, name in enumerate(names):
        table[f"contact_{name}_s"] = [1.0, 2.0, 3.0, 4.0]
        table[f"se_{name}_s"] = [1e-4, 2e-4, 3e-4, 9.0]
        table[f"common_{name}_s"] = 1e-3 * (k + 1)
    table.loc[3, "contact_left_s"] = np.nan
    table["order_class"] = table["schedule"]
    table.loc[: unsure - 1, "order_class"] = "ambiguous"
    return table.assign(excluded=[True, False, False, True], reason="")


def test_contacts_of_a_study_are_told_whatever_its_answer():
    """Also of landings that the maps do not use; one without all contacts is not timed."""
    found = contacts_of(landed())
    assert (found["landings"], found["timed"]) == (4, 3)
    assert [one["se_s"] for one in found["feet"]] == [2e-4, 2e-4]
    assert [one["common_s"] for one in found["feet"]] == [1e-3, 2e-3]
    assert found["orders"] == [
        {"order": "left → right", "seen": 2, "sure": 1},
        {"order": "right → left", "seen": 1, "sure": 1},
    ]
    none = contacts_of(landed().assign(contact_left_s=np.nan))
    assert none["timed"] == 0
    assert none["feet"][0]["se_s"] is None
    assert none["orders"] == []


def test_timed_landings_are_counted_of_those_that_the_page_of_the_study_counts():
    """A landing without any timed foot is one; a descent in which none lands is not."""
    table = landed()
    feet = ["contact_left_s", "contact_right_s"]
    table.loc[3, feet] = np.nan
    untimed = contacts_of(table)
    assert (untimed["landings"], untimed["timed"]) == (4, 3)
    table.loc[3, "reason"] = "no foot of the study landed"
    assert contacts_of(table)["landings"] == 3


def test_landings_that_a_study_left_out_are_counted_and_other_descents_are_not():
    table = landed().assign(reason=["by hand", "", "", "no foot of the study landed"])
    assert landings_left_out(table) == 1
    assert landings_left_out(table.assign(excluded=False)) == 0


def undecided(subject, **more):
    limit = {"cause": "noise", "costs": 0.1, "said": "", "code": "maps.limit_noise"}
    known = row(subject, 0.1, "expected 150, found 149") | {"name": subject}
    return known | {"what_now": [limit], "contacts": contacts_of(landed())} | more


def test_a_group_without_an_answer_shows_contacts_and_what_to_do():
    group = put_together([undecided("a"), undecided("b")], GROUP)
    page = build_group_page(group, []).replace("\u00a0", " ")
    assert page.count(">left → right: 2; right → left: 1<") == 2
    assert page.count(">left 1, right 2<") == 2, "the common errors of the feet differ"
    assert page.count(">0.2<") == 2, "the median errors do not"
    assert page.count(">2 of 3<") == 2
    assert "Noise: 2 of 2 studies (a; b)." in page
    assert "Put the body markers on bone" in page
    assert "Two feet have one kink only" in page
    assert "Legs that move in flight" not in page
    three = [undecided(n, contacts=contacts_of(landed(3))) for n in "ab"]
    page = build_group_page(put_together(three, GROUP), [])
    assert "Two feet have one kink only" not in page


def test_lags_over_subjects_are_told_whatever_the_answer():
    """In ms, and None where one subject leaves no interval."""
    lag = {"foot": "left", "other": "right", "landings": 9, "common_s": None}
    rows = []
    for subject, mean_s in zip("ab", (0.004, 0.006), strict=True):
        own = {**lag, "mean_s": mean_s, "median_abs_s": 0.007}
        rows.append(undecided(subject, lags=[own]))
    group = put_together(rows, GROUP)
    (told,) = group["lags"]
    assert told["subjects"] == 2
    assert told["common_s"] is None
    page = build_group_page(group, [])
    assert ">left minus right<" in page
    assert ">5.00<" in page
    assert ">7.00<" in page
    assert put_together(rows[:1], GROUP)["lags"][0]["low_s"] is None
    assert "Lags of the feet" not in build_group_page(
        put_together(made_up(3), GROUP), []
    )


def test_a_group_with_an_answer_is_told_nothing_to_do():
    rows = [one | {"contacts": contacts_of(landed())} for one in made_up(12)]
    group = put_together(rows, GROUP) | {"conclusion": "no difference"}
    page = build_group_page(group, []).replace("\u00a0", " ")
    assert "what now?" not in page
    bound = f"{100 * group['effect']['upper_bound']:.2g} %"
    assert f">at most {bound}<" in page
    assert "the number to print" in page
    tiles = page.partition('<dl class="highlights">')[2].partition("</dl>")[0]
    assert f"to {100 * group['effect']['high']:.2g} %" not in tiles


def test_few_of_many_copies_are_named():
    rows = [row(f"s{k}", 0.1) for k in range(20)]
    sentence = put_together(rows, GROUP)["sentence"]
    assert "found the same in: s0, s1, s2, s3, s4 and 15 others." in sentence


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
    few = {
        "prediction": {"bootstraps": 40},
        "distances": {"enabled": False},
        "verdict": {"flips": 99},
    }
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
    assert found["lags"][0]["subjects"] == 1
    assert "gone.h5" in reasons["ben"]
    assert "broken.h5" in reasons["cara"]
    page = (tmp_path / "results/trio/group.html").read_text()
    for name, reason in reasons.items():
        assert f'href="members/{name}/report.html"' in page
        assert (tmp_path / f"results/trio/members/{name}/report.html").exists()
        assert reason.split(";")[0].split("'")[0] in page

    group = hd.load(tmp_path / "results/trio")
    assert [*group] == [*group.studies] == ["anna"]
    assert len(group.members) == 3
    assert group.members["kind"].tolist()[0] == "hopper"
    assert group.verdict is None
    assert group.sentence in repr(group)
    assert "answer of their own: 1 (anna: " in group.sentence
    assert "3 studies" in group.methods().text
    assert group.plot().axes
    with pytest.raises(hd.HopdataError, match=r"ben: expected a member .*gone\.h5"):
        _ = group["ben"]
    with pytest.raises(hd.HopdataError, match="did you mean 'anna'"):
        _ = group["ana"]
    anna = group["anna"]
    assert anna.verdict.sentence in repr(anna)
    assert len(anna.recordings[0].time) == len(anna.imported[0].time) > 1000
    assert "of 1 recording (15,000 frames" in anna.methods().text
    assert repr(anna.methods()).startswith("Motion capture")
    assert anna.home_frame().touchdowns.equals(anna.touchdowns)
    assert anna.floor_compensation()["recording1"].floor_model.degree > 0
    answer = tmp_path / "results/trio/group.json"
    answer.write_text(answer.read_text().replace('"version":', '"former":'))
    with pytest.raises(hd.HopdataError, match="found one of no version"):
        hd.load(tmp_path / "results/trio")


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
@pytest.mark.skipif("'ALL' not in os.environ", reason="takes 20 s: ALL=1")
def test_a_locked_folder_is_told_with_the_option_that_takes_it_over(
    tmp_path, monkeypatch, capfd
):
    monkeypatch.chdir(tmp_path)
    Path("samples.tsv").write_text("subject\tfile\nanna\t\n")
    Path("group.yaml").write_text(yaml.safe_dump(CONFIG))
    lock = Path(".snakemake/locks/0.output.lock")
    lock.parent.mkdir(parents=True)
    lock.write_text("results/jumps/group.html\n")
    # Nobody can know whose lock it is.
    assert main(["run", "group.yaml"]) == 1
    assert "hopdata run --if-locked take" in capfd.readouterr().err
    assert lock.exists()
    main(["run", "group.yaml", "--if-locked", "take"])
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
