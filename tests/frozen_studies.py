"""Run the bundled studies, keep their tables, and later report differences.

    python tests/frozen_studies.py keep FOLDER       # run the studies, copy tables and numbers
    python tests/frozen_studies.py compare FOLDER    # run them again, compare

The workflow runs every study of `STUDIES` in the current checkout (only what is out of
date), with one seed for steering. It keeps the CSV and JSON files except provenance,
which holds times and versions. A comparison writes one line per file: `same bytes`, or
the largest relative difference among its numbers and its place, or the columns, keys or
rows that were added or removed. The exit code is 1 if anything differs by more than
``--digits`` allows. A study whose recording is missing is named and skipped.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

STUDIES = {
    "config/config.yaml": ("all", "steering"),
    "config/thesis.yaml": ("all",),
    "config/control.yaml": ("all",),
    "config/runner.yaml": ("all",),
}
NOT_KEPT = {"provenance.json"}
ONE_SEED = "steering: {experiments: {seeds: 1}}"  # further seeds would add nothing new


def make_studies(configs: list[str], cores: int) -> list[Path]:
    """Run the workflow for each study; return the folders of results."""
    folders = []
    for config in configs:
        targets = STUDIES[config]
        study = yaml.safe_load(Path(config).read_text())
        files = [entry.get("file") for entry in study["recordings"]]
        missing = [name for name in files if name and not Path(name).exists()]
        if missing:
            print(f"{config}: passed over, {missing[0]} is not there")
            continue
        with tempfile.NamedTemporaryFile("w", suffix=".yaml") as besides:
            besides.write(ONE_SEED)
            besides.flush()
            command = ["snakemake", "--cores", str(cores), "--quiet", "all"]
            command += ["--configfile", config, besides.name, "--", *targets]
            subprocess.run([sys.executable, "-m", *command], check=True)
        folders.append(Path("results") / study["study"])
    return folders


def kept_files(folder: Path) -> Iterator[Path]:
    """Yield the CSV and JSON files of a study by their paths within its folder."""
    for path in sorted([*folder.rglob("*.csv"), *folder.rglob("*.json")]):
        if path.name not in NOT_KEPT:
            yield path.relative_to(folder)


def numbers(path: Path) -> dict[str, Any]:
    """Return the values of a table or JSON file by their places."""
    if path.suffix == ".csv":
        try:
            table = pd.read_csv(path)
        except pd.errors.EmptyDataError:
            return {}
        return {f"{c}[{i}]": v for c in table for i, v in enumerate(table[c].tolist())}
    found: dict[str, Any] = {}

    def visit(place: str, value: Any) -> None:
        if isinstance(value, dict | list):
            items = value.items() if isinstance(value, dict) else enumerate(value)
            for key, inner in items:
                visit(f"{place}.{key}" if place else str(key), inner)
        else:
            found[place] = value

    visit("", json.loads(path.read_text()))
    return found


def difference(before: Any, after: Any) -> float:
    """Return the relative difference of two values; infinite if they are not both numbers."""
    if before == after or (before != before and after != after):
        return 0.0
    if isinstance(before, int | float) and isinstance(after, int | float):
        gap = abs(after - before) / max(abs(after), abs(before))
        return math.inf if math.isnan(gap) else gap
    return math.inf


def compared(before: Path, after: Path) -> tuple[float, str]:
    """Return the largest relative difference of two files, and a line that reports it."""
    if not before.exists() or not after.exists():
        return math.inf, "new" if after.exists() else "gone"
    if before.read_bytes() == after.read_bytes():
        return 0.0, "same bytes"
    old, new = numbers(before), numbers(after)
    apart = {key: difference(old[key], new[key]) for key in old.keys() & new.keys()}
    worst = max(apart, key=lambda key: apart[key], default="")
    came, went = sorted(new.keys() - old.keys()), sorted(old.keys() - new.keys())
    told = [
        f"{apart[worst]:.1e} at {worst}: {old[worst]} -> {new[worst]}" if worst else "",
        f"{len(came)} came, as {came[0]}" if came else "",
        f"{len(went)} went, as {went[0]}" if went else "",
    ]
    return (math.inf if came or went else apart.get(worst, 0.0)), "; ".join(
        text for text in told if text
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("action", choices=["keep", "compare"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--studies", nargs="+", choices=STUDIES, default=list(STUDIES))
    parser.add_argument("--cores", type=int, default=2)
    parser.add_argument(
        "--digits", type=float, default=0.0, help="relative difference allowed"
    )
    options = parser.parse_args()
    wrong = 0
    for results in make_studies(options.studies, options.cores):
        kept = options.folder / results.name
        if options.action == "keep":
            for name in kept_files(results):
                (kept / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(results / name, kept / name)
            print(
                f"{results.name}: {sum(1 for _ in kept_files(kept))} files kept in {kept}"
            )
            continue
        names = sorted({*kept_files(kept), *kept_files(results)})
        told = {name: compared(kept / name, results / name) for name in names}
        same = sum(gap == 0.0 for gap, _ in told.values())
        print(f"{results.name}: {same} of {len(names)} files with the same numbers")
        for name, (gap, text) in told.items():
            if text != "same bytes":
                print(f"  {name}: {text}")
            wrong += gap > options.digits
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
