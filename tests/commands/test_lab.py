"""``hopdata init`` of a folder: what stays, what is left out and why, and whose it is."""

import contextlib
import csv
import io
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up_hopper import hopping
from made_up_lab import SUBJECTS, static, trial, write_lab, write_trc
from scipy.signal import savgol_filter
from written_files import write_c3d

from hopdata.__main__ import main
from hopdata.commands.lab import _unfit
from hopdata.config.loading import load_config, read_yaml
from hopdata.recording import Recording
from hopdata.recordings.quality import orientation
from hopdata.samples import read_group


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """Return a folder in which `init` was run on a lab; its trials, what was printed."""
    home = tmp_path_factory.mktemp("lab")
    trials = write_lab(home / "mylab", n_trials=2, n_frames=300)
    printed = io.StringIO()
    with contextlib.chdir(home), contextlib.redirect_stdout(printed):
        assert main(["init", "mylab"]) == 0
    return home, trials, printed.getvalue().splitlines()


@pytest.fixture
def initialised(lab, monkeypatch):
    """Return the lines that `init` printed for the lab, and its trials."""
    home, trials, printed = lab
    monkeypatch.chdir(home)
    return printed, trials


def test_a_lab_becomes_a_group_with_all_its_trials_and_nothing_else(initialised):
    out, trials = initialised
    group = read_group("config/mylab.yaml")
    assert list(group["members"]) == list(SUBJECTS)
    files = [
        entry["file"]
        for member in group["members"].values()
        for entry in member["config"]["recordings"]
    ]
    assert sorted(files) == [f"mylab/{place}" for place in trials]
    content = read_yaml("config/mylab.yaml")
    assert content["samples"] == "config/mylab.tsv"
    assert content["markers"]["feet"] == ["toe1", "toe2", "toe3"]
    assert "  6 of 14 files are in the study: trials with landings" in out
    assert "  3 subjects, by folder" in out
    assert not any("an answer over subjects" in line for line in out)


def test_each_file_left_out_is_told_with_its_reason(initialised):
    out, _ = initialised
    reasons = {}
    for line in out:
        if line.startswith("  left out: "):
            file, _, reason = line.removeprefix("  left out: ").partition(": ")
            reasons[file] = reason
    beginnings = {
        "S01/other name.trc": "the same positions as in S01/hop1.c3d",
        "S01/static.c3d": "hardly any marker moves",
        "S02/cut.trc": "the same positions as in S02/hop1.c3d",
        "S02/old set.c3d": "another set of markers (PELA, ",
        "S02/static.c3d": "hardly any marker moves",
        "S03/broken.c3d": "byte 1: expected a C3D file",
        "S03/static.c3d": "hardly any marker moves",
        "S03/stopped.c3d": "too short for a landing: 20 frames",
    }
    assert reasons.keys() == beginnings.keys()
    for file, beginning in beginnings.items():
        assert reasons[file].startswith(beginning)
    text = "".join(line.lstrip("# ") + " " for line in _lines("config/mylab.yaml"))
    assert all(f"left out: {file}: " in text for file in beginnings)
    assert "  not read, since no reader takes them: 1 .docx" in out


def _lines(file):
    with open(file) as opened:
        return opened.read().splitlines()


def test_the_group_of_a_lab_passes_its_check(initialised, capsys):
    assert main(["check", "config/mylab.yaml"]) == 0
    out = capsys.readouterr().out
    assert "study S01, the first of 3 of a group" in out
    assert "study S03: 'hop2'" in out
    # What is the same in all files is written down, and not asked of each again.
    assert "vertical axis" not in out
    assert "note:" not in out


def test_nothing_is_replaced_without_being_told_to(initialised, capsys):
    for file in ("config/mylab.yaml", "config/mylab.tsv"):
        kept = _lines(file)
        assert main(["init", "mylab"]) == 1
        assert "--force replaces it" in capsys.readouterr().err
        assert _lines(file) == kept


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "day").mkdir()
    return tmp_path / "day"


def test_trials_of_one_subject_become_one_study_with_several_recordings(folder, capsys):
    for k in range(3):
        write_c3d(folder / f"jump{k + 1}.c3d", trial(k, n_frames=300))
    assert main(["init", "day"]) == 0
    assert "one subject, since nothing tells several apart" in capsys.readouterr().out
    config = load_config("config/day.yaml")
    named = [(entry["name"], entry["file"]) for entry in config["recordings"]]
    assert named == [(f"jump{k}", f"day/jump{k}.c3d") for k in (1, 2, 3)]
    assert not (folder.parent / "config/day.tsv").exists()


def test_a_subject_before_the_names_is_told_once(folder, capsys):
    for k in range(3):
        raw = trial(k, n_frames=300)
        named = replace(raw, markers=tuple(f"Anna:{name}" for name in raw.markers))
        write_c3d(folder / f"jump{k + 1}.c3d", named)
    assert main(["init", "day"]) == 0
    assert capsys.readouterr().out.count("without the subject") == 1
    text = Path("config/day.yaml").read_text(encoding="utf-8")
    assert text.count("'Anna:'") == 1
    assert load_config("config/day.yaml")["markers"]["feet"] == ["toe1", "toe2", "toe3"]


def without_breaks(file):
    """Return the comments of a configuration in one line."""
    return Path(file).read_text().replace("\n# ", " ")


def test_prefixes_that_are_no_numbers_of_subjects_are_asked_about(folder, capsys):
    for k, name in enumerate(("anna_1", "anna_2", "ben_1", "ben_2")):
        write_c3d(folder / f"{name}.c3d", trial(k, n_frames=300))
    assert main(["init", "day"]) == 0
    out = capsys.readouterr().out
    assert "2 subjects, by how the file names begin; or one subject" in out
    assert "column subject of config/day.tsv settles it" in out
    assert (
        "the group has 2 subjects, and an answer over subjects takes at least 3" in out
    )
    assert "Note: the group has 2 subjects" in without_breaks("config/day.yaml")
    assert main(["check", "config/day.yaml"]) == 0
    checked = capsys.readouterr().out
    assert "note: the group has 2 subjects, and an answer over subjects" in checked
    assert "the page of each subject stands on its own" in checked
    with open("config/day.tsv") as opened:
        rows = list(csv.DictReader(opened, delimiter="\t"))
    assert [row["subject"] for row in rows] == ["anna", "anna", "ben", "ben"]


def test_files_with_y_up_and_with_z_up_are_read_each_along_its_own(folder):
    write_c3d(folder / "a.c3d", trial(1, n_frames=300))
    write_trc(folder / "b.trc", trial(2, n_frames=300))
    assert main(["init", "day"]) == 0
    config = load_config("config/day.yaml")
    assert len(config["recordings"]) == 2
    assert config["input"]["vertical_axis"] == "auto"


@pytest.fixture
def unsure_of_301_frames(monkeypatch):
    """Files of 301 frames do not show what is up."""
    guessed = orientation.guess_unit_and_up

    def unsure(raw, **options):
        unit, up = guessed(raw, **options)
        return unit, replace(up, is_sure=len(raw.time) != 301)

    monkeypatch.setattr(orientation, "guess_unit_and_up", unsure)


@pytest.mark.usefixtures("unsure_of_301_frames")
def test_files_that_do_not_show_what_is_up_take_it_from_the_others(folder, capsys):
    for k, n_frames in enumerate((300, 310, 301)):
        write_trc(folder / f"jump{k}.trc", trial(k, n_frames=n_frames))
    assert main(["init", "day"]) == 0
    assert "what is up is not clear in 1 file: taken as y" in capsys.readouterr().out
    config = load_config("config/day.yaml")
    assert len(config["recordings"]) == 3
    assert config["input"]["vertical_axis"] == "y"


@pytest.mark.usefixtures("unsure_of_301_frames")
def test_files_that_do_not_show_what_is_up_are_left_out_where_others_disagree(
    folder, capsys
):
    write_c3d(folder / "a.c3d", trial(1, n_frames=300))
    write_trc(folder / "b.trc", trial(2, n_frames=300))
    write_trc(folder / "c.trc", trial(3, n_frames=301))
    assert main(["init", "day"]) == 0
    assert "left out: c.trc" in capsys.readouterr().out
    assert len(load_config("config/day.yaml")["recordings"]) == 2


def test_a_folder_without_any_trial_is_refused_with_the_reasons(folder, capsys):
    write_c3d(folder / "static.c3d", static(1))
    (folder / "empty.trc").write_text("")
    assert main(["init", "day"]) == 1
    error = capsys.readouterr().err
    assert "static.c3d: hardly any marker moves" in error
    assert "empty.trc: " in error


def test_trials_in_which_nothing_lands_are_left_out(folder, capsys):
    lands = trial(1, n_frames=300)
    write_c3d(folder / "lands.c3d", lands)
    # The subject is carried about: everything moves, but no foot comes to rest.
    positions = hopping(2, n_frames=300)[1]
    carried = positions.copy()
    phase = 2 * 3.1416 * lands.time[:, None]
    carried[:, :6, 0] += 0.3 * (phase % 6.28 - 3.14)
    carried[:, :6, 2] = positions[:1, :6, 2] + 1.0 + 0.1 * phase / 6.28
    raw = trial(2, n_frames=300)
    write_c3d(
        folder / "carried.c3d", type(raw)(**(vars(raw) | {"positions": 1e3 * carried}))
    )
    assert main(["init", "day"]) == 0
    out = capsys.readouterr().out
    assert "left out: carried.c3d: " in out
    assert "1 of 2 files are in the study" in out


@pytest.mark.parametrize(
    ("raised_m", "code"),
    [(0.08, "lab_lands_without_descent"), (0.0, "lab_nothing_lands")],
)
def test_feet_that_land_while_the_body_rises_are_told_from_none(raised_m, code):
    time = np.arange(300) / 100
    # Two feet fall freely to the floor at 1.5 s, one 20 ms after the other.
    fallen = [np.clip((instant - time) / 0.128, 0, 1) for instant in (1.5, 1.52)]
    left, right = (np.where(part < 1, raised_m * part**2, 0.0) for part in fallen)
    left[:137] = right[:139] = raised_m
    left[:100] = right[:100] = 0.0
    body = 0.5 + 0.1 * time
    positions = np.random.default_rng(1).normal(0, 3e-4, (300, 5, 3))
    positions[..., 2] += np.stack([body, body, body + 0.1, left, right], axis=1)
    positions[..., 0] += [0, 0.2, 0.1, 0, 0.3]
    markers = ("b1", "b2", "b3", "l", "r")
    roles = ("body",) * 3 + ("foot",) * 2
    reason = _unfit(Recording("rising", time, positions, markers, roles, 100.0))
    assert reason.code == f"recordings.{code}"


def test_a_copy_under_another_name_counts_once(folder, capsys):
    write_c3d(folder / "a.c3d", trial(1, n_frames=300))
    shutil.copy(folder / "a.c3d", folder / "z.c3d")
    write_c3d(folder / "b.c3d", trial(2, n_frames=300))
    assert main(["init", "day"]) == 0
    told = "left out: z.c3d: the same positions as in a.c3d"
    printed = capsys.readouterr().out
    assert told in printed
    # A study refuses the same bytes twice, so nothing keeps them.
    assert "--keep-copies" not in printed
    assert main(["init", "day", "--force", "--keep-copies"]) == 0
    assert "2 of 3 files are in the study" in capsys.readouterr().out


def test_a_trial_that_was_processed_stays_only_if_asked_for(folder, capsys):
    raw = trial(1, n_frames=300)
    write_c3d(folder / "a.c3d", raw)
    smooth = savgol_filter(raw.positions, 9, 2, axis=0)
    write_c3d(folder / "smooth.c3d", replace(raw, positions=smooth))
    write_c3d(folder / "b.c3d", trial(2, n_frames=300))
    assert main(["init", "day"]) == 0
    printed = capsys.readouterr().out
    assert "left out: smooth.c3d: the same trial as in a.c3d, filtered" in printed
    assert "--keep-copies keeps them" in printed
    assert main(["init", "day", "--force", "--keep-copies"]) == 0
    printed = capsys.readouterr().out
    assert "--keep-copies" not in printed
    assert "3 of 3 files are in the study" in printed


def test_a_folder_goes_from_init_over_check_to_run(folder, capfd):
    for k in range(2):
        write_c3d(folder / f"jump{k + 1}.c3d", trial(k, n_frames=300))
    assert main(["init", "day"]) == 0
    assert main(["check", "config/day.yaml"]) == 0
    ran = ["run", "--cores", "1", "--until", "foot_contacts", "config/day.yaml"]
    assert main(ran) == 0
    for k in range(2):
        table = _lines(f"results/day/contacts/jump{k + 1}.csv")
        assert len(table) > 3  # landings below the heads of the columns


def test_a_piece_of_a_trial_is_left_out_for_the_whole_of_it(folder, capsys):
    whole = trial(1, n_frames=600)
    cut = slice(150, 290)
    piece = replace(whole, time=whole.time[cut], positions=whole.positions[cut])
    write_trc(folder / "whole.trc", whole)
    write_c3d(folder / "piece.c3d", piece)
    write_c3d(folder / "other.c3d", trial(2, n_frames=300))
    assert main(["init", "day"]) == 0
    told = "left out: piece.c3d: the same positions as in whole.trc"
    assert told in capsys.readouterr().out
    files = [entry["file"] for entry in load_config("config/day.yaml")["recordings"]]
    assert files == ["day/other.c3d", "day/whole.trc"]


def test_the_working_folder_is_called_by_its_name(folder, monkeypatch):
    write_c3d(folder / "a.c3d", trial(1, n_frames=300))
    monkeypatch.chdir(folder)
    assert main(["init", "."]) == 0
    assert _lines("config/day.yaml")[0].startswith("# Study of day, drafted by")
