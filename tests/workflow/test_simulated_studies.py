"""Small simulated studies, from their configuration to a report, in a copy of the checkout."""

import json
import os
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
    results = checkout / "results" / "small"
    # The two studies below run to their reports, too.
    whole = "ALL" in os.environ
    only = () if whole else ("--", "results/small/truth.json")
    completed(checkout, "--configfile", edited, *only)
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
    assert 0 < truth["map_estimate_error_corrected_curved"]["value"] < 2
    table = pd.read_csv(results / "tables" / "touchdowns.csv")
    assert table["recording"].nunique() == 2
    assert (~table["excluded"]).sum() > 250
    if whole:
        for name in (*FIGURES, "scaling_study", "map_matrices"):
            assert (results / "figures" / f"{name}.svg").exists()


def small(config, hops):
    """Reduce a study of an animal to what a test needs."""
    config["recordings"] = config["recordings"][:1]
    config["recordings"][0]["simulation"] = {"hops": hops}
    config["scaling_study"] = {"landings": 100, "scales": [1.0, 0.25]}
    config.update(FEW)


def test_a_small_study_of_a_hexapod_runs_to_a_report(checkout):
    hops = 400 if "ALL" in os.environ else 250
    edited = edit_config(
        checkout, lambda c: small(c, hops), source="config/hexapod.yaml"
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
    assert len(used) >= 0.825 * hops
    assert used["schedule"].str.count(">").eq(5).all()
    for name in ("scaling_study", "map_matrices"):
        assert (results / "figures" / f"{name}.svg").exists()
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
    page = (results / "report.html").read_text().replace("\u00a0", " ")
    assert verdict["sentence"] in page
    drawn = {path.stem for path in (results / "figures").iterdir()}
    assert {*FIGURES} - drawn == {OF_DISTANCES}
    assert escape(CALLED["foot1"]) in page
    # The file has no truth and the study wants no distances, so there is nothing of
    # either.
    assert "constraint subspaces" not in page
    for name in (
        "truth.json",
        "tables/distances.csv",
        "schedules/velocity_minimum.csv",
    ):
        assert not (results / name).exists(), name
