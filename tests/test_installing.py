"""An installation contains what the lock files list, including the build requirements."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
# a requirement of Snakemake without a wheel, which has to be built
SOURCE_ONLY = "connection-pool"


def entries(lock):
    """Return name -> its lines, version and hashes."""
    entry = (ROOT / lock).read_text().replace("\\\n", " ").splitlines()
    return {
        line.split("==")[0]: line for line in entry if line and not line.startswith("#")
    }


def test_every_requirement_is_pinned_with_hashes():
    for lock in ROOT.glob("requirements*.lock"):
        for name, entry in entries(lock).items():
            assert entry.startswith(f"{name}=="), f"{lock}: {name}"
            assert "--hash=sha256:" in entry, f"{lock}: {name}"


def test_what_builds_hopdata_is_locked():
    locked = entries("requirements-build.lock")
    for text in tomllib.loads((ROOT / "pyproject.toml").read_text())["build-system"][
        "requires"
    ]:
        needed = Requirement(text)
        version = locked[needed.name.replace("_", "-")].split("==")[1].split()[0]
        assert needed.specifier.contains(version)


def test_an_environment_is_made_of_hashed_files_alone(tmp_path):
    """Pip follows the Makefile's steps, with the one dependency that has to be built."""
    for name in (
        "Makefile",
        "Snakefile",
        "pyproject.toml",
        "README.md",
        "LICENSE",
        "requirements-build.lock",
    ):
        shutil.copy(ROOT / name, tmp_path)
    (tmp_path / "src").symlink_to(ROOT / "src")
    built = entries("requirements.lock")[SOURCE_ONLY]
    (tmp_path / "requirements.lock").write_text(f"{built}\n")
    log = tmp_path / "pip.log"
    tools = tmp_path / "tools"  # excludes uv
    tools.mkdir()
    for name in ("sh", "touch", "echo", "test"):
        (tools / name).symlink_to(shutil.which(name))
    environment = {
        **os.environ,
        "PATH": str(tools),
        "PIP_LOG": str(log),
        "PIP_NO_CACHE_DIR": "1",
    }
    run = subprocess.run(
        [shutil.which("make"), ".venv/.run", "VENV=.venv", f"PYTHON={sys.executable}"],
        cwd=tmp_path, env=environment, capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    said = log.read_text()
    assert "Successfully built connection-pool" in said
    assert "build dependencies" not in said.lower(), (
        "a build was isolated: its tools are not locked"
    )


def test_what_is_published_agrees_with_the_project():
    """The conda recipe, the citation and Zenodo's record agree with pyproject.toml."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    recipe = (ROOT / "packaging/meta.yaml").read_text()
    assert f'version = "{project["version"]}"' in recipe
    assert f"version: {project['version']}\n" in (ROOT / "CITATION.cff").read_text()
    other = {"matplotlib": "matplotlib-base", "snakemake": "snakemake-minimal"}
    for text in project["dependencies"]:
        needed = Requirement(text)
        assert f"- {other.get(needed.name, needed.name)} {needed.specifier}" in recipe
    record = json.loads((ROOT / ".zenodo.json").read_text())
    assert record["license"] == project["license"]
    assert set(record["keywords"]) <= set(project["keywords"])


def test_what_the_image_compiles_is_there():
    """The code in the Dockerfile exists in today's library."""
    image = (ROOT / "Dockerfile").read_text()
    line = re.search(r"^RUN (python -c .*) \\$", image, re.MULTILINE)[1]
    subprocess.run([sys.executable, *shlex.split(line)[1:]], check=True, timeout=300)


@pytest.mark.parametrize(
    "path", sorted((ROOT / ".github/workflows").glob("*.yml")), ids=str
)
def test_workflows_call_what_the_makefile_has(path):
    workflow = yaml.safe_load(path.read_text())
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    for job in workflow["jobs"].values():
        assert set(job.get("needs", "").split()) <= set(workflow["jobs"])
        for command in (step["run"] for step in job["steps"] if "run" in step):
            for target in re.findall(r"^make ([a-z-]+)", command, re.MULTILINE):
                assert target in targets


@pytest.mark.parametrize("config", ["config/config.yaml", "config/thesis.yaml"])
def test_make_figures_says_what_it_makes_and_where_it_is(config):
    asked = ["make", "--no-print-directory", "--dry-run", "figures", f"CONFIG={config}"]
    commands = subprocess.run(
        asked, cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    first, *_, last = (line for line in commands if line.startswith("echo "))
    is_first_look = config == "config/config.yaml"
    assert commands[0] == first
    assert ("Two studies" in first) == is_first_look
    assert (config in first) != is_first_look
    studies = [
        yaml.safe_load((ROOT / one).read_text(encoding="utf-8"))["study"]
        for one in ("config/config.yaml", "config/sample_control.yaml")
    ]
    pages = [f"results/{study}/report.html" for study in studies]
    if not is_first_look:
        pages = []
    assert re.findall(r"results/\S+/report\.html", last) == pages
