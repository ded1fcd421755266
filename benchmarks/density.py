"""Kernel density of foot heights: error and time of ours against scipy's exact sum.

    python benchmarks/density.py --out density.csv

One row for each size, bandwidth and number of nodes. `error` is the largest deviation from the
exact sum, over its highest value; `ratio` is scipy's time over ours, both the best of several
runs taken one after the other in this process.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import gaussian_kde

from hopdata.landings.density import kde

FloatArray = NDArray[np.float64]


def foot_heights(n: int, rng: np.random.Generator) -> FloatArray:
    """Return heights as of feet on the ground half the time: noise of 0.7 mm, or up to 0.25 m."""
    return np.concatenate([rng.normal(0, 0.0007, n // 2), rng.uniform(0, 0.25, n - n // 2)])


def timed(work: Callable[[], FloatArray], repeats: int) -> tuple[FloatArray, float]:
    """Return the result and the shortest of several times, s."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        result = work()
        times.append(time.perf_counter() - start)
    return result, min(times)


def compare(samples: FloatArray, bandwidth_m: float, nodes: int) -> dict[str, float]:
    """Measure one case."""
    grid = np.linspace(-0.02, 0.27, nodes)
    factor = bandwidth_m / samples.std(ddof=1)
    exact, scipy_s = timed(lambda: gaussian_kde(samples, bw_method=factor)(grid), 1)
    ours, ours_s = timed(lambda: kde(samples, bandwidth=bandwidth_m, grid=grid), 7)
    return {
        "n_samples": len(samples),
        "nodes": nodes,
        "bandwidth_m": bandwidth_m,
        "error": float(np.abs(ours - exact).max() / exact.max()),
        "hopdata_ms": 1e3 * ours_s,
        "scipy_ms": 1e3 * scipy_s,
        "ratio": scipy_s / ours_s,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="CSV to write; printed as well")
    parser.add_argument("--sizes", type=int, nargs="+", default=[2000, 20000, 182611])
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    rows = [
        compare(samples, bandwidth_m, 1024)
        for samples in (foot_heights(n, rng) for n in arguments.sizes)
        for bandwidth_m in (0.0001, 0.0003, 0.001, 0.00246)
    ]
    table = pd.DataFrame(rows)
    print(table.to_string(index=False))
    if arguments.out:
        table.to_csv(arguments.out, index=False)


if __name__ == "__main__":
    main()
