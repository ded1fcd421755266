"""The integrator is a product of its own: its wheel brings it, and nothing else.

``python packaging/hybrid/alone.py`` runs its tests, pages and benchmarks in an
environment that has only this wheel; here is what is quick.
"""

from __future__ import annotations

import ast
import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

import hopdata

ROOT = Path(__file__).parents[1]
PACKAGE = Path(hopdata.__file__).parent
PROJECT = ROOT / "packaging" / "hybrid"
TESTS = ROOT / "tests" / "hybrid"
OWN_TESTS = ("compiled/test_kernel.py", "compiled/test_digest.py")
# The folder of the wheel that holds the package, and that a .pth file names.
FOLDER = "hopdata_hybrid"
# Modules beside the integrator that come with it.
BROUGHT = {"arrays", "code_cache", "errors", "private_numba", "seal"}
# Libraries that the integrator may import. Numba brings llvmlite.
LIBRARIES = {"llvmlite", "numba", "numpy", "scipy"}
# `model` is written by the test that imports it, in another process.
OF_TESTS = {"hypothesis", "model", "mpmath", "packaging", "pytest"}

# Whatever the rest of the package needs is refused, as if it were not installed.
REFUSING = """
import importlib.abc, sys

ABSENT = {"pandas", "h5py", "matplotlib", "sklearn", "statsmodels", "snakemake",
          "threadpoolctl", "jsonschema", "jinja2", "yaml", "platformdirs", "psutil"}

class Refuse(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ABSENT:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Refuse())
"""
REFUSING_SCIPY = REFUSING.replace('{"pandas"', '{"scipy", "pandas"')
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
from pathlib import Path

import hopdata

assert Path(hopdata.__file__).is_relative_to(sys.argv[1]), hopdata.__file__
loaded = {name.split(".")[1] for name in sys.modules if name.startswith("hopdata.")}
brought = {"arrays", "code_cache", "errors", "private_numba", "seal"}
assert loaded == {"hybrid", *brought}, loaded
try:
    import hopdata.recording
except ModuleNotFoundError:
    pass
else:
    raise AssertionError("the rest of the package is there as well")
"""


def pip(*arguments):
    options = ["--quiet", "--no-index", "--no-deps", "--disable-pip-version-check"]
    subprocess.run([sys.executable, "-m", "pip", *arguments, *options], check=True)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Return the wheel, built by the locked tools alone."""
    folder = tmp_path_factory.mktemp("wheel")
    pip("wheel", "--no-build-isolation", str(PROJECT), "--wheel-dir", str(folder))
    return next(folder.glob("hopdata_hybrid-*.whl"))


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """Install the wheel in a folder, and return where it is."""
    folder = tmp_path_factory.mktemp("installed")
    pip("install", str(wheel), "--target", str(folder))
    return folder


def run(installed, program, *options, first=FOLDER, code=None):
    """Run a program that finds the installed integrator, as the .pth file says.

    Compiled code is kept in a folder beside it, or in another one.
    """
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(installed / first), str(installed)]),
        "NUMBA_CACHE_DIR": str(code or installed / "cache"),
        "NUMBA_OPT": "0",  # compiles the integrator in less time
    }
    command = [sys.executable, *options, "-c", program, str(installed)]
    pipes = {"capture_output": True, "text": True}
    return subprocess.run(command, check=False, env=environment, cwd=installed, **pipes)


def test_it_solves_with_numpy_and_numba_only():
    """The same files as in the wheel, in the checkout, whose compiled code is kept."""
    environment = os.environ | {"PYTHONPATH": str(PACKAGE.parent)}
    command = [sys.executable, "-c", REFUSING_SCIPY + SOLVING]
    pipes = {"capture_output": True, "text": True}
    done = subprocess.run(command, check=False, env=environment, **pipes)
    assert done.returncode == 0, done.stderr


@pytest.mark.skipif("'ALL' not in os.environ", reason="compiles for 16 s: ALL=1")
def test_the_installed_one_solves_with_numpy_and_numba_only(installed):
    done = run(installed, REFUSING_SCIPY + SOLVING + LOOKING)
    assert done.returncode == 0, done.stderr


def test_the_printed_method_needs_no_scipy(installed):
    done = run(installed, REFUSING_SCIPY + WRAPPING + LOOKING)
    assert done.returncode == 0, done.stderr


def test_it_passes_tests_of_its_own(installed):
    paths = [str(TESTS / name) for name in OWN_TESTS]
    options = [
        "-q", "-n", "0", "-p", "no:cacheprovider", "--noconftest", "-c", os.devnull,
    ]  # fmt: skip
    program = f"import pytest\nraise SystemExit(pytest.main({[*options, *paths]!r}))"
    done = run(installed, REFUSING_SCIPY + program)
    assert done.returncode == 0, done.stdout + done.stderr


def test_what_it_lacks_is_told(installed):
    done = run(installed, REFUSING + "import hopdata.hybrid, pandas")
    assert "No module named 'pandas'" in done.stderr
    done = run(installed, "import hopdata\nhopdata.analyse")
    assert "only the integrator, hopdata.hybrid, is installed" in done.stderr
    safely = run(installed, "from hopdata import solve, __version__", "-P")
    assert safely.returncode == 0, safely.stderr


def test_a_python_finds_it_by_the_file_that_names_its_folder(installed):
    program = "import site, sys\nsite.addsitedir(sys.argv[1])\nprint(sys.path[-1])"
    done = subprocess.run(
        [sys.executable, "-S", "-c", program, str(installed)],
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    assert Path(done.stdout.strip()) == installed / FOLDER


def test_it_shares_no_file_with_the_whole_and_gives_way_to_it(wheel, installed):
    """The whole package is before it on the search path, wherever both are installed."""
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    assert f"{FOLDER}/hopdata/hybrid/driver/proof.py" in names
    assert all(name.startswith(FOLDER) for name in names)
    program = (
        "import site, sys\nsite.addsitedir(sys.argv[1])\n"
        "import hopdata.hybrid, hopdata.recording\nprint(hopdata.hybrid.__file__)"
    )
    done = run(PACKAGE.parent, program, first=".", code=installed / "cache")
    assert done.returncode == 0, done.stderr
    assert Path(done.stdout.strip()).parent == PACKAGE / "hybrid"


def test_the_wheel_has_what_the_integrator_imports():
    """Found by a walk over all imports, those inside functions too."""
    libraries, reached = set(), set()
    ahead = sorted((PACKAGE / "hybrid").rglob("*.py"))
    assert len(ahead) > 60
    for path in ahead:
        for name in imported(path):
            parts = name.split(".")
            if parts[0] != "hopdata":
                libraries.add(parts[0])
            elif parts[1] != "hybrid" and parts[1] not in reached:
                reached.add(parts[1])
                ahead.append(PACKAGE / f"{parts[1]}.py")
    assert reached == BROUGHT
    # These are for the rest, inside functions, and may be absent.
    for_the_rest = {"platformdirs", "threadpoolctl"}
    assert libraries - set(sys.stdlib_module_names) == LIBRARIES | for_the_rest
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text())
    files = project["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    brought = {Path(name).stem for name in files if name.startswith("../../src")}
    assert brought == {"hybrid", "py", *BROUGHT}
    asked = {text.partition(">")[0] for text in project["project"]["dependencies"]}
    assert asked == LIBRARIES - {"llvmlite"}


def test_tests_of_the_integrator_need_nothing_else():
    paths = sorted(TESTS.rglob("*.py"))
    assert len(paths) > 60
    helpers = {path.stem for path in paths}
    allowed = LIBRARIES | OF_TESTS | helpers | set(sys.stdlib_module_names)
    for path in paths:
        for name in imported(path):
            parts = name.split(".")
            if parts[0] != "hopdata":
                assert parts[0] in allowed, f"{path.name} imports {name}"
            elif len(parts) > 1:
                assert parts[1] in {"hybrid", *BROUGHT}, f"{path.name} imports {name}"


def test_versions_of_libraries_are_those_of_the_whole():
    own = tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]
    whole = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert set(own["dependencies"]) <= set(whole["dependencies"])
    of_tests = own["optional-dependencies"]["test"]
    of_whole = whole["dependencies"] + whole["optional-dependencies"]["test"]
    assert set(of_tests) <= set(of_whole)
    assert own["requires-python"] == whole["requires-python"]


def imported(path):
    """Return the absolute names of all modules that a file imports at run time."""
    for_types = set()
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            for_types |= {id(one) for part in node.body for one in ast.walk(part)}
    for node in ast.walk(tree):
        if id(node) in for_types:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            if node.module == "hopdata":
                yield from (f"hopdata.{alias.name}" for alias in node.names)
            else:
                yield node.module
        elif isinstance(node, ast.Call) and "import_module" in ast.unparse(node.func):
            given = node.args[0]
            if isinstance(given, ast.Constant):
                yield given.value
