"""What a study costs, and how the cost per hop grows with the number of hops.

    python benchmarks/study_cost.py --out study_cost.csv

All stages of the study of config/thesis.yaml run in a separate folder on two cores, and
then again with recordings ten times as long. `study_cost.csv` has a row for each:
frames, hops used, wall and processor time, the peak memory of one stage, and the times
per hop relative to the first row. `study_cost_stages.csv`, beside it, has the processor
time of each stage, summed over recordings, and the memory of its largest job according
to Snakemake, which samples it at intervals.

With `--frames 1e6 1e7` the study has a single recording of that many frames instead:
the bundled one repeated, with fresh noise and after a pause, like files of one day that
were joined.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from hopdata.recordings.readers.hdf5 import read_recording, write_recording

ROOT = Path(__file__).resolve().parents[1]
FACTORS = (1, 10)
PAUSE_S = 2.0


def scaled_config(factor: float, base: float = 1.0) -> dict[str, Any]:
    """Return the study of the dissertation's size with recordings `base * factor` times as long."""
    config = yaml.safe_load((ROOT / "config/thesis.yaml").read_text(encoding="utf-8"))
    for recording in config["recordings"]:
        simulation = recording["simulation"]
        simulation["duration_s"] = round(base * factor * simulation["duration_s"], 2)
        simulation["hops"] = round(1000 * base * factor)
    return config


def long_config(frames: int, folder: Path) -> dict[str, Any]:
    """Return the study of one recording of `frames` frames, which is written into the folder."""
    config: dict[str, Any] = yaml.safe_load(
        (ROOT / "config/config.yaml").read_text("utf-8")
    )
    one = read_recording(ROOT / "data/sample/hopper.h5")
    rng, n = np.random.default_rng(config["seed"]), len(one.time)
    time_s, positions = (
        np.empty(frames),
        np.empty((frames, *one.positions.shape[1:]), np.float32),
    )
    for number, first in enumerate(range(0, frames, n)):
        part = slice(0, min(n, frames - first))
        into = slice(first, first + part.stop)
        time_s[into] = one.time[part] + number * (np.ptp(one.time) + PAUSE_S)
        positions[into] = one.positions[part]
        positions[into] += rng.normal(
            0.0, config["report"]["expected_noise_m"], positions[into].shape
        )
    write_recording(folder / "long.h5", replace(one, time=time_s, positions=positions))
    config["recordings"][0]["file"] = str(folder / "long.h5")
    del config["simulation"]
    return config


def run_study(config: dict[str, Any], folder: Path, cores: int) -> tuple[float, float]:
    """Run a study in an empty folder; return wall time, s, and the largest process, MB."""
    file = folder / "study.yaml"
    file.write_text(yaml.safe_dump(config), encoding="utf-8")
    command = [
        sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile"),
        "--directory", str(folder), "--configfile", str(file), "--cores", str(cores),
        "--quiet", "all",
    ]  # fmt: skip
    start = time.perf_counter()
    with subprocess.Popen(command) as study:
        _, status, usage = os.wait4(study.pid, 0)
        study.returncode = os.waitstatus_to_exitcode(status)
    if study.returncode:
        raise subprocess.CalledProcessError(study.returncode, command)
    return time.perf_counter() - start, usage.ru_maxrss * 1024 / 1e6


def stage_costs(results: Path) -> pd.DataFrame:
    """Return processor time, s, and memory, MB, of each job, as recorded by the workflow."""
    rows = []
    for file in sorted((results / "benchmarks").rglob("*.tsv")):
        noted = pd.read_csv(file, sep="\t").iloc[0]
        stage = file.stem.split("_trial")[0]
        rows.append(
            (stage, float(noted["cpu_time"]), float(noted["max_rss"]) * 2**20 / 1e6)
        )
    return pd.DataFrame(rows, columns=["stage", "cpu_s", "peak_mb"])


def measure(
    factor: float, base: float, cores: int, frames: int = 0
) -> tuple[dict[str, float], pd.DataFrame]:
    """Run one size; return its row and the processor time of its stages."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        config = long_config(frames, folder) if frames else scaled_config(factor, base)
        wall, peak = run_study(config, folder, cores)
        results = Path(temporary) / "results" / config["study"]
        jobs = stage_costs(results)
        touchdowns = pd.read_csv(results / "tables/touchdowns.csv")
        hops = int((~touchdowns["excluded"].astype(bool)).sum())
        markers = pd.read_csv(results / "tables/markers.csv").drop_duplicates(
            "recording"
        )
    row = {
        "times": factor,
        "frames": int(markers["frames"].sum()),
        "hops": hops,
        "wall_s": wall,
        "cpu_s": jobs["cpu_s"].sum(),
        "peak_mb": peak,
    }
    stages = jobs.groupby("stage", as_index=False).agg(
        {"cpu_s": "sum", "peak_mb": "max"}
    )
    return row, stages.assign(times=factor, hops=hops)


def write(table: pd.DataFrame, by_stage: pd.DataFrame, out: Path) -> None:
    """Write both tables, with costs per hop and per frame, and print the first."""
    for kind in ("wall", "cpu"):
        per_hop = table[f"{kind}_s"] / table["hops"]
        table[f"{kind}_ms_per_hop"] = 1e3 * per_hop
        table[f"{kind}_per_hop_ratio"] = per_hop / per_hop[0]
    table["cpu_us_per_frame"] = 1e6 * table["cpu_s"] / table["frames"]
    by_stage["cpu_ms_per_hop"] = 1e3 * by_stage["cpu_s"] / by_stage["hops"]
    table.to_csv(out, index=False, float_format="%.4g")
    by_stage.to_csv(
        out.with_name("study_cost_stages.csv"), index=False, float_format="%.4g"
    )
    print(table.to_string(index=False), flush=True)


def main() -> None:
    """Run each size, and rewrite the tables after it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="CSV file to write")
    parser.add_argument(
        "--base", type=float, default=1.0, help="length of the first, in studies"
    )
    parser.add_argument(
        "--frames", type=float, nargs="+", help="lengths of one recording"
    )
    parser.add_argument("--cores", type=int, default=2)
    args = parser.parse_args()
    sizes = [(int(n), n / args.frames[0]) for n in args.frames or ()]
    args.out.parent.mkdir(parents=True, exist_ok=True)
    rows, stages = [], []
    for frames, factor in sizes or [(0, factor) for factor in FACTORS]:
        row, of_stages = measure(factor, args.base, args.cores, frames)
        rows.append(row)
        stages.append(of_stages)
        write(pd.DataFrame(rows), pd.concat(stages), args.out)


if __name__ == "__main__":
    main()
