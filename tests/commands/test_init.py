import os
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from checkouts import ROOT, part_of_sample
from made_up_files import export
from made_up_hopper import MARKERS, hopping, with_spike
from made_up_jumps import STYLES, jumping
from made_up_runner import NAMES, RATE_HZ, SHORTEST_M, runner

from hopdata.__main__ import main
from hopdata.commands.init import (
    Draft,
    draft_config,
    print_next,
    scalar,
    too_few_landings,
)
from hopdata.config.loading import load_config
from hopdata.jobs import study_name
from hopdata.landings.role_guesses import guessed_roles
from hopdata.recording import Recording
from hopdata.recordings.axes import rotate_up
from hopdata.recordings.quality.inspection import inspect_recording
from hopdata.recordings.quality.roles import guess_roles
from hopdata.recordings.raw import RawRecording


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_sample_gets_the_roles_of_its_own_configuration(folder, capsys):
    assert main(["init", str(part_of_sample(folder / "hopper.h5", 200))]) == 0
    drafted = load_config("config/hopper.yaml")
    bundled = load_config(ROOT / "config/config.yaml", check_files=False)
    assert drafted["markers"] == bundled["markers"]
    assert (
        drafted["home"]["marker"] is None
    )  # the bundled study names one as an example
    changed = {key for key in bundled if drafted[key] != bundled[key]}
    assert changed == {"study", "recordings", "input", "home", "report", "simulation"}
    known = {
        "expected_noise_m": bundled["report"]["expected_noise_m"]
    }  # of the user's own cameras
    assert {**drafted["report"], **known} == bundled["report"]
    assert drafted["input"] == {**bundled["input"], "unit": "m"}
    assert main(["check", "config/hopper.yaml"]) == 0
    assert "is sound" in capsys.readouterr().out


def test_feet_are_found_on_a_slope(folder, capsys):
    positions = hopping(1)[1]
    gone = 0.005 * np.cumsum(positions[:, 3, 2] > 0.01)  # in flight
    positions[:, :6, :2] += np.stack([gone, np.sin(2 * gone)], axis=1)[:, None]
    export(folder, positions)
    main(["init", "monday.tsv", "-o", "config/level.yaml"])
    assert "floor that slopes" not in capsys.readouterr().out
    positions[:, :6, 2] += np.tan(np.deg2rad(8)) * positions[:, :6, 0]
    export(folder, positions)
    main(["init", "monday.tsv", "-o", "config/slope.yaml"])
    assert "; on a floor that slopes" in capsys.readouterr().out
    for name in ("level", "slope"):
        assert load_config(f"config/{name}.yaml")["markers"]["feet"] == [
            "toe1",
            "toe2",
            "toe3",
        ]


@pytest.mark.parametrize(
    "names", [MARKERS, tuple("abcdefg")], ids=["named", "nameless"]
)
@pytest.mark.parametrize("seed", [1, 3, 5])
def test_the_foot_that_stands_highest_on_a_slope_is_no_less_a_foot(names, seed):
    time, positions = hopping(seed)
    positions[:, :6, 2] += np.tan(np.deg2rad(6)) * positions[:, :6, seed % 2]
    inspection = inspect_recording(RawRecording(names, time, positions, 100.0, "m"))
    assert len(guess_roles(inspection).feet) < 3
    assert guessed_roles(inspection).feet == names[3:6]


def test_a_file_in_mm_with_y_up_becomes_a_sound_study(folder, capsys):
    positions = hopping(1)[1][..., [1, 2, 0]]  # z of the world is the file's y
    export(folder, positions)
    assert main(["init", "monday.tsv", "-o", "config/mine.yaml"]) == 0
    out = capsys.readouterr().out
    assert "config/mine.yaml: written" in out
    assert "  unit  mm (in " in out
    assert "hopdata run config/mine.yaml" in out
    config = load_config("config/mine.yaml")
    assert config["study"] == "mine"
    assert config["recordings"][0]["name"] == "monday"
    assert config["recordings"][0]["file"] == "monday.tsv"
    assert config["input"] == {
        "unit": "mm",
        "vertical_axis": "y",
        "rate_hz": None,
        "least_score": 0.6,
    }
    assert config["markers"] == {
        "body": ["hip1", "hip2", "hip3"],
        "feet": ["toe1", "toe2", "toe3"],
        "boom": ["post"],
    }
    assert main(["check", "config/mine.yaml"]) == 0


def test_a_file_with_z_down_becomes_a_sound_study(folder):
    export(folder, hopping(1)[1] * [-1, 1, -1])
    assert main(["init", "monday.tsv"]) == 0
    assert load_config("config/monday.yaml")["input"]["vertical_axis"] == "-z"
    assert main(["check", "config/monday.yaml"]) == 0


def test_every_guess_has_its_reason_above_it(folder):
    export(folder)
    main(["init", "monday.tsv"])
    lines = (folder / "config/monday.yaml").read_text().splitlines()
    for key in ("body:", "feet:", "boom:", "unit:"):
        at = next(i for i, line in enumerate(lines) if line.strip().startswith(key))
        assert lines[at - 1].strip().startswith("#")
    assert all(len(line) <= 100 for line in lines)


def test_a_runner_gets_one_foot_and_landings_only(external_recording, folder, capsys):
    assert main(["init", str(external_recording)]) == 0
    told = capsys.readouterr().out
    assert "note: L_heel, L_mt1, L_mt5 land in between" in told
    assert f"hopdata contacts {external_recording} times the touchdowns" in told
    config = load_config("config/RBDS001runT25markers.yaml")
    assert config["markers"]["feet"] == ["R_heel", "R_mt1", "R_mt5"]
    assert config["markers"]["body"] == ["body1", "body2", "body3"]
    assert config["sections"]["frames"] == "landings"
    assert main(["check", "config/RBDS001runT25markers.yaml"]) == 0


def test_a_rate_that_nobody_states_is_asked_for_with_two_candidates(folder, capsys):
    heads = [f"{name}_{axis}" for name in MARKERS for axis in "xyz"]
    rows = [",".join(f"{x:.5f}" for x in row.ravel()) for row in 1000 * hopping(1)[1]]
    (folder / "monday.csv").write_text("\n".join([",".join(heads), *rows]))
    assert main(["init", "monday.csv"]) == 1
    said = capsys.readouterr().err
    assert "frame rate: expected a number in the file or in input.rate_hz" in said
    assert "of the frames are free fall if the rate is 100 Hz: --rate 100 or " in said
    assert main(["init", "monday.csv", "--rate", "100"]) == 0
    assert load_config("config/monday.yaml")["input"]["rate_hz"] == 100


def test_nothing_is_replaced_unless_asked(folder, capsys):
    export(folder)
    assert main(["init", "monday.tsv"]) == 0
    before = (folder / "config/monday.yaml").read_text()
    (folder / "config/monday.yaml").write_text("mine: 1\n")
    assert main(["init", "monday.tsv"]) == 1
    assert "expected no such file yet" in capsys.readouterr().err
    assert (folder / "config/monday.yaml").read_text() == "mine: 1\n"
    assert main(["init", "monday.tsv", "--force"]) == 0
    assert (folder / "config/monday.yaml").read_text() == before


@pytest.mark.filterwarnings("error")
def test_what_cannot_be_guessed_is_said_and_left_to_fill_in(folder, capsys):
    drift = np.cumsum(np.random.default_rng(2).normal(0, 1e-3, (3000, 4, 3)), axis=0)
    export(folder, drift + np.arange(4)[:, None] * 0.1, names=("a", "b", "c", "d"))
    assert main(["init", "monday.tsv"]) == 1
    out = capsys.readouterr().out
    assert "note: markers.feet: expected two markers or more" in out
    assert "note: input.vertical_axis: z or y? z is not sure" in out
    text = (folder / "config/monday.yaml").read_text()
    assert "# TO DO: markers.feet" in text
    assert "# Not used: " in text
    assert re.search(r"feet: \[.*\]  # TO DO: fill in, see above", text)
    assert len(yaml.safe_load(text)["markers"]["feet"]) < 2
    assert main(["check", "config/monday.yaml"]) == 1
    assert (
        "markers.feet: expected a list of 2 to 18 names, found"
        in capsys.readouterr().err
    )


#: Each is a study; `test_roles.py` reads the names of all styles in any run.
SOME_STYLES = [*STYLES][:: 1 if "ALL" in os.environ else 3]


@pytest.mark.parametrize("style", SOME_STYLES)
def test_a_jump_on_two_feet_becomes_a_sound_study(style, folder, capsys):
    export(folder, jumping([*style.encode()]), names=STYLES[style])
    assert main(["init", "monday.tsv"]) == 0
    out = capsys.readouterr().out
    assert "\n  2. hopdata check config/monday.yaml\n" in out
    # Two jumps are too few for maps; their contacts are given. In some layouts the
    # noise leaves one of them without a contact of both feet.
    assert main(["check", "config/monday.yaml"]) == 0
    told = capsys.readouterr().out
    assert "too few landings for maps and a verdict: " in told
    too_few = (
        "pairs: expected at least 3 usable",
        "sections: expected landings in which",
    )
    assert any(one in told for one in too_few)
    config = load_config("config/monday.yaml")
    assert len(config["markers"]["feet"]) >= 4
    assert len(config["markers"]["body"]) >= 4
    names = [foot["name"] for foot in config["feet"]]
    assert names == ([] if style == "numbers" else ["left", "right"])


def test_a_floor_that_moves_is_told_by_check(folder, capsys):
    _, positions = hopping(1, n_frames=3000)
    positions[:, :6, 2] += 0.01 * np.sin(2 * np.pi * np.arange(3000)[:, None] / 700)
    export(folder, positions)
    assert main(["init", "monday.tsv"]) == 0
    main(["check", "config/monday.yaml"])
    told = capsys.readouterr().out
    assert re.search(
        r"note: .*monday.tsv: the floor moves: .* together by (18|19|20|21) mm; hopdata",
        told,
    )


def test_a_suspected_marker_is_not_taken_for_home_and_it_is_said_why(folder, capsys):
    export(folder, with_spike(hopping(1)[1], "hip1", 700, 0.05))
    assert main(["init", "monday.tsv"]) == 0
    why = "(the first of the body's markers without fault; hip1: 1 suspected fault)"
    assert f"home  hip2 {why}" in capsys.readouterr().out
    assert load_config("config/monday.yaml")["home"]["marker"] == "hip2"
    text = (folder / "config/monday.yaml").read_text()
    assert "body's markers without fault; hip1: 1 suspected fault.\n  marker: h" in text


def test_centimetres_are_told(folder, capsys):
    export(folder, scale=100.0)
    assert main(["init", "monday.tsv"]) == 0
    assert "the numbers look like cm" in capsys.readouterr().out
    assert main(["check", "config/monday.yaml"]) == 1
    assert (
        "centimetres taken for millimetres: export in mm or m"
        in capsys.readouterr().err
    )


def test_frames_that_are_there_twice_are_told_with_the_file(folder, capsys):
    path = export(folder)
    *head, last = path.read_text().splitlines(keepends=True)
    path.write_text("".join([*head, last, head[-1], last]))
    assert main(["init", "monday.tsv"]) == 1
    told = capsys.readouterr().err
    assert "monday.tsv: frame " in told
    assert "if frames occur twice, remove them from the file" in told
    assert not (folder / "config").exists()


def test_names_that_yaml_would_misread(folder):
    names = ("on", "hip: 2", "3", "toe1", "toe2", "toe3", "no # 1")
    export(folder, names=names)
    assert main(["init", "monday.tsv"]) == 0
    markers = load_config("config/monday.yaml")["markers"]
    assert [name for role in markers.values() for name in role] == list(names)


def test_odd_file_names_become_names_of_studies(folder):
    export(folder, name="day 1 (run).tsv")
    assert main(["init", "day 1 (run).tsv"]) == 0
    config = load_config("config/day-1-run.yaml")
    assert config["study"] == config["recordings"][0]["name"] == "day-1-run"
    assert re.fullmatch(r"day 1 \(run\).tsv", config["recordings"][0]["file"])


DRAFT = Draft(
    study="mine",
    file="data/monday.tsv",
    recordings=[("monday", "data/monday.tsv")],
    markers={"body": ["b1", "b2", "b3"], "feet": ["f1", "f2"], "boom": []},
    reasons={
        "markers.body": "rigid.",
        "input.vertical_axis": "the markers fall along it.",
    },
    settings={"input": {"vertical_axis": "y", "rate_hz": 250.0}},
    remarks=["look at frame 3"],
    all_markers=["b1", "b2", "b3", "f1", "f2", "left over"],
)


def test_a_draft_is_a_configuration():
    config = load_config(
        yaml.safe_load(draft_config(DRAFT, path="x.yaml")), check_files=False
    )
    assert config["study"] == "mine"
    assert config["recordings"][0]["file"] == "data/monday.tsv"
    assert config["markers"] == {
        "body": ["b1", "b2", "b3"],
        "feet": ["f1", "f2"],
        "boom": [],
    }
    assert config["input"]["vertical_axis"] == "y"
    assert config["input"]["rate_hz"] == 250.0
    assert config["home"]["marker"] is None


def test_markers_that_may_be_on_one_foot_are_joined_by_a_comment():
    """With its marks taken off, the comment is a block of the configuration."""
    sides = {"left": ["f1", "f2"]}
    assert "feet:\n" not in draft_config(DRAFT, path="x.yaml")
    text = draft_config(replace(DRAFT, may_be_joined=sides), path="x.yaml")
    assert "feet" not in yaml.safe_load(text)
    marked = text[text.index("# feet:") :].splitlines()[:2]
    block = yaml.safe_load("\n".join(line.removeprefix("# ") for line in marked))
    assert block == {"feet": [{"name": "left", "markers": ["f1", "f2"]}]}
    # Feet that are joined already need no such comment.
    joined = replace(DRAFT, joined=sides, may_be_joined=sides)
    assert "# feet:" not in draft_config(joined, path="x.yaml")


def test_comments_say_how_to_run_what_was_guessed_and_what_is_left():
    text = draft_config(DRAFT, path="config/x.yaml")
    for part in (
        "# Step 1: answer the 1 remark marked TO DO below",
        "# Step 2: hopdata check config/x.yaml",
        "# Step 3: hopdata run config/x.yaml",
        "# TO DO: look at frame 3",
        "  # Rigid.\n  body:",
        "  # The markers fall along it.\n  vertical_axis: y",
        "  # Not used: left over",
    ):
        assert part in text


@pytest.mark.parametrize(
    ("remarks", "is_complete", "first"),
    [
        ([], True, "look at the guesses in x.yaml"),
        (["a", "b"], True, "in x.yaml, answer the 2 remarks marked TO DO"),
        (["a"], False, "in x.yaml, fill in what is missing"),
    ],
)
def test_the_steps_that_follow_have_one_order(remarks, is_complete, first, capsys):
    """A reader did not know whether TO DO comes before the next command."""
    code = print_next(Path("x.yaml"), remarks, is_complete=is_complete)
    assert code == (0 if is_complete else 1)
    head, *steps = capsys.readouterr().out.splitlines()
    assert head == "next, in this order:"
    assert steps[0].startswith(f"  1. {first}")
    assert steps[1:] == ["  2. hopdata check x.yaml", "  3. hopdata run x.yaml"]


def test_a_draft_without_remarks_is_checked_first():
    text = draft_config(replace(DRAFT, remarks=()), path="x.yaml")
    assert "# Step 1: look at the guesses below" in text
    assert "# Step 2: hopdata check x.yaml\n# Step 3: hopdata run x.yaml\n" in text
    assert "TO DO" not in text


@pytest.mark.parametrize(
    "value",
    ["plain", "R.Heel_1", "on", "NO", "y", "1", "1e3", "a: b", "x #y", "", "null", "-", "ä", "~",
     "0x10", "2021-01-01", "a'b", 'a"b', "[a]", "data/x y.tsv", 3, 2.5, True, None],
)  # fmt: skip
def test_every_value_is_read_back_as_it_was(value):
    assert yaml.safe_load(f"key: {scalar(value)}")["key"] == value


@pytest.mark.parametrize(
    ("text", "name"),
    [("monday", "monday"), ("day 1 (run)", "day-1-run"), ("..", "study"), ("_x_", "x"),
     ("Läufer müde", "Laufer-mude"), ("跑", "study")],
)  # fmt: skip
def test_study_names_fit_the_schema(text, name):
    assert study_name(text) == name


@pytest.mark.parametrize("name", ["2021-11-05", "0012", "no", "1e5", "null"])
def test_names_that_yaml_takes_for_something_else_stay_names(name):
    draft = replace(DRAFT, study=name, recordings=[(name, "data/monday.tsv")])
    config = load_config(
        yaml.safe_load(draft_config(draft, path="x.yaml")), check_files=False
    )
    assert config["study"] == config["recordings"][0]["name"] == name


def test_the_commands_of_a_draft_can_be_pasted():
    text = draft_config(DRAFT, path="my studies/x.yaml")
    assert "hopdata check 'my studies/x.yaml'" in text
    assert "hopdata run 'my studies/x.yaml'" in text


def test_several_files_make_one_study(folder, capsys):
    for seed, (name, up, scale) in enumerate(
        [
            ("monday.tsv", "z", 1000.0),
            ("jump 2.tsv", "-y", 1.0),
            ("jump-2.tsv", "x", 1000.0),
        ]
    ):
        turned = hopping(seed)[1] @ rotate_up(np.eye(3), up).T
        export(folder, turned, name=name, scale=scale)
    assert main(["init", "monday.tsv", "jump 2.tsv", "jump-2.tsv"]) == 0
    config = load_config("config/monday.yaml")
    files = {entry["name"]: entry["file"] for entry in config["recordings"]}
    assert files == {
        "monday": "monday.tsv",
        "jump-2-2": "jump 2.tsv",
        "jump-2-3": "jump-2.tsv",
    }
    capsys.readouterr()
    assert main(["check", "config/monday.yaml"]) == 0
    told = capsys.readouterr().out
    assert "jump 2.tsv: -y is up: the markers fall along it" in told
    assert "jump-2.tsv: x is up: the markers fall along it" in told


def write_runner(pelvis, feet, *, names=(*NAMES, "L_toe", "R_toe")):
    """Write a recording as CSV in m."""
    positions = np.concatenate([pelvis, feet], axis=1)
    time = np.arange(len(positions)) / RATE_HZ
    head = ["time", *(f"{name}_{axis} (m)" for name in names for axis in "xyz")]
    table = np.column_stack([time, positions.reshape(len(positions), -1)])
    np.savetxt(
        "run.csv", table, fmt="%.4f", delimiter=",", header=",".join(head), comments=""
    )


#: Seeds of the runner and its skin's movement; with `ALL=1` more of them.
SOFT = [(0, 0.0), (1, 0.1)]
if "ALL" in os.environ:
    SOFT += [(0, 0.1), (2, 0.1)]


@pytest.mark.parametrize(("seed", "skin"), SOFT)
def test_check_accepts_the_body_that_init_proposes_however_soft(
    folder, capsys, seed, skin
):
    """An impact shakes the skin of a pelvis; the shortest distance then varies most of all."""
    write_runner(*runner(seed, skin_m=skin * SHORTEST_M, wobble_m=0.015 * (skin > 0)))
    assert main(["init", "run.csv", "-o", "run.yaml"]) == 0
    assert load_config("run.yaml")["markers"]["body"] == [*NAMES]
    assert main(["check", "run.yaml"]) == 0
    assert ("the body is soft" in capsys.readouterr().out) == (skin > 0)


def test_init_leaves_out_what_check_would_refuse(folder, capsys):
    """A marker of the pelvis by its name that hangs loose; of three, no body is left."""
    pelvis, feet = runner(1)
    time = np.arange(len(pelvis)) / RATE_HZ
    pelvis[:, 1, 1] += 0.05 * np.sin(7.0 * time)
    write_runner(pelvis, feet)
    assert main(["init", "run.csv", "-o", "run.yaml"]) == 0
    assert load_config("run.yaml")["markers"]["body"] == ["R.ASIS", "R.PSIS", "L.PSIS"]
    assert main(["check", "run.yaml"]) == 0
    capsys.readouterr()
    write_runner(pelvis[:, :3], feet, names=(*NAMES[:3], "L_toe", "R_toe"))
    assert main(["init", "run.csv", "-o", "three.yaml"]) == 1
    assert (
        "markers.body: expected three markers or more that keep"
        in capsys.readouterr().out
    )


def test_what_a_filter_does_is_told_in_milliseconds(folder, capsys):
    from scipy.signal import butter, filtfilt

    positions = hopping(2, n_frames=700)[1]
    smooth = filtfilt(*butter(2, 2 * 12 / 100), positions, axis=0)
    for name, written in (("raw", positions), ("smooth", smooth)):
        export(folder, written, name=f"{name}.tsv")
        assert main(["init", f"{name}.tsv", "-o", f"config/{name}.yaml"]) == 0
        told = "note: the low-pass moves contacts by " in capsys.readouterr().out
        assert told == (name == "smooth")
    with open("config/smooth.yaml") as written:
        text = " ".join(line.strip("# \n") for line in written)
    assert re.search(r"TO DO: The low-pass moves contacts by \S+ ms", text, re.I)


@pytest.mark.parametrize(("n_feet", "told_of"), [(2, ""), (4, "at least 168 landings")])
def test_too_few_landings_for_a_verdict_are_told_before_the_run(n_feet, told_of):
    """`init` did not say so; 150 are enough for two feet."""
    inspection = SimpleNamespace(recording=lambda *_: falling_body(hops=150))
    feet = tuple(f"f{k}" for k in range(n_feet))
    roles = SimpleNamespace(problems=(), joined={}, feet=feet, body=("b",))
    told = too_few_landings(inspection, roles)
    assert len(told) == bool(told_of)
    assert told_of in "".join(told)


def falling_body(hops):
    """Return a recording of one body marker that sinks so many times."""
    time = np.arange(50 * hops) / 100
    positions = np.zeros((len(time), 1, 3))
    positions[:, 0, 2] = 0.4 + 0.1 * np.cos(2 * np.pi * time / 0.5)
    return Recording.from_arrays(time, positions, ["b"], feet=[], body=["b"], name="x")
