"""Robust and quantile regression of a floor: error and time of ours against statsmodels.

    python benchmarks/robust_regression.py --out robust_regression.csv

One row for each method, number of rests and unit of their heights. A tenth of the rests is
raised. Errors are root mean squares over the rests of the fitted floor, in units of the heights'
noise: for the robust norms from the solution iterated until it stands still, by statsmodels; for
the quantile, whose optimum need not be unique, the loss beyond that of scipy's linear program, over
it. Times are medians with quartiles of runs taken in turn; `ratio` is statsmodels' median over
ours. `unit_m` is there because RLM's own end depends on it.
"""

from __future__ import annotations

import one_thread  # noqa: F401

# isort: split
import argparse
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import csr_array, hstack, identity
from statsmodels.regression.quantile_regression import QuantReg
from statsmodels.robust import norms
from statsmodels.robust.robust_linear_model import RLM
from timing import columns_ms, quartiles

from hopdata.landings.floor_surface import design, polynomial_terms
from hopdata.landings.quantile_regression import quantile_regression
from hopdata.landings.robust_regression import robust_regression

FloatArray = NDArray[np.float64]

NOISE_M = 0.0006
DEGREE = 5
QUANTILE = 0.05
NORMS = {"tukey": norms.TukeyBiweight, "huber": norms.HuberT}


def rests(n: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return columns of floor and three mounts, and heights, m, a tenth of them raised."""
    contrasts = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]])
    terms = polynomial_terms(DEGREE)
    places = rng.uniform(-1, 1, (n, 2))
    columns = np.hstack([design(places, terms), contrasts[np.arange(n) % 3]])
    heights = columns @ (0.003 * rng.standard_normal(columns.shape[1]))
    heights += NOISE_M * rng.standard_normal(n)
    heights[rng.random(n) < 0.1] += 0.004
    return columns, heights


def check_loss(columns: FloatArray, heights: FloatArray, coefficients: FloatArray) -> float:
    """Sum that the quantile regression makes least."""
    rest = heights - columns @ coefficients
    return float(np.sum(np.maximum(QUANTILE * rest, (QUANTILE - 1) * rest)))


def least_loss(columns: FloatArray, heights: FloatArray) -> float:
    """Return the least such sum, by a linear program."""
    n, k = columns.shape
    cost = np.repeat([0.0, QUANTILE, 1 - QUANTILE], [k, n, n])
    equal = hstack([csr_array(columns), identity(n), -identity(n)])
    bounds = [(None, None)] * k + [(0, None)] * (2 * n)
    return float(linprog(cost, A_eq=equal, b_eq=heights, bounds=bounds).fun)


def ways(
    method: str, columns: FloatArray, heights: FloatArray
) -> tuple[Callable[[], FloatArray], Callable[[], FloatArray]]:
    """Return ours and that of statsmodels, as calls without arguments."""
    if method == "quantile":
        return (
            lambda: quantile_regression(columns, heights, quantile=QUANTILE),
            lambda: QuantReg(heights, columns).fit(q=QUANTILE).params,
        )
    return (
        lambda: robust_regression(columns, heights, norm=method),
        lambda: RLM(heights, columns, M=NORMS[method]()).fit().params,
    )


def errors(
    method: str, columns: FloatArray, heights: FloatArray, unit_m: float
) -> Callable[[FloatArray], float]:
    """Return the error of coefficients, as a function of them."""
    if method == "quantile":
        least = least_loss(columns, heights)
        return lambda found: check_loss(columns, heights, found) / least - 1.0
    model = RLM(heights, columns, M=NORMS[method]())
    best = model.fit(conv="coefs", tol=1e-14 / unit_m, maxiter=1000).params
    noise = NOISE_M / unit_m
    return lambda found: float(np.sqrt(np.mean((columns @ (found - best)) ** 2))) / noise


def compare(
    method: str, columns: FloatArray, heights_m: FloatArray, unit_m: float
) -> dict[str, float | str]:
    """Measure one case."""
    heights = heights_m / unit_m
    ours, peer = ways(method, columns, heights)
    error = errors(method, columns, heights, unit_m)
    times = quartiles({"hopdata": ours, "statsmodels": peer})
    return {
        "method": method,
        "n_rests": len(heights),
        "unit_m": unit_m,
        "hopdata_error": error(ours()),
        "statsmodels_error": error(peer()),
        **columns_ms(times),
        "ratio": times["statsmodels"][1] / times["hopdata"][1],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="CSV to write; printed as well")
    parser.add_argument("--sizes", type=int, nargs="+", default=[500, 2000, 10000])
    parser.add_argument("--units", type=float, nargs="+", default=[1.0, 0.001], help="m")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    warnings.simplefilter("ignore")  # statsmodels': not converged
    rows = [
        compare(method, columns, heights_m, unit_m)
        for columns, heights_m in (rests(n, rng) for n in arguments.sizes)
        for method in ("tukey", "huber", "quantile")
        for unit_m in (arguments.units if method != "quantile" else arguments.units[:1])
    ]
    table = pd.DataFrame(rows)
    print(table.to_string(index=False, float_format="%.4g"))
    if arguments.out:
        table.to_csv(arguments.out, index=False, float_format="%.4g")


if __name__ == "__main__":
    main()
