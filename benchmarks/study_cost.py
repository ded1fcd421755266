"""What a study costs, and how the cost of a hop grows with their number.

    python benchmarks/study_cost.py --out study_cost.csv

The study of config/thesis.yaml is run in a folder of its own, all stages, on two cores; then the
same with recordings ten times as long. `study_cost.csv` has a row for each: frames, hops used, wall
and processor time, the largest memory of one stage, and the times of a hop relative to the first
row. `study_cost_stages.csv` beside it has the processor time of each stage, recordings added up.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

ROOT = Path(__file__).resolve().parents[1]
FACTORS = (1, 10)


def scaled_config(factor: float, base: float = 1.0) -> dict[str, Any]:
    """Return the study of the dissertation's size with recordings `base * factor` times as long."""
    config = yaml.safe_load((ROOT / "config/thesis.yaml").read_text(encoding="utf-8"))
    for recording in config["recordings"]:
        simulation = recording["simulation"]
        simulation["duration_s"] = round(base * factor * simulation["duration_s"], 2)
        simulation["hops"] = round(1000 * base * factor)
    return config


def run_study(config: dict[str, Any], folder: Path, cores: int) -> float:
    """Run a study in an empty folder and return the wall time, s."""
    file = folder / "study.yaml"
    file.write_text(yaml.safe_dump(config), encoding="utf-8")
    command = [
        sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile"),
        "--directory", str(folder), "--configfile", str(file), "--cores", str(cores),
        "--quiet", "all",
    ]  # fmt: skip
    start = time.perf_counter()
    subprocess.run(command, check=True)
    return time.perf_counter() - start


def stage_costs(results: Path) -> pd.DataFrame:
    """Processor time, s, and memory, MB, of each job, from what the workflow noted."""
    rows = []
    for file in sorted((results / "benchmarks").rglob("*.tsv")):
        noted = pd.read_csv(file, sep="\t").iloc[0]
        stage = file.stem.split("_trial")[0]
        rows.append((stage, float(noted["cpu_time"]), float(noted["max_rss"])))
    return pd.DataFrame(rows, columns=["stage", "cpu_s", "peak_mb"])


def measure(factor: float, base: float, cores: int) -> tuple[dict[str, float], pd.DataFrame]:
    """Run one size; return its row, and the processor time of its stages."""
    with tempfile.TemporaryDirectory() as temporary:
        config = scaled_config(factor, base)
        wall = run_study(config, Path(temporary), cores)
        results = Path(temporary) / "results" / config["study"]
        jobs = stage_costs(results)
        touchdowns = pd.read_csv(results / "tables/touchdowns.csv")
        hops = int((~touchdowns["excluded"].astype(bool)).sum())
    row = {
        "times": factor,
        "duration_s": sum(r["simulation"]["duration_s"] for r in config["recordings"]),
        "hops": hops,
        "wall_s": wall,
        "cpu_s": jobs["cpu_s"].sum(),
        "peak_mb": jobs["peak_mb"].max(),
    }
    return row, jobs.groupby("stage", as_index=False)["cpu_s"].sum().assign(times=factor, hops=hops)


def main() -> None:
    """Run both sizes and write the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument("--base", type=float, default=1.0, help="length of the first, in studies")
    parser.add_argument("--cores", type=int, default=2)
    args = parser.parse_args()
    rows, stages = zip(*(measure(k, args.base, args.cores) for k in FACTORS), strict=True)
    table = pd.DataFrame(rows)
    for kind in ("wall", "cpu"):
        per_hop = table[f"{kind}_s"] / table["hops"]
        table[f"{kind}_ms_per_hop"] = 1e3 * per_hop
        table[f"{kind}_per_hop_ratio"] = per_hop / per_hop[0]
    by_stage = pd.concat(stages)
    by_stage["cpu_ms_per_hop"] = 1e3 * by_stage["cpu_s"] / by_stage["hops"]
    args.out.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(args.out, index=False, float_format="%.4g")
    by_stage.to_csv(args.out.with_name("study_cost_stages.csv"), index=False, float_format="%.4g")
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
