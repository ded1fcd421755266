"""hopdata installed from its wheel, away from any checkout."""

import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
BUNDLED = ("Snakefile", "workflow/**/*", "config/*", "profiles/**/*", "data/sample/*")
pytestmark = pytest.mark.workflow


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Return the wheel, built by the locked tools alone."""
    folder = tmp_path_factory.mktemp("wheel")
    pip("wheel", "--no-build-isolation", str(ROOT), "--wheel-dir", str(folder))
    return next(folder.glob("hopdata-*.whl"))


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    folder = tmp_path_factory.mktemp("installed")
    pip("install", str(wheel), "--target", str(folder))
    return folder


def pip(command, *arguments):
    options = ("--quiet", "--disable-pip-version-check", "--no-index", "--no-deps")
    subprocess.run(
        [sys.executable, "-m", "pip", command, *options, *arguments], check=True
    )


def hopdata_run(installed, folder, *arguments):
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    return subprocess.run(
        [sys.executable, "-m", "hopdata", "run", *arguments],
        cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip


def test_the_wheel_holds_the_workflow_of_the_checkout(wheel):
    found = {
        file for pattern in BUNDLED for file in ROOT.glob(pattern) if file.is_file()
    }
    asked = {
        f"hopdata/_workflow/{file.relative_to(ROOT)}": file.read_bytes()
        for file in found
        if file.parent.name != "__pycache__"
    }
    assert len(asked) > 50
    with zipfile.ZipFile(wheel) as archive:
        held = {
            name for name in archive.namelist() if name.startswith("hopdata/_workflow/")
        }
        assert {name: archive.read(name) for name in held} == asked


def test_the_sample_is_planned_from_the_wheel_in_an_empty_folder(installed, tmp_path):
    result = hopdata_run(
        installed, tmp_path, "--", "-n"
    )  # lets Snakemake say everything
    assert result.returncode == 0, result.stdout + result.stderr
    assert (
        f"{installed.name}/hopdata/_workflow/workflow/captions/verdict.md"
        in result.stdout
    )
    assert "This was a dry-run" in result.stdout
    assert not (tmp_path / "results").exists()


def test_a_target_after_the_dashes_is_snakemakes(installed, tmp_path):
    result = hopdata_run(
        installed, tmp_path, "--", "results/sample/verdict.json", "--dry-run"
    )
    assert result.returncode == 0, result.stdout + result.stderr
    stages = [
        line.split()[0] for line in result.stdout.splitlines() if line.startswith("  ")
    ]
    assert stages == [
        "import_recording",
        "floor_compensation",
        "foot_contacts",
        "poincare_sections",
        "mode_schedules",
        "home_frame",
        "verdict",
    ]


def test_the_page_on_the_dissertation_is_planned_from_the_wheel(installed, tmp_path):
    result = hopdata_run(installed, tmp_path, "dissertation", "--dry-run")
    assert result.returncode == 0, result.stdout + result.stderr
    assert "dissertation: would run\n" in result.stdout
    assert "  dissertation_page    1 job\n" in result.stdout
    package = installed / "hopdata" / "dissertation"
    for file in ("items/README.md", "report/templates/dissertation.html.j2"):
        assert (package / file).is_file()


def test_another_recording_in_the_samples_place_is_refused(installed, tmp_path):
    recording = tmp_path / "data/sample/hopper.h5"
    recording.parent.mkdir(parents=True)
    recording.write_bytes(b"mine")
    result = hopdata_run(installed, tmp_path)
    assert result.returncode == 1
    assert "hopper.h5: expected the bundled one, found another file" in result.stderr
    assert recording.read_bytes() == b"mine"


def test_what_made_a_result_is_named_alike(installed):
    """The scripts in the wheel are not modules of the library."""
    digest = "from hopdata.provenance import package_digest; print(package_digest())"
    said = {
        subprocess.run(
            [sys.executable, "-c", digest], env={**os.environ, "PYTHONPATH": str(path)},
            capture_output=True, text=True, check=True,
        ).stdout
        for path in (installed, ROOT / "src")
    }  # fmt: skip
    assert len(said) == 1


def test_the_pages_example_of_a_module_is_planned(tmp_path):
    """The test runs the block of docs/cluster.md with one path changed, beside another workflow."""
    page = (ROOT / "docs/cluster.md").read_text()
    block = re.search(r"```python\n(module landing:.*?)```", page, re.DOTALL)[1]
    assert '"../hopdata/Snakefile"' in block
    block = block.replace("../hopdata/Snakefile", str(ROOT / "Snakefile"))
    own = 'rule mine:\n    input: "results/sample/report.html"\n    default_target: True\n'
    (tmp_path / "Snakefile").write_text(f'configfile: "both.yaml"\n{block}\n{own}')
    config = yaml.safe_load((ROOT / "config/config.yaml").read_text())
    (tmp_path / "both.yaml").write_text(yaml.safe_dump({"landing": config, "other": 1}))
    (tmp_path / "data").symlink_to(ROOT / "data")
    result = subprocess.run(
        [sys.executable, "-m", "snakemake", "--cores", "1", "--dry-run"], cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
        capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert result.returncode == 0, result.stdout + result.stderr
    assert "rule landing_report:" in result.stdout
