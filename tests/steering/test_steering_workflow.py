"""A small steering study, from its configuration to its page, in a copy of the checkout."""

import json
import os
import shutil

import pandas as pd
import pytest
from checkouts import (
    completed,
    copy_checkout,
    edit_config,
    part_of_sample,
    planned_rules,
    snakemake,
)

from hopdata.steering.experiments.tasks import EXPERIMENTS
from plain_columns import counted_from_zero_in, shadowed_in

pytestmark = pytest.mark.workflow

STEERING_FIGURES = (
    "fig3_5_origin",
    "fig3_6_turn",
    "fig3_8_origin_board",
    "fig3_9_turn_board",
    "steering_outcomes",
    "steering_waypoints",
    "steering_map",
    "fig3_3_printed",
    "steering_learning",
    "steering_kernels",
)


#: With `ALL=1` both; `test_subsets.py` puts both together in any run.
OBSERVATIONS = ["corrected", "printed"] if "ALL" in os.environ else ["corrected"]


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """Return a checkout in which nothing has run yet."""
    return copy_checkout(tmp_path_factory.mktemp("steering"))


@pytest.fixture(scope="module")
def steered(checkout):
    """Run a small steering study: one seed, one start, few hops."""

    def shorten(config):
        config["study"] = "steered"
        config["figures"] = {"formats": ["svg"]}
        config["steering"] = {
            "observations": OBSERVATIONS,
            "excitation": {"n_angles": 12, "n_steps": 2, "repeats": 1},
            "model": {"training_hops": 40, "draws": 2},
            "experiments": {
                "seeds": 1,
                "starts": 1,
                "hops": 6,
                "turn_hops": 5,
                "horizons": [3],
                "waypoints_m": [[0.5, 0.0], [0.5, 0.5]],
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
    assert set(outcomes["experiment"]) == set(EXPERIMENTS)
    assert (outcomes["runs"] == 1).all()
    who = {"printed", "planner", "random", "none", "ceiling"}
    if "printed" in OBSERVATIONS:
        who |= {f"{name}, printed observation" for name in ("printed", "planner")}
    assert set(outcomes["controller"]) == who
    assert len(outcomes) == 5 * len(who)
    trajectories = pd.read_csv(results / "tables" / "trajectories.csv")
    runs = trajectories.groupby(["seed", "experiment", "controller", "run"])
    assert runs.ngroups == 5 * len(who)
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
    assert len(record["stage_seconds"]) == {1: 13, 2: 17}[len(OBSERVATIONS)]
    assert not (steered[0] / "results" / "steered" / "report.html").exists()


def test_no_column_of_a_table_shadows_an_attribute(steered):
    assert shadowed_in(steered[0] / "results" / "steered") == {}


def test_every_number_in_a_table_counts_from_1(steered):
    assert counted_from_zero_in(steered[0] / "results" / "steered") == {}


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
        config["figures"] = {"formats": ["svg"]}
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
