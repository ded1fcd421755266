"""Bootstrapped prediction errors of the six models of Fig. 2.4.

The models are affine maps and mean predictors of the state at the post section from the
state at the pre section. Some are "specialised" to one mode schedule. The others use
all landings, or only those "near" to or "far" from the trajectory on which all feet
touch at once (Sec. 2.3 of the dissertation: contact spread below or above the median of
the data set).

A bootstrap here is a random split: 161 distinct landings are drawn from those that a
model may use, 120 to fit and the other 41 to test. No landing is drawn twice, because a
landing on both sides of a split would flatter the fit. If a model has fewer than 161
landings, both numbers shrink in proportion for every model of the study, so that all
are compared at the same sample size.

The dissertation speaks of "bootstraps with a 120/41 train/test split" (Sec. 2.3): a
bootstrap draws with replacement, a split has no landing on both sides. `DRAWS` lists
what that can mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.arrays import FloatArray, IntArray, one_blas_thread, pd
from hopdata.errors import chosen, require
from hopdata.maps.affine import (
    affine_test_errors,
    checked,
    mean_test_errors,
    pooled_basis,
)
from hopdata.maps.draws import (
    Notes,
    distinct_draws,
    draws_together,
    grouped,
    named_generator,
    rare_notes,
    resampled_draws,
    schedule_stream,
)

# The landings that each model of Fig. 2.4 draws from, and the sizes of its splits.

#: Number of landings that a fit needs beyond its number of coefficients per output.
#: Unit: landings. Origin: chosen.
SPARE_LANDINGS = 2


@dataclass(frozen=True)
class Population:
    """Landings that a model draws from.

    `kind` is ``class``, ``near``, ``all`` or ``far``; `schedule` is the mode schedule
    of a class.
    """

    kind: str
    schedule: str
    rows: IntArray

    @property
    def name(self) -> str:
        """Name in notes."""
        return f"schedule {self.schedule}" if self.kind == "class" else self.kind

    @property
    def stream(self) -> str:
        """Name of the random stream of the splits."""
        return schedule_stream(self.rows) if self.kind == "class" else self.kind


def select_populations(
    schedule: NDArray[np.str_], spread: FloatArray, minimum_class: int
) -> tuple[list[Population], Notes]:
    """Sort the landings into classes, near, all and far, and note the classes left out.

    Near and far landings have a contact spread below and above the median of all
    landings.
    """
    classes, rare = grouped(schedule, minimum_class)
    populations = []
    for name, rows in classes.items():
        populations.append(Population("class", name, rows))
    notes = rare_notes("specialised models", rare, f"at least {minimum_class} wanted")
    if not populations:
        reason = f"no mode schedule has {minimum_class} touchdowns"
        notes.append({"what": "specialised models", "reason": reason})
    known = np.isfinite(spread)
    median = np.nan
    if known.any():
        median = np.median(spread[known])
    populations += [
        Population("near", "", np.flatnonzero(known & (spread < median))),
        Population("all", "", np.arange(len(schedule))),
        Population("far", "", np.flatnonzero(known & (spread > median))),
    ]
    return populations, notes


def split_sizes(population: int, train: int, test: int) -> tuple[int, int]:
    """Return the sizes of both parts of a split, scaled down if landings are few.

    >>> split_sizes(2860, 120, 41), split_sizes(80, 120, 41)
    ((120, 41), (60, 20))
    """
    total = min(population, train + test)
    fitted = min(round(total * train / (train + test)), total - 1)
    return fitted, total - fitted


def needed_training(x: FloatArray) -> int:
    """Return the least size of a training set for an affine map of these inputs."""
    n_coefficients = 1
    if len(x):
        n_coefficients = pooled_basis(x).shape[1]
    return n_coefficients + SPARE_LANDINGS


def large_enough(
    populations: list[Population], train: int, test: int, needed: int
) -> tuple[list[Population], Notes]:
    """Drop populations too small for an affine map, and note them.

    `all` stays for its mean predictor if it has two landings or more.
    """
    kept = []
    notes = []
    too_small: dict[str, int] = {}
    wanted = f"an affine map of these inputs needs {needed}"
    for population in populations:
        size = len(population.rows)
        fitted = 0
        if size:
            fitted, _ = split_sizes(size, train, test)
        is_enough = fitted >= needed
        if is_enough or (population.kind == "all" and size >= 2):
            kept.append(population)
        if is_enough:
            continue
        if population.kind == "class":
            too_small[population.schedule] = fitted
        else:
            reason = f"{fitted} touchdowns to fit, {wanted}"
            notes.append({"what": f"affine ({population.name})", "reason": reason})
    of_classes = rare_notes("affine models", too_small, f"left to fit: {wanted}")
    return kept, of_classes + notes


def common_split(
    populations: list[Population], train: int, test: int
) -> tuple[tuple[int, int], Notes]:
    """Return the split of the smallest population, which all models use."""
    if not populations:
        return (train, test), []
    smallest = min(populations, key=lambda population: len(population.rows))
    sizes = split_sizes(len(smallest.rows), train, test)
    if sizes == (train, test):
        return sizes, []
    done = f"All models were trained on {sizes[0]} and tested on {sizes[1]} touchdowns"
    what = f"{done} instead of {train} and {test}"
    return sizes, [{"what": what, "reason": _fewest(smallest)}]


def _fewest(smallest: Population) -> str:
    """Return words for the population whose size limits the splits."""
    size = len(smallest.rows)
    if smallest.kind == "class":
        rarest = f"the rarest order with a model of its own, {smallest.schedule}"
        return f"{rarest}, has only {size}"
    if smallest.kind == "all":
        return f"there are only {size} touchdowns"
    return f"there are only {size} {smallest.kind} touchdowns"


#: Models in the order of Fig. 2.4 -> the kind of population that each draws from.
MODELS = {
    "specialised": "class",
    "near": "near",
    "all": "all",
    "far": "far",
    "specialised_mean": "class",
    "mean": "all",
}

#: Those that predict the mean of the training set; the others are affine maps.
MEAN_PREDICTORS = ("specialised_mean", "mean")


#: How landings are drawn to fit and to test: each once; with replacement, from two
#: parts of the population (the reading of the printed text in which a bootstrap stays a
#: bootstrap and a split a split); with replacement, from the whole population, so that
#: some landings are fitted and tested.
DRAWS = {
    "distinct": distinct_draws,
    "resampled": resampled_draws,
    "resampled_together": draws_together,
}


@dataclass(frozen=True)
class PredictionStudy:
    """Results of the bootstrap.

    Attributes
    ----------
    errors
        One row per model, schedule and bootstrap: ``model, schedule, bootstrap,
        n_train, n_test``; ``mse, mse_position, mse_velocity`` in squared normalised
        units; and ``worst_position_mm, worst_velocity_m_s``, the largest rms error of
        any one coordinate.
    summary
        One row per model: see `summarise_errors`.
    notes
        Steps that were omitted or changed, each ``{"what": ..., "reason": ...}``.
    """

    errors: pd.DataFrame
    summary: pd.DataFrame
    notes: Notes


@one_blas_thread()
def bootstrap_prediction(  # noqa: PLR0913 - the data, and the method's options
    x: FloatArray,
    y: FloatArray,
    schedule: ArrayLike,
    spread: ArrayLike,
    *,
    seed: int,
    length_unit_m: float = 1.0,
    time_unit_s: float = 1.0,
    bootstraps: int = 1000,
    train: int = 120,
    test: int = 41,
    minimum_class: int = 40,
    draws: str = "distinct",
) -> PredictionStudy:
    """Bootstrap the test errors of the six models.

    Parameters
    ----------
    x, y
        (n, 6B) normalised pairs: 3B positions, then 3B velocities.
    schedule
        (n,) mode schedules; a landing without one (empty) joins no class.
    spread
        (n,) sd of the contact instants, s; a landing without one (NaN) is neither near
        nor far.
    seed
        Seed of the study. Each class and each of near, all and far has its own stream.
    length_unit_m, time_unit_s
        Units of `x` and `y`, for the errors in mm and m/s.
    bootstraps
        Number of splits per model (and schedule).
    train, test
        Numbers of landings to fit and to test in a split of full size.
    minimum_class
        Classes with fewer landings get no specialised model.
    draws
        ``"distinct"`` (no landing twice), ``"resampled"`` (with replacement, no landing
        on both sides) or ``"resampled_together"`` (with replacement from all).

    Raises
    ------
    ConfigError
        If `draws` is not one of `DRAWS`, or a number of splits or landings is below 1.
    ValueError
        If the arrays do not match or hold values that are not finite.

    Notes
    -----
    An affine map is fitted only if the training set is large enough (see
    `needed_training`); otherwise it is left out and noted. Too few landings never raise
    an error: the result may be an empty table with notes.
    """
    draw = chosen("prediction.draws", draws, DRAWS)
    counts = {"bootstraps": bootstraps, "train": train, "test": test}
    for name, count in counts.items():
        fits = isinstance(count, Integral) and count >= 1
        require(fits, f"prediction.{name}", "a whole number, 1 or more", count)
    x, y = checked(x, y, schedule, spread)
    populations, notes = select_populations(
        np.asarray(schedule, str), np.asarray(spread, float), minimum_class
    )
    needed = needed_training(x)
    populations, too_small = large_enough(populations, train, test, needed)
    sizes = (train, test)
    scaled_down: Notes = []
    if draws == "distinct":
        # With replacement, landings need not be as many as are drawn.
        sizes, scaled_down = common_split(populations, train, test)
    notes = [*notes, *too_small, *scaled_down]

    affordable = [model for model in MODELS if sizes[0] >= needed or model == "mean"]
    units = (length_unit_m, length_unit_m / time_unit_s)
    tables: dict[str, list[pd.DataFrame]] = {model: [] for model in MODELS}
    for population in populations:
        generator = named_generator(seed, "prediction", population.stream)
        fitted, tested = draw(generator, len(population.rows), sizes, bootstraps)
        inputs = x[population.rows]
        outputs = y[population.rows]
        for model in affordable:
            if MODELS[model] != population.kind:
                continue
            if model in MEAN_PREDICTORS:
                errors = mean_test_errors(outputs, fitted, tested)
            else:
                errors = affine_test_errors(inputs, outputs, fitted, tested)
            table = _rows(model, population, errors, sizes, units)
            tables[model].append(table)

    in_order = [table for of_model in tables.values() for table in of_model]
    if not in_order:
        in_order = [pd.DataFrame(columns=list(_COLUMNS))]
    whole = pd.concat(in_order, ignore_index=True)
    return PredictionStudy(whole, summarise_errors(whole), notes)


def summarise_errors(errors: pd.DataFrame) -> pd.DataFrame:
    """Summarise the bootstraps of each model, classes pooled.

    Returns
    -------
    DataFrame
        ``model, n_classes, n_train, n_test``; the median and quantiles of the mean
        squared error (``median_mse, q25, q75, p2_5, p97_5``); ``worst_position_mm,
        worst_velocity_m_s``, the 97.5 % quantile over the splits of the rms error of
        the worst coordinate; and the median and 95 % interval of the errors in position
        and in velocity alone (``position_median, position_p2_5, position_p97_5``, and
        the same for ``velocity``).
    """
    rows = []
    fitted = set(errors["model"])
    for model in MODELS:
        if model not in fitted:
            continue
        part = errors[errors["model"] == model]
        mse = np.quantile(part["mse"], [0.5, 0.25, 0.75, 0.025, 0.975])
        row = {
            "model": model,
            "n_classes": part["schedule"].nunique(),
            "n_train": part["n_train"].iloc[0],
            "n_test": part["n_test"].iloc[0],
        }
        row |= dict(
            zip(("median_mse", "q25", "q75", "p2_5", "p97_5"), mse, strict=True)
        )
        for column in _WORST:
            row[column] = np.quantile(part[column], 0.975)
        for kind in _PARTS:
            of_part = np.quantile(part[f"mse_{kind}"], [0.5, 0.025, 0.975])
            for level, value in zip(_LEVELS, of_part, strict=True):
                row[f"{kind}_{level}"] = value
        rows.append(row)
    return pd.DataFrame(rows, columns=[*_SUMMARY_COLUMNS, *_WORST, *_PART_COLUMNS])


def error_ratios(summary: pd.DataFrame, touchdowns: pd.DataFrame) -> dict[str, float]:
    """Return the comparisons of the models' errors that Fig. 2.4 shows.

    Parameters
    ----------
    summary
        Table from `summarise_errors`; a missing model gives NaN.
    touchdowns
        The study's table of touchdowns.

    Returns
    -------
    dict
        Median contact spread of the touchdowns used, ``spread_ms``; median errors,
        relative to the variance, of the models ``near, all, far, specialised``; the
        ratios ``specialised_over_mean`` and ``all_over_specialised``; and the
        specialised models' ``worst_position_mm`` and ``worst_velocity_m_s``.
    """
    rows = summary.set_index("model").reindex(list(MODELS))
    median = dict(zip(MODELS, rows["median_mse"].to_numpy(float), strict=True))
    worst_position, worst_velocity = rows.loc[["specialised"], list(_WORST)].to_numpy(
        float
    )[0]
    is_used = ~touchdowns["excluded"].astype(bool)
    spread_s = float(touchdowns.loc[is_used, "spread_s"].median())
    return {
        "spread_ms": 1e3 * spread_s,
        "near": median["near"],
        "all": median["all"],
        "far": median["far"],
        "specialised": median["specialised"],
        "specialised_over_mean": median["specialised"] / median["specialised_mean"],
        "all_over_specialised": median["all"] / median["specialised"],
        "worst_position_mm": worst_position,
        "worst_velocity_m_s": worst_velocity,
    }


_WORST = ("worst_position_mm", "worst_velocity_m_s")
_SIZES = ("n_train", "n_test")
_SUMMARY_COLUMNS = (
    "model",
    "n_classes",
    *_SIZES,
    "median_mse",
    "q25",
    "q75",
    "p2_5",
    "p97_5",
)
_PARTS = ("position", "velocity")
_LEVELS = ("median", "p2_5", "p97_5")
_PART_COLUMNS = [f"{part}_{level}" for part in _PARTS for level in _LEVELS]
_ERRORS = ("mse", "mse_position", "mse_velocity", *_WORST)
_COLUMNS = ("model", "schedule", "bootstrap", *_SIZES, *_ERRORS)


def _rows(
    model: str,
    population: Population,
    errors: FloatArray,
    sizes: tuple[int, int],
    units: tuple[float, float],
) -> pd.DataFrame:
    """Return the table of one model and population, given its (R, 6B) squared errors.

    `units` are those of length, m, and of velocity, m/s.
    """
    length_unit, velocity_unit = units
    position, velocity = np.split(errors, 2, axis=1)
    n_train, n_test = sizes
    columns = {
        "model": model,
        "schedule": population.schedule,
        "bootstrap": np.arange(1, len(errors) + 1),
        "n_train": n_train,
        "n_test": n_test,
        "mse": errors.mean(axis=1),
        "mse_position": position.mean(axis=1),
        "mse_velocity": velocity.mean(axis=1),
        "worst_position_mm": 1e3 * length_unit * np.sqrt(position.max(axis=1)),
        "worst_velocity_m_s": velocity_unit * np.sqrt(velocity.max(axis=1)),
    }
    return pd.DataFrame(columns)
