"""Small simulated studies, from their configuration to a report, in a copy of the checkout."""

import json
import shutil
from dataclasses import replace
from html import escape

import numpy as np
import pandas as pd
import pytest
from checkouts import (
    FIGURES,
    completed,
    copy_checkout,
    edit_config,
    part_of_sample,
    planned_rules,
    snakemake,
)

from hopdata.figures.catalogue import OF_DISTANCES
from hopdata.recordings.readers.hdf5 import read_recording, read_truth, write_recording

pytestmark = pytest.mark.workflow

# Draws that no test here uses; the sample has as many as a user's study, and the PNGs.
FEW = {
    "prediction": {"bootstraps": 40, "train": 30, "test": 10, "minimum_class": 15},
    "subspaces": {"bootstraps": 40},
    "distances": {"pairs": 40},
    "verdict": {"flips": 99},
    "figures": {"formats": ["svg"]},
}

# Names that other programs read as code, for a study whose markers may have any name.
CALLED = {
    "body1": "{x}",
    "body2": "$\\frac{$",
    "body3": "=1+1",
    "foot1": "<b>%s</b>",
    "foot2": '-"Fuß" 鹿\'',
    "boom": "@{0}",
}
STEERING_FIGURES = (
    "fig3_5_origin",
    "fig3_6_turn",
    "fig3_8_origin_board",
    "fig3_9_turn_board",
    "steering_outcomes",
    "steering_map",
    "steering_learning",
    "steering_kernels",
)


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """Return a checkout in which nothing has run yet."""
    return copy_checkout(tmp_path_factory.mktemp("studies"))


@pytest.mark.parametrize("study", ["thesis", "control", "half_spread"])
def test_the_dissertation_s_study_simulates_its_recordings_apart(checkout, study):
    printed = completed(checkout, "--dry-run", "--configfile", f"config/{study}.yaml")
    jobs = [x for x in printed.splitlines() if x.startswith("rule simulate")]
    assert len(jobs) == 4


def test_a_small_study_of_a_control_runs_to_a_report(checkout):
    def shorten(config):
        config["study"] = "small"
        config["recordings"] = config["recordings"][:2]
        for recording, seconds in zip(config["recordings"], (100, 90.5), strict=True):
            recording["simulation"]["duration_s"] = seconds
        config["sections"] = {"pre_height_m": 0.52, "post_height_m": 0.275}
        config["scaling_study"] = {"landings": 200}
        config.update(FEW)

    edited = edit_config(checkout, shorten, source="config/control.yaml")
    completed(checkout, "--configfile", edited)
    results = checkout / "results" / "small"
    truth = json.loads((results / "truth.json").read_text())
    assert truth["labels_right_of_all_kink"]["value"] > 0.9
    assert truth["exact_map_difference_hopper"]["value"] < 1e-12
    assert truth["exact_map_difference_coupling"]["value"] > 1
    assert abs(truth["scaling_slope_hopper"]["value"] - 2) < 0.15
    assert truth["scaling_slope_coupling"]["value"] < 1.4
    assert (
        0
        < truth["velocity_rms_pre"]["value"]
        < truth["velocity_rms_post"]["value"]
        < 100
    )
    assert 0 < truth["map_estimate_error_printed"]["value"] < 2
    assert (results / "figures" / "scaling_study.svg").exists()
    assert (results / "figures" / "map_matrices.svg").exists()
    assert 0 < truth["map_estimate_error_corrected_curved"]["value"] < 2
    for name in FIGURES:
        assert (results / "figures" / f"{name}.svg").exists()
    table = pd.read_csv(results / "tables" / "touchdowns.csv")
    assert table["recording"].nunique() == 2
    assert (~table["excluded"]).sum() > 250


def small(config, hops):
    """Reduce a study of an animal to what a test needs."""
    config["recordings"] = config["recordings"][:1]
    config["recordings"][0]["simulation"] = {"hops": hops}
    config["scaling_study"] = {"landings": 100, "scales": [1.0, 0.25]}
    config.update(FEW)


def test_a_small_study_of_a_hexapod_runs_to_a_report(checkout):
    edited = edit_config(
        checkout, lambda c: small(c, 400), source="config/hexapod.yaml"
    )
    completed(checkout, "--configfile", edited)
    results = checkout / "results" / "hexapod"
    truth = json.loads((results / "truth.json").read_text())
    assert truth["unmatched_kink"]["value"] == 0
    assert truth["contact_rms_kink"]["value"] < 0.6, "ms"
    assert truth["labels_right_kink"]["value"] > 0.8
    maps = json.loads((results / "maps" / "exact_maps.json").read_text())
    assert 12 <= len(maps["schedules"]) < 40, "of 720, those that occur"
    assert truth["exact_map_difference_hopper"]["value"] < 1e-12
    table = pd.read_csv(results / "tables" / "touchdowns.csv")
    used = table[~table["excluded"]]
    assert len(used) >= 330
    assert used["schedule"].str.count(">").eq(5).all()
    notes = json.loads((results / "maps" / "prediction_notes.json").read_text())
    assert len(notes) < 10, "rare schedules are counted, not listed"
    page = (results / "report.html").read_text()
    assert "rarer orders, " in page
    for name in FIGURES:
        assert (results / "figures" / f"{name}.svg").exists()


def test_a_biped_with_odd_names_whose_file_has_y_up_runs_to_a_report(checkout):
    edited = edit_config(checkout, lambda c: small(c, 160), source="config/biped.yaml")
    completed(
        checkout, "--configfile", edited, "--", "results/biped/simulated/trial1.h5"
    )
    made = checkout / "results" / "biped" / "simulated" / "trial1.h5"
    recording, truth = read_recording(made), read_truth(made)
    y_up = np.ascontiguousarray(recording.positions[..., [1, 2, 0]])
    target = checkout / "data" / "external" / "biped.h5"
    target.parent.mkdir(parents=True, exist_ok=True)
    named = tuple(CALLED[name] for name in recording.markers)
    write_recording(target, replace(recording, positions=y_up, markers=named), None)

    def from_file(config):
        small(config, 160)
        config["study"] = "biped_y"
        config["recordings"] = [{"name": "trial1", "file": "data/external/biped.h5"}]
        config["input"] = {"vertical_axis": "y"}
        config["distances"] = {"enabled": False}
        config["markers"] = {
            role: [CALLED[name] for name in names]
            for role, names in config["markers"].items()
        }
        del config["simulation"]

    edited = edit_config(checkout, from_file, source="config/biped.yaml")
    completed(checkout, "--configfile", edited)
    results = checkout / "results" / "biped_y"
    table = pd.read_csv(results / "tables" / "touchdowns.csv")
    used = table[~table["excluded"]]
    assert len(used) >= 150
    assert set(used["schedule"]) == {"1>2", "2>1"}
    found = used[
        [f"contact_{CALLED[foot]}_s" for foot in ("foot1", "foot2")]
    ].to_numpy()
    nearest = np.abs(
        found.mean(axis=1)[:, None] - truth.contact_times.mean(axis=1)
    ).argmin(axis=1)
    error = found - truth.contact_times[nearest]
    assert 1e3 * error.std() < 0.5, "ms"
    axis = read_recording(results / "recordings" / "trial1.h5").vertical_axis
    assert axis == "y"
    verdict = json.loads((results / "verdict.json").read_text())
    page = (results / "report.html").read_text()
    assert verdict["sentence"] in page
    drawn = {path.stem for path in (results / "figures").iterdir()}
    assert {*FIGURES} - drawn == {OF_DISTANCES}
    assert escape(CALLED["foot1"]) in page
    # The file has no truth and the study wants no distances, so there is nothing of
    # either.
    assert "does not ask for constraint subspaces" in page
    for name in (
        "truth.json",
        "tables/distances.csv",
        "schedules/velocity_minimum.csv",
    ):
        assert not (results / name).exists(), name


@pytest.fixture(scope="module")
def steered(checkout):
    """Run a small steering study: one seed, observed in two ways, one start, few hops."""

    def shorten(config):
        config["study"] = "steered"
        config["figures"] = FEW["figures"]
        config["steering"] = {
            "observations": ["corrected", "printed"],
            "excitation": {"repeats": 1},
            "model": {"training_hops": 40, "draws": 2},
            "experiments": {
                "seeds": 1,
                "starts": 1,
                "hops": 6,
                "turn_hops": 5,
                "horizons": [3],
            },
        }

    own = (
        "config/steered.yaml"  # other tests write to the place of edited configurations
    )
    shutil.copy(checkout / edit_config(checkout, shorten), checkout / own)
    completed(checkout, "steering", "--configfile", own)
    return checkout, own


def test_a_steering_study_runs_to_a_page(steered):
    results = steered[0] / "results" / "steered" / "steering"
    outcomes = pd.read_csv(results / "tables" / "outcomes.csv")
    assert len(outcomes) == 28
    assert (outcomes["runs"] == 1).all()
    who = {"printed", "planner", "random", "none", "ceiling"}
    as_printed = {f"{name}, printed observation" for name in ("printed", "planner")}
    assert set(outcomes["controller"]) == who | as_printed
    trajectories = pd.read_csv(results / "tables" / "trajectories.csv")
    assert (
        trajectories.groupby(["seed", "experiment", "controller", "run"]).ngroups == 28
    )
    truth = json.loads((results / "truth.json").read_text())
    assert truth["missed_pairs"]["value"] == truth["invented_pairs"]["value"] == 0
    assert truth["heading_rms"]["value"] < 3, "mrad"
    assert truth["boom_angle_rms"]["value"] < 5, "mrad"
    for name in STEERING_FIGURES:
        assert (results / "figures" / f"{name}.svg").stat().st_size > 2000
    assert 1e4 < (results / "figures" / "steering_film.gif").stat().st_size < 2e6
    page = (results / "report.html").read_text()
    assert page.count("<figure") == len(STEERING_FIGURES) + 1
    record = json.loads((results / "provenance.json").read_text())
    assert len(record["stage_seconds"]) == 14
    assert not (steered[0] / "results" / "steered" / "report.html").exists()


def test_a_key_of_the_experiments_leaves_the_model_alone(steered):
    folder, edited = steered
    config = (folder / edited).read_text()
    (folder / "config" / "drag.yaml").write_text(
        config.replace("starts: 1", "starts: 3")
    )
    planned = planned_rules(folder, "steering", "--configfile", "config/drag.yaml")
    assert {"steering_experiments", "steering_outcomes", "steering_report"} <= planned
    assert "steering_learn" not in planned


def test_the_study_s_page_does_not_wait_for_the_steering(steered):
    folder, edited = steered
    planned = planned_rules(folder, "--configfile", edited)
    assert "report" in planned
    assert not any("steering" in rule for rule in planned)


def test_a_recorded_boom_takes_the_place_of_the_simulated_trial(steered):
    """The excitation is a user's recording: there is a model and a page, but no experiments."""
    folder, _ = steered
    recorded = (
        folder / "results" / "steered" / "steering" / "seeds" / "1" / "excitation.h5"
    )
    shutil.copy(recorded, folder / "data" / "mine.h5")

    def use(config):
        config["study"] = "mine"
        config["figures"] = FEW["figures"]
        config["recordings"] = [{"name": "monday", "file": "data/mine.h5"}]
        config["steering"] = {
            "recordings": ["monday"],
            "model": {"training_hops": 20, "draws": 2},
        }

    completed(folder, "steering", "--configfile", edit_config(folder, use))
    results = folder / "results" / "mine" / "steering"
    assert "no simulation of it to steer" in (results / "report.html").read_text()
    hops = pd.read_csv(results / "seeds" / "1" / "frame_changes.csv")
    assert (hops["recording"] == "monday").all()
    assert not (results / "tables" / "outcomes.csv").exists()
    assert (results / "seeds" / "1" / "geometry.json").exists()


def test_a_boom_that_does_not_move_is_told_in_words(steered):
    folder = steered[0]
    part_of_sample(folder / "data/still.h5", 60)

    def use(config):
        config["study"] = "still"
        config["recordings"] = [{"name": "hopper", "file": "data/still.h5"}]
        config["steering"] = {"recordings": ["hopper"]}

    run = snakemake(folder, "steering", "--configfile", edit_config(folder, use))
    assert run.returncode != 0
    assert "hopdata: error:" in run.stdout + run.stderr
    assert (
        "boom" in (run.stdout + run.stderr).split("hopdata: error:")[1].splitlines()[0]
    )
