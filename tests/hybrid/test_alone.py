"""The integrator is a product of its own: a folder with it and its helpers suffices."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import hopdata

PACKAGE = Path(hopdata.__file__).parent
TESTS = Path(__file__).parent
HELPERS = ("__init__.py", "arrays.py", "code_cache.py", "errors.py", "seal.py")
OWN_TESTS = ("compiled/test_kernel.py", "compiled/test_digest.py")
PYPROJECT = """
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "hopdata"
version = "0"
dependencies = ["numpy", "numba"]

[tool.hatch.build.targets.wheel]
packages = ["hopdata"]
"""
# Whatever the rest of the package needs is refused, as if it were not installed.
REFUSING = """
import importlib.abc, sys

ABSENT = {"pandas", "scipy", "h5py", "matplotlib", "sklearn", "statsmodels", "snakemake",
          "threadpoolctl", "jsonschema", "jinja2", "yaml", "platformdirs", "psutil"}

class Refuse(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ABSENT:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Refuse())
"""
# The time of flight from 20 m is known, also to the event-driven integrator.
SOLVING = """
from hopdata.hybrid import System, field, guards, solve


@field
def fall(t, y, mode, params, dy):
    dy[0] = y[1]
    dy[1] = -params[0]


@guards
def floor(t, y, dy, mode, params, h, hdot):
    h[0] = y[0]
    hdot[0] = dy[0]


system = System(fall, floor, n_states=2, guard_names=("floor",), terminal=(True,))
solution = solve(system, (0.0, 10.0), [20.0, 0.0], params=[10.0], method="dopri5")
assert abs(solution.t_end - 2.0) < 1e-9, solution
"""
# The printed method wraps a solver of the user's, without SciPy.
WRAPPING = """
from hopdata.hybrid import System, field, guards
from hopdata.hybrid.printed import FixedSteps, integrate, region_of, rk4_step


@field(compiled=False)
def run(t, y, mode, params, dy):
    dy[0] = 2.0 if mode[0] > 0 else 1.0


@guards(compiled=False)
def line(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = y[0] - 0.3, dy[0]


system = System(run, line, n_states=1, guard_names=("line",))
solver = FixedSteps(rk4_step, 0.25)
found = integrate(region_of(system), (0.0, 1.0), [0.0], solver=solver)
assert abs(found.y_end[0] - 1.7) < 1e-12, found
"""
LOOKING = """
import sys
from pathlib import Path

import hopdata

here = Path(hopdata.__file__).parent
assert here.parent == Path(sys.argv[1]), here
loaded = {name.split(".")[1] for name in sys.modules if name.startswith("hopdata.")}
assert loaded == {"arrays", "code_cache", "errors", "hybrid", "seal"}, loaded
try:
    import hopdata.recording
except ModuleNotFoundError:
    pass
else:
    raise AssertionError("the rest of the package is there as well")
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Install a folder with only the integrator, and return where it is."""
    source = tmp_path_factory.mktemp("source")
    target = tmp_path_factory.mktemp("installed")
    (source / "pyproject.toml").write_text(PYPROJECT)
    without_caches = shutil.ignore_patterns("__pycache__")
    shutil.copytree(
        PACKAGE / "hybrid", source / "hopdata/hybrid", ignore=without_caches
    )
    for name in HELPERS:
        shutil.copy(PACKAGE / name, source / "hopdata" / name)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps"]
    options = ["--no-build-isolation", "--target", str(target)]
    subprocess.run([*pip, *options, str(source)], check=True)
    return target


def run(installed, program):
    """Run a program that finds only the installed integrator, NumPy and Numba."""
    environment = os.environ | {
        "PYTHONPATH": str(installed),
        "NUMBA_CACHE_DIR": str(installed / "cache"),
        "NUMBA_OPT": "0",  # compiles the integrator in less time
    }
    command = [sys.executable, "-c", REFUSING + program, str(installed)]
    pipes = {"capture_output": True, "text": True}
    return subprocess.run(command, check=False, env=environment, cwd=installed, **pipes)


def test_it_solves_with_numpy_and_numba_only(installed):
    done = run(installed, SOLVING + LOOKING)
    assert done.returncode == 0, done.stderr


def test_the_printed_method_needs_no_scipy(installed):
    done = run(installed, WRAPPING + LOOKING)
    assert done.returncode == 0, done.stderr


def test_it_passes_tests_of_its_own(installed):
    paths = [str(TESTS / name) for name in OWN_TESTS]
    options = [
        "-q",
        "-n",
        "0",
        "-p",
        "no:cacheprovider",
        "--noconftest",
        "-c",
        os.devnull,
    ]
    program = f"import pytest\nraise SystemExit(pytest.main({[*options, *paths]!r}))"
    done = run(installed, program)
    assert done.returncode == 0, done.stdout + done.stderr


def test_what_it_lacks_is_noticed(installed):
    done = run(installed, "import hopdata.hybrid, scipy")
    assert "No module named 'scipy'" in done.stderr
    done = run(installed, "import hopdata\nhopdata.analyse")
    assert "No module named 'hopdata.analysis'" in done.stderr
