"""Platform and versions of the packages, and how the benchmarks measure time.

Import it before anything that starts threads: it limits every library to one thread.
"""

from __future__ import annotations

import os

os.environ.update(
    OMP_NUM_THREADS="1",
    OPENBLAS_NUM_THREADS="1",
    MKL_NUM_THREADS="1",
    NUMBA_NUM_THREADS="1",
    JAX_PLATFORMS="cpu",
    JAX_ENABLE_X64="1",
    JAX_CPU_ENABLE_ASYNC_DISPATCH="0",
    EQX_ON_ERROR="nan",  # diffrax looks for roots under `vmap` even without an event
    XLA_FLAGS="--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
)
# isort: split

import argparse
import csv
import platform
import time
from collections.abc import Callable, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TypeVar

import numpy as np

# Times of several functions in turn, as medians with quartiles.
#
# Time is the processor time of this thread. On an idle machine it equals the time on
# the clock, and on a shared machine other work disturbs it less. The measured function
# must run in this thread alone.


Result = TypeVar("Result")

LONGEST_S = 0.25  # longest duration of one function's repeats, beyond the fewest


def timed(run: Callable[[], Result]) -> tuple[float, Result]:
    """Return the time of one run, s, and its result."""
    start = time.thread_time()
    result = run()
    return time.thread_time() - start, result


def quartiles(
    runs: Mapping[str, Callable[[], object]], *, fewest: int = 3, most: int = 15
) -> dict[str, tuple[float, float, float]]:
    """Return quartile, median and quartile of each function's time, s; see `in_turn`."""
    times = in_turn(runs, fewest=fewest, most=most)
    return {
        name: tuple(np.percentile(sample, [25, 50, 75]))
        for name, sample in times.items()
    }


def in_turn(
    runs: Mapping[str, Callable[[], object]], *, fewest: int = 3, most: int = 15
) -> dict[str, list[float]]:
    """Return the times of each function, s, turn by turn.

    All functions run equally often: `most` times if the slowest is quick enough, but at
    least `fewest` times. The first run is a warm-up and does not count.
    """
    slowest = max(timed(run)[0] for run in runs.values())
    times: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(int(np.clip(LONGEST_S / slowest, fewest, most))):
        for name, run in runs.items():
            times[name].append(timed(run)[0])
    return times


PEERS = ("scipy", "scikit-learn", "mujoco", "heyoka", "diffrax", "jax", "scikit-sundae")


def processor() -> str:
    """Return the processor's name, as far as the system reports it."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = [
        line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")
    ]
    return names[0] if names else platform.processor() or platform.machine()


def installed(package: str) -> str:
    """Return the version of a package, or an empty text if it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def this_machine(*packages: str) -> dict[str, str | int]:
    """Return platform, processor and versions of Python, numpy, numba and further packages."""
    versions = {
        f"{name}_version": installed(name) for name in ("numpy", "numba", *packages)
    }
    return {
        "platform": platform.platform(),
        "processor": processor(),
        "n_processors": os.cpu_count() or 1,
        "python_version": platform.python_version(),
        **versions,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description="What the benchmarks ran on.")
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    out = parser.parse_args().out
    out.parent.mkdir(parents=True, exist_ok=True)
    with out.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(("what", "value"))
        rows.writerows(
            (what, value or "absent") for what, value in this_machine(*PEERS).items()
        )
    print(out.read_text())


if __name__ == "__main__":
    main()
