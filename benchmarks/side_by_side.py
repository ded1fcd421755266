# ruff: noqa: ARG001, ARG005 (the solvers prescribe the signatures)
"""Thirteen hybrid systems, ten of them not ours, solved by us and by six other packages.

    python benchmarks/side_by_side.py --out side_by_side.csv [--turns 9] [--systems ...]

It writes the table and, beside it, `side_by_side_ratios.csv`, `side_by_side_starts.csv`
and `side_by_side_lines.csv`. The systems that are not ours are in `side/__init__.py`;
the octant, the hopper and the plate are those of `work_precision.py`.

The table has one row for each system, solver and tolerance (relative and absolute; time
step for MuJoCo). `error_max` is the largest deviation of the final state from the
reference: for the ten systems 30 digits of mpmath, which heyoka confirms in extended
precision (`side/references.csv`). `events_lost` counts events that were not found
(negative: too many). Times are CPU times of one trajectory, warm, in turn: medians and
quartiles. heyoka's batch has as many systems as a register has doubles, ours 200; both
give the time of one. A solver that fails, or a package that is not installed, has a row
that says so.

`side_by_side_starts.csv` has the CPU time of whole processes, imports included, that run
the programs of `side/programs`: `first` with no cache, `again` with the cache that the
first has left, `new system` with a cache that has seen only another system, and
`imports`, which only import the package. `side_by_side_lines.csv` has the lines of these
programs that are neither empty nor comments.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
import pandas as pd
import peers
from side import Scene, scenes
from work_precision import (
    COLUMNS,
    absent_row,
    best_of_way,
    measured,
    ratios,
    row,
)

TOLERANCES = (1e-4, 1e-7, 1e-10)
STEPS_S = (2e-3, 2.5e-4, 3.125e-5)  # of MuJoCo
EQUAL_ERROR = 1e-6
MODULES = {
    "hopdata": "ours",
    "heyoka": "heyoka_side",
    "SUNDIALS": "cvode_side",
    "diffrax": "diffrax_side",
    "SciPy": "scipy_side",
}
PROGRAMS = Path(__file__).resolve().parent / "side" / "programs"
IMPORTS = {
    "hopdata": "hopdata.hybrid",
    "scipy": "scipy.integrate",
    "heyoka": "heyoka",
    "cvode": "sksundae.cvode",
    "diffrax": "diffrax",
}
NAMES = ("bouncing_ball", "thermostat", "spiking_neuron")
NEITHER = "SciML needs Julia, which is not installed"


def solvers_of(scene: Scene) -> tuple[list[peers.Solver], dict[str, str]]:
    """Return all solvers of a system that is not ours, and why others are absent."""
    found: list[peers.Solver] = []
    absent = {"SciML": NEITHER}
    for package, name in MODULES.items():
        try:
            found += import_module(f"side.{name}").solvers(scene)
        except (ImportError, OSError, AttributeError) as error:
            absent[package] = str(error)
    return found, absent


def as_scene(problem: peers.Problem) -> Scene:
    """Return one of our own systems in the form of the others, for heyoka's batch."""
    signs = problem.locks
    first = tuple(float(one) for one in problem.coefficients(signs))
    count = len(first)

    def rates(m: Any) -> Any:
        slope = problem.slope(m)
        return lambda t, y, c: slope(y, c[:count])

    def heights(m: Any) -> Any:
        height = problem.height(m)
        guards = range(problem.n_guards)
        return lambda t, y, c: tuple(c[count + k] * height(y, k) for k in guards)

    def after(_: Any) -> Any:
        def flipped(t: Any, y: Any, c: Any, k: int) -> Any:
            locks = np.array(c[count:])
            locks[k] = -locks[k]
            return y, (*problem.coefficients(locks), *locks)

        return flipped

    return Scene(
        problem.name, "ours", problem.t_span, problem.y0, (*first, *signs),
        problem.n_guards, rates, heights, after,
    )  # fmt: skip


def our_solvers(problem: peers.Problem) -> tuple[list[peers.Solver], dict[str, str]]:
    """Return all solvers of one of our own systems, at three settings each."""
    found, absent = peers.solvers_of(problem)
    absent["SciML"] = NEITHER
    if "heyoka" not in absent:
        heyoka_side = import_module("side.heyoka_side")
        found.append(heyoka_side.batch_solver(as_scene(problem)))
    return found, absent


def at_three(solver: peers.Solver) -> peers.Solver:
    """Return a solver with three settings."""
    settings = TOLERANCES
    if solver.package == "MuJoCo":
        settings = STEPS_S
    return replace(solver, settings=settings)


def everything() -> Iterator[tuple[Any, list[peers.Solver], dict[str, str]]]:
    """Yield each system with its solvers."""
    for scene in scenes():
        yield scene, *solvers_of(scene)
    for make in (peers.octant_problem, peers.hopper_problem, peers.plate_problem):
        problem = make()
        yield problem, *our_solvers(problem)


def table_of(turns: int, names: list[str], out: Path) -> pd.DataFrame:
    """Return the table; it is written after each system."""
    rows: list[tuple[object, ...]] = []
    for problem, solvers, absent in everything():
        if names and problem.name not in names:
            continue
        chosen = [at_three(solver) for solver in solvers]
        rows += [row(problem, entry) for entry in measured(problem, chosen, turns)]
        rows += [absent_row(problem, name, why) for name, why in absent.items()]
        pd.DataFrame(rows, columns=COLUMNS).to_csv(out, index=False)
        print(problem.name, flush=True)
    return pd.DataFrame(rows, columns=COLUMNS)


# The first solve of a process, and the programs that users write.


def cpu_s(command: list[str], folder: Path) -> tuple[float, str]:
    """Return the CPU time of a process, and what it prints."""
    caches = {
        "NUMBA_CACHE_DIR": str(folder),
        "XDG_CACHE_HOME": str(folder),
        "HOME": str(folder),
    }
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, *command], env={**os.environ, **caches},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    user, system = after.ru_utime - before.ru_utime, after.ru_stime - before.ru_stime
    return user + system, done.stdout


def error_of(printed: str, name: str) -> float:
    """Return the error of a final state that a program has printed."""
    end = np.array(printed.split(), dtype=float)
    exact = next(scene.end for scene in scenes() if scene.name == name)
    return float(np.abs(end - exact).max())


def start_row(package: str) -> dict[str, object]:
    """Return the times of the first solves with a package; CPU s."""
    first, second, third = (str(PROGRAMS / f"{name}_{package}.py") for name in NAMES)
    with tempfile.TemporaryDirectory() as folder:
        cache = Path(folder)
        try:
            imports, _ = cpu_s(["-c", f"import {IMPORTS[package]}"], cache)
        except subprocess.CalledProcessError:
            return {"package": package, "note": "absent"}
        whole, printed = cpu_s([first], cache)
        again, _ = cpu_s([first], cache)
        new = [cpu_s([program], cache)[0] for program in (second, third)]
    return {
        "package": package, "imports_s": imports, "first_s": whole, "again_s": again,
        "new_system_s": float(np.mean(new)), "error": error_of(printed, NAMES[0]),
    }  # fmt: skip


def lines_of(program: Path) -> int:
    """Return how many lines of a program are neither empty nor comments."""
    lines = [line.strip() for line in program.read_text().splitlines()]
    return sum(bool(line) and not line.startswith("#") for line in lines)


def lines() -> pd.DataFrame:
    """Return the lines of the programs, by system and package."""
    return pd.DataFrame(
        [
            {"system": name}
            | {
                package: lines_of(PROGRAMS / f"{name}_{package}.py")
                for package in IMPORTS
            }
            for name in NAMES
        ]
    )


def print_best(at_equal_error: pd.DataFrame) -> None:
    """Print the fastest method of each way, by system."""
    best = at_equal_error[at_equal_error["best_of_way"]]
    across = best.pivot_table(
        index="scene", columns="way", values="time_us", sort=False
    )
    print(across.to_string(float_format="%.0f"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument("--turns", type=int, default=9, help="timings of a solver")
    parser.add_argument("--systems", nargs="*", default=[], help="only these")
    parser.add_argument("--no-starts", action="store_true", help="no new processes")
    arguments = parser.parse_args()
    out = arguments.out
    out.parent.mkdir(parents=True, exist_ok=True)
    table = table_of(arguments.turns, arguments.systems, out)
    at_equal_error = ratios(table, EQUAL_ERROR)
    at_equal_error["best_of_way"] = best_of_way(at_equal_error)
    at_equal_error.to_csv(out.with_name(f"{out.stem}_ratios.csv"), index=False)
    print_best(at_equal_error)
    lines().to_csv(out.with_name(f"{out.stem}_lines.csv"), index=False)
    starts = []
    if not arguments.no_starts:
        starts = [start_row(package) for package in IMPORTS]
    columns = [
        "package",
        "imports_s",
        "first_s",
        "again_s",
        "new_system_s",
        "error",
        "note",
    ]
    beside = pd.DataFrame(starts, columns=columns)
    beside.to_csv(out.with_name(f"{out.stem}_starts.csv"), index=False)
    print(beside.to_string(index=False))


if __name__ == "__main__":
    main()
