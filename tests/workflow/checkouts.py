"""Copies of the checkout in which the workflow runs as for a user."""

from __future__ import annotations

import atexit
import json
import os
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from tempfile import NamedTemporaryFile

import yaml

from hopdata.recordings.readers.hdf5 import read_recording, write_recording

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
    """Copy everything but the library, which is linked so that it compiles only once."""
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


def part_of_sample(path, seconds):
    """Write the beginning of the bundled recording, for tests that need no more."""
    sample = read_recording(ROOT / "data/sample/hopper.h5")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_recording(path, sample.part(slice(int(seconds * sample.rate_hz))), None)
    return path


def snakemake(folder, *arguments, cores=2):
    """Run Snakemake as a user does, except that its imports are already loaded (on Linux)."""
    environment = {**os.environ, "PYTHONPATH": str((folder / "src").resolve())}
    arguments = [
        *([] if cores is None else ["--cores", str(cores)]),
        *map(str, arguments),
    ]
    if sys.platform != "linux":
        return subprocess.run(
            [sys.executable, "-m", "snakemake", *arguments],
            cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=1200,
        )  # fmt: skip
    with NamedTemporaryFile("r") as out, NamedTemporaryFile("r") as err:
        ask = [str(folder), environment, arguments, [out.name, err.name]]
        server = _forked()
        print(json.dumps(ask), file=server.stdin, flush=True)
        code = int(server.stdout.readline())
        return subprocess.CompletedProcess(arguments, code, out.read(), err.read())


@cache
def _forked():
    """Return a process that has imported Snakemake and forks for each run."""
    program = Path(__file__).with_name("forked.py")
    server = subprocess.Popen(
        [sys.executable, program],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    atexit.register(server.communicate)
    return server


def completed(folder, *arguments, cores=2):
    """Run Snakemake, require success, and return all that is printed."""
    run = snakemake(folder, *arguments, cores=cores)
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout + run.stderr


def require_same_bytes(results, saved):
    """Require that a study of one process has saved what the workflow has written."""
    kinds = ("tables/*.csv", "figures/*.svg", "figures/*.png")
    for kind in (*kinds, "verdict.json", "quality.json"):
        names = {path.relative_to(results) for path in results.glob(kind)}
        assert names, kind
        assert names == {path.relative_to(saved) for path in saved.glob(kind)}
        for name in names:
            assert (saved / name).read_bytes() == (results / name).read_bytes(), name


def edit_config(folder, edit, *, source="config/config.yaml"):
    """Write a changed copy of a config and return its path."""
    config = yaml.safe_load((folder / source).read_text())
    edit(config)
    path = folder / "config" / "edited.yaml"
    path.write_text(yaml.safe_dump(config, sort_keys=False))
    return str(path)


def planned_rules(folder, *arguments):
    """Return the names of the rules that a dry run would execute."""
    lines = completed(folder, "--dry-run", *arguments).splitlines()
    return {
        x.split()[1].rstrip(":") for x in lines if x.startswith(("rule ", "localrule "))
    }
