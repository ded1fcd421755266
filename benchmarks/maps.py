"""Statistics of the maps and of the libraries: error and time in the same run.

    python benchmarks/maps.py --out maps.csv

Each row is one method on one problem. `size` counts fits or pairs. `each_us` is the
median time for one of them, between its quartiles, over runs taken in turn with the
peers. `error` is the largest relative error of a mean squared error (regressions), or
the largest absolute error in rad (arc lengths). The reference has more digits than a
double; for arc lengths this holds for the first five, and the others are compared with
singular values, which are good to 1e-14. `times_faster` is the method's time over ours.
Everything runs in one thread and times are processor times, except for all pairs of a
study, which use every core: there `each_us` is wall-clock time.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from importlib.util import find_spec
from typing import Any, TextIO

import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
from machine import quartiles

from hopdata.maps.affine import affine_test_errors, mean_test_errors
from hopdata.maps.draws import distinct_draws, named_generator
from hopdata.maps.subspaces import arc_length, orthonormalised

OURS, SKLEARN = "hopdata", "scikit-learn LinearRegression, loop"
Methods = dict[str, Callable[..., np.ndarray]]
Splits = tuple[np.ndarray, ...]
#: Landings of six classes, then of near, all and far, in the dissertation's data set.
POPULATIONS = (477, 477, 477, 477, 476, 476, 1430, 2860, 1430)
#: Fits and pairs whose reference is computed in more digits, which is slow.
EXACT_FITS, EXACT_PAIRS = 10, 5
#: Pairs for the peers' loops, whose time per pair does not depend on their number.
FEW_PAIRS = 1000
COLUMNS = (
    *("problem", "method", "size", "each_us", "each_us_q25", "each_us_q75"),
    *("error", "times_faster"),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", help="CSV file to write; standard output by default")
    parser.add_argument(
        "--bootstraps", type=int, default=1000, help="fits of each of nine models"
    )
    parser.add_argument("--pairs", type=int, default=20_000, help="pairs of subspaces")
    options = parser.parse_args()
    rows = [*regressions(options.bootstraps), *lengths(options.pairs)]
    if options.out:
        with open(options.out, "w", newline="", encoding="utf-8") as file:
            write(rows, file)
    else:
        write(rows, sys.stdout)


def write(rows: list[dict[str, Any]], file: TextIO) -> None:
    writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)


def regressions(bootstraps: int) -> Iterator[dict[str, Any]]:
    """Yield the rows for the bootstraps of nine models, as for Fig. 2.4."""
    fits: Methods = {
        OURS: affine_test_errors,
        "statsmodels OLS, loop": statsmodels_loop,
        SKLEARN: sklearn_loop,
    }
    if find_spec("sklearn") is None:
        del fits[SKLEARN]
        yield absent(SKLEARN)
    for condition in (1e2, 1e6):
        data = [regression_problem(n, bootstraps, condition) for n in POPULATIONS]
        exact = exact_errors(*data[0])
        errors = {
            name: relative_error(exact, fit(*data[0])) for name, fit in fits.items()
        }
        runs = {name: partial(on_each, fit, data) for name, fit in fits.items()}
        name = f"nine affine models, condition {condition:.0e}"
        yield from race(name, runs, errors, dict.fromkeys(runs, bootstraps * len(data)))
    of_means: Methods = {
        OURS: lambda _x, *rest: mean_test_errors(*rest),
        "numpy, loop": lambda _x, *rest: mean_loop(*rest),
    }
    runs = {name: partial(on_each, fit, data) for name, fit in of_means.items()}
    loop = mean_loop(*data[0][1:])
    errors = {
        name: relative_error(loop, fit(*data[0])) for name, fit in of_means.items()
    }
    yield from race(
        "nine mean models", runs, errors, dict.fromkeys(runs, bootstraps * len(data))
    )


def lengths(pairs: int) -> Iterator[dict[str, Any]]:
    """Yield the rows for the arc lengths of given pairs."""
    few = min(pairs, FEW_PAIRS)
    for name, (a, b) in (("far", far_pairs(pairs)), ("mixed", mixed_pairs(few))):
        exact = arc_length(a, b)
        exact[:EXACT_PAIRS] = exact_arc_lengths(a, b)
        sizes = {OURS: len(a), "scipy subspace_angles, loop": few}
        runs = {
            OURS: partial(arc_length, a, b),
            "scipy subspace_angles, loop": partial(scipy_loop, a[:few], b[:few]),
        }
        errors = {method: absolute_error(exact, run()) for method, run in runs.items()}
        yield from race(f"arc length, {name} angles", runs, errors, sizes)


def on_each(fit: Callable[..., np.ndarray], data: list[Splits]) -> list[np.ndarray]:
    return [fit(*part) for part in data]


def absent(method: str) -> dict[str, Any]:
    """Return the row of a peer that is not installed."""
    print(f"{method}: absent", file=sys.stderr)
    return {"problem": "absent: not installed", "method": method}


def relative_error(exact: np.ndarray, found: np.ndarray) -> float:
    return float(np.abs(found[: len(exact)] / exact - 1).max())


def absolute_error(exact: np.ndarray, found: np.ndarray) -> float:
    return float(np.abs(found - exact[: len(found)]).max())


def race(
    problem: str,
    runs: Mapping[str, Callable[[], object]],
    errors: dict[str, float],
    sizes: dict[str, int],
) -> Iterator[dict[str, Any]]:
    """Time the methods in turn, so that a busy machine slows all equally; compare errors."""
    times = quartiles(runs)
    each = {name: 1e6 * np.array(times[name]) / sizes[name] for name in runs}
    for name in runs:
        low, middle, high = each[name]
        values = (middle, low, high, errors[name], middle / each[OURS][1])
        digits = (f"{value:.3g}" for value in values)
        yield dict(zip(COLUMNS, (problem, name, sizes[name], *digits), strict=True))


def regression_problem(landings: int, bootstraps: int, condition: float) -> Splits:
    """Return landings of 18 inputs and outputs, and their splits into 120 to fit and 41 to test."""
    rng = np.random.default_rng(1)
    twist = orthonormalised(rng.normal(size=(18, 18)))
    x = rng.normal(size=(landings, 18)) @ (
        np.geomspace(1, 1 / condition, 18)[:, None] * twist
    )
    y = x @ rng.normal(size=(18, 18)) + 0.05 * rng.normal(size=(landings, 18))
    return (
        x,
        y,
        *distinct_draws(named_generator(1, "splits"), landings, (120, 41), bootstraps),
    )


def mean_loop(y: np.ndarray, train: np.ndarray, test: np.ndarray) -> np.ndarray:
    splits = zip(train, test, strict=True)
    return np.array(
        [np.mean((y[held] - y[fit].mean(0)) ** 2, axis=0) for fit, held in splits]
    )


def statsmodels_loop(
    x: np.ndarray, y: np.ndarray, train: np.ndarray, test: np.ndarray
) -> np.ndarray:
    import statsmodels.api as sm

    errors = []
    x = sm.add_constant(x)
    for fitted, held in zip(train, test, strict=True):
        model = sm.OLS(y[fitted], x[fitted]).fit()
        errors.append(np.mean((y[held] - x[held] @ model.params) ** 2, axis=0))
    return np.array(errors)


def sklearn_loop(
    x: np.ndarray, y: np.ndarray, train: np.ndarray, test: np.ndarray
) -> np.ndarray:
    from sklearn.linear_model import LinearRegression

    errors = []
    for fitted, held in zip(train, test, strict=True):
        model = LinearRegression().fit(x[fitted], y[fitted])
        errors.append(np.mean((y[held] - model.predict(x[held])) ** 2, axis=0))
    return np.array(errors)


def exact_errors(
    x: np.ndarray, y: np.ndarray, train: np.ndarray, test: np.ndarray
) -> np.ndarray:
    """Return the errors of the first fits in extended precision (if the machine has it)."""
    x, y = (
        part.astype(np.longdouble)
        for part in (np.column_stack([np.ones(len(x)), x]), y)
    )
    errors = []
    for fitted, held in zip(train[:EXACT_FITS], test[:EXACT_FITS], strict=True):
        basis, upper = gram_schmidt(x[fitted])
        right = basis.T @ y[fitted]
        slopes = np.zeros_like(right)
        for row in reversed(range(len(upper))):
            slopes[row] = (
                right[row] - upper[row, row + 1 :] @ slopes[row + 1 :]
            ) / upper[row, row]
        errors.append(np.mean((y[held] - x[held] @ slopes) ** 2, axis=0))
    return np.array(errors)


def gram_schmidt(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return Q and R of a matrix of any precision, each column orthogonalised twice."""
    basis = matrix.copy()
    upper = np.zeros((matrix.shape[1],) * 2, matrix.dtype)
    for column in range(matrix.shape[1]):
        for _ in range(2):
            overlap = basis[:, :column].T @ basis[:, column]
            upper[:column, column] += overlap
            basis[:, column] -= basis[:, :column] @ overlap
        upper[column, column] = np.sqrt(np.sum(basis[:, column] ** 2))
        basis[:, column] /= upper[column, column]
    return basis, upper


def far_pairs(count: int) -> tuple[np.ndarray, ...]:
    """Return random pairs of 17-dimensional subspaces of 34 dimensions."""
    return tuple(
        orthonormalised(np.random.default_rng(2).normal(size=(2, count, 34, 17)))
    )


def mixed_pairs(count: int) -> tuple[np.ndarray, ...]:
    """Return pairs that each have angles from 1e-16 to a right angle."""
    rng = np.random.default_rng(3)
    frame = orthonormalised(rng.normal(size=(count, 34, 34)))
    angles = np.sort(10 ** rng.uniform(-16, 0, (count, 1, 17)) * np.pi / 2)
    angles[..., -1] = np.pi / 2 - 1e-10
    mixes = orthonormalised(rng.normal(size=(2, count, 17, 17)))
    tilted = frame[..., :17] * np.cos(angles) + frame[..., 17:] * np.sin(angles)
    return frame[..., :17] @ mixes[0], tilted @ mixes[1]


def scipy_loop(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    from scipy.linalg import subspace_angles

    return np.array(
        [np.linalg.norm(subspace_angles(*pair)) for pair in zip(a, b, strict=True)]
    )


def exact_arc_lengths(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the arc lengths of the first pairs, computed with 40 digits."""
    import mpmath  # type: ignore[import-untyped]

    lengths = []
    with mpmath.workdps(40):
        for pair in zip(a[:EXACT_PAIRS], b[:EXACT_PAIRS], strict=True):
            p, q = (
                mpmath.qr(mpmath.matrix(m.tolist()), mode="skinny")[0] for m in pair
            )
            sines = sorted(mpmath.svd_r(q - p * (p.T * q), compute_uv=False))
            cosines = sorted(mpmath.svd_r(p.T * q, compute_uv=False), reverse=True)
            angles = [mpmath.atan2(s, c) for s, c in zip(sines, cosines, strict=True)]
            lengths.append(float(mpmath.norm(angles)))
    return np.array(lengths)


if __name__ == "__main__":
    main()
