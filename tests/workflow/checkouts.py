"""Copies of the checkout in which the workflow runs as a user runs it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[2]
PARTS = ("Snakefile", "workflow", "config", "profiles", "data/sample", "pyproject.toml")
FIGURES = (
    "verdict",
    "fig2_2_sections",
    "fig2_3_schedule",
    "fig2_4_prediction",
    "fig2_5_distances",
    "stability",
)


def copy_checkout(target):
    """Copy all but the library, to which a link leads: what it has compiled is compiled once."""
    (target / "src").parent.mkdir(parents=True, exist_ok=True)
    (target / "src").symlink_to(ROOT / "src")
    for part in PARTS:
        source, copy = ROOT / part, target / part
        copy.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, copy, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, copy)
    return target


def snakemake(folder, *arguments, cores=2):
    environment = {**os.environ, "PYTHONPATH": str((folder / "src").resolve())}
    here = [] if cores is None else ["--cores", str(cores)]
    return subprocess.run(
        [sys.executable, "-m", "snakemake", *here, *arguments],
        cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=1200,
    )  # fmt: skip


def completed(folder, *arguments, cores=2):
    """Run, which has to end well, and return all that is printed."""
    run = snakemake(folder, *arguments, cores=cores)
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout + run.stderr


def edit_config(folder, edit, *, source="config/config.yaml"):
    """Write a changed copy of a config and return its path."""
    config = yaml.safe_load((folder / source).read_text())
    edit(config)
    path = folder / "config" / "edited.yaml"
    path.write_text(yaml.safe_dump(config, sort_keys=False))
    return str(path)


def planned_rules(folder, *arguments):
    """Names of the rules that a dry run would execute."""
    lines = completed(folder, "--dry-run", *arguments).splitlines()
    return {x.split()[1].rstrip(":") for x in lines if x.startswith(("rule ", "localrule "))}
