"""The whole workflow, run as by a user, in a copy of the checkout."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from checkouts import (
    FIGURES,
    ROOT,
    completed,
    copy_checkout,
    edit_config,
    part_of_sample,
    planned_rules,
    require_same_bytes,
    snakemake,
)

import hopdata
from hopdata.commands.forecast import foretell
from hopdata.config.loading import load_config
from hopdata.figures.catalogue import FIGURES as CATALOGUE
from hopdata.landings.contacts.timing import METHODS
from hopdata.recordings.importing import import_recording
from hopdata.recordings.readers.hdf5 import read_recording, read_truth
from hopdata.stages import LINE
from plain_columns import counted_from_zero_in, shadowed_in

pytestmark = pytest.mark.workflow

SVG = {"figures": {"formats": ["svg"]}}


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    """Return a checkout in which the sample study has run on two cores."""
    folder = copy_checkout(tmp_path_factory.mktemp("sample"))
    completed(folder)
    return folder


def test_all_figures_and_the_report_are_there(sample):
    results = sample / "results" / "sample"
    for name in FIGURES:
        assert (results / "figures" / f"{name}.svg").stat().st_size > 2000
        assert (results / "figures" / f"{name}.png").stat().st_size > 2000
    page = (results / "report.html").read_text()
    assert page.count("<figure") >= len(FIGURES)
    record = json.loads((results / "provenance.json").read_text())
    assert record["study"] == "sample"
    stages = {*LINE.stages} - {"simulate"}
    jobs = {stage.removesuffix("_hopper") for stage in record["stage_seconds"]}
    assert stages - jobs == {"mode_schedules"}
    assert {one for one in jobs if one.startswith("mode_schedules")} == {
        f"mode_schedules_{method}" for method in METHODS
    }
    assert not any("simulate" in stage for stage in record["stage_seconds"])


def test_no_column_of_a_table_shadows_an_attribute(sample):
    assert shadowed_in(sample / "results" / "sample") == {}


def test_every_number_in_a_table_counts_from_1(sample):
    assert counted_from_zero_in(sample / "results" / "sample") == {}


def test_nothing_is_left_to_do(sample):
    assert "Nothing to be done" in completed(sample)


def test_one_run_makes_both_bundled_studies_as_each_run_alone_does(sample):
    """`make figures` runs them together; what one study has made is not made again."""
    together = ("--snakefile", "workflow/first_look.smk")
    together += ("--workflow-profile", "profiles/default")
    planned = planned_rules(sample, *together)
    made = {name for name in planned if name.startswith("sample_")}
    assert made == {"sample_verdicts", "sample_first_look"}
    missing = {name for name in planned if name.startswith("control_")}
    assert {"control_verdict", "control_report"} <= missing
    assert not {"control_verdicts", "control_first_look"} & missing


@pytest.mark.parametrize(
    ("block", "key", "value", "rules"),
    [
        (
            "units",
            "length_m",
            0.03,
            {
                *("normalisation", "prediction", "constraint_subspaces"),
                *("landing_maps", "score", "figures_maps"),
            },
        ),
        ("verdict", "margin", 0.15, {"verdict", "figures_maps"}),
        ("sections", "grid_nodes", 512, {"section_densities", "figures_landings"}),
    ],
)
def test_a_key_runs_only_its_stage_and_what_follows(sample, block, key, value, rules):
    """Snakemake plans what `tests/workflow/test_rules.py` states for every key."""
    changed = edit_config(
        sample, lambda config: config.setdefault(block, {}).update({key: value})
    )
    planned = planned_rules(sample, "--configfile", changed)
    assert planned == {"all", "report", *rules}


def test_a_run_stops_after_a_stage(sample):
    planned = planned_rules(sample, "--forceall", "--until", "poincare_sections")
    chain = ["import_recording", "floor_compensation", "foot_contacts"]
    assert planned == {*chain, "poincare_sections"}


def test_the_verdict_on_the_sample(sample):
    """The bundled hopper is C1; whether its landings suffice to say so depends on them."""
    verdict = json.loads((sample / "results" / "sample" / "verdict.json").read_text())
    assert verdict["conclusion"] in {"no difference", "cannot tell"}
    page = (sample / "results" / "sample" / "report.html").read_text()
    page = page.replace("\u00a0", " ")  # numbers stay with their units
    # The page tells what is reserved apart, in ms.
    answer, _, reserved = verdict["sentence"].partition(" at 95 % confidence")
    assert answer in page
    assert ("Reservation: " in page) == (len(reserved) > 1)
    assert (
        verdict["effect"]["low"]
        <= verdict["effect"]["estimate"]
        <= verdict["effect"]["high"]
    )


def test_the_check_foretells_what_the_study_found(sample, monkeypatch):
    monkeypatch.chdir(sample)
    config = load_config("config/config.yaml")
    recording, _ = import_recording(
        ["data/sample/hopper.h5"],
        name="hopper",
        markers=config["markers"],
        **config["input"],
    )
    verdict = json.loads((sample / "results/sample/verdict.json").read_text())
    if "ALL" in os.environ:  # `tests/commands/test_forecast.py` has a smaller one
        part = foretell(config, [recording])
        assert part.frames_share < 1
        assert part.used == pytest.approx(verdict["n_landings"], rel=0.02)
    monkeypatch.setattr("hopdata.commands.forecast.MOST_FRAMES", len(recording.time))
    forecast = foretell(config, [recording])
    # The verdict leaves out what it takes for mistakes.
    mistakes = sum(len(rows) for rows in verdict["gross_errors"].values())
    assert mistakes <= 0.005 * verdict["n_landings"]
    assert forecast.used == verdict["n_landings"] + mistakes
    assert not forecast.stops
    assert forecast.detectable == pytest.approx(
        verdict["effect"]["detectable"], rel=0.01
    )
    table = pd.read_csv(
        sample / "results/sample/tables/touchdowns.csv", keep_default_na=False
    )
    found = table.loc[table["excluded"], "reason"].value_counts()
    assert (
        forecast.left_out()
        == found.drop("no foot of the study landed", errors="ignore").to_dict()
    )


def test_an_edited_library_module_runs_the_stages_that_use_it(sample):
    library = sample / "src"
    library.unlink()
    shutil.copytree(ROOT / "src", library)
    with (library / "hopdata/landings/states/assemble.py").open("a") as module:
        module.write("\n# edited\n")
    planned = planned_rules(sample)
    shutil.rmtree(library)
    library.symlink_to(ROOT / "src")
    assert {"home_frame", "prediction", "verdict", "report"} <= planned
    assert not {"floor_compensation", "poincare_sections", "mode_schedules"} & planned


@pytest.mark.skipif("'ALL' not in os.environ", reason="takes 16 s: ALL=1")
def test_one_process_has_the_same_bytes(sample, tmp_path, monkeypatch):
    """A study in a notebook gives everything that two parallel processes have written.

    `test_without_products.py` asks it of a short study.
    """
    monkeypatch.chdir(sample)
    hopdata.analyse("config/config.yaml").save(tmp_path)
    require_same_bytes(sample / "results" / "sample", tmp_path)
    assert len(list(tmp_path.rglob("*.csv"))) >= 15


def test_accuracy_against_truth(sample):
    truth = json.loads((sample / "results" / "sample" / "truth.json").read_text())
    value = {name: entry["value"] for name, entry in truth.items()}
    assert value["labels_right_of_all_kink"] >= 0.96, (
        "of all landings, excluded ones included"
    )
    assert value["labels_right_kink"] >= value["labels_right_of_all_kink"]
    assert value["labels_right_velocity_minimum"] < 0.9 < value["labels_right_kink"]
    assert value["unmatched_kink"] == 0
    assert value["contact_rms_kink"] <= 1.5, "ms"
    assert abs(value["section_pre_error"]) <= 2, "mm"
    assert abs(value["section_post_error"]) <= 2, "mm"
    assert value["near_below_all_below_far"]
    assert value["random_clearance"] > 0.5, "rad above the 95 % quantile of all others"
    sections = json.loads((sample / "results/sample/sections.json").read_text())
    assert sections["pre_height_m"] - sections["post_height_m"] >= 0.14
    summary = pd.read_csv(sample / "results/sample/tables/prediction_summary.csv")
    median = summary.set_index("model")["median_mse"]
    assert median["specialised"] <= 0.2 * median["specialised_mean"]


def test_every_touchdown_is_accounted_for(sample):
    table = pd.read_csv(sample / "results" / "sample" / "tables" / "touchdowns.csv")
    assert len(table) >= 400
    excluded = table[table["excluded"]]
    assert excluded["reason"].notna().all()
    assert table.loc[~table["excluded"], "schedule"].str.count(">").eq(2).all()


@pytest.mark.skipif(
    "'ALL' not in os.environ",
    reason="a whole study, of a runner that is checked elsewhere: ALL=1",
)
def test_a_real_recording_runs_to_a_report(sample):
    svg = edit_config(
        sample, lambda config: config.update(SVG), source="config/runner.yaml"
    )
    completed(sample, "--configfile", svg)
    results = sample / "results" / "runner"
    table = pd.read_csv(results / "tables" / "touchdowns.csv")
    assert 25 <= (~table["excluded"]).sum() <= 45
    for name in FIGURES:
        assert (results / "figures" / f"{name}.svg").exists()
    page = (results / "report.html").read_text()
    assert "minimum" in page
    verdict = json.loads((results / "verdict.json").read_text())
    assert verdict["conclusion"] == "cannot tell"
    assert verdict["effect"] is None
    assert verdict["sentence"] in page


def test_contacts_known_from_elsewhere_are_laid_over(sample):
    """The truth serves as a table of another device, on its own clock, with one contact missing."""
    truth = read_truth(sample / "data" / "sample" / "hopper.h5")
    known = pd.DataFrame(
        truth.contact_times * 1000 - 250, columns=["foot1", "foot2", "foot3"]
    )
    known.loc[100, "foot2"] = None
    known.to_csv(sample / "data" / "known.csv", index=False)
    contacts = {"file": "data/known.csv", "unit": "ms", "offset_s": 0.25}
    config = edit_config(sample, lambda c: c["recordings"][0].update(contacts=contacts))
    completed(sample, "--configfile", config, cores=1)
    results = sample / "results" / "sample"
    summary = pd.read_csv(
        results / "tables" / "contact_overlay_summary.csv", index_col="column"
    )
    assert summary["n_invented"].tolist() == [0, 1, 0]
    assert (summary["n_matched"] >= 0.99 * summary["n_external"]).all()
    assert (summary["bias_s"].abs() < 1e-4).all()
    assert (summary["robust_sd_s"] < 5e-4).all()
    assert (results / "figures" / "contact_overlay.svg").stat().st_size > 2000
    assert 'id="overlay"' in (results / "report.html").read_text()


@pytest.mark.parametrize(
    ("body", "filling", "fills"),
    [(3, {}, False), (4, {}, True), (4, {"longest_s": 0}, False)],
)
def test_gaps_are_filled_only_where_they_can_be(tmp_path, body, filling, fills):
    folder = copy_checkout(tmp_path)

    def simulate(config):
        config["recordings"] = [{"name": "hopper"}]
        config["markers"]["body"] = [f"body{i + 1}" for i in range(body)]
        places = [
            [0.13, 0.03, 0.05],
            [-0.08, 0.11, 0.075],
            [-0.07, -0.14, 0.055],
            [0.0, 0.0, 0.1],
        ]
        config["motion_capture"] = {"markers": {"body_m": places[:body]}}
        config["filling"] = filling

    printed = completed(
        folder, "--dry-run", "--configfile", edit_config(folder, simulate)
    )
    page = re.search(r"rule report:\n +input: (.*)", printed)[1]
    assert ("tables/filled.csv" in page) == fills


def swap_body_and_feet(config):
    markers = config["markers"]
    markers["body"], markers["feet"] = markers["feet"], markers["body"]
    config["home"] = {"marker": markers["body"][0]}


MISTAKES = {
    "misspelt key": (lambda c: c.update(floors={"degree": 3}), ["floors", "floor"]),
    "missing file": (
        lambda c: c["recordings"][0].update(file="data/sample/hoper.h5"),
        ["hoper.h5", "hopper.h5"],
    ),
    "unknown marker": (
        lambda c: c["markers"].update(feet=["foot1", "foot2", "fot3"]),
        ["fot3", "foot3"],
    ),
    "body below the feet": (swap_body_and_feet, ["body", "feet"]),
    "millimetres taken for metres": (
        lambda c: c.update(input={"unit": "mm"}),
        ["hopper.h5", "scale", "input.unit: m"],
    ),
}


def test_a_python_that_snakemake_cannot_start_is_told_at_once(tmp_path):
    (tmp_path / "my tools").mkdir()
    python = tmp_path / "my tools" / "python"
    python.symlink_to(sys.executable)
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(ROOT / "src"), *sys.path]),
    }
    run = subprocess.run(
        [python, "-m", "snakemake", "--cores", "1", "--dry-run", "--snakefile", ROOT / "Snakefile",
         "--configfile", ROOT / "config/config.yaml"],
        cwd=tmp_path, env=environment, capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert run.returncode == 1
    assert "hopdata: error: Python: expected a path without spaces" in run.stderr
    assert "Traceback" not in run.stderr


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_clear_message_and_nothing_half_written(sample, name):
    edit, words = MISTAKES[name]

    def renamed(config):
        edit(config)
        config["study"] = "mistake"

    run = snakemake(sample, "--configfile", edit_config(sample, renamed))
    assert run.returncode == 1
    message = [x for x in run.stderr.splitlines() if x.startswith("hopdata: error: ")]
    assert message, run.stderr
    assert all(word in message[0] for word in words), message
    assert "Traceback" not in run.stderr
    written = [
        p
        for p in (sample / "results" / "mistake").rglob("*")
        if p.suffix in {".h5", ".csv"}
    ]
    assert written == []


BUNDLED = {"config": "hopper.h5", "sample_control": "control.h5"}


@pytest.mark.parametrize("config", BUNDLED if "ALL" in os.environ else ["config"])
def test_the_bundled_recordings_are_what_the_committed_rules_make(sample, config):
    bundled = sample / "data" / "sample" / BUNDLED[config]
    study = {"config": "sample"}.get(config, config)
    made = Path("results") / study / "bundled" / bundled.name
    completed(sample, "--configfile", f"config/{config}.yaml", "--", str(made))
    np.testing.assert_allclose(
        read_recording(sample / made).positions,
        read_recording(bundled).positions,
        rtol=0,
        atol=2e-5,
    )
    truth, again = read_truth(bundled), read_truth(sample / made)
    np.testing.assert_allclose(
        again.contact_times, truth.contact_times, rtol=0, atol=1e-6
    )
    assert again.true_effect == pytest.approx(truth.true_effect, rel=1e-5, abs=1e-9)


@pytest.mark.parametrize(
    ("file", "differs"), [("hopper.h5", False), ("control.h5", True)]
)
def test_the_bundled_recordings_hold_what_both_verdicts_are_of(file, differs):
    """Their truth has the difference of the exact maps, shown on the page with both verdicts."""
    bundled = ROOT / "data" / "sample" / file
    assert bundled.stat().st_size < 4_700_000  # positions are float64
    truth = read_truth(bundled)
    assert np.isfinite(truth.contact_times).all(axis=1).sum() >= 400
    assert truth.true_effect > 0.5 if differs else truth.true_effect < 1e-9


@pytest.mark.parametrize("taken", ["results", "results/taken"])
def test_a_file_where_the_results_belong_is_told_at_once(tmp_path, taken):
    folder = copy_checkout(tmp_path)
    (folder / taken).parent.mkdir(exist_ok=True)
    (folder / taken).touch()
    config = edit_config(folder, lambda config: config.update(study="taken"))
    run = snakemake(folder, "--dry-run", "--configfile", config)
    assert run.returncode == 1
    assert (
        f"hopdata: error: {taken}: expected a folder for the results, found a file"
        in run.stderr
    )
    assert "Traceback" not in run.stderr


MODULE = """
configfile: "landing.yaml"

module hopdata:
    snakefile: {snakefile!r}
    config: config["landing"]

use rule * from hopdata as landing_*

rule everything:
    default_target: True
    input: rules.landing_all.input
"""


def test_as_a_module_of_another_workflow_on_a_machine_that_is_not_here(tmp_path):
    """Everything is planned from another folder; the job is submitted, as to a cluster."""
    config = yaml.safe_load((ROOT / "config/config.yaml").read_text())
    config["recordings"][0]["file"] = str(part_of_sample(tmp_path / "hopper.h5", 60))
    (tmp_path / "landing.yaml").write_text(yaml.safe_dump({"landing": config}))
    (tmp_path / "Snakefile").write_text(
        MODULE.format(snakefile=str(ROOT / "Snakefile"))
    )
    run = snakemake(
        tmp_path, "--executor", "cluster-generic", "--cluster-generic-submit-cmd", "bash",
        "--jobs", "1", "--until", "landing_import_recording", "--seconds-between-status-checks", "1",
        cores=None,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout + run.stderr
    assert (tmp_path / "results/sample/recordings/hopper.h5").is_file()


def test_a_job_asks_for_twice_as_much_at_a_retry(tmp_path):
    """This includes jobs whose inputs do not exist yet, as in a group submitted as one."""
    folder = copy_checkout(tmp_path)

    def asked(attempt):
        run = snakemake(folder, "-n", "--attempt", str(attempt))
        found = re.findall(r"runtime=(\d+), mem_mb=(\d+),", run.stdout + run.stderr)
        return np.array(sorted((int(time), int(memory)) for time, memory in found))

    first = asked(1)
    assert first.shape == (20, 2)
    np.testing.assert_array_equal(asked(3), 4 * first)


def test_the_profile_groups_rules_that_there_are():
    profile = yaml.safe_load((ROOT / "profiles/slurm/config.yaml").read_text())
    files = (ROOT / "workflow").rglob("*.smk")
    rules = "".join(path.read_text() for path in files)
    names = set(re.findall(r"^rule (\w+):", rules, re.MULTILINE))
    names |= {f"figures_{kind}" for kind in CATALOGUE}
    assert {entry.split("=")[0] for entry in profile["groups"]} <= names


def test_after_a_kill_the_next_run_says_how_to_unlock_and_leaves_nothing(sample):
    figure = "results/sample/figures/fig2_3_schedule.svg"
    before = (sample / figure).read_bytes()
    (sample / figure).unlink()
    lock = sample / ".snakemake/locks/0.output.lock"
    left = [
        sample / "results/sample/figures/.fig2_3_schedule.svg.123.part",
        sample / ".snakemake/scripts/tmp123.figure_schedule.py",
    ]
    for path in [lock, *left]:
        path.parent.mkdir(exist_ok=True)
        path.touch()
    lock.write_text(f"{figure}\n")
    run = snakemake(sample, figure)
    assert run.returncode == 1
    said = next(
        line for line in run.stderr.splitlines() if line.startswith("hopdata: ")
    )
    unlock = shlex.split(said.split("unlock the folder: ")[1])
    assert unlock[-1] == "--unlock"
    assert subprocess.run(unlock, cwd=sample, check=False, timeout=120).returncode == 0
    assert not lock.exists()
    printed = completed(sample, figure)
    assert not any(path.exists() for path in left)
    assert (sample / figure).read_bytes() == before
    assert "hopdata: " not in printed


def test_a_flipped_bit_is_noticed_told_and_made_again(sample):
    """Also of a table that nothing reads again; the date of the file does not tell."""
    results = sample / "results/sample"
    files = [results / "tables/section_densities.csv", results / "truth.json"]
    whole = {path.name: path.read_bytes() for path in results.rglob("*.csv")}
    for file in files:
        status = file.stat()
        content = bytearray(file.read_bytes())
        content[len(content) // 2] ^= 1
        file.write_bytes(content)
        os.utime(file, ns=(status.st_atime_ns, status.st_mtime_ns))
    printed = snakemake(sample, "--dry-run").stderr
    assert "not as written" not in printed
    printed = completed(sample)
    assert (
        "hopdata: results/sample/tables/section_densities.csv and 1 more are not as "
        "written (damaged, or changed by hand); they are made again"
    ) in printed
    assert json.loads(files[1].read_text())
    assert whole == {path.name: path.read_bytes() for path in results.rglob("*.csv")}
    assert "Nothing to be done" in completed(sample)


def test_a_job_refuses_a_damaged_input_that_changed_after_the_start(tmp_path):
    """The start of a run looked at nothing here, since it did not make the file."""
    folder = copy_checkout(tmp_path)
    part_of_sample(folder / "data/sample/hopper.h5", 30)
    level = "results/sample/level/hopper.h5"
    completed(folder, level)
    script = folder / "workflow/scripts/stage.py"
    text = script.read_text()
    damage = "open('results/sample/level/hopper.h5', 'r+b').write(b'x')\n"
    script.write_text(text.replace("with reported", damage + "with reported"))
    run = snakemake(
        folder, "results/sample/contacts/hopper.csv", "--rerun-triggers", "mtime"
    )
    assert run.returncode == 1
    said = [x for x in run.stderr.splitlines() if x.startswith("hopdata: error: ")]
    assert f"{level}: expected the bytes that were written, found others" in said[-1]
    script.write_text(text)
    again = completed(folder, "results/sample/contacts/hopper.csv")
    assert f"hopdata: {level} is not as written" in again


def test_a_clock_that_jumps_is_told_and_what_another_file_replaced_is_read(sample):
    """A source dated ahead is refused, such results are named, and an older source is read anew."""
    source, made = (
        sample / "data/sample/hopper.h5",
        "results/sample/recordings/hopper.h5",
    )
    seconds, before = source.stat().st_mtime, (sample / made).read_bytes()
    os.utime(source, (seconds, time.time() + 86_400))
    run = snakemake(sample, made)
    assert run.returncode == 1
    told = "expected a time before now, found a later one: a clock is or was wrong"
    assert f"hopdata: error: data/sample/hopper.h5: {told}; touch it" in run.stderr
    os.utime(source, (seconds, seconds - 86_400))
    os.utime(sample / made, (seconds, time.time() + 86_400))
    run = snakemake(sample, made, "--dry-run")
    assert "rule import_recording:" in run.stdout + run.stderr
    assert f"hopdata: {made}: {told}, and a run will date it anew" in run.stderr
    assert (sample / made).stat().st_mtime > time.time()
    assert f"hopdata: {made}: {told}; such results are" in completed(sample, made)
    assert (sample / made).stat().st_mtime <= time.time()
    assert (sample / made).read_bytes() == before
    assert "hopdata: " not in snakemake(sample, made, "--dry-run").stderr
