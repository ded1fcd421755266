"""Time to the first solution in a fresh process, imports not counted.

    python benchmarks/first_solve.py --out first_solve.csv

There is one row per case. `install`: nothing is cached, so the driver and the generic
methods are compiled. `install, Jacobian`: afterwards, the code that carries Jacobians
is compiled. `new scene`: a new module, with the driver cached. `known scene`: the same
module in another process. `new scene, Jacobian` and `known scene, Jacobian`: the same
with the flow's Jacobian, for which nothing more is compiled for the scene; only the
fall is solved, because a bounce resets the state. `new scene, plain Python`: its field
uses a dictionary, which Numba does not compile. `known scene, plain Python`: the same
again. `own code`: `System.compile` first builds all methods for the scene. `known
scene, own code`: the next process.

Times are medians over the repeats, with the smallest and the largest. `imports_s` is
the import of `hopdata.hybrid`. `first_solve_s` is the time from there to the end of the
first `solve`: the import of the module, the compilation of its three functions, and
everything that Numba imports when it first loads or compiles code. That last part alone
is `numba_start_s`, measured in separate processes. `first_solve_cpu_s` is processor
time, `second_solve_us` the time of the same call again. The caches are kept in a
separate folder.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

REPEATS = 7
CASES = (
    "install",
    "install, Jacobian",
    "new scene",
    "known scene",
    "new scene, Jacobian",
    "known scene, Jacobian",
    "new scene, plain Python",
    "known scene, plain Python",
    "own code",
    "known scene, own code",
)
TIMES = (
    "imports_s",
    "numba_start_s",
    "first_solve_s",
    "first_solve_cpu_s",
    "second_solve_us",
)

SCENE = """
from hopdata.hybrid import System, field, guards, on_event

CONSTANTS = {{"gravity": {gravity}}}
GRAVITY = {gravity}

@field
def fall(t, y, mode, params, dy):
    dy[0] = y[1]
    dy[1] = -{constant}

@guards
def floor(t, y, dy, mode, params, h, hdot):
    h[0] = -y[0]
    hdot[0] = -dy[0]

@on_event
def bounce(t, y, mode, params, guard, direction):
    if direction > 0:
        y[1] = -0.9 * y[1]
    return 0

ball = System(fall, floor, bounce, n_states=2, guard_names=("floor",))
"""

PROGRAM = """
import json, sys, time, warnings

warnings.simplefilter("ignore")
start = time.perf_counter()
from hopdata.hybrid import solve

imported, cpu = time.perf_counter(), time.process_time()
from {scene} import ball

if {own_code}:
    ball.compile()
solve(ball, (0.0, {until}), (1.0, 0.0), jacobian={jacobian})
solved, cpu = time.perf_counter(), time.process_time() - cpu
solve(ball, (0.0, {until}), (1.0, 0.0), jacobian={jacobian})
again = time.perf_counter() - solved
json.dump([imported - start, solved - imported, cpu, 1e6 * again], sys.stdout)
"""

NUMBA_START = """
import time
from hopdata.hybrid import solve
from numba.core.registry import cpu_target

start = time.perf_counter()
cpu_target.target_context.refresh()
print(time.perf_counter() - start)
"""


def write_scene(folder: Path, name: str, number: int, *, plain: bool) -> None:
    constant = 'CONSTANTS["gravity"]' if plain else "GRAVITY"
    (folder / f"{name}.py").write_text(
        SCENE.format(gravity=9.0 + 0.01 * number, constant=constant)
    )


def output(folder: Path, program: str) -> str:
    """Return the output of a program that runs in its own process."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache")}
    command = [sys.executable, "-c", program]
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout


def first_solve(
    folder: Path, scene: str, *, own_code: bool = False, jacobian: bool = False
) -> list[float]:
    """Return the five times of a process that solves this scene."""
    until = 0.4 if jacobian else 1.0  # ends before the bounce, which resets the state
    program = PROGRAM.format(
        scene=scene, own_code=own_code, jacobian=jacobian, until=until
    )
    imports, *rest = json.loads(output(folder, program))
    return [imports, float(output(folder, NUMBA_START)), *rest]


def measure(folder: Path, repeats: int) -> dict[str, list[list[float]]]:
    """Return the times of all runs of each case."""
    write_scene(folder, "first", 0, plain=False)
    times: dict[str, list[list[float]]] = {case: [] for case in CASES}
    times["install"].append(first_solve(folder, "first"))
    times["install, Jacobian"].append(first_solve(folder, "first", jacobian=True))
    for number in range(1, repeats + 1):
        for name, plain in ((f"scene{number}", False), (f"plain{number}", True)):
            write_scene(folder, name, number, plain=plain)
        write_scene(folder, f"derived{number}", number, plain=False)
        for case in ("new scene, Jacobian", "known scene, Jacobian"):
            times[case].append(first_solve(folder, f"derived{number}", jacobian=True))
        for case in ("new scene", "known scene"):
            times[case].append(first_solve(folder, f"scene{number}"))
            times[f"{case}, plain Python"].append(first_solve(folder, f"plain{number}"))
        times["own code"].append(first_solve(folder, f"scene{number}", own_code=True))
        times["known scene, own code"].append(first_solve(folder, f"scene{number}"))
    return times


def summary(times: dict[str, list[list[float]]]) -> pd.DataFrame:
    """Return one row for each case."""
    rows = []
    for case, runs in times.items():
        row: dict[str, object] = {"case": case, "processes": len(runs)}
        for name, values in zip(TIMES, np.transpose(runs), strict=True):
            what, unit = name.rsplit("_", 1)
            row[f"{what}_median_{unit}"] = np.median(values)
            row[f"{what}_min_{unit}"], row[f"{what}_max_{unit}"] = (
                values.min(),
                values.max(),
            )
        rows.append(row)
    return pd.DataFrame(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument(
        "--repeats", type=int, default=REPEATS, help="processes of each case"
    )
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        table = summary(measure(Path(folder), arguments.repeats))
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(arguments.out, index=False)
    for row in table.to_dict("records"):
        print(
            f"{row['case']:26} imports {row['imports_median_s']:.2f} s, first solve "
            f"{row['first_solve_median_s']:.2f} s ({row['first_solve_min_s']:.2f} to "
            f"{row['first_solve_max_s']:.2f}), processor {row['first_solve_cpu_median_s']:.2f} s, "
            f"of which Numba's start {row['numba_start_median_s']:.2f} s"
        )


if __name__ == "__main__":
    main()
