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
from collections.abc import Callable, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from hopdata.dissertation.turns import in_turn, timed

__all__ = ["in_turn", "installed", "processor", "quartiles", "this_machine", "timed"]


def quartiles(
    runs: Mapping[str, Callable[[], object]], *, fewest: int = 3, most: int = 15
) -> dict[str, tuple[float, float, float]]:
    """Return quartile, median and quartile of each function's time, s; see `in_turn`.

    Times are the processor time of this thread.
    """
    times = in_turn(runs, fewest=fewest, most=most)
    return {
        name: tuple(np.percentile(sample, [25, 50, 75]))
        for name, sample in times.items()
    }


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
