"""How close linear maps fitted to landings come to the exact ones.

Landings are those of a simulated study, as measured and as they truly were. Maps take the eight
coordinates of the body at the pre section to eleven at the post section (`hopdata.maps.rigid`), in
the axes of the true body. Errors are relative differences of predictions for the study's inputs
(`hopdata.maps.truth.map_differences`), outputs as displacements of the markers
in the study's unit of time, as the errors of Fig. 2.4 are.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hopdata.blas import one_blas_thread
from hopdata.errors import AnalysisError
from hopdata.maps.rigid import (
    output_weights,
    rigid_states,
    section_coordinates,
)
from hopdata.maps.truth.entries import Entries, entry
from hopdata.maps.truth.map_differences import input_root, relative_difference

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Coordinates = tuple[Floats, Floats]

SIZES = (30, 60, 120, 240, 480, 960, 1920)
DRAWS = 200
SOURCES = {"noise_free": "without noise", "measured": "as measured"}
MODELS = {"pooled": "one map for all schedules", "specialised": "a map of one schedule"}


@one_blas_thread()
def map_error_table(
    pairs: Any,
    true: Any,
    rows: Integers,
    exact: Mapping[str, Any],
    *,
    time_unit_s: float,
    seed: int,
) -> pd.DataFrame:
    """Fit ordinary least squares to random landings, and compare with the exact maps.

    A map for all schedules is compared with the mean of the exact ones, a map of one schedule (as
    it truly was) with that schedule's.

    Parameters
    ----------
    pairs, true, rows
        See `hopdata.maps.truth.state_errors.true_rows`.
    exact
        Content of ``exact_maps.json``.
    time_unit_s
        Unit of time that weighs velocities against positions, s.
    seed
        Of the draws.

    Returns
    -------
    DataFrame
        Columns source, model, landings, draws, median, q05, q95. The row of most landings has all
        of them: one draw, or one a schedule.

    Raises
    ------
    AnalysisError
        If no touchdown has a true landing.
    """
    import pandas as pd

    known = np.flatnonzero(rows >= 0)
    if not len(known):
        raise AnalysisError("map errors: expected touchdowns with a true landing, found none")
    shape = _shape(exact)
    samples = {
        "noise_free": _coordinates(true.x[rows[known]], true.y[rows[known]], shape),
        "measured": _coordinates(pairs.x[known], pairs.y[known], shape),
    }
    schedule = true.schedule[rows[known]]
    root = input_root(samples["noise_free"][0])
    units = 1 / output_weights(shape, time_unit_s)
    streams = iter(np.random.SeedSequence(seed).spawn(len(MODELS) * (len(SIZES) + 1)))
    table = []
    for model, classes in _classes(schedule, exact).items():
        for size in (*SIZES, None):
            rng = np.random.default_rng(next(streams))
            draws = list(_draws(classes, size, rng))
            for source, sample in samples.items() if draws else ():
                errors = [
                    relative_difference(_slopes(sample, chosen), target, root=root, units=units)
                    for chosen, target in draws
                ]
                count = round(float(np.mean([len(chosen) for chosen, _ in draws])))
                quantiles = np.quantile(errors, (0.5, 0.05, 0.95))
                table.append((source, model, count, len(draws), *quantiles))
    columns = ["source", "model", "landings", "draws", "median", "q05", "q95"]
    return pd.DataFrame(table, columns=columns)


def _shape(exact: Mapping[str, Any]) -> Floats:
    """Return the body markers about their mean, body frame, (B, 3), m."""
    points = np.array(exact["body_points_m"])
    shape: Floats = points - points.mean(axis=0)
    return shape


def _coordinates(x: Floats, y: Floats, shape: Floats) -> Coordinates:
    return section_coordinates(rigid_states(x, shape), rigid_states(y, shape))


def _classes(
    schedule: NDArray[np.str_], exact: Mapping[str, Any]
) -> dict[str, list[tuple[Integers, Floats]]]:
    """Return the landings that each model may draw from, with the map that it estimates."""
    maps = np.array(exact["maps"])
    own = [
        (np.flatnonzero(schedule == name), target)
        for name, target in zip(exact["schedules"], maps, strict=True)
    ]
    return {"pooled": [(np.arange(len(schedule)), maps.mean(axis=0))], "specialised": own}


def _draws(
    classes: list[tuple[Integers, Floats]], size: int | None, rng: np.random.Generator
) -> Iterator[tuple[Integers, Floats]]:
    """Yield random landings and the exact map; all landings for no size.

    Classes of fewer landings than the smallest size play no part; of the others all or none.
    """
    classes = [one for one in classes if len(one[0]) >= SIZES[0]]
    if size is None:
        yield from classes
    elif all(size < len(rows) for rows, _ in classes):
        for rows, target in classes:
            for _ in range(-(-DRAWS // len(classes))):
                yield rng.choice(rows, size, replace=False), target


def _slopes(sample: Coordinates, rows: Integers) -> Floats:
    """Return the linear part (q, p) of an affine map by least squares."""
    x, y = sample[0][rows], sample[1][rows]
    centred = x - x.mean(axis=0)
    spread = centred.std(axis=0)
    slopes: Floats = np.linalg.lstsq(centred / spread, y - y.mean(axis=0), rcond=None)[0]
    return (slopes / spread[:, None]).T


def score_maps(errors: pd.DataFrame) -> Entries:
    """Say how good maps of 120 and of all landings are."""
    entries: Entries = {}
    for (source, model), rows in errors.groupby(["source", "model"], sort=False):
        for name, row in _shown(rows):
            entries[f"map_error_{source}_{model}_{name}"] = entry(
                float(row["median"]),
                "1",
                "Median relative error of least squares against the exact map: "
                f"{MODELS[str(model)]}, {row['landings']} landings, {SOURCES[str(source)]}",
            )
    return entries


def _shown(rows: pd.DataFrame) -> Iterator[tuple[str, Any]]:
    some = rows[rows["landings"] == 120]
    if len(some):
        yield "120", some.iloc[0]
    yield "all", rows.iloc[-1]
