"""``hopdata check`` reports its guesses."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from external_blocks import block, columns
from made_up_files import export
from made_up_hopper import MARKERS, hopping
from trc_files import trc_text

from hopdata.__main__ import main
from hopdata.commands import check as check_module
from hopdata.commands.check import describe_external
from hopdata.recordings.importing import import_recording
from hopdata.recordings.readers.hdf5 import write_recording

STUDY = """study: trial
input: {{unit: {unit}}}
recordings:
  - {{name: one, file: {file}}}
markers: {{body: [hip1, hip2, hip3], feet: [toe1, toe2, toe3]}}
"""


@pytest.fixture
def check(tmp_path, capsys):
    """Return a function that gives the notes of a check that finds the study sound."""

    def checked(file, unit="auto"):
        config = tmp_path / "study.yaml"
        config.write_text(STUDY.format(file=file, unit=unit))
        assert main(["check", str(config)]) == 0
        return [
            x for x in capsys.readouterr().out.splitlines() if x.startswith("note:")
        ]

    return checked


def test_a_unit_that_was_guessed_is_noted_with_the_key_that_settles_it(check, tmp_path):
    file = tmp_path / "silent.trc"
    file.write_text(trc_text(1000 * hopping(1)[1], MARKERS, values={"Units": None}))
    (note,) = check(file)
    assert note == (
        f"note: {file}: unit: expected the file to state it, found none; taken for mm, in which "
        "the markers span 0.936 m and fall at 9.81 m/s² in 37 % of the frames; input.unit: mm "
        "makes it certain"
    )
    assert check(file, unit="mm") == []


def test_a_unit_that_the_format_prescribes_is_not_noted(check, tmp_path):
    assert check(export(tmp_path)) == []


def test_a_rate_that_is_not_sure_is_asked_for_by_the_key_that_answers(
    check, tmp_path, capsys
):
    file = export(tmp_path, frequency="50", counters=False)
    question = "input.rate_hz: 50 or 100? 50 is not sure"
    (note,) = check(file)
    assert note.startswith(f"note: {file}: {question}")
    main(["inspect", str(file)])
    assert question in " ".join(capsys.readouterr().out.split())
    (note,) = check(file, unit="auto, rate_hz: 100")
    assert (
        note
        == f"note: {file}: frame rate: 100 Hz as in input.rate_hz; the file states 50"
    )


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [("toe1 toe2", "is a comma missing?"), ("toe11", "did you mean 'toe1'?")],
)
def test_a_wrong_marker_is_told_with_the_configuration_s_line(
    tmp_path, capsys, wrong, hint
):
    config = tmp_path / "study.yaml"
    study = STUDY.format(file=export(tmp_path), unit="auto")
    config.write_text(study.replace("[toe1, toe2,", f"[{wrong},"))
    assert main(["check", str(config)]) == 1
    told = capsys.readouterr().err
    assert f"{config}, line 5: " in told
    assert f"found '{wrong}'; {hint}" in told


def test_whole_millimetres_are_noted(check, tmp_path):
    (note,) = check(export(tmp_path, np.round(hopping(1)[1], 3)))
    assert "coordinates are rounded to 1 mm, which adds noise of 0.29 mm" in note


def test_contacts_of_another_device_are_counted_by_column(tmp_path):
    path = tmp_path / "switches.csv"
    path.write_text("left,both\n0.5,0.25\n1.5,\n2.125,\n")
    feet_of_columns = columns(left=["toe1"], both=["toe1", "toe2"])
    contacts = block("contacts", file=str(path), columns=feet_of_columns)
    entry = {"contacts": contacts, "forces": block("forces")}
    assert describe_external(entry, feet=["toe1", "toe2"], span_s=(0.0, 3.0)) == [
        "  contacts  left: 3, 0.500 to 2.125 s, of toe1",
        "  contacts  both: 1, 0.250 to 0.250 s, of toe1, toe2",
    ]


# What `hopdata check` says about forces: their place relative to the recording.


@pytest.fixture
def plate(tmp_path):
    path = tmp_path / "plate.csv"
    path.write_text("Fz\n" + "0\n30\n" * 50)
    return path


@pytest.mark.parametrize(
    ("rate_hz", "offset_s", "said"),
    [
        (100.0, 0.0, ""),
        (100.0, 0.2, ""),
        (50.0, 0.0, "covers 100 % of the recording, 49 % of it lies outside"),
        (1000.0, 0.0, "covers 10 % of the recording, 0 % of it lies outside"),
        (100.0, 5.0, "covers 0 % of the recording, 100 % of it lies outside"),
    ],
)
def test_forces_of_a_wrong_clock_are_pointed_out(plate, rate_hz, offset_s, said):
    forces = block(
        "forces",
        file=str(plate),
        rate_hz=rate_hz,
        offset_s=offset_s,
        columns=columns(Fz=["foot1"]),
    )
    entry = {"contacts": block("contacts"), "forces": forces}
    (line,) = describe_external(entry, feet=["foot1"], span_s=(0.0, 1.0))
    assert said in line
    assert ("outside" in line) == bool(said)


@pytest.mark.parametrize(
    ("unit", "weight_n", "extent_m", "said"),
    [
        ("N", None, 0.5, ""),
        ("N", None, None, ""),
        ("N", 14.0, 0.5, ""),
        (
            "kN",
            None,
            0.5,
            "15000 N on average, where a body of 0.5 m weighs 1.2 to 6100 N",
        ),
        (
            "N",
            None,
            1.8,
            "15 N on average, where a body of 1.8 m weighs 57 to 290000 N",
        ),
        ("kN", 14.0, 0.5, "on average 1070 times the body weight"),
        ("body_weight", None, 0.5, "on average 15 times the body weight"),
    ],
)
def test_forces_in_another_unit_are_pointed_out(plate, unit, weight_n, extent_m, said):
    forces = block(
        "forces", file=str(plate), rate_hz=100.0, unit=unit, body_weight_n=weight_n,
        columns=columns(Fz=["foot1"]),
    )  # fmt: skip
    entry = {"contacts": block("contacts"), "forces": forces}
    (line,) = describe_external(
        entry, feet=["foot1"], span_s=(0.0, 1.0), extent_m=extent_m
    )
    assert said in line
    assert ("is forces.unit right?" in line) == bool(said)


def test_of_a_group_all_files_are_read_and_the_first_study_is_foretold(
    tmp_path, capsys
):
    table, config = tmp_path / "group.tsv", tmp_path / "group.yaml"
    (_, positions), other = hopping(1), tmp_path / "other"
    other.mkdir()
    files = export(tmp_path), export(other, positions[..., [0, 2, 1]])
    copy = shutil.copy(files[0], tmp_path / "tuesday.tsv")
    markers = "markers: {body: [body1, body2, body3], feet: [foot1, foot2, foot3]}"
    config.write_text(f"study: all\nsamples: {table}\n{markers}\n")
    table.write_text("subject\tfile\ncat\t\ndog\t\n")
    assert main(["check", str(config)]) == 0
    assert capsys.readouterr().out.startswith("study cat, the first of 2 of a group\n")
    config.write_text(
        config.read_text().replace("body1, body2, body3", "hip1, hip2, hip3")
    )
    config.write_text(config.read_text().replace("foot", "toe"))
    table.write_text(f"subject\tfile\ncat\t{files[0]}\ndog\t{copy}\nemu\t{files[1]}\n")
    assert main(["check", str(config)]) == 1
    told = capsys.readouterr()
    assert "study dog: 'recording1': " in told.out
    assert f"{files[1]}: vertical axis z: expected" in told.err


@pytest.mark.parametrize(
    ("conditions", "told"),
    [
        (["", ""], ["the group has 2 subjects, and"]),
        (["", "", ""], []),
        (["a", "a", "a", "b"], ["has 1 subject in the condition b, and"]),
    ],
)
def test_conditions_with_too_few_subjects_for_an_answer_are_told(
    tmp_path, conditions, told
):
    table, config = tmp_path / "group.tsv", tmp_path / "group.yaml"
    rows = [f"s{k}\t{condition}\t" for k, condition in enumerate(conditions)]
    table.write_text("\n".join(["subject\tcondition\tfile", *rows]) + "\n")
    markers = "markers: {body: [body1, body2, body3], feet: [foot1, foot2, foot3]}"
    config.write_text(f"study: all\nsamples: {table}\n{markers}\n")
    found = check_module._few_subjects(str(config))
    assert len(found) == len(told)
    for one, words in zip(found, told, strict=True):
        assert words in one
        assert "takes at least 3" in one


def test_a_marker_that_lands_as_the_feet_do_and_has_no_role_is_told(tmp_path, capsys):
    names = ("hip1", "hip2", "hip3", "toe1", "toe2", "nose", "post")
    file = export(tmp_path, names=names)
    config = tmp_path / "study.yaml"
    study = STUDY.format(file=file, unit="auto").replace("toe1, toe2, toe3", "{feet}")
    told = f"note: {file}: nose come to rest on the floor as often and as low"
    for feet, is_told in (("toe1, toe2", True), ("toe1, toe2, nose", False)):
        config.write_text(study.replace("{feet}", feet))
        assert main(["check", str(config)]) == 0
        assert (told in capsys.readouterr().out) == is_told


def test_a_scene_of_one_s_own_is_foretold_from_what_a_run_has_simulated(
    tmp_path, monkeypatch, capsys
):
    """Before, the command that simulates it is told; of others no code is named."""
    monkeypatch.chdir(tmp_path)
    bodies = ["body1", "body2", "body3"]
    feet = ["foot1", "foot2", "foot3"]
    study = {
        "study": "trial",
        "recordings": [{"name": "one"}],
        "markers": {"body": bodies, "feet": feet},
        "simulation": {"scene": "hopper", "hops": 20},
    }
    config = tmp_path / "study.yaml"
    config.write_text(yaml.safe_dump(study))
    assert main(["check", "study.yaml"]) == 0
    out = capsys.readouterr().out
    kept = Path("results/trial/simulated/one.h5")
    assert "one: simulated, 20 hops; no forecast before it is there: " in out
    assert f"'hopdata run study.yaml --until simulate' writes {kept}, then" in out
    assert "forecast" not in out.splitlines()

    kept.parent.mkdir(parents=True)
    file = export(tmp_path, names=(*bodies, *feet, "boom"))
    known, _ = import_recording(file, name="one", markers=study["markers"])
    write_recording(kept, known)
    assert main(["check", "study.yaml"]) == 0
    out = capsys.readouterr().out
    assert f"one: simulated, 20 hops, as in {kept}" in out
    assert "forecast" in out.splitlines()
    assert "is older than" not in out
    os.utime(kept, (0, 0))
    main(["check", "study.yaml"])
    assert f"{kept} is older than study.yaml" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("there", "told"),
    [
        (0, ""),
        (1, "2 of its 3 recordings are still to be simulated"),
    ],
)
def test_recordings_that_are_still_to_be_simulated_are_counted(there, told):
    """Without any, each line on a recording has told it."""
    config = {"study": "trial", "recordings": [{}, {}, {}]}
    line = check_module._conclusion("study.yaml", config, [object()] * there, [], 1)
    assert told in line
    assert ("can be run, but" in line) == bool(told)


def test_the_command_that_simulates_a_scene_of_one_s_own_names_it(tmp_path):
    config = {
        "study": "s",
        "recordings": [{"name": "one", "simulation": {}}],
        "simulation": {"scene": "lander:Lander", "hops": 20},
    }
    file = tmp_path / "s.yaml"
    (line,) = check_module._simulated(str(file), config, config["recordings"][0])
    assert "--scene lander:Lander --until simulate'" in line


def test_of_a_group_the_longest_study_is_foretold(tmp_path, monkeypatch, capsys):
    table, config = tmp_path / "group.tsv", tmp_path / "group.yaml"
    rows = ["subject\tfile"]
    for subject, n_frames in (("ant", 300), ("bee", 600), ("cat", 400)):
        (tmp_path / subject).mkdir()
        file = export(tmp_path / subject, hopping(1, n_frames=n_frames)[1])
        rows.append(f"{subject}\t{file}")
    table.write_text("\n".join(rows) + "\n")
    markers = "markers: {body: [hip1, hip2, hip3], feet: [toe1, toe2, toe3]}"
    config.write_text(f"study: all\nsamples: {table}\n{markers}\n")
    foretold = []

    def foretell(of_study, recordings):
        foretold.append((of_study["study"], len(recordings[0].time)))
        return "it is too short"

    monkeypatch.setattr("hopdata.commands.check._foretell", foretell)
    assert main(["check", str(config)]) == 0
    assert foretold == [("bee", 600)]
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.endswith(
        "it is too short (forecast of bee, the longest of its 3 studies)"
    )


def test_the_bundled_study_is_checked_outside_a_clone(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["check", "config/quadruped.yaml"]) == 0
    told = capsys.readouterr().out
    assert "config/quadruped.yaml: copied from the installation" in told
    assert "config/quadruped.yaml is sound" in told
    assert main(["check", "config/quadrupet.yaml"]) == 1
    assert "did you mean 'quadruped.yaml'?" in capsys.readouterr().err
