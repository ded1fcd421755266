"""Whose each file of a folder is."""

from pathlib import PurePosixPath

import pytest

from hopdata.recordings.subjects import tell_subjects


def told(names, stated=None):
    files = [PurePosixPath(name) for name in names]
    return tell_subjects(files, stated or [""] * len(files))


@pytest.mark.parametrize(
    ("names", "subjects", "code"),
    [
        (["S01/a.c3d", "S02/a.c3d"], ["S01", "S02"], "subjects_by_folder"),
        (["x/anna/a.c3d", "x/ben/a.c3d"], ["anna", "ben"], "subjects_by_folder"),
        (["S01_run.c3d", "S02_run.c3d"], ["S01", "S02"], "subjects_by_prefix"),
        (["sub-07_a.tsv", "sub-9_a.tsv"], ["07", "9"], "subjects_by_bids"),
        (
            ["RBDS1runT25.c3d", "RBDS1runT35.c3d", "RBDS2runT25.c3d", "RBDS2r.c3d"],
            ["RBDS1", "RBDS1", "RBDS2", "RBDS2"],
            "subjects_by_prefix",
        ),
        (
            ["p1/walk/a.c3d", "P1/run/a.c3d", "p2/a/a.c3d"],
            ["p1", "p1", "p2"],
            "subjects_by_folder",
        ),
    ],
)
def test_subjects_are_told_apart(names, subjects, code):
    found = told(names)
    assert list(found.names) == subjects
    assert found.reason.code == f"recordings.{code}"


@pytest.mark.parametrize(
    "names",
    [
        ["jump1.c3d", "jump2.c3d", "jump3.c3d"],
        ["walk_1.c3d", "walk_2.c3d", "run_1.c3d", "run_2.c3d"],
        ["static/a.c3d", "trials/b.c3d", "running/c.c3d"],
        ["2021-03-04/a.c3d", "2021-03-05/a.c3d"],
        ["01_jump.c3d", "02_jump.c3d", "03_jump.c3d"],
        ["c3d/a.c3d", "trc/b.c3d"],
    ],
)
def test_deeds_dates_and_numbers_of_trials_are_no_subjects(names):
    found = told(names)
    assert len(found.distinct) == 1
    assert found.reason.code == "recordings.subjects_one"


def test_what_the_file_states_comes_first_and_another_division_is_told():
    names = ["A/t1.c3d", "A/t2.c3d", "B/t3.c3d", "B/t4.c3d"]
    found = told(names, ["Eva", "Eva", "Tom", "Ida"])
    assert found.distinct == ["Eva", "Tom", "Ida"]
    assert found.reason.code == "recordings.subjects_stated"
    assert found.doubt.code == "recordings.subjects_by_folder"
    assert told(names, ["Eva", "Eva", "Tom", "Tom"]).doubt is None


def test_names_that_programs_write_if_nobody_gave_one_are_no_subjects():
    found = told(["S1_a.c3d", "S2_a.c3d"], ["Subject", "Patient"])
    assert found.distinct == ["S1", "S2"]


def test_sessions_are_read_from_the_path():
    found = told(["sub-1/ses-a/x.tsv", "sub-2/ses-b/x.tsv"])
    assert found.sessions == ("a", "b")
