"""Kernel density of foot heights: error and time of ours against scipy's exact sum.

    python benchmarks/density.py --out density.csv

One row for each size, bandwidth and number of nodes. `error` is the largest deviation from the
exact sum, over its highest value. Times are medians with quartiles of runs taken in turn;
`ratio` is scipy's median over that of the compiled code; `hopdata_numpy` is the default, which
loads nothing compiled.
"""

from __future__ import annotations

import one_thread  # noqa: F401

# isort: split
import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import gaussian_kde
from timing import columns_ms, quartiles

from hopdata.landings.sections.modes import kde

FloatArray = NDArray[np.float64]


def foot_heights(n: int, rng: np.random.Generator) -> FloatArray:
    """Return heights as of feet on the ground half the time: noise of 0.7 mm, or up to 0.25 m."""
    return np.concatenate([rng.normal(0, 0.0007, n // 2), rng.uniform(0, 0.25, n - n // 2)])


def compare(samples: FloatArray, bandwidth_m: float, nodes: int) -> dict[str, float]:
    """Measure one case."""
    grid = np.linspace(-0.02, 0.27, nodes)
    factor = bandwidth_m / samples.std(ddof=1)

    def scipy() -> FloatArray:
        return gaussian_kde(samples, bw_method=factor)(grid)

    def hopdata() -> FloatArray:
        return kde(samples, bandwidth=bandwidth_m, grid=grid)

    def hopdata_numpy() -> FloatArray:
        return kde(samples, bandwidth=bandwidth_m, grid=grid)

    exact = scipy()
    times = quartiles({"hopdata": hopdata, "hopdata_numpy": hopdata_numpy, "scipy": scipy})
    return {
        "n_samples": len(samples),
        "nodes": nodes,
        "bandwidth_m": bandwidth_m,
        "error": float(np.abs(hopdata() - exact).max() / exact.max()),
        **columns_ms(times),
        "ratio": times["scipy"][1] / times["hopdata"][1],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="CSV to write; printed as well")
    parser.add_argument("--sizes", type=int, nargs="+", default=[2000, 20000, 182611])
    parser.add_argument(
        "--bandwidths", type=float, nargs="+", default=[0.0001, 0.0003, 0.001, 0.00246], help="m"
    )
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    rows = [
        compare(samples, bandwidth_m, 1024)
        for samples in (foot_heights(n, rng) for n in arguments.sizes)
        for bandwidth_m in arguments.bandwidths
    ]
    table = pd.DataFrame(rows)
    print(table.to_string(index=False, float_format="%.4g"))
    if arguments.out:
        table.to_csv(arguments.out, index=False, float_format="%.4g")


if __name__ == "__main__":
    main()
