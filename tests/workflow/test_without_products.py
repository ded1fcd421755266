"""A study runs in an installation whose products were deleted, and loads none that is there."""

import json
import os
import shutil
import subprocess
import sys

import pytest
import yaml
from checkouts import (
    ROOT,
    copy_checkout,
    part_of_sample,
    planned_rules,
    require_same_bytes,
    snakemake,
)

pytestmark = pytest.mark.workflow

# A study of a minute of the sample, with few draws.
SHORT = """
study: short
recordings: [{name: hopper, file: data/short.h5}]
markers: {body: [body1, body2, body3], feet: [foot1, foot2, foot3], boom: [boom]}
prediction: {bootstraps: 20, train: 30, test: 10, minimum_class: 15}
distances: {enabled: false}
verdict: {flips: 99}
figures: {formats: [svg, png]}
"""
PRODUCTS = ["steering", "dissertation"]
OURS = tuple(f"hopdata.{name}" for name in PRODUCTS)
LOADED = f"[name for name in sys.modules if name.startswith({OURS})]"
NOTEBOOK = f"""
import sys
import hopdata as hd


study = hd.study("config/short.yaml")
assert len(study.pairs) > 50, len(study.pairs)
assert "verdict" in dir(study.figures)
assert not {LOADED}, {LOADED}
"""
# What reads the files of products: schema, command line, catalogue of figures.
READS = f"""
import sys
from hopdata.__main__ import COMMANDS
from hopdata.config.loading import load_config
from hopdata.figures.catalogue import FIGURES
config = load_config("config/short.yaml")
print("steering" in config, "drive" in COMMANDS, "steering_runs" in FIGURES, {LOADED})
"""


def checkout_with_library(target, *, leave_out=()):
    """Copy a checkout whose library is a copy too, without these parts of it."""
    copy_checkout(target)
    (target / "src").unlink()
    ignored = shutil.ignore_patterns("__pycache__", *leave_out)
    shutil.copytree(ROOT / "src", target / "src", symlinks=True, ignore=ignored)
    part_of_sample(target / "data/short.h5", 60)
    (target / "config/short.yaml").write_text(SHORT)
    return target


@pytest.fixture(scope="module")
def without(tmp_path_factory):
    """Return a checkout in which the folders of the products were deleted."""
    folder = tmp_path_factory.mktemp("without")
    return checkout_with_library(folder, leave_out=PRODUCTS)


def python(folder, *arguments):
    environment = {**os.environ, "PYTHONPATH": str(folder / "src")}
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip


def test_without_steering_a_study_runs_to_its_report(without):
    run = snakemake(without, "--configfile", "config/short.yaml")
    assert run.returncode == 0, run.stdout + run.stderr
    results = without / "results/short"
    assert json.loads((results / "verdict.json").read_text())["conclusion"]
    assert (results / "figures/verdict.svg").stat().st_size > 2000
    assert "Study" in (results / "report.html").read_text()


def test_one_process_has_the_same_bytes(without, tmp_path):
    """A study in a notebook gives everything that two parallel processes have written."""
    study = (
        "import hopdata, sys; hopdata.analyse('config/short.yaml').save(sys.argv[1])"
    )
    run = python(without, "-c", study, tmp_path)
    assert run.returncode == 0, run.stderr
    require_same_bytes(without / "results/short", tmp_path)


def test_without_steering_the_commands_and_the_notebook_work(without):
    checked = python(without, "-m", "hopdata", "check", "config/short.yaml")
    assert checked.returncode == 0, checked.stdout + checked.stderr
    assert "touchdowns" in checked.stdout
    told = python(without, "-m", "hopdata", "--help").stdout
    assert "check" in told
    assert "drive" not in told
    assert "dissertation" not in told
    notebook = python(without, "-c", NOTEBOOK)
    assert notebook.returncode == 0, notebook.stderr
    assert python(without, "-c", READS).stdout == "False False False []\n"


def test_without_steering_its_block_is_an_error_that_names_the_extra(without):
    config = yaml.safe_load(SHORT) | {"steering": {"model": {"training_hops": 20}}}
    (without / "config/steered.yaml").write_text(yaml.safe_dump(config))
    run = python(without, "-m", "hopdata", "check", "config/steered.yaml")
    assert run.returncode == 1
    assert run.stderr.count("expected") == 1
    assert "steering: expected a known key" in run.stderr
    assert "pip install 'hopdata[steering]'" in run.stderr


@pytest.fixture
def broken(without):
    """Put the products back for a test, so that each fails when it is imported.

    The library stays where it was, and so need not be compiled again.
    """
    for name in PRODUCTS:
        copy = without / "src/hopdata" / name
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / "src/hopdata" / name, copy, ignore=ignored)
        (copy / "__init__.py").write_text("raise ValueError('used')")
    yield without
    for name in PRODUCTS:
        shutil.rmtree(without / "src/hopdata" / name)


def test_a_study_does_not_load_the_steering_that_is_there(broken):
    """Products fail when they are imported: their rules are planned all the same."""
    folder = broken
    options = ("--forceall", "--configfile", "config/short.yaml")
    planned = planned_rules(folder, *options)
    assert "report" in planned
    planned = planned_rules(folder, "steering", *options)
    assert {"steering_learn", "figures_steering_runs", "steering_report"} <= planned
    planned = planned_rules(folder, "dissertation", *options)
    assert {"dissertation_page", "dissertation"} <= planned
    assert python(folder, "-c", READS).stdout == "True True True []\n"
    notebook = python(folder, "-c", NOTEBOOK)
    assert notebook.returncode == 0, notebook.stderr
    # What fails in a product that is there is told.
    run = python(folder, "-m", "hopdata", "drive")
    assert "ValueError: used" in run.stderr
