"""What the benchmarks ran on: platform, processor, versions; run with `--out machine.csv`."""

from __future__ import annotations

import argparse
import csv
import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PEERS = ("scipy", "scikit-learn", "mujoco", "heyoka", "diffrax", "jax", "scikit-sundae")


def processor() -> str:
    """Return the processor's name, as well as the system tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def installed(package: str) -> str:
    """Return the version of a package, or an empty text if it is not there."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def machine(*packages: str) -> dict[str, str | int]:
    """Return platform, processor and versions of Python, numpy, numba and further packages."""
    versions = {f"{name}_version": installed(name) for name in ("numpy", "numba", *packages)}
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
        rows.writerows((what, value or "absent") for what, value in machine(*PEERS).items())
    print(out.read_text())


if __name__ == "__main__":
    main()
