"""Small simulated studies, from their configuration to a report, in a copy of the checkout."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from checkouts import FIGURES, copy_checkout, edit_config, snakemake

from hopdata.recordings.hdf5 import read_recording, read_truth, write_recording

pytestmark = pytest.mark.workflow


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """A checkout in which nothing has run yet."""
    return copy_checkout(tmp_path_factory.mktemp("studies"))


@pytest.mark.parametrize("study", ["thesis", "control", "half_spread"])
def test_the_dissertation_s_study_simulates_its_recordings_apart(checkout, study):
    run = snakemake(checkout, "--dry-run", "--configfile", f"config/{study}.yaml")
    assert run.returncode == 0, run.stderr
    jobs = [x for x in (run.stdout + run.stderr).splitlines() if x.startswith("rule simulate")]
    assert len(jobs) == 4


def test_a_small_study_of_a_control_runs_to_a_report(checkout):
    def shorten(config):
        config["study"] = "small"
        for recording, seconds in zip(config["recordings"], (50, 50, 50, 40.5), strict=True):
            recording["simulation"]["duration_s"] = seconds
        config["sections"] = {"pre_height_m": 0.52, "post_height_m": 0.275}

    edited = edit_config(checkout, shorten, source="config/control.yaml")
    run = snakemake(checkout, "--configfile", edited)
    assert run.returncode == 0, run.stdout + run.stderr
    results = checkout / "results" / "small"
    truth = json.loads((results / "truth.json").read_text())
    assert truth["touchdowns_usable"]["value"] > 250
    assert truth["labels_right_of_all_kink"]["value"] > 0.9
    assert truth["exact_map_difference_hopper"]["value"] < 1e-12
    assert truth["exact_map_difference_coupling"]["value"] > 1
    assert abs(truth["scaling_slope_hopper"]["value"] - 2) < 0.15
    assert truth["scaling_slope_coupling"]["value"] < 1.4
    assert 0 < truth["velocity_rms_pre"]["value"] < truth["velocity_rms_post"]["value"] < 100
    assert 0 < truth["map_error_noise_free_pooled_all"]["value"] < 2
    assert (results / "figures" / "scaling_study.svg").exists()
    assert (results / "figures" / "map_matrices.svg").exists()
    assert 0 < truth["map_estimate_error_corrected_curved"]["value"] < 2
    for name in FIGURES:
        assert (results / "figures" / f"{name}.svg").exists()
    table = pd.read_csv(results / "tables" / "touchdowns.csv")
    assert table["recording"].nunique() == 4


def small(config, hops):
    """Cut a study of an animal down to what a test needs."""
    config["recordings"] = config["recordings"][:1]
    config["recordings"][0]["simulation"] = {"hops": hops}
    config["prediction"] = {"bootstraps": 40, "train": 30, "test": 10, "minimum_class": 15}
    config["subspaces"] = {"bootstraps": 40}
    config["distances"] = {"pairs": 40}
    config["verdict"] = {"flips": 99, "permutations": 19}
    config["scaling_study"] = {"landings": 100, "scales": [1.0, 0.25]}


def test_a_small_study_of_a_hexapod_runs_to_a_report(checkout):
    edited = edit_config(checkout, lambda c: small(c, 400), source="config/hexapod.yaml")
    run = snakemake(checkout, "--configfile", edited)
    assert run.returncode == 0, run.stdout + run.stderr
    results = checkout / "results" / "hexapod"
    truth = json.loads((results / "truth.json").read_text())
    assert truth["touchdowns_usable"]["value"] >= 330
    assert truth["unmatched_kink"]["value"] == 0
    assert truth["contact_rms_kink"]["value"] < 0.6, "ms"
    assert truth["labels_right_kink"]["value"] > 0.8
    maps = json.loads((results / "maps" / "exact_maps.json").read_text())
    assert 12 <= len(maps["schedules"]) < 40, "of 720, those that occur"
    assert truth["exact_map_difference_hopper"]["value"] < 1e-12
    table = pd.read_csv(results / "tables" / "touchdowns.csv")
    used = table[~table["excluded"]]
    assert used["schedule"].str.count(">").eq(5).all()
    notes = json.loads((results / "maps" / "prediction_notes.json").read_text())
    assert len(notes) < 10, "rare schedules are counted, not listed"
    page = (results / "report.html").read_text()
    assert "rarer orders are not listed" in page
    for name in FIGURES:
        assert (results / "figures" / f"{name}.svg").exists()


def test_a_small_study_of_a_biped_whose_file_has_y_up_runs_to_a_report(checkout):
    edited = edit_config(checkout, lambda c: small(c, 160), source="config/biped.yaml")
    run = snakemake(checkout, "--configfile", edited, "--", "results/biped/simulated/trial1.h5")
    assert run.returncode == 0, run.stdout + run.stderr
    made = checkout / "results" / "biped" / "simulated" / "trial1.h5"
    recording, truth = read_recording(made), read_truth(made)
    y_up = np.ascontiguousarray(recording.positions[..., [1, 2, 0]])
    target = checkout / "data" / "external" / "biped.h5"
    target.parent.mkdir(parents=True, exist_ok=True)
    write_recording(target, replace(recording, positions=y_up), None)

    def from_file(config):
        small(config, 160)
        config["study"] = "biped_y"
        config["recordings"] = [{"name": "trial1", "file": "data/external/biped.h5"}]
        config["input"] = {"vertical_axis": "y"}
        del config["simulation"]

    edited = edit_config(checkout, from_file, source="config/biped.yaml")
    run = snakemake(checkout, "--configfile", edited)
    assert run.returncode == 0, run.stdout + run.stderr
    results = checkout / "results" / "biped_y"
    table = pd.read_csv(results / "tables" / "touchdowns.csv")
    used = table[~table["excluded"]]
    assert len(used) >= 150
    assert set(used["schedule"]) == {"1>2", "2>1"}
    found = used[["contact_foot1_s", "contact_foot2_s"]].to_numpy()
    nearest = np.abs(found.mean(axis=1)[:, None] - truth.contact_times.mean(axis=1)).argmin(axis=1)
    error = found - truth.contact_times[nearest]
    assert 1e3 * error.std() < 0.5, "ms"
    axis = read_recording(results / "recordings" / "trial1.h5").vertical_axis
    assert axis == "y"
    verdict = json.loads((results / "verdict.json").read_text())
    assert verdict["sentence"] in (results / "report.html").read_text()
    for name in FIGURES:
        assert (results / "figures" / f"{name}.svg").exists()
