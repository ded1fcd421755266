"""What a benchmark ran on, for its table: platform, processor, versions."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


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
