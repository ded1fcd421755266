"""Build the integrator's wheel, and use it where nothing else of hopdata is.

    python packaging/hybrid/alone.py dist                 all of its tests
    python packaging/hybrid/alone.py dist --tests test_solve.py first_order

The wheel is written to the folder. It is installed in a fresh environment with its own
requirements, in the versions of ``requirements-dev.lock``, and there its tests run
(``tests/hybrid``, or those that are named), the code of its pages, and a small run of
its benchmarks. It must be called by the Python of the development environment.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import tomllib
import venv
from collections.abc import Iterable, Iterator
from importlib.metadata import requires
from pathlib import Path

from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
TESTS = ROOT / "tests" / "hybrid"
LOCK = ROOT / "requirements-dev.lock"
PAGES = (
    *("integrator", "integrator_examples", "integrator_reference", "integrator_many"),
    *("integrator_compiled", "integrator_method", "sliding", "gradients"),
)
RUN_PAGES = """
import sys

from pages import run_page

for name in sys.argv[1:]:
    run_page(name)
    print(f"docs/{name}.md: its code runs")
"""
# Programs of benchmarks/ that need the integrator alone, each as a small run.
BENCHMARKS = (
    ("proofs.py", "--members", "1", "--families", "box 0.2", "roof"),
    ("large.py", "--largest", "400", "--solvers", "ours, Rodas5P"),
    ("gradients.py",),
)
# The package that is imported must be the one that was installed, with nothing beside.
LOOK = """
import sys
from pathlib import Path

import hopdata
import hopdata.hybrid

assert Path(hopdata.__file__).is_relative_to(sys.prefix), hopdata.__file__
for absent in ("analysis", "recording", "scenes"):
    try:
        __import__(f"hopdata.{absent}")
    except ModuleNotFoundError:
        continue
    raise AssertionError(f"hopdata.{absent} is there as well")
print("hopdata", hopdata.__version__, "with the integrator alone")
"""


def needed(names: Iterable[str]) -> set[str]:
    """Return the names of these requirements and of all that they require in turn."""
    found: set[str] = set()
    ahead = [Requirement(name) for name in names]
    while ahead:
        one = ahead.pop()
        name = canonicalize_name(one.name)
        if name in found:
            continue
        found.add(name)
        for text in requires(name) or ():
            following = Requirement(text)
            if following.marker is None or following.marker.evaluate(
                {**default_environment(), "extra": ""}
            ):
                ahead.append(following)
    return found


def pinned(names: set[str]) -> Iterator[str]:
    """Yield the entries of the lock file, with versions and digests, of these names."""
    for entry in LOCK.read_text(encoding="utf-8").replace("\\\n", " ").splitlines():
        name = canonicalize_name(entry.partition("==")[0])
        if name in names:
            yield entry


def build(folder: Path) -> Path:
    """Build the wheel with the tools of this environment, and return it."""
    folder.mkdir(parents=True, exist_ok=True)
    for older in folder.glob("hopdata_hybrid-*.whl"):
        older.unlink()
    options = ["--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    command = [sys.executable, "-m", "pip", "wheel", *options, "--wheel-dir", folder]
    subprocess.run([*command, HERE], check=True)
    return next(folder.glob("hopdata_hybrid-*.whl"))


def install(wheel: Path, place: Path) -> Path:
    """Make an environment with the wheel, and return its Python."""
    project = tomllib.loads((HERE / "pyproject.toml").read_text(encoding="utf-8"))
    own = project["project"]["dependencies"]
    for_tests = project["project"]["optional-dependencies"]["test"]
    lock = place / "requirements.lock"
    lock.write_text("\n".join(pinned(needed([*own, *for_tests]))), encoding="utf-8")
    venv.create(place / "venv", with_pip=True)
    python = place / "venv" / "bin" / "python"
    if os.name == "nt":
        python = place / "venv" / "Scripts" / "python.exe"
    pip = [python, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    locked = ["--require-hashes", "--only-binary", ":all:", "-r", lock]
    subprocess.run([*pip, "install", *locked], check=True)
    subprocess.run([*pip, "install", "--no-deps", "--no-index", wheel], check=True)
    subprocess.run([*pip, "check"], check=True)
    return python


def use(python: Path, place: Path, tests: list[str], cores: int) -> None:
    """Run tests, pages and benchmarks."""
    environment = {**os.environ, "PYTHONPATH": str(TESTS), "PYTHONNOUSERSITE": "1"}

    def run(*arguments: object, folder: Path = place) -> None:
        command = [python, *map(str, arguments)]
        subprocess.run(command, check=True, cwd=folder, env=environment)

    run("-c", LOOK)
    run("-c", RUN_PAGES, *PAGES)
    for program, *options in BENCHMARKS:
        table = place / Path(program).with_suffix(".csv")
        run(ROOT / "benchmarks" / program, "--out", table, *options)
    paths = [TESTS / name for name in tests] or [TESTS]
    how = ["-q", "-n", cores, "--dist", "loadfile", "-p", "no:cacheprovider"]
    run("-m", "pytest", "-c", HERE / "pyproject.toml", *how, *paths, folder=HERE)


def main() -> None:
    """Build, install, use."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="where to put the wheel")
    parser.add_argument("--tests", nargs="*", default=[], help="of tests/hybrid")
    parser.add_argument("--cores", type=int, default=2)
    arguments = parser.parse_args()
    wheel = build(arguments.folder.resolve())
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        use(install(wheel, place), place, arguments.tests, arguments.cores)
    print(f"{wheel.name}: installed and used alone")


if __name__ == "__main__":
    main()
