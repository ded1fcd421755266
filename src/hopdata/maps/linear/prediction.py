"""Bootstrapped prediction errors of the six models of Fig. 2.4.

Affine maps and mean predictors of the state at the post section from the state at the pre
section, "specialised" to one mode schedule or not, and "near" to or "far" from the trajectory
on which all feet touch at once (Sec. 2.3 of the dissertation: contact spread below or above the
median of the data set).

A bootstrap here is a random split: 161 distinct landings are drawn from those that a model may
use, 120 to fit and the other 41 to test. Nothing is drawn twice, since a landing on both sides
of a split would flatter the fit. Where a model has fewer than 161 landings, both numbers shrink
in proportion, and they shrink for every model of the study, so that all are compared at one
sample size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.blas import one_blas_thread
from hopdata.maps.draws import distinct_draws, named_generator
from hopdata.maps.linear.affine import affine_test_errors, mean_test_errors
from hopdata.maps.linear.populations import (
    Notes,
    Population,
    common_split,
    large_enough,
    needed_training,
    select_populations,
)

if TYPE_CHECKING:
    import pandas as pd

#: Models in the order of Fig. 2.4, and the landings each draws from.
MODELS = {
    "specialised": "class",
    "near": "near",
    "all": "all",
    "far": "far",
    "specialised_mean": "class",
    "mean": "all",
}

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PredictionStudy:
    """What the bootstrap gave.

    Attributes
    ----------
    errors
        One row per model, schedule and bootstrap: ``model, schedule, bootstrap, n_train,
        n_test, mse, mse_position, mse_velocity`` in squared normalised units, and
        ``worst_position_mm, worst_velocity_m_s``, the largest rms error of any one coordinate.
    summary
        One row per model: see `summarise_errors`.
    notes
        What could not be done or was done otherwise, each ``{"what": ..., "reason": ...}``.
    """

    errors: pd.DataFrame
    summary: pd.DataFrame
    notes: Notes


@one_blas_thread()
def bootstrap_prediction(
    x: Floats,
    y: Floats,
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
) -> PredictionStudy:
    """Bootstrap the test errors of the six models.

    Parameters
    ----------
    x, y
        (n, 6B) normalised pairs: 3B positions, then 3B velocities.
    schedule
        (n,) mode schedules; a landing without one (empty) joins no class.
    spread
        (n,) sd of the contact instants in s; a landing without one (NaN) is neither near nor far.
    seed
        Seed of the study. Each class, and near, all and far, has its own stream.
    length_unit_m, time_unit_s
        Units of `x` and `y`, for the errors in mm and m/s.
    bootstraps
        Number of splits per model (and schedule).
    train, test
        Landings to fit and to test in a split of full size.
    minimum_class
        Classes with fewer landings are left out of the specialised models.

    Notes
    -----
    An affine map is fitted only where the training set is large enough for it (see
    `.populations.needed_training`); otherwise it is noted and left out. Few landings
    never raise: an empty table with its notes is a result too.
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    populations, notes = select_populations(
        np.asarray(schedule, str), np.asarray(spread, float), minimum_class
    )
    needed = needed_training(x)
    populations, more = large_enough(populations, train, test, needed)
    sizes, scaled = common_split(populations, train, test)
    notes += more + scaled
    frames = []
    for population in populations:
        generator = named_generator(seed, "prediction", population.name)
        splits = distinct_draws(generator, len(population.rows), sizes, bootstraps)
        inputs, outputs = x[population.rows], y[population.rows]
        for model in _models_of(population, sizes[0], needed):
            if model in ("specialised_mean", "mean"):
                errors = mean_test_errors(outputs, *splits)
            else:
                errors = affine_test_errors(inputs, outputs, *splits)
            frames.append(_rows(model, population, errors, sizes, length_unit_m, time_unit_s))
    table = _table(frames)
    return PredictionStudy(table, summarise_errors(table), notes)


def summarise_errors(errors: pd.DataFrame) -> pd.DataFrame:
    """Summarise the bootstraps of each model, classes pooled.

    Returns
    -------
    DataFrame
        ``model, n_classes, n_train, n_test``, the median and quantiles of ``mse`` (``median,
        q25, q75, p2_5, p97_5``), ``worst_position_mm, worst_velocity_m_s``: the level that
        97.5 % of the splits keep below with the rms error of their worst coordinate, and median
        and 95 % interval of the errors in position and in velocity alone (``position_median,
        position_p2_5, position_p97_5``, and of ``velocity``).
    """
    import pandas as pd

    rows = []
    for model in [name for name in MODELS if name in set(errors["model"])]:
        part = errors[errors["model"] == model]
        mse = np.quantile(part["mse"], [0.5, 0.25, 0.75, 0.025, 0.975])
        worst = [np.quantile(part[column], 0.975) for column in _WORST]
        parts = [
            np.quantile(part[f"mse_{kind}"], [0.5, 0.025, 0.975])
            for kind in ("position", "velocity")
        ]
        sizes = part["n_train"].iloc[0], part["n_test"].iloc[0]
        rows.append((model, part["schedule"].nunique(), *sizes, *mse, *worst, *np.ravel(parts)))
    return pd.DataFrame(rows, columns=[*_SUMMARY_COLUMNS, *_WORST, *_PART_COLUMNS])


def error_ratios(summary: pd.DataFrame, touchdowns: pd.DataFrame) -> dict[str, float]:
    """Return what Fig. 2.4 is read for: how the models' errors compare.

    Parameters
    ----------
    summary
        As from `summarise_errors`; a model that it lacks gives NaN.
    touchdowns
        The study's table of touchdowns.

    Returns
    -------
    dict
        Median contact spread of the touchdowns used, ``spread_ms``; median errors, relative to the
        variance, of the models ``near, all, far, specialised``; the ratios
        ``specialised_over_mean`` and ``all_over_specialised``; and the specialised models'
        ``worst_position_mm`` and ``worst_velocity_m_s``.
    """
    rows = summary.set_index("model").reindex(list(MODELS))
    median = dict(zip(MODELS, rows["median"].to_numpy(float), strict=True))
    own = rows.loc[["specialised"], list(_WORST)].to_numpy(float)[0]
    used = touchdowns.loc[~touchdowns["excluded"].astype(bool), "spread_s"]
    return {
        "spread_ms": 1e3 * float(used.median()),
        **{name: median[name] for name in ("near", "all", "far", "specialised")},
        "specialised_over_mean": median["specialised"] / median["specialised_mean"],
        "all_over_specialised": median["all"] / median["specialised"],
        **dict(zip(_WORST, own, strict=True)),
    }


_WORST = ("worst_position_mm", "worst_velocity_m_s")
_SUMMARY_COLUMNS = (
    *("model", "n_classes", "n_train", "n_test"),
    *("median", "q25", "q75", "p2_5", "p97_5"),
)
_PART_COLUMNS = (
    *("position_median", "position_p2_5", "position_p97_5"),
    *("velocity_median", "velocity_p2_5", "velocity_p97_5"),
)
_COLUMNS = (
    *("model", "schedule", "bootstrap", "n_train", "n_test"),
    *("mse", "mse_position", "mse_velocity", *_WORST),
)


def _models_of(population: Population, fitted: int, needed: int) -> Iterator[str]:
    for model, kind in MODELS.items():
        if kind == population.kind and (fitted >= needed or model == "mean"):
            yield model


def _rows(
    model: str,
    population: Population,
    errors: Floats,
    sizes: tuple[int, int],
    length_unit_m: float,
    time_unit_s: float,
) -> pd.DataFrame:
    """Return the table of one model and population from its (R, 6B) squared errors."""
    import pandas as pd

    half = errors.shape[1] // 2
    position, velocity = errors[:, :half], errors[:, half:]
    worst_position = 1e3 * length_unit_m * np.sqrt(position.max(axis=1))
    worst_velocity = length_unit_m / time_unit_s * np.sqrt(velocity.max(axis=1))
    values = (
        model,
        population.schedule,
        np.arange(len(errors)),
        *sizes,
        errors.mean(axis=1),
        position.mean(axis=1),
        velocity.mean(axis=1),
        worst_position,
        worst_velocity,
    )
    return pd.DataFrame(dict(zip(_COLUMNS, values, strict=True)))


def _table(frames: list[pd.DataFrame]) -> pd.DataFrame:
    """Concatenate in the order of Fig. 2.4."""
    import pandas as pd

    if not frames:
        return pd.DataFrame(columns=list(_COLUMNS))
    order = list(MODELS)
    frames = sorted(frames, key=lambda frame: order.index(frame["model"].iloc[0]))
    return pd.concat(frames, ignore_index=True)
