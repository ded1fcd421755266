"""``hopdata run``: the whole workflow, from wherever hopdata is installed."""

from __future__ import annotations

import argparse
import filecmp
import json
import shutil
import subprocess
import sys
from pathlib import Path

from hopdata.commands.terminal import OK, PROBLEM
from hopdata.errors import ConfigError

# In a checkout this link leads to its own Snakefile; in a wheel the file is beside the others.
SNAKEFILE = (Path(__file__).parents[1] / "_workflow" / "Snakefile").resolve()
SAMPLE, SAMPLE_CONFIG = Path("data/sample/hopper.h5"), Path("config/config.yaml")


def run(options: argparse.Namespace) -> int:
    """Run a study in the current folder, and say what came out and where it is to be read."""
    from hopdata.config.loading import load_config

    config = options.config
    if config is None:
        _bring_sample()
        config = SNAKEFILE.parent / SAMPLE_CONFIG
    results = Path("results") / load_config(config)["study"]
    if run_workflow(config, "--cores", options.cores, *options.passed_on):
        return PROBLEM
    verdict, page = results / "verdict.json", results / "report.html"
    is_dry = {"-n", "--dry-run", "--dryrun"} & set(options.passed_on)
    if page.exists() and verdict.exists() and not is_dry:
        print(json.loads(verdict.read_text(encoding="utf-8"))["sentence"])
        print(page)
    return OK


def run_workflow(config: Path, *options: str) -> int:
    """Run Snakemake on a configuration, and return its exit code."""
    if not SNAKEFILE.exists():
        raise ConfigError(
            f"{SNAKEFILE}: expected the workflow, found no file; install hopdata anew"
        )
    # In this order: any number of files may follow --configfile, and a target would be one.
    places = ["--configfile", str(config), "--snakefile", str(SNAKEFILE)]
    command = [sys.executable, "-m", "snakemake", *places, *options]
    with subprocess.Popen(command) as snakemake:
        try:
            return snakemake.wait()
        except KeyboardInterrupt:  # Snakemake got it too: it ends its jobs and unlocks the folder
            snakemake.wait()
            raise


def _bring_sample() -> None:
    """Copy the bundled recording to where its configuration, as any, names it."""
    source = SNAKEFILE.parent / SAMPLE
    if not SAMPLE.exists():
        print(f"{SAMPLE}: copied from the installation", flush=True)
        SAMPLE.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, SAMPLE)
    elif not filecmp.cmp(source, SAMPLE, shallow=False):
        raise ConfigError(
            f"{SAMPLE}: expected the bundled sample, found another file; go to another folder"
        )
