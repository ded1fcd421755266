"""How close linear maps fitted to landings come to the exact ones, and how good their data are.

Landings are those of a simulated study, as measured and as they truly were. Maps take the eight
coordinates of the body at the pre section to eleven at the post section (`hopdata.maps.rigid`), in
the axes of the true body. Errors are relative differences of predictions for the study's inputs
(`hopdata.maps.map_differences`), outputs as displacements of the markers
in the study's unit of time, as the errors of Fig. 2.4 are.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import AnalysisError
from hopdata.maps.entries import Entries, entry
from hopdata.maps.map_differences import input_root, relative_difference
from hopdata.maps.matching import match_landings
from hopdata.maps.rigid import output_weights, rigid_states, section_coordinates, split_states

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Coordinates = tuple[Floats, Floats]

SIZES = (30, 60, 120, 240, 480, 960, 1920)
DRAWS = 200
SOURCES = {"noise_free": "without noise", "measured": "as measured"}
MODELS = {"pooled": "one map for all schedules", "specialised": "a map of one schedule"}


def true_rows(
    pairs: Any, table: pd.DataFrame, true: Any, contacts: Mapping[str, Floats], feet: Sequence[str]
) -> Integers:
    """Return the row of `true` that each row of `pairs` is, (n,), -1 where there is none.

    Parameters
    ----------
    pairs, true
        Measured and true `Pairs`; the index of the latter is the number of the landing.
    table
        The study's touchdowns.
    contacts
        Recording -> true contact instants (L, feet), s.
    feet
        Names of the feet, in the order of the truth.
    """
    keyed = table.set_index(["recording", "index"])[[f"contact_{foot}_s" for foot in feet]]
    keys = list(zip(pairs.recording.tolist(), pairs.index.tolist(), strict=True))
    found = keyed.loc[keys].to_numpy(float)
    places = {
        key: row
        for row, key in enumerate(zip(true.recording.tolist(), true.index.tolist(), strict=True))
    }
    rows = np.full(len(found), -1)
    for name, instants in contacts.items():
        mine = np.flatnonzero(pairs.recording == name)
        landing = match_landings(found[mine], instants)
        rows[mine] = [places.get((name, int(number)), -1) for number in landing]
    return rows


def state_errors(pairs: Any, true: Any, rows: Integers) -> pd.DataFrame:
    """Return the errors of the states at the sections.

    Each touchdown's home frame is where it lies best on the true states, at both sections at once:
    a shift in the plane and a turn about the vertical.

    Returns
    -------
    DataFrame
        Columns section (``pre``, ``post``), landings, position_rms_mm, velocity_rms_mm_s; per
        coordinate of a marker.
    """
    import pandas as pd

    known = np.flatnonzero(rows >= 0)
    mine = [split_states(states[known]) for states in (pairs.x, pairs.y)]
    truly = [split_states(states[rows[known]]) for states in (true.x, true.y)]
    turn = _plane_turns(
        np.concatenate([state[0] for state in truly], axis=1),
        np.concatenate([state[0] for state in mine], axis=1),
    )
    offset = np.zeros((len(known), 1, 3))
    both = [(m[0] - t[0] @ turn)[..., :2] for m, t in zip(mine, truly, strict=True)]
    offset[..., :2] = np.concatenate(both, axis=1).mean(axis=1, keepdims=True)
    table = []
    for section, measured, known_state in zip(("pre", "post"), mine, truly, strict=True):
        position = measured[0] - known_state[0] @ turn - offset
        velocity = measured[1] - known_state[1] @ turn
        table.append((section, len(known), 1e3 * _rms(position), 1e3 * _rms(velocity)))
    columns = ["section", "landings", "position_rms_mm", "velocity_rms_mm_s"]
    return pd.DataFrame(table, columns=columns)


def _plane_turns(source: Floats, target: Floats) -> Floats:
    """Return the turns (n, 3, 3), for rows on the left, that bring points (n, k, 3) to others."""
    a, b = (p[..., :2] - p[..., :2].mean(axis=1, keepdims=True) for p in (source, target))
    along = (a * b).sum(axis=(1, 2))
    across = (a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]).sum(axis=1)
    length = np.hypot(along, across)
    turn = np.tile(np.eye(3), (len(a), 1, 1))
    turn[:, 0, 0] = turn[:, 1, 1] = along / length
    turn[:, 0, 1], turn[:, 1, 0] = across / length, -across / length
    return turn


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


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
        See `true_rows`.
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
    points = np.array(exact["body_points_m"])
    shape = points - points.mean(axis=0)
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
    """Yield random landings and the exact map; all of them for no size."""
    for rows, target in classes:
        if size is None:
            if len(rows) >= SIZES[0]:
                yield rows, target
        elif size < len(rows):
            for _ in range(-(-DRAWS // len(classes))):
                yield rng.choice(rows, size, replace=False), target


def _slopes(sample: Coordinates, rows: Integers) -> Floats:
    """Return the linear part (q, p) of an affine map by least squares."""
    x, y = sample[0][rows], sample[1][rows]
    centred = x - x.mean(axis=0)
    spread = centred.std(axis=0)
    slopes: Floats = np.linalg.lstsq(centred / spread, y - y.mean(axis=0), rcond=None)[0]
    return (slopes / spread[:, None]).T


def score_maps(errors: pd.DataFrame, states: pd.DataFrame) -> Entries:
    """Say how good the states at the sections are, and maps of 120 and of all landings."""
    entries: Entries = {}
    for row in states.to_dict("records"):
        section = row["section"]
        entries[f"position_rms_{section}"] = entry(
            row["position_rms_mm"],
            "mm",
            f"Rms error of the marker positions at the {section} section, per coordinate",
        )
        entries[f"velocity_rms_{section}"] = entry(
            row["velocity_rms_mm_s"],
            "mm/s",
            f"Rms error of the marker velocities at the {section} section, per coordinate",
        )
    for (source, model), rows in errors.groupby(["source", "model"], sort=False):
        for name, row in _shown(rows):
            entries[f"map_error_{source}_{model}_{name}"] = entry(
                float(row["median"]),
                "1",
                f"Median relative error of OLS against the exact map: {MODELS[str(model)]}, "
                f"{row['landings']} landings, {SOURCES[str(source)]}",
            )
    return entries


def _shown(rows: pd.DataFrame) -> Iterator[tuple[str, Any]]:
    some = rows[rows["landings"] == 120]
    if len(some):
        yield "120", some.iloc[0]
    yield "all", rows.iloc[-1]
