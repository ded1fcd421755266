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

Beside it are `<table>_noise.csv`, the response of six distances between equal subspaces
to noise, and `<table>_readings.csv`, the arc lengths of noised identities in every
reading of a "signal-to-noise ratio of 10".
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TextIO

import machine  # noqa: F401  first, since it sets the number of threads
import numpy as np
import pandas as pd
from machine import quartiles

from hopdata.maps.affine import affine_test_errors, mean_test_errors
from hopdata.maps.draws import distinct_draws, named_generator
from hopdata.maps.subspaces import arc_length, orthonormalised, principal_angles

OURS, SKLEARN = "hopdata", "scikit-learn LinearRegression, loop"
Methods = dict[str, Callable[..., np.ndarray]]
Splits = tuple[np.ndarray, ...]
#: Landings of six classes, then of near, all and far, in the dissertation's data set.
POPULATIONS = (477, 477, 477, 477, 476, 476, 1430, 2860, 1430)
#: Fits and pairs whose reference is computed in more digits, which is slow.
EXACT_FITS, EXACT_PAIRS = 10, 5
#: Pairs for the peers' loops, whose time per pair does not depend on their number.
FEW_PAIRS = 1000
#: Dimensions of the space of pairs and of the subspaces in the dissertation's data set.
SHAPE = (34, 17)
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
        out = Path(options.out)
        noise_sensitivity(SHAPE, seed=1).to_csv(
            out.with_name("maps_noise.csv"), index=False
        )
        snr_readings(SHAPE, seed=1).to_csv(
            out.with_name("maps_readings.csv"), index=False
        )
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


# Response of distances between subspaces to noise, and the meaning of "a
# signal-to-noise ratio of 10".
#
# The dissertation uses the arc length because it is the most sensitive to noise of the
# distances collated by Edelman, Arias and Smith (1998) (Sec. 2.2.4): if a distance
# makes equal but noisy subspaces look far apart, its finding that two schedules are
# alike carries more weight. Here equal subspaces get more and more noise, and two
# things are measured for each distance: its size, and how well a single value
# distinguishes one level of noise from twice that level.

# The dissertation does not explain that ratio (Sec. 2.3): neither what receives noise,
# nor how the ratio is counted. `READINGS` lists every reading; the one taken for Fig.
# 2.5 gives distances like the printed ones.

# Powers of the ratio and of the number of rows to which the noise of an entry is
# proportional.
RATIOS = {"amplitude": -1.0, "power": -0.5}
SIGNALS = {"entry": 0.0, "matrix": -0.5}
#: The printed signal-to-noise ratio.
PRINTED_SNR = 10.0


@dataclass(frozen=True)
class Reading:
    """A reading of "a signal-to-noise ratio of 10".

    Attributes
    ----------
    ratio
        ``amplitude``: the noise is 1/10 of the signal; ``power``: 1/10 of its power, or
        10 dB.
    signal
        ``entry``: the ones of the identity; ``matrix``: the rms of all its entries,
        zeros included, so that the ratio is that of Frobenius norms (or of the norms of
        columns).
    noised
        Number of noisy matrices in a pair, one or two.
    """

    ratio: str
    signal: str
    noised: int

    def noise_sd(self, shape: tuple[int, int], snr: float = PRINTED_SNR) -> float:
        """Return the sd of the noise on each entry of a (D, k) identity."""
        level = snr ** RATIOS[self.ratio]
        return level * shape[0] ** SIGNALS[self.signal]


READINGS = tuple(
    Reading(ratio, signal, noised)
    for ratio in RATIOS
    for signal in SIGNALS
    for noised in (2, 1)
)
#: Noise of sd 0.1 on every entry of both matrices, the reading of Fig. 2.5.
PRINTED_READING = READINGS[0]


def noised_identities(
    generator: np.random.Generator,
    shape: tuple[int, int],
    count: int,
    noise_sd: float,
    noised: int = 2,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (count, D, k) bases of pairs of identities with normal noise on each entry.

    In each pair, `noised` bases have independent noise; both are orthonormalised.
    """
    noise = noise_sd * generator.standard_normal((2, count, *shape))
    noise[noised:] = 0.0
    a, b = orthonormalised(np.eye(*shape) + noise)
    return a, b


# The distances between subspaces that Edelman, Arias and Smith (1998, Sec. 4.3)
# collate.
#
# All are functions of the principal angles, under the names of that paper. Others call
# the chordal F-norm the Procrustes distance (the least ``norm(a q - b)`` over rotations
# q), the projection F-norm the chordal distance, and the projection 2-norm the gap.


def arc_length_of(angles: np.ndarray) -> np.ndarray:
    """Return the geodesic distance, the 2-norm of the angles, rad."""
    return _norm(angles)


def fubini_study(angles: np.ndarray) -> np.ndarray:
    """Return the angle between the subspaces' exterior products, acos of the product of cosines.

    Computed from ``1 - prod(cos^2)`` by logarithms, so that small angles keep their
    digits.
    """
    with np.errstate(
        divide="ignore"
    ):  # a right angle gives minus infinity, whose exp is zero
        logarithm = np.sum(np.log1p(-(np.sin(angles) ** 2)), axis=-1)
    return np.arctan2(np.sqrt(-np.expm1(logarithm)), np.exp(logarithm / 2))


def chordal_2(angles: np.ndarray) -> np.ndarray:
    """Return the least 2-norm of the difference of two orthonormal bases."""
    return np.asarray(2 * np.sin(angles.max(axis=-1) / 2))


def chordal_f(angles: np.ndarray) -> np.ndarray:
    """Return the least Frobenius norm of the difference of two orthonormal bases (Procrustes)."""
    return 2 * _norm(np.sin(angles / 2))


def projection_2(angles: np.ndarray) -> np.ndarray:
    """Return the 2-norm of the difference of the projections, the sine of the largest angle."""
    return np.asarray(np.sin(angles.max(axis=-1)))


def projection_f(angles: np.ndarray) -> np.ndarray:
    """Return the Frobenius norm of the difference of the projections, divided by sqrt(2)."""
    return _norm(np.sin(angles))


#: Name -> function of (..., k) principal angles in rad, as returned by
#: `principal_angles`.
DISTANCES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "arc_length": arc_length_of,
    "chordal_f": chordal_f,
    "projection_f": projection_f,
    "fubini_study": fubini_study,
    "chordal_2": chordal_2,
    "projection_2": projection_2,
}


def _norm(values: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(values, axis=-1))


#: Sd of the noise on each entry, in steps of 2^(1/2); 0.1 is one of them.
NOISE_SDS = tuple(0.1 * 2.0 ** (step / 2) for step in range(-12, 7))
_LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)


def noise_sensitivity(
    shape: tuple[int, int],
    *,
    seed: int,
    pairs: int = 400,
    noise_sds: Sequence[float] = NOISE_SDS,
) -> pd.DataFrame:
    """Measure each distance between equal subspaces under increasing noise.

    Parameters
    ----------
    shape
        Dimensions (D, k) of the subspaces.
    seed
        Seed of the study; each level of noise has its own random stream.
    pairs
        Number of pairs of noisy subspaces at each level, and of random ones.
    noise_sds
        Sd of the noise on each entry of both bases.

    Returns
    -------
    DataFrame
        One row per distance and level: ``distance, noise_sd, mean, sd, q05, q95``;
        ``share_of_random``, the mean divided by that of random subspaces; and
        ``doubling``, the change of the mean when the noise doubles, in units of the sd
        (root mean square of both), NaN if the doubled noise is not among the levels.
    """
    generator = named_generator(seed, "sensitivity", "random")
    a, b = orthonormalised(generator.standard_normal((2, pairs, *shape)))
    unrelated = principal_angles(a, b)
    angles = {sd: _noised_angles(seed, shape, pairs, sd) for sd in noise_sds}
    rows = []
    for name, distance in DISTANCES.items():
        found = {sd: distance(part) for sd, part in angles.items()}
        scale = distance(unrelated).mean()
        for sd, values in found.items():
            twice = next(
                (part for other, part in found.items() if np.isclose(other, 2 * sd)),
                None,
            )
            spread = np.quantile(values, [0.05, 0.95])
            level = (values.mean(), values.std(ddof=1), *spread, values.mean() / scale)
            rows.append(
                (
                    name,
                    sd,
                    *level,
                    np.nan if twice is None else _separation(values, twice),
                )
            )
    columns = (
        "distance",
        "noise_sd",
        "mean",
        "sd",
        "q05",
        "q95",
        "share_of_random",
        "doubling",
    )
    return pd.DataFrame(rows, columns=list(columns))


def snr_readings(
    shape: tuple[int, int], *, seed: int, pairs: int = 1000
) -> pd.DataFrame:
    """Measure the arc lengths of both baselines: random, and noised identity in every reading.

    Returns
    -------
    DataFrame
        One row per reading, and one for random subspaces: ``kind, ratio, signal,
        noised, noise_sd, printed, mean, mean_se, sd, q05, q25, median, q75, q95``,
        lengths in rad; ``printed`` marks the reading of Fig. 2.5.
    """
    rows = []
    for reading in READINGS:
        names = (reading.ratio, reading.signal, str(reading.noised))
        sd = reading.noise_sd(shape)
        generator = named_generator(seed, "snr", *names)
        lengths = arc_length(
            *noised_identities(generator, shape, pairs, sd, reading.noised)
        )
        known = ("noised_identity", *names, sd, reading == PRINTED_READING)
        rows.append((*known, *_summary(lengths)))
    generator = named_generator(seed, "snr", "random")
    lengths = arc_length(
        *orthonormalised(generator.standard_normal((2, pairs, *shape)))
    )
    rows.append(("random", "", "", "", np.nan, False, *_summary(lengths)))
    columns = ("kind", "ratio", "signal", "noised", "noise_sd", "printed")
    levels = ("mean", "mean_se", "sd", "q05", "q25", "median", "q75", "q95")
    return pd.DataFrame(rows, columns=[*columns, *levels])


def _noised_angles(
    seed: int, shape: tuple[int, int], pairs: int, noise_sd: float
) -> np.ndarray:
    generator = named_generator(seed, "sensitivity", f"{noise_sd:.9g}")
    return principal_angles(*noised_identities(generator, shape, pairs, noise_sd))


def _separation(values: np.ndarray, twice: np.ndarray) -> float:
    spread = np.sqrt((values.var(ddof=1) + twice.var(ddof=1)) / 2)
    return float((twice.mean() - values.mean()) / spread)


def _summary(values: np.ndarray) -> tuple[float, ...]:
    spread = values.std(ddof=1)
    return (
        values.mean(),
        spread / len(values) ** 0.5,
        spread,
        *np.quantile(values, _LEVELS),
    )


if __name__ == "__main__":
    main()
